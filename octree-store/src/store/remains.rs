//! A damaged store, read for what is whole in it.
//!
//! A record has a checksum and names its node, and the metadata frame has a magic and a checksum: both are
//! known wherever they lie, whatever the first page says, and where parts of the file have changed places.
//! What is found is read as any store is; what is not found is damaged, and so is what the disk does not give back.

use super::open::{MOST_METADATA_BYTES, open_file, refused};
use super::reader::Store;
use super::record_table::RecordTable;
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
/// What disks fail to read, they fail to read by the page or less.
const PAGE: u64 = 4096;
/// Bytes of metadata that are read first: more than most have.
const FIRST_METADATA_BYTES: usize = 4096;

/// Records found in a file: 16 bytes of memory each.
#[derive(Debug)]
pub(super) struct FoundRecords {
    file: Arc<DiskFile>,
    geometry: Geometry,
    /// Keys with the bytes at which their records begin, in key order.
    places: Vec<(u64, u64)>,
}

impl FoundRecords {
    /// A record's bytes; zeros where none was found, or the disk does not give it back this time.
    fn record(&self, key: NodeKey) -> [u8; NodeRecord::BYTES] {
        let mut bytes = [0; NodeRecord::BYTES];
        let found = self.places.binary_search_by_key(&key.to_u64(), |(key, _)| *key);
        if let Ok(index) = found
            && self.file.read_exact_at(&mut bytes, self.places[index].1).is_err()
        {
            bytes.fill(0);
        }
        bytes
    }

    pub(super) fn group(&self, parent: NodeKey) -> Vec<u8> {
        let mut group = Vec::with_capacity(8 * NodeRecord::BYTES);
        for key in parent.children().into_iter().filter(|key| self.geometry.contains(*key)) {
            group.extend_from_slice(&self.record(key));
        }
        group
    }

    pub(super) fn visit(&self, level: u8, visit: &mut dyn FnMut(NodeKey, &[u8]) -> bool) {
        for key in self.geometry.keys_at(level) {
            if !visit(key, &self.record(key)) {
                break;
            }
        }
    }
}

impl Store {
    /// Opens what is left of a store that may be damaged anywhere: all records that are whole count, wherever
    /// they lie. Takes a moment for each gigabyte of index, and of the whole file where its first page is damaged.
    ///
    /// What the disk refuses to give back is damage there: a failing disk is what this is for.
    ///
    /// # Errors
    /// When the file cannot be opened, no metadata are left in it or next to nothing else, it is of another version,
    /// or was never finished.
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
            Err(
                SuperblockError::NotAStore(_)
                | SuperblockError::Damaged(_)
                | SuperblockError::Io(_),
            ) if is_file => None,
            Err(other) => return Err(refused(path, other)),
        };
        let begin = superblock.map_or(0, |superblock| superblock.metadata_offset()).min(length);
        let Remains { metadata, mut places, end_of_payloads, unreadable } =
            search(&file, begin, length);
        let Some((metadata, json)) = metadata else {
            if let Some(source) = unreadable {
                return Err(io_error(source));
            }
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
        // A record takes 120 bytes. Of what has not a byte for each all is lost, and a file must not have its
        // reader count bricks for ever.
        let index_bytes = superblock.map(|superblock| superblock.index_bytes);
        if geometry.bricks() > length
            || index_bytes.is_some_and(|b| Some(b) != RecordTable::bytes(&geometry))
        {
            return Err(StoreError::NothingLeft { path: path.to_owned() });
        }
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
    /// Why a part of the file could not be searched, if one could not.
    unreadable: Option<io::Error>,
}

