//! Opening a complete store for reading: what must be right before anything is read from it.

use super::reader::Store;
use super::record_table::RecordTable;
use super::records::Records;
use super::superblock::{Superblock, SuperblockError};
use crate::disk::{Disk, DiskFile};
use crate::error::StoreError;
use crate::metadata::{FORMAT_VERSION, FRAME_BYTES, Metadata, MetadataError};
use std::io;
use std::path::Path;
use std::sync::Arc;

/// More than the metadata of any volume: what is longer is none.
pub(super) const MOST_METADATA_BYTES: u64 = 1 << 20;

impl Store {
    /// Opens a complete store for reading.
    ///
    /// # Errors
    /// When the file cannot be read, is no store, is of another version, was never finished, or its metadata are
    /// damaged in both places.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, StoreError> {
        Self::open_on(&Disk::default(), path.as_ref())
    }

    /// As [`Store::open`], on a disk that may be watched.
    ///
    /// # Errors
    /// As [`Store::open`].
    pub fn open_on(disk: &Disk, path: &Path) -> Result<Self, StoreError> {
        let io_error = |source| StoreError::Io { path: path.to_owned(), source };
        let damaged = |what: String| StoreError::MetadataDamaged { path: path.to_owned(), what };
        let file = open_file(disk, path)?;
        let superblock = Superblock::read(&file).map_err(|error| refused(path, error))?;
        if superblock.index_offset == 0 {
            return Err(StoreError::Incomplete { path: path.to_owned() });
        }
        let found = file.length().map_err(io_error)?;
        let wrong_length = |expected| StoreError::Length { path: path.to_owned(), expected, found };
        if !superblock.fits(found) {
            return Err(wrong_length(superblock.copy_offset()));
        }
        let [first, copy] = frames(&file, &superblock, found).map_err(io_error)?;
        let (metadata, mut frame) = match Metadata::from_bytes(&first) {
            Ok(metadata) => (metadata, first),
            Err(MetadataError::Newer(found)) => return Err(newer(path, found)),
            Err(error) => {
                let metadata = Metadata::from_bytes(&copy);
                (metadata.map_err(|_| damaged(error.to_string()))?, copy)
            }
        };
        let expected = superblock.copy_offset() + frame.len() as u64;
        if found != expected {
            return Err(wrong_length(expected));
        }
        let geometry = metadata.geometry().map_err(|error| damaged(error.to_string()))?;
        if RecordTable::bytes(&geometry) != Some(superblock.index_bytes) {
            return Err(damaged("it speaks of other bricks than the index holds".into()));
        }
        let file = Arc::new(file);
        let offset = superblock.index_offset;
        let records = RecordTable { file: Arc::clone(&file), offset, geometry };
        Ok(Self {
            path: path.to_owned(),
            file,
            superblock: Some(superblock),
            payload_bytes: superblock.payload_bytes,
            json: frame.split_off(FRAME_BYTES),
            metadata,
            geometry,
            records: Records::Table(records),
        })
    }

    /// The metadata as they are stored.
    pub(crate) fn metadata_json(&self) -> &[u8] {
        &self.json
    }

    /// Whether the metadata stand in both places.
    pub(crate) fn metadata_are_there_twice(&self) -> Result<bool, StoreError> {
        let Some(superblock) = self.superblock else { return Ok(false) };
        let read = self.file.length().and_then(|length| frames(&self.file, &superblock, length));
        match (read, &self.records) {
            (Ok([first, copy]), _) => Ok(first == copy && Metadata::from_bytes(&first).is_ok()),
            (Err(_), Records::Found(_)) => Ok(false),
            (Err(source), Records::Table(_)) => {
                Err(StoreError::Io { path: self.path.clone(), source })
            }
        }
    }
}

/// Opens a file that may be a store.
pub(super) fn open_file(disk: &Disk, path: &Path) -> Result<DiskFile, StoreError> {
    let io_error = |source| StoreError::Io { path: path.to_owned(), source };
    // To open a pipe would wait for one who writes to it.
    let kind = std::fs::metadata(path).map_err(io_error)?.file_type();
    if !kind.is_file() && !kind.is_dir() {
        let found = "it is a pipe, a socket or a device";
        return Err(StoreError::NotAStore { path: path.to_owned(), found });
    }
    disk.open(path).map_err(io_error)
}

/// The metadata frames of a store whose parts fit the file, the one before the index and the one behind it; empty
/// where one would be longer than any is.
fn frames(file: &DiskFile, superblock: &Superblock, file_bytes: u64) -> io::Result<[Vec<u8>; 2]> {
    let read = |begin: u64, end: u64| {
        let length = end.saturating_sub(begin);
        let mut bytes = vec![0; if length > MOST_METADATA_BYTES { 0 } else { length as usize }];
        file.read_exact_at(&mut bytes, begin)?;
        Ok::<_, io::Error>(bytes)
    };
    let mut first = read(superblock.metadata_offset(), superblock.index_offset)?;
    // Behind it are zeros up to the page's end; JSON ends with a brace.
    first.truncate(first.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1));
    Ok([first, read(superblock.copy_offset(), file_bytes)?])
}

/// The error for a first page that cannot be used.
pub(super) fn refused(path: &Path, error: SuperblockError) -> StoreError {
    let path = path.to_owned();
    match error {
        SuperblockError::Io(source) => StoreError::Io { path, source },
        SuperblockError::NotAStore(found) => StoreError::NotAStore { path, found },
        SuperblockError::Newer(found) => newer(&path, found),
        SuperblockError::Older(found) => StoreError::OlderFormat { path, found },
        SuperblockError::Features(found) => StoreError::UnknownFeatures { path, found },
        SuperblockError::Damaged(what) => StoreError::MetadataDamaged { path, what: what.into() },
    }
}

fn newer(path: &Path, found: u32) -> StoreError {
    StoreError::NewerFormat { path: path.to_owned(), found, supported: FORMAT_VERSION }
}
