//! Voxels that a header describes and that lie behind it, in a file of their own, or in a row of files,
//! as NRRD's and MetaImage's headers have them.
//!
//! Where the volume lies in one file, it is mapped or a stream; where it is spread over several, slices
//! are read one by one from the files they lie in.

use super::data_pieces::{Piece, PieceSlices};
use super::world::World;
use super::{Found, Place, Source, SourceError, StoredFormat, StreamCoding};
use octree_store::{Geometry, SampleType};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Numbers side by side, in the order of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ArrayShape {
    /// The type of the samples.
    pub(super) stored: SampleType,
    /// Voxels of one volume.
    pub(super) dims_xyz: [u64; 3],
    /// Samples of one voxel, side by side, and which of them is read.
    pub(super) components: u64,
    /// The component that is read.
    pub(super) component: u64,
    /// Volumes, one after the other.
    pub(super) volumes: u64,
    /// The volume that is read.
    pub(super) volume: u64,
}

/// Where the data begin in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataStart {
    /// After so many lines, then so many bytes; the bytes are decoded ones where there is a coding.
    After { lines: u64, bytes: u64 },
    /// As far from the end as the data are long.
    AtEnd,
}

/// A row of files of equal size.
#[derive(Debug, Clone)]
pub(super) struct DataFiles {
    /// The header's file.
    pub(super) header: PathBuf,
    /// The byte at which the header ends, where the data follow it in its own file.
    pub(super) attached_at: Option<u64>,
    /// The files, in the order of the data; the header's own alone where the data follow it.
    pub(super) paths: Vec<PathBuf>,
    /// How they are coded, if they are.
    pub(super) coding: Option<StreamCoding>,
    /// Where the data begin in each of them.
    pub(super) start: DataStart,
    /// Whether the most significant byte of a sample comes first.
    pub(super) big_endian: bool,
}

/// Voxels that have been found.
#[derive(Debug)]
struct Placed {
    place: Place,
    /// Whether what the place gives is big-endian.
    big_endian: bool,
    /// Bytes of all files.
    bytes: u64,
    /// The header, and the files of the data.
    files: Vec<PathBuf>,
}

impl ArrayShape {
    /// Bytes of everything, if there can be so many.
    fn total_bytes(&self, header: &Path) -> Result<u64, SourceError> {
        // Any brick will do: this asks only whether such a volume can be.
        Geometry::new(self.dims_xyz, 128, 0)
            .map_err(|source| SourceError::Geometry { path: header.to_owned(), source })?;
        let factors = [self.components, self.volumes, self.stored.bytes() as u64];
        self.dims_xyz
            .into_iter()
            .chain(factors)
            .try_fold(1_u64, u64::checked_mul)
            .filter(|&total| total < 1 << 62)
            .ok_or_else(|| SourceError::TooManyDimensions {
                path: header.to_owned(),
                dims: self.dims_xyz.into_iter().chain([self.components, self.volumes]).collect(),
            })
    }

    pub(super) fn slice_bytes(&self) -> u64 {
        self.dims_xyz[0] * self.dims_xyz[1] * self.components * self.stored.bytes() as u64
    }

    pub(super) fn sample_bytes(&self) -> usize {
        self.stored.bytes()
    }
}

/// The number that was asked for, or 0, if there are so many.
pub(super) fn chosen(path: &Path, count: u64, asked: Option<u64>) -> Result<u64, SourceError> {
    let asked = asked.unwrap_or(0);
    if asked < count {
        Ok(asked)
    } else {
        Err(SourceError::NoSuchVolume { path: path.to_owned(), count, asked })
    }
}

/// What a user should know where one of several volumes was chosen.
pub(super) fn choice_note(
    [times, channels]: [u64; 2],
    [time, channel]: [u64; 2],
) -> Option<String> {
    (times * channels > 1).then(|| {
        format!(
            "it holds {times} times and {channels} channels: time {time} of channel {channel} is used \
             (--time and --channel choose another)"
        )
    })
}

/// The file that a header names: beside the header, unless it says all of the path.
pub(super) fn beside(header: &Path, name: &str) -> Result<PathBuf, SourceError> {
    let path = header.parent().unwrap_or(Path::new("")).join(name);
    match std::fs::metadata(&path) {
        Ok(metadata) if metadata.is_file() => Ok(path),
        Ok(metadata) if metadata.is_dir() => Err(SourceError::Folder { path }),
        Ok(_) => {
            let source = io::Error::new(io::ErrorKind::InvalidInput, "this is no regular file");
            Err(SourceError::Io { path, source })
        }
        // A name that no file can have is the header's fault as much as one that none has.
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::NotFound
                    | io::ErrorKind::NotADirectory
                    | io::ErrorKind::InvalidFilename
                    | io::ErrorKind::InvalidInput
            ) =>
        {
            Err(SourceError::PartnerMissing { path: header.to_owned(), partner: path })
        }
        Err(source) => Err(SourceError::Io { path, source }),
    }
}

impl DataFiles {
    /// Finds the voxels of an array's volume that lies so in the world.
    pub(super) fn open(self, shape: &ArrayShape, world: World) -> Result<Source, SourceError> {
        let path = self.header.clone();
        let Placed { place, big_endian, bytes, files } = self.place(shape)?;
        let World { spacing_xyz, unit, affine, notes } = world;
        let format = StoredFormat { stored: shape.stored, big_endian, scaling: None };
        let dims_xyz = shape.dims_xyz;
        let found =
            Found { dims_xyz, spacing_xyz, unit, affine, path, bytes, notes, files, format, place };
        Ok(found.into())
    }

