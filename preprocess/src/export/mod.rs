//! Volumes written out again, in the source's type, streamed slice by slice: one file a format.

mod nifti;
mod nrrd;
mod tiff;

use crate::convert::check_place;
use crate::disk::check_room;
use crate::error::PreprocessError;
use crate::progress::Progress;
use crate::volume::Volume;
use flate2::Compression;
use flate2::write::GzEncoder;
use octree_store::{Sample, with_sample_type};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use tempfile::NamedTempFile;

/// What a file name's ending asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFormat {
    /// Samples alone, little-endian.
    Raw,
    /// NIfTI-1, or NIfTI-2 where a dimension is too large for it.
    Nifti,
    /// The same, gzip-compressed.
    NiftiGz,
    /// NRRD, header and samples in one file, raw.
    Nrrd,
    /// TIFF, a page for each slice, with ImageJ's metadata; BigTIFF where it is too large for TIFF.
    Tiff,
}

impl ExportFormat {
    /// The format of a file name, if its ending is known.
    pub fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        let endings = [
            (".raw", Self::Raw),
            (".nii", Self::Nifti),
            (".nii.gz", Self::NiftiGz),
            (".nrrd", Self::Nrrd),
            (".tif", Self::Tiff),
            (".tiff", Self::Tiff),
        ];
        endings.into_iter().find_map(|(end, format)| name.ends_with(end).then_some(format))
    }
}

/// Writes a volume to `output`, which appears when it is whole; `progress` hears of each slice.
///
/// # Errors
/// When the disk has no room for it, the volume cannot be read, the format cannot hold it, the output exists and `force` is not
/// set, or cannot be written, or `progress` asks to stop. Nothing is left then.
pub fn export(
    volume: &Volume,
    output: &Path,
    format: ExportFormat,
    force: bool,
    progress: &dyn Progress,
) -> Result<(), PreprocessError> {
    let inputs = match volume {
        Volume::Source(source) => source.files.as_slice(),
        Volume::Store { .. } => &[],
    };
    check_place(output, inputs)?;
    if output.exists() && !(output.is_file() && force) {
        return Err(PreprocessError::Exists { path: output.to_owned() });
    }
    let voxel_bytes = volume.sample_type().bytes() as u64;
    let bytes = volume.dims_xyz().iter().fold(voxel_bytes, |n, &dim| n.saturating_mul(dim));
    match format {
        ExportFormat::Raw | ExportFormat::Nifti | ExportFormat::Nrrd | ExportFormat::Tiff => {
            check_room(output, bytes)?;
        }
        // How small it becomes is not known.
        ExportFormat::NiftiGz => {}
    }
    let failed = |source: io::Error| PreprocessError::Output { path: output.to_owned(), source };
    let file = tempfile::Builder::new()
        .prefix(".octavo-")
        .permissions(std::fs::Permissions::from_mode(0o666))
        .tempfile_in(super::convert::folder_of(output))
        .map_err(failed)?;
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    match format {
        ExportFormat::Raw => write_voxels(volume, &mut writer, output, progress)?,
        ExportFormat::Nifti => {
            writer.write_all(&nifti::header(volume, output)?).map_err(failed)?;
            write_voxels(volume, &mut writer, output, progress)?;
        }
        ExportFormat::NiftiGz => {
            let mut gzip = GzEncoder::new(&mut writer, Compression::fast());
            gzip.write_all(&nifti::header(volume, output)?).map_err(failed)?;
            write_voxels(volume, &mut gzip, output, progress)?;
            gzip.finish().map_err(failed)?;
        }
        ExportFormat::Nrrd => {
            writer.write_all(nrrd::header(volume).as_bytes()).map_err(failed)?;
            write_voxels(volume, &mut writer, output, progress)?;
        }
        ExportFormat::Tiff => {
            let pages = tiff::Pages::of(volume, output)?;
            writer.write_all(&pages.before_samples()).map_err(failed)?;
            write_voxels(volume, &mut writer, output, progress)?;
            pages.write_after_samples(&mut writer).map_err(failed)?;
        }
    }
    let file = writer.into_inner().map_err(|error| failed(error.into_error()))?;
    persist(file, output).map_err(failed)
}

/// Makes a finished file durable and gives it its name.
///
/// # Errors
/// When the system refuses.
pub fn persist(file: NamedTempFile, output: &Path) -> io::Result<()> {
    file.as_file().sync_all()?;
    file.persist(output)?;
    Ok(())
}

fn write_voxels(
    volume: &Volume,
    writer: &mut impl Write,
    output: &Path,
    progress: &dyn Progress,
) -> Result<(), PreprocessError> {
    with_sample_type!(volume.sample_type(), T => write_samples::<T>(volume, writer, output, progress))
}

fn write_samples<T: Sample>(
    volume: &Volume,
    writer: &mut impl Write,
    output: &Path,
    progress: &dyn Progress,
) -> Result<(), PreprocessError> {
    let [width, height, depth] = volume.dims_xyz();
    let mut slice = vec![T::default(); (width * height) as usize];
    let mut slices = volume.slices::<T>()?;
    let mut bytes = Vec::with_capacity(size_of_val(slice.as_slice()));
    for _ in 0..depth {
        if progress.should_stop() {
            return Err(PreprocessError::Cancelled);
        }
        slices.next(&mut slice)?;
        progress.bricks_done(1);
        bytes.clear();
        for sample in &slice {
            bytes.extend_from_slice(sample.to_le_array().as_ref());
        }
        writer
            .write_all(&bytes)
            .map_err(|source| PreprocessError::Output { path: output.to_owned(), source })?;
    }
    Ok(())
}
