//! Opening a complete store for reading: what must be right before anything is read from it.

use super::guard::guard;
use super::index_backend::IndexBackend;
use super::reader::Store;
use super::records::Records;
use super::superblock::{Superblock, SuperblockError};
use super::tables::ReadTables;
use crate::error::StoreError;
use crate::metadata::{FORMAT_VERSION, FRAME_BYTES, Metadata, MetadataError};
use crate::record::NodeRecord;
use redb::Builder;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

/// More than the metadata of any volume: what is longer is none.
pub(super) const MOST_METADATA_BYTES: u64 = 1 << 20;

/// How to open a store for reading.
#[derive(Debug, Clone, Copy)]
pub struct OpenOptions {
    /// Bytes of redb's page cache, which holds records (default 64 MiB).
    pub cache_bytes: usize,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { cache_bytes: 64 << 20 }
    }
}

impl OpenOptions {
    /// Opens a complete store for reading.
    ///
    /// # Errors
    /// When the file cannot be read, is no store, is of a later version, was never finished, is
    /// being written, or its metadata is damaged.
    pub fn open(&self, path: impl AsRef<Path>) -> Result<Store, StoreError> {
        let path = path.as_ref();
        let io_error = |source| StoreError::Io { path: path.to_owned(), source };
        let metadata_damaged =
            |what: String| StoreError::MetadataDamaged { path: path.to_owned(), what };
        let incomplete = || StoreError::Incomplete { path: path.to_owned() };
        // To open a pipe would wait for one who writes to it.
        let kind = std::fs::metadata(path).map_err(io_error)?.file_type();
        if !kind.is_file() && !kind.is_dir() {
            let found = "it is a pipe, a socket or a device";
            return Err(StoreError::NotAStore { path: path.to_owned(), found });
        }
        let file = File::open(path).map_err(io_error)?;
        let superblock = Superblock::read(&file).map_err(|error| match error {
            SuperblockError::Io(source) => io_error(source),
            SuperblockError::NotAStore(found) => {
                StoreError::NotAStore { path: path.to_owned(), found }
            }
            SuperblockError::Newer(found) => newer(path, found),
            SuperblockError::Features(found) => {
                StoreError::UnknownFeatures { path: path.to_owned(), found }
            }
            SuperblockError::Damaged(what) => metadata_damaged(what.into()),
        })?;
        if superblock.index_offset == 0 {
            return Err(incomplete());
        }
        let found = file.metadata().map_err(io_error)?.len();
        if !superblock.fits(found) {
            let expected = superblock.index_offset.saturating_add(superblock.index_bytes);
            return Err(StoreError::Length { path: path.to_owned(), expected, found });
        }
        let file = Arc::new(file);
        let Superblock { index_offset, index_bytes, payload_bytes, .. } = superblock;
        let backend = IndexBackend::reading(Arc::clone(&file), index_offset, index_bytes);
        let database = guard(|| {
            Builder::new().set_cache_size(self.cache_bytes).open_read_only_with_backend(backend)
        })
        .map_err(|failure| failure.at(path))?;
        let tables = ReadTables::open(&database).map_err(|failure| failure.at(path))?;
        let mut bytes =
            tables.metadata().map_err(|failure| failure.at(path))?.ok_or_else(incomplete)?;
        let metadata = Metadata::from_bytes(&bytes).map_err(|error| match error {
            MetadataError::Newer(found) => newer(path, found),
            other => metadata_damaged(other.to_string()),
        })?;
        if !metadata.complete {
            return Err(incomplete());
        }
        let geometry = metadata.geometry().map_err(|error| metadata_damaged(error.to_string()))?;
        // Whoever goes through all bricks must not go on for ever.
        if geometry.bricks() > index_bytes / NodeRecord::BYTES as u64 {
            return Err(metadata_damaged(
                "it speaks of more bricks than the index can hold".into(),
            ));
        }
        Ok(Store {
            path: path.to_owned(),
            file,
            superblock: Some(superblock),
            payload_bytes,
            json: bytes.split_off(FRAME_BYTES),
            metadata,
            geometry,
            records: Records::Index { tables: Box::new(tables), _database: database },
        })
    }
}

impl Store {
    /// The metadata as they are stored.
    pub(crate) fn metadata_json(&self) -> &[u8] {
        &self.json
    }

    /// Whether the copy of the metadata between payloads and index is what it should be. Version 0 had none.
    pub(crate) fn copy_is_whole(&self) -> Result<bool, StoreError> {
        let Some(superblock) = self.superblock else { return Ok(false) };
        let (begin, end) = (superblock.copy_offset(), superblock.index_offset);
        if superblock.version == 0 || end - begin > MOST_METADATA_BYTES {
            return Ok(superblock.version == 0);
        }
        let mut bytes = vec![0; (end - begin) as usize];
        self.file
            .read_exact_at(&mut bytes, begin)
            .map_err(|source| StoreError::Io { path: self.path.clone(), source })?;
        let length = (FRAME_BYTES + self.json.len()).min(bytes.len());
        let (frame, zeros) = bytes.split_at(length);
        Ok(frame.get(FRAME_BYTES..) == Some(&self.json)
            && Metadata::from_bytes(frame).is_ok()
            && zeros.iter().all(|byte| *byte == 0))
    }
}

pub(super) fn newer(path: &Path, found: u32) -> StoreError {
    StoreError::NewerFormat { path: path.to_owned(), found, supported: FORMAT_VERSION }
}
