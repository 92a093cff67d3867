//! Streaming a phantom to raw bytes, x fastest, without header.
//!
//! Rows are computed in batches of a few megabytes, in parallel, while the batch before is
//! being written: two batches are all the memory there is, whatever the volume's size.

use std::{
    fs::{self, File},
    io::{self, Write},
    ops::Range,
    path::Path,
};

use rayon::prelude::*;
use tempfile::NamedTempFile;

use crate::{ByteOrder, Phantom, Sample, SampleType, WriteError};

const BATCH_BYTES: usize = 8 << 20;

/// Writes the whole volume to `out` and returns the number of bytes. `out` need not be buffered.
///
/// # Errors
/// If a value of the recipe does not fit in `sample_type`, or `out` fails.
pub fn write_raw<W: Write + Send>(
    phantom: &Phantom,
    sample_type: SampleType,
    order: ByteOrder,
    out: &mut W,
) -> Result<u64, WriteError> {
    phantom.check_fits(sample_type)?;
    match sample_type {
        SampleType::U8 => stream::<u8, W>(phantom, order, out),
        SampleType::U16 => stream::<u16, W>(phantom, order, out),
        SampleType::F32 => stream::<f32, W>(phantom, order, out),
    }
}

/// Writes the whole volume to the file at `path` and returns the number of bytes.
///
/// The bytes go to a temporary file in the same folder, which gets the final name (replacing a
/// plain file of that name) when it is complete. On an error nothing is left behind, and what
/// stood at `path` still does; a killed process leaves the temporary file, `.NAME.*.part`.
///
/// # Errors
/// If a value does not fit in `sample_type`, `path` is a folder, a link or a device, or the file
/// system fails.
pub fn write_raw_file(
    phantom: &Phantom,
    sample_type: SampleType,
    order: ByteOrder,
    path: &Path,
) -> Result<u64, WriteError> {
    phantom.check_fits(sample_type)?;
    if fs::symlink_metadata(path).is_ok_and(|found| !found.is_file()) {
        return Err(WriteError::NotAPlainFile { path: path.into() });
    }
    let mut file =
        create_beside(path).map_err(|source| WriteError::Create { path: path.into(), source })?;
    let bytes = write_raw(phantom, sample_type, order, file.as_file_mut())?;
    file.persist(path)
        .map_err(|error| WriteError::Rename { path: path.into(), source: error.error })?;
    Ok(bytes)
}

fn create_beside(path: &Path) -> io::Result<NamedTempFile<File>> {
    let name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let prefix = format!(".{}.", name.to_string_lossy());
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".part");
    #[cfg(unix)]
    {
        // Temporary files are private by default; this one is to become an ordinary file.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666)); // less the umask
    }
    builder.tempfile_in(folder.unwrap_or(Path::new(".")))
}

fn stream<T: Sample, W: Write + Send>(
    phantom: &Phantom,
    order: ByteOrder,
    out: &mut W,
) -> Result<u64, WriteError> {
    let [nx, ny, nz] = phantom.dims_xyz();
    let row_bytes = nx * T::TYPE.bytes();
    let rows = ny * nz;
    let rows_in_batch = (BATCH_BYTES / row_bytes).clamp(1, rows);
    let batch = |first: usize| first..(first + rows_in_batch).min(rows);

    let mut ready = vec![0; rows_in_batch * row_bytes];
    let mut next = ready.clone();
    fill::<T>(phantom, order, batch(0), &mut ready);
    for first in (0..rows).step_by(rows_in_batch) {
        let written = batch(first).len() * row_bytes;
        let (result, ()) = rayon::join(
            || out.write_all(&ready[..written]),
            || fill::<T>(phantom, order, batch((first + rows_in_batch).min(rows)), &mut next),
        );
        let byte_offset = (first * row_bytes) as u64;
        result.map_err(|source| WriteError::Stream { byte_offset, source })?;
        std::mem::swap(&mut ready, &mut next);
    }
    let bytes = (rows * row_bytes) as u64;
    out.flush().map_err(|source| WriteError::Stream { byte_offset: bytes, source })?;
    Ok(bytes)
}

/// Fills the start of `bytes` with the rows numbered y + ny z.
fn fill<T: Sample>(phantom: &Phantom, order: ByteOrder, rows: Range<usize>, bytes: &mut [u8]) {
    let [nx, ny, _] = phantom.dims_xyz();
    bytes.par_chunks_mut(nx * T::TYPE.bytes()).zip(rows).for_each_init(
        || vec![T::default(); nx],
        |row, (bytes, i)| {
            phantom.fill_row(i % ny, i / ny, row);
            T::write_bytes(row, order, bytes);
        },
    );
}
