//! redb's own check of a store's index: every page that it uses, against redb's checksums.
//!
//! Reading needs none of it, for records and metadata have checksums of ours. But an index that redb would
//! call damaged is no whole one, and may fail another reader. The check wants to write what it finds out; that
//! goes into memory.

use super::guard::{Failure, guard};
use super::index_backend::IndexBackend;
use super::reader::Store;
use crate::error::StoreError;
use redb::{Builder, StorageBackend};
use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const PAGE: u64 = 4096;
/// redb's page cache: the check reads each page once.
const CACHE_BYTES: usize = 8 << 20;

/// An index whose changes stay in memory.
#[derive(Debug)]
struct InMemory {
    index: IndexBackend,
    changes: Mutex<Changes>,
}

#[derive(Debug)]
struct Changes {
    length: u64,
    /// Pages that were written.
    pages: BTreeMap<u64, Vec<u8>>,
}

impl InMemory {
    fn new(index: IndexBackend) -> io::Result<Self> {
        let length = index.len()?;
        Ok(Self { index, changes: Mutex::new(Changes { length, pages: BTreeMap::new() }) })
    }

    fn changes(&self) -> MutexGuard<'_, Changes> {
        // A page is changed by one statement.
        self.changes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A page as it is in the file; zeros beyond its end.
    fn page(&self, page: u64) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; PAGE as usize];
        let there = self.index.len()?.saturating_sub(page * PAGE).min(PAGE) as usize;
        self.index.read(page * PAGE, &mut bytes[..there])?;
        Ok(bytes)
    }
}

impl StorageBackend for InMemory {
    fn len(&self) -> io::Result<u64> {
        Ok(self.changes().length)
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        let changes = self.changes();
        let end = offset.checked_add(out.len() as u64);
        if end.is_none_or(|end| end > changes.length) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let mut done = 0;
        while done < out.len() {
            let at = offset + done as u64;
            let within = (at % PAGE) as usize;
            let count = (out.len() - done).min(PAGE as usize - within);
            let to = &mut out[done..done + count];
            match changes.pages.get(&(at / PAGE)) {
                Some(page) => to.copy_from_slice(&page[within..within + count]),
                None => to.copy_from_slice(&self.page(at / PAGE)?[within..within + count]),
            }
            done += count;
        }
        Ok(())
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        let mut changes = self.changes();
        changes.length = len;
        changes.pages.split_off(&len.div_ceil(PAGE));
        Ok(())
    }

    fn sync_data(&self) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        let mut changes = self.changes();
        let mut done = 0;
        while done < data.len() {
            let at = offset + done as u64;
            let within = (at % PAGE) as usize;
            let count = (data.len() - done).min(PAGE as usize - within);
            let mut page = match changes.pages.remove(&(at / PAGE)) {
                Some(page) => page,
                None => self.page(at / PAGE)?,
            };
            page[within..within + count].copy_from_slice(&data[done..done + count]);
            changes.pages.insert(at / PAGE, page);
            done += count;
        }
        changes.length = changes.length.max(offset + data.len() as u64);
        Ok(())
    }
}

impl Store {
    /// What redb finds wrong with the store's index, if anything. Reads all of it.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub(crate) fn fault_of_index(&self) -> Result<Option<String>, StoreError> {
        let Some(superblock) = self.superblock else { return Ok(None) };
        let (offset, length) = (superblock.index_offset, superblock.index_bytes);
        let index = IndexBackend::reading(Arc::clone(&self.file), offset, length);
        let checked = guard(|| {
            let backend = InMemory::new(index)?;
            Builder::new()
                .set_cache_size(CACHE_BYTES)
                .set_check_integrity_on_open(true)
                .create_with_backend(backend)
                .map(drop)
                .map_err(redb::Error::from)
        });
        match checked {
            Ok(()) => Ok(None),
            Err(Failure::Corrupt(what)) => Ok(Some(what)),
            Err(other) => Err(other.at(&self.path)),
        }
    }
}