/// Looks for metadata and records in a part of a file.
fn search(file: &DiskFile, begin: u64, end: u64) -> Remains {
    let mut remains =
        Remains { metadata: None, places: Vec::new(), end_of_payloads: 0, unreadable: None };
    let mut block = vec![0; BLOCK + NodeRecord::BYTES];
    let mut start = begin;
    while start < end {
        let there = (end - start).min(block.len() as u64) as usize;
        if let Err(error) = read_what_can_be(file, &mut block[..there], start) {
            remains.unreadable = Some(error);
        }
        // What begins in a block may end in the next one.
        let mut at = 0;
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
            if remains.metadata.is_none() && Metadata::may_begin(bytes) {
                // What cannot be read here stands in the file once more.
                remains.metadata = metadata_at(file, start + at as u64, end).unwrap_or_default();
            }
            at += 1;
        }
        start += BLOCK as u64;
    }
    remains
}

/// Reads bytes, page by page where they cannot be read at once; zeros stand for pages that cannot be read at all.
///
/// # Errors
/// When some cannot; all others are there.
fn read_what_can_be(file: &DiskFile, bytes: &mut [u8], start: u64) -> io::Result<()> {
    if file.read_exact_at(bytes, start).is_ok() {
        return Ok(());
    }
    let mut outcome = Ok(());
    let mut at = 0;
    while at < bytes.len() {
        // To the end of a page of the file.
        let page = PAGE - (start + at as u64) % PAGE;
        let end = bytes.len().min(at + page as usize);
        if let Err(error) = file.read_exact_at(&mut bytes[at..end], start + at as u64) {
            bytes[at..end].fill(0);
            outcome = Err(error);
        }
        at = end;
    }
    outcome
}

/// The whole record with which these bytes begin. Few bytes are looked at where there is none.
fn record_at(bytes: &[u8]) -> Option<NodeRecord> {
    let bytes = bytes.get(..NodeRecord::BYTES)?;
    if !NodeRecord::may_be(bytes) {
        return None;
    }
    NodeRecord::from_bytes(bytes)
}

/// The metadata whose frame begins at a byte, with their JSON. No more is read than twice what is JSON there, so
/// that a file full of beginnings costs no more than its length.
fn metadata_at(file: &DiskFile, at: u64, end: u64) -> io::Result<Option<(Metadata, Vec<u8>)>> {
    let most = (end - at).min(MOST_METADATA_BYTES) as usize;
    let mut bytes = Vec::new();
    let mut wanted = FIRST_METADATA_BYTES;
    loop {
        let (known, there) = (bytes.len(), wanted.min(most));
        bytes.resize(there, 0);
        file.read_exact_at(&mut bytes[known..], at + known as u64)?;
        let Some(json) = bytes.get(metadata::FRAME_BYTES..) else { return Ok(None) };
        // The frame does not say how long it is; the JSON does.
        let mut values = serde_json::Deserializer::from_slice(json).into_iter::<IgnoredAny>();
        match values.next() {
            Some(Ok(_)) => {
                bytes.truncate(metadata::FRAME_BYTES + values.byte_offset());
                let metadata = Metadata::from_bytes(&bytes).ok();
                return Ok(metadata.map(|known| (known, bytes.split_off(metadata::FRAME_BYTES))));
            }
            // It may go on behind what was read.
            Some(Err(error)) if error.is_eof() && there < most => wanted *= 2,
            _ => return Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::{Encoding, encode_samples};

    #[test]
    fn a_record_is_found_wherever_it_lies() {
        let [key, other] = [NodeKey::new(0, [3, 1, 2]), NodeKey::new(1, [0; 3])];
        let record = |key| encode_samples(key, &[7_u16; 27], Encoding::Lossless).0.to_bytes();
        for at in [0, 1, BLOCK - NodeRecord::BYTES, BLOCK - 60, BLOCK - 1, BLOCK] {
            let file = DiskFile::from(tempfile::tempfile().unwrap());
            let records = [record(key), record(other)].concat();
            file.write_all_at(&records, at as u64).unwrap();
            let end = (at + records.len()) as u64;
            let next = (at + NodeRecord::BYTES) as u64;
            let found = search(&file, 0, end).places;
            assert_eq!(found, [(key.to_u64(), at as u64), (other.to_u64(), next)], "{at}");
            assert_eq!(search(&file, 0, end - 1).places, found[..1], "{at}");
        }
    }
}
