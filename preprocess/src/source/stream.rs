//! Compressed or written-out voxels that can only be read from front to back.

use super::{SourceError, ascii};
use bzip2::read::MultiBzDecoder;
use flate2::read::{MultiGzDecoder, ZlibDecoder};
use octree_store::SampleType;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// How the bytes of a stream are coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum StreamCoding {
    /// A gzip file of one or more members.
    Gzip,
    /// One zlib stream.
    Zlib,
    /// One or more bzip2 streams.
    Bzip2,
    /// Numbers as text, white space between them; decoded to little-endian samples.
    Ascii(SampleType),
}

/// Where a stream of voxels is.
#[derive(Debug, Clone)]
pub(crate) struct StreamPlace {
    /// The file.
    pub(crate) path: PathBuf,
    /// The byte of the file at which the coded data begin.
    pub(crate) file_offset: u64,
    /// How they are coded.
    pub(crate) coding: StreamCoding,
    /// The decoded byte at which the first voxel is.
    pub(crate) offset: u64,
    /// Whether the data end with the last voxel, so that what follows is a fault.
    pub(crate) ends_with_volume: bool,
}

impl StreamPlace {
    /// Opens the stream at its first decoded byte, which need not be the first voxel's.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub(crate) fn open(&self) -> Result<VoxelStream, SourceError> {
        let path = &self.path;
        let io_error = |source: io::Error| match source.kind() {
            io::ErrorKind::NotFound => SourceError::Missing { path: path.clone() },
            _ => SourceError::Io { path: path.clone(), source },
        };
        let mut file = File::open(path).map_err(io_error)?;
        file.seek(SeekFrom::Start(self.file_offset)).map_err(io_error)?;
        let file = BufReader::with_capacity(1 << 16, file);
        let reader: Box<dyn Read + Send> = match self.coding {
            StreamCoding::Gzip => Box::new(MultiGzDecoder::new(file)),
            StreamCoding::Zlib => Box::new(ZlibDecoder::new(file)),
            StreamCoding::Bzip2 => Box::new(MultiBzDecoder::new(file)),
            StreamCoding::Ascii(sample_type) => Box::new(ascii::Numbers::new(file, sample_type)),
        };
        Ok(VoxelStream { path: path.clone(), reader })
    }
}

/// A stream of stored voxels, z slice by z slice, that can only be read forwards.
pub(crate) struct VoxelStream {
    /// The file, for messages.
    pub(crate) path: PathBuf,
    /// The decompressed bytes, positioned at the first voxel.
    pub(crate) reader: Box<dyn Read + Send>,
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
    pub(crate) fn read(&mut self, bytes: &mut [u8]) -> Result<(), SourceError> {
        self.reader.read_exact(bytes).map_err(|error| stream_error(&self.path, error))
    }

    /// Passes over `count` bytes.
    ///
    /// # Errors
    /// As [`VoxelStream::read`].
    pub(crate) fn skip(&mut self, count: u64) -> Result<(), SourceError> {
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
    pub(crate) fn finish(&mut self) -> Result<(), SourceError> {
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
