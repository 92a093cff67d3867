//! A damaged store, read for what is whole in it.
//!
//! A record has a checksum and names its node, and the metadata frame has a magic and a checksum: both are
//! known wherever they lie, whatever the first page says, and where parts of the file have changed places.
//! What is found is read as any store is; what is not found is damaged.

use super::open::{MOST_METADATA_BYTES, open_file, refused};
use super::reader::Store;
use super::records::Records;
use super::superblock::{SUPERBLOCK_BYTES, Superblock, SuperblockError};
use crate::disk::{Disk, DiskFile};
use crate::error::StoreError;
use crate::geometry::Geometry;
use crate::key::NodeKey;
use crate::metadata::{self, Metadata};
use crate::record::NodeRecord;
use serde::de::IgnoredAny;
use std::io;
use std::path::Path;
use std::sync::Arc;

/// Bytes that are searched at a time.
const BLOCK: usize = 1 << 20;

/// Records found in a file: 16 bytes of memory each.
#[derive(Debug)]
pub(super) struct FoundRecords {
    file: Arc<DiskFile>,
    geometry: Geometry,
    /// Keys with the bytes at which their records begin, in key order.
    places: Vec<(u64, u64)>,
}

impl FoundRecords {
    /// A record's bytes; zeros where none was found.
    fn record(&self, key: NodeKey) -> io::Result<[u8; NodeRecord::BYTES]> {
        let mut bytes = [0; NodeRecord::BYTES];
        let found = self.places.binary_search_by_key(&key.to_u64(), |(key, _)| *key);
        if let Ok(index) = found {
            self.file.read_exact_at(&mut bytes, self.places[index].1)?;
        }
        Ok(bytes)
    }

    pub(super) fn group(&self, parent: NodeKey) -> io::Result<Vec<u8>> {
        let mut group = Vec::with_capacity(8 * NodeRecord::BYTES);
        for key in parent.children().into_iter().filter(|key| self.geometry.contains(*key)) {
            group.extend_from_slice(&self.record(key)?);
        }
        Ok(group)
    }

    pub(super) fn visit(
        &self,
        level: u8,
        visit: &mut dyn FnMut(NodeKey, &[u8]) -> bool,
    ) -> io::Result<()> {
        for key in self.geometry.keys_at(level) {
            if !visit(key, &self.record(key)?) {
                break;
            }
        }
        Ok(())
    }
}

impl Store {
    /// Opens what is left of a store that may be damaged anywhere: all records that are whole count, wherever
    /// they lie. Takes a moment for each gigabyte of index, and of the whole file where its first page is damaged.
    ///
    /// # Errors
    /// When the file cannot be read, no metadata are left in it, it is of another version, or was never finished.
    pub fn open_remains(path: impl AsRef<Path>) -> Result<Self, StoreError> {
        Self::open_remains_on(&Disk::default(), path.as_ref())
    }

    /// As [`Store::open_remains`], on a disk that may be watched.
    ///
    /// # Errors
    /// As [`Store::open_remains`].
    pub fn open_remains_on(disk: &Disk, path: &Path) -> Result<Self, StoreError> {
        let io_error = |source| StoreError::Io { path: path.to_owned(), source };
        let file = open_file(disk, path)?;
        let is_file = file.file().metadata().map_err(io_error)?.is_file();
        let length = file.length().map_err(io_error)?;
        let superblock = match Superblock::read(&file) {
            Ok(superblock) if superblock.index_offset == 0 => {
                return Err(StoreError::Incomplete { path: path.to_owned() });
            }
            Ok(superblock) => Some(superblock),
            Err(SuperblockError::NotAStore(_) | SuperblockError::Damaged(_)) if is_file => None,
            Err(other) => return Err(refused(path, other)),
        };
        let begin = superblock.map_or(0, |superblock| superblock.metadata_offset()).min(length);
        let Remains { metadata, mut places, end_of_payloads } =
            search(&file, begin, length).map_err(io_error)?;
        let Some((metadata, json)) = metadata else {
            let found = "neither its beginning nor anything in it is a store's";
            return Err(match superblock {
                Some(_) => StoreError::NothingLeft { path: path.to_owned() },
                None => StoreError::NotAStore { path: path.to_owned(), found },
            });
        };
        let geometry = metadata.geometry().map_err(|error| StoreError::MetadataDamaged {
            path: path.to_owned(),
            what: error.to_string(),
        })?;
        places.retain(|(key, _)| NodeKey::from_u64(*key).is_some_and(|key| geometry.contains(key)));
        places.sort_unstable();
        places.dedup_by_key(|(key, _)| *key);
        let payload_bytes = superblock
            .map_or(end_of_payloads, |superblock| superblock.payload_bytes)
            .min(length.saturating_sub(SUPERBLOCK_BYTES));
        let file = Arc::new(file);
        let records = Records::Found(FoundRecords { file: Arc::clone(&file), geometry, places });
        let path = path.to_owned();
        Ok(Self { path, file, superblock, payload_bytes, metadata, json, geometry, records })
    }
}

