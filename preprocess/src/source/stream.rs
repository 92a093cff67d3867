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
    /// Not at all: samples as they are.
    Plain,
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
    /// Which of the samples are wanted, where it is not all of them.
    pub(crate) pick: Option<Pick>,
    /// The decoded byte, of those that are picked, at which the first voxel is.
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
            StreamCoding::Plain => Box::new(file),
            StreamCoding::Gzip => Box::new(MultiGzDecoder::new(file)),
            StreamCoding::Zlib => Box::new(ZlibDecoder::new(file)),
            StreamCoding::Bzip2 => Box::new(MultiBzDecoder::new(file)),
            StreamCoding::Ascii(sample_type) => Box::new(ascii::Numbers::new(file, sample_type)),
        };
        let mut stream = VoxelStream { path: path.clone(), reader };
        if let Some(pick) = self.pick {
            stream.skip(pick.after)?;
            stream.reader =
                Box::new(Picked { reader: stream.reader, pick, samples: Vec::new(), at: 0 });
        }
        Ok(stream)
    }
}

/// One sample out of every group: a channel of interleaved ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Pick {
    /// Decoded bytes before the first group.
    pub(crate) after: u64,
    /// Bytes of a group.
    pub(crate) group: u64,
    /// The sample's first byte in it.
    pub(crate) first: u64,
    /// The sample's bytes.
    pub(crate) length: usize,
}

/// A reader of the picked samples.
struct Picked {
    reader: Box<dyn Read + Send>,
    pick: Pick,
    samples: Vec<u8>,
    /// The first byte of `samples` that has not been given.
    at: usize,
}

impl Picked {
    /// Reads a few thousand groups; the last one may not be cut short.
    fn refill(&mut self) -> io::Result<()> {
        let Pick { group, first, length, .. } = self.pick;
        let groups = ((1 << 16) / group).max(1);
        let mut bytes = Vec::new();
        self.reader.by_ref().take(groups * group).read_to_end(&mut bytes)?;
        if !(bytes.len() as u64).is_multiple_of(group) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let first = first as usize;
        let samples = bytes.chunks_exact(group as usize).map(|group| &group[first..first + length]);
        self.samples.clear();
        self.samples.extend(samples.flatten());
        self.at = 0;
        Ok(())
    }
}

impl Read for Picked {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.at == self.samples.len() {
            self.refill()?;
        }
        let count = out.len().min(self.samples.len() - self.at);
        out[..count].copy_from_slice(&self.samples[self.at..self.at + count]);
        self.at += count;
        Ok(count)
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