    /// Finds the voxels; every file is checked to be as long as it must be, or, where it is coded, as it
    /// must be at least.
    fn place(self, shape: &ArrayShape) -> Result<Placed, SourceError> {
        let total = shape.total_bytes(&self.header)?;
        let count = self.paths.len() as u64;
        if count == 0 || !total.is_multiple_of(count) {
            return Err(SourceError::DataFileCount { path: self.header, found: count });
        }
        let piece_bytes = total / count;
        let mut bytes = if self.attached_at.is_some() { 0 } else { file_length(&self.header)? };
        let mut pieces = Vec::with_capacity(self.paths.len());
        for path in &self.paths {
            let found = file_length(path)?;
            bytes = bytes.saturating_add(found);
            pieces.push(self.piece(path, found, piece_bytes, shape.stored)?);
        }
        let mut files = if self.attached_at.is_some() { vec![] } else { vec![self.header.clone()] };
        files.extend(self.paths);
        let volume_bytes = shape.slice_bytes() * shape.dims_xyz[2];
        let first = shape.volume * volume_bytes;
        // Text is written out as little-endian samples.
        let text = matches!(self.coding, Some(StreamCoding::Ascii(_)));
        let big_endian = self.big_endian && !text;
        let (index, offset) = ((first / piece_bytes) as usize, first % piece_bytes);
        let slices = PieceSlices {
            pieces,
            coding: self.coding,
            piece_bytes,
            first,
            shape: *shape,
            big_endian,
        };
        if offset + volume_bytes > piece_bytes {
            let place = Place::Slices(Box::new(slices));
            return Ok(Placed { place, big_endian: false, bytes, files });
        }
        let place = slices.in_one_piece(index, offset, volume_bytes)?;
        Ok(Placed { place, big_endian, bytes, files })
    }

    /// Where the data are in one of the files.
    fn piece(
        &self,
        path: &Path,
        found: u64,
        piece_bytes: u64,
        stored: SampleType,
    ) -> Result<Piece, SourceError> {
        let truncated = || SourceError::Truncated { path: path.to_owned() };
        let data_size = |expected| SourceError::DataSize {
            path: path.to_owned(),
            header: self.header.clone(),
            expected,
            found,
        };
        let header_end = self.attached_at.unwrap_or(0);
        let (lines, skipped) = match self.start {
            DataStart::After { lines, bytes } => (lines, bytes),
            DataStart::AtEnd => {
                let file_offset = found
                    .checked_sub(piece_bytes)
                    .filter(|&offset| offset >= header_end)
                    .ok_or_else(|| data_size(header_end + piece_bytes))?;
                return Ok(Piece { path: path.to_owned(), file_offset, decoded_skip: 0 });
            }
        };
        let after_lines = after_lines(path, header_end, lines)?;
        let rest = found.checked_sub(after_lines).ok_or_else(truncated)?;
        let piece = |file_offset, decoded_skip| {
            Ok(Piece { path: path.to_owned(), file_offset, decoded_skip })
        };
        // Deflate packs 1032 to 1 at best, bzip2 about a million to 1: what claims more is not there.
        let most = match self.coding {
            None => {
                let expected = after_lines.saturating_add(skipped).saturating_add(piece_bytes);
                if found != expected {
                    return Err(data_size(expected));
                }
                return piece(after_lines + skipped, 0);
            }
            Some(StreamCoding::Plain) => rest,
            Some(StreamCoding::Gzip | StreamCoding::Zlib) => rest.saturating_mul(1032),
            Some(StreamCoding::Bzip2) => rest.saturating_mul(1 << 21),
            // A digit and a space for each number; bytes are passed over as they stand in the file.
            Some(StreamCoding::Ascii(_)) => {
                let text = rest.checked_sub(skipped).ok_or_else(truncated)?;
                if text.div_ceil(2) < piece_bytes / stored.bytes() as u64 {
                    return Err(truncated());
                }
                return piece(after_lines + skipped, 0);
            }
        };
        if skipped.saturating_add(piece_bytes) > most {
            return Err(truncated());
        }
        piece(after_lines, skipped)
    }
}

fn file_length(path: &Path) -> Result<u64, SourceError> {
    std::fs::metadata(path)
        .map(|metadata| metadata.len())
        .map_err(|source| SourceError::Io { path: path.to_owned(), source })
}

/// The byte after so many lines from `start` on.
fn after_lines(path: &Path, start: u64, lines: u64) -> Result<u64, SourceError> {
    if lines == 0 {
        return Ok(start);
    }
    let io_error = |source| SourceError::Io { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(io_error)?;
    file.seek(SeekFrom::Start(start)).map_err(io_error)?;
    let mut text = BufReader::new(file);
    let mut at = start;
    for _ in 0..lines {
        at += pass_line(&mut text)
            .map_err(io_error)?
            .ok_or_else(|| SourceError::Truncated { path: path.to_owned() })?;
    }
    Ok(at)
}

/// Passes over a line of any length; its bytes, or `None` where the file ends first.
fn pass_line(text: &mut impl BufRead) -> io::Result<Option<u64>> {
    let mut passed = 0;
    loop {
        let buffer = text.fill_buf()?;
        if buffer.is_empty() {
            return Ok(None);
        }
        let end = buffer.iter().position(|&byte| byte == b'\n');
        let count = end.map_or(buffer.len(), |end| end + 1);
        text.consume(count);
        passed += count as u64;
        if end.is_some() {
            return Ok(Some(passed));
        }
    }
}

/// A header's first bytes, at most `limit` of them.
pub(super) fn read_start(path: &Path, limit: u64) -> Result<Vec<u8>, SourceError> {
    let io_error = |source| SourceError::Io { path: path.to_owned(), source };
    let mut bytes = Vec::new();
    File::open(path).map_err(io_error)?.take(limit).read_to_end(&mut bytes).map_err(io_error)?;
    Ok(bytes)
}