/// What a search has found.
struct Remains {
    metadata: Option<(Metadata, Vec<u8>)>,
    /// Of every whole record its key, and where it begins.
    places: Vec<(u64, u64)>,
    /// Where the last payload that any of them speaks of ends in its stream.
    end_of_payloads: u64,
}

/// Looks for metadata and records in a part of a file.
fn search(file: &DiskFile, begin: u64, end: u64) -> io::Result<Remains> {
    let mut remains = Remains { metadata: None, places: Vec::new(), end_of_payloads: 0 };
    let mut block = vec![0; BLOCK + NodeRecord::BYTES];
    let mut start = begin;
    // What begins in a block may end in the next one.
    let mut skip = 0;
    while start < end {
        let there = (end - start).min(block.len() as u64) as usize;
        file.read_exact_at(&mut block[..there], start)?;
        let mut at = skip;
        while at < there.min(BLOCK) {
            let bytes = &block[at..there];
            if let Some(record) = record_at(bytes) {
                let place = record.place;
                remains.places.push((record.key.to_u64(), start + at as u64));
                remains.end_of_payloads =
                    remains.end_of_payloads.max(place.offset.saturating_add(place.length.into()));
                at += NodeRecord::BYTES;
                continue;
            }
            if remains.metadata.is_none() && bytes.starts_with(&metadata::MAGIC) {
                remains.metadata = metadata_at(file, start + at as u64, end)?;
            }
            at += 1;
        }
        skip = at - there.min(BLOCK);
        start += BLOCK as u64;
    }
    Ok(remains)
}

/// The whole record with which these bytes begin. Few bytes are looked at where there is none.
fn record_at(bytes: &[u8]) -> Option<NodeRecord> {
    let bytes = bytes.get(..NodeRecord::BYTES)?;
    if !NodeRecord::may_be(bytes) {
        return None;
    }
    NodeRecord::from_bytes(bytes)
}

/// The metadata whose frame begins at a byte, with their JSON.
fn metadata_at(file: &DiskFile, at: u64, end: u64) -> io::Result<Option<(Metadata, Vec<u8>)>> {
    let mut bytes = vec![0; (end - at).min(MOST_METADATA_BYTES) as usize];
    file.read_exact_at(&mut bytes, at)?;
    let Some(json) = bytes.get(metadata::FRAME_BYTES..) else { return Ok(None) };
    // The frame does not say how long it is; the JSON does.
    let mut values = serde_json::Deserializer::from_slice(json).into_iter::<IgnoredAny>();
    let Some(Ok(_)) = values.next() else { return Ok(None) };
    bytes.truncate(metadata::FRAME_BYTES + values.byte_offset());
    let metadata = Metadata::from_bytes(&bytes).ok().filter(|metadata| metadata.complete);
    Ok(metadata.map(|metadata| (metadata, bytes.split_off(metadata::FRAME_BYTES))))
}
