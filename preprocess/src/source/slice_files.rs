//! Volumes whose slices can be decoded one by one, from any thread: pages of a TIFF file, a folder of
//! pictures, a DICOM series.

use super::SourceError;

/// Slices that are decoded one by one.
pub(crate) trait SliceFiles: std::fmt::Debug + Send + Sync {
    /// Decodes slice `z` into `bytes`: all its samples, x fastest, little-endian, of the stored type.
    ///
    /// # Errors
    /// When the slice is damaged, is not what it was when the volume was opened, or cannot be read.
    fn read_slice(&self, z: u64, bytes: &mut [u8]) -> Result<(), SourceError>;

    /// Bytes of memory that [`SliceFiles::read_slice`] takes at most, `bytes` apart.
    fn decode_bytes(&self) -> u64;
}
