//! Volumes written out again: raw and NIfTI, in the source's type, streamed slice by slice.

use crate::disk::check_room;
use crate::error::PreprocessError;
use crate::progress::Progress;
use crate::source::SourceError;
use crate::source::nifti_header::{NiftiDatatype, NiftiHeader, NiftiUnit};
use crate::volume::Volume;
use flate2::Compression;
use flate2::write::GzEncoder;
use octree_store::{LengthUnit, Sample, SampleType, with_sample_type};
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
}

impl ExportFormat {
    /// The format of a file name, if its ending is known.
    pub fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_lowercase();
        [(".raw", Self::Raw), (".nii", Self::Nifti), (".nii.gz", Self::NiftiGz)]
            .into_iter()
            .find_map(|(end, format)| name.ends_with(end).then_some(format))
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
    if output.exists() && !(output.is_file() && force) {
        return Err(PreprocessError::Exists { path: output.to_owned() });
    }
    let voxel_bytes = volume.sample_type().bytes() as u64;
    let bytes = volume.dims_xyz().iter().fold(voxel_bytes, |n, &dim| n.saturating_mul(dim));
    match format {
        ExportFormat::Raw | ExportFormat::Nifti => check_room(output, bytes)?,
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
            writer.write_all(&nifti_header(volume, output)?).map_err(failed)?;
            write_voxels(volume, &mut writer, output, progress)?;
        }
        ExportFormat::NiftiGz => {
            let mut gzip = GzEncoder::new(&mut writer, Compression::fast());
            gzip.write_all(&nifti_header(volume, output)?).map_err(failed)?;
            write_voxels(volume, &mut gzip, output, progress)?;
            gzip.finish().map_err(failed)?;
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

/// The header of a volume: little-endian, 352 or 544 bytes.
fn nifti_header(volume: &Volume, output: &Path) -> Result<Vec<u8>, PreprocessError> {
    let datatype = match volume.sample_type() {
        SampleType::U8 => NiftiDatatype::U8,
        SampleType::I8 => NiftiDatatype::I8,
        SampleType::U16 => NiftiDatatype::U16,
        SampleType::I16 => NiftiDatatype::I16,
        SampleType::U32 => NiftiDatatype::U32,
        SampleType::I32 => NiftiDatatype::I32,
        SampleType::F32 => NiftiDatatype::F32,
        SampleType::F64 => NiftiDatatype::F64,
    };
    // NIfTI has no nanometre: spacing and affine go to micrometres.
    let (unit, scale) = match volume.unit() {
        LengthUnit::M => (NiftiUnit::Metre, 1.0),
        LengthUnit::Mm => (NiftiUnit::Millimetre, 1.0),
        LengthUnit::Um => (NiftiUnit::Micrometre, 1.0),
        LengthUnit::Nm => (NiftiUnit::Micrometre, 1e-3),
    };
    let spacing = volume.spacing_xyz().map(|spacing| spacing * scale);
    let affine = volume.affine().map(|mut affine| {
        affine.iter_mut().take(3).flatten().for_each(|value| *value *= scale);
        affine
    });
    let header = NiftiHeader::for_volume(volume.dims_xyz(), datatype, spacing, unit, affine)
        .map_err(|source| SourceError::NiftiHeader { path: output.to_owned(), source })?;
    Ok(header.to_bytes())
}
