//! Putting payloads right in a store's file, and telling what else is wrong with it.
//!
//! What is written in place is known by the record's checksum to be what was there, and goes where damage is.
//! So the store is never worse than before, whenever this is interrupted.

use super::reader::Store;
use super::superblock::SUPERBLOCK_BYTES;
use super::writer::io_at;
use crate::disk::DiskFile;
use crate::error::StoreError;
use crate::record::NodeRecord;
use std::fs::File;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use twox_hash::XxHash3_128;

/// A store's file, open for putting payloads right.
#[derive(Debug)]
pub struct Mender {
    path: PathBuf,
    file: DiskFile,
}

impl Mender {
    /// Opens a store's file.
    ///
    /// # Errors
    /// When it cannot be written, or another file has its name by now.
    pub fn open(store: &Store) -> Result<Self, StoreError> {
        let path = store.path();
        let open = || {
            let file = store.disk().open_to_write(path)?;
            let [read, written] = [store.file.file(), file.file()].map(File::metadata);
            let [read, written] = [read?, written?];
            if (read.dev(), read.ino()) == (written.dev(), written.ino()) {
                Ok(file)
            } else {
                Err(io::Error::other("it was replaced after it was opened"))
            }
        };
        let file = open().map_err(|source| io_at(path, source))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Writes a payload where its record says; false, and nothing done, where it is not the record's.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, record: &NodeRecord, payload: &[u8]) -> Result<bool, StoreError> {
        let the_same = payload.len() == record.place.length as usize
            && record.place.stream == 0
            && XxHash3_128::oneshot(payload) == record.payload_checksum;
        if the_same {
            let at = SUPERBLOCK_BYTES + record.place.offset;
            self.file.write_all_at(payload, at).map_err(|source| io_at(&self.path, source))?;
        }
        Ok(the_same)
    }

    /// Makes durable what was written.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn finish(self) -> Result<(), StoreError> {
        self.file.sync_all().map_err(|source| io_at(&self.path, source))
    }
}

impl Store {
    /// What is wrong with the file of which this store is what remains ([`Store::open_remains`]), apart from records
    /// and payloads that are damaged: its first page, its metadata, or the places of its records, which cannot be
    /// read or are not what they were. None where a reader finds all that was found.
    pub fn fault_around_records(&self) -> Option<String> {
        let read = match Self::open_on(self.disk(), self.path()) {
            Ok(read) => read,
            Err(error) => return Some(error.to_string()),
        };
        for key in self.geometry.levels().flat_map(|level| self.geometry.keys_at(level)) {
            match (self.node(key), read.node(key)) {
                (Ok(found), Ok(record)) if found == record => {}
                (Ok(_), Err(error @ StoreError::Unreadable { .. })) => {
                    return Some(error.to_string());
                }
                (Ok(_), _) => return Some("records have changed places".into()),
                // Nothing was found of it.
                (Err(_), _) => {}
            }
        }
        let twice = read.metadata_are_there_twice().unwrap_or(false);
        (!twice).then(|| "one of its two metadata records is damaged".into())
    }
}
