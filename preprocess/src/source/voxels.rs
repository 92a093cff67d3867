//! Voxels as a file stores them, and their way to the type that a reader gets.

use crate::source::SourceError;
use octree_store::{Sample, SampleType, with_sample_type};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// How a file stores its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoredFormat {
    /// The type in the file.
    pub stored: SampleType,
    /// Whether the most significant byte comes first.
    pub big_endian: bool,
    /// Real value = stored * slope + intercept; the samples then become f32.
    pub scaling: Option<(f64, f64)>,
}

impl StoredFormat {
    /// The type that a reader gets: the stored one, or f32 where values are scaled.
    pub fn sample_type(&self) -> SampleType {
        if self.scaling.is_some() { SampleType::F32 } else { self.stored }
    }

    /// Turns stored bytes into samples; `bytes` holds `out.len()` stored samples.
    ///
    /// # Panics
    /// When `T` is not [`StoredFormat::sample_type`].
    #[inline(always)]
    pub fn read_into<T: Sample>(&self, bytes: &[u8], out: &mut [T]) {
        assert_eq!(T::TYPE, self.sample_type());
        if let Some((slope, intercept)) = self.scaling {
            with_sample_type!(self.stored, S => {
                self.each::<S, T>(bytes, out, |v| T::from_f64(v.to_f64() * slope + intercept));
            });
        } else {
            self.each::<T, T>(bytes, out, |v| v);
        }
    }

    #[inline(always)]
    fn each<S: Sample, T: Sample>(&self, bytes: &[u8], out: &mut [T], value: impl Fn(S) -> T) {
        // As many as there are samples: where the compiler knows their number, it knows this too.
        let stored = bytes[..size_of::<S>() * out.len()].chunks_exact(size_of::<S>());
        if self.big_endian {
            for (out, bytes) in out.iter_mut().zip(stored) {
                *out = value(S::from_be_slice(bytes));
            }
        } else {
            for (out, bytes) in out.iter_mut().zip(stored) {
                *out = value(S::from_le_slice(bytes));
            }
        }
    }
}

/// A stream of stored voxels, z slice by z slice, that can only be read forwards.
pub struct VoxelStream {
    /// The file, for messages.
    pub path: PathBuf,
    /// The decompressed bytes, positioned at the first voxel.
    pub reader: Box<dyn Read + Send>,
}

impl std::fmt::Debug for VoxelStream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("VoxelStream").field("path", &self.path).finish_non_exhaustive()
    }
}

impl VoxelStream {
    /// Fills `bytes` with what comes next.
    ///
    /// # Errors
    /// When the stream ends first, or cannot be decompressed.
    pub fn read(&mut self, bytes: &mut [u8]) -> Result<(), SourceError> {
        self.reader.read_exact(bytes).map_err(|error| stream_error(&self.path, error))
    }

    /// Passes over `count` bytes.
    ///
    /// # Errors
    /// As [`VoxelStream::read`].
    pub fn skip(&mut self, count: u64) -> Result<(), SourceError> {
        let skipped = io::copy(&mut self.reader.by_ref().take(count), &mut io::sink())
            .map_err(|error| stream_error(&self.path, error))?;
        if skipped == count {
            Ok(())
        } else {
            Err(stream_error(&self.path, io::ErrorKind::UnexpectedEof.into()))
        }
    }

    /// Checks that the stream ends here: its checksum is only looked at then.
    ///
    /// # Errors
    /// When there is more, or the end is damaged.
    pub fn finish(&mut self) -> Result<(), SourceError> {
        match self.reader.read(&mut [0]) {
            Ok(0) => Ok(()),
            Ok(_) => Err(SourceError::TrailingData { path: self.path.clone() }),
            Err(error) => Err(stream_error(&self.path, error)),
        }
    }
}

/// A stream's failure is the file's fault where the decoder says so, else the system's.
fn stream_error(path: &Path, source: io::Error) -> SourceError {
    let path = path.to_owned();
    match source.kind() {
        io::ErrorKind::UnexpectedEof => SourceError::Truncated { path },
        io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => {
            SourceError::Decompression { path, what: source.to_string() }
        }
        _ => SourceError::Io { path, source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_byte_orders_give_the_same_samples() {
        let little = StoredFormat { stored: SampleType::I16, big_endian: false, scaling: None };
        let big = StoredFormat { big_endian: true, ..little };
        let mut samples = [0_i16; 2];
        little.read_into(&[0x34, 0x12, 0xfe, 0xff], &mut samples);
        assert_eq!(samples, [0x1234, -2]);
        big.read_into(&[0x12, 0x34, 0xff, 0xfe], &mut samples);
        assert_eq!(samples, [0x1234, -2]);
    }

    #[test]
    fn scaled_values_are_real_ones() {
        let format =
            StoredFormat { stored: SampleType::U8, big_endian: false, scaling: Some((0.5, -10.0)) };
        assert_eq!(format.sample_type(), SampleType::F32);
        let mut samples = [0_f32; 3];
        format.read_into(&[0, 1, 255], &mut samples);
        assert_eq!(samples, [-10.0, -9.5, 117.5]);
    }
}
