//! Writing a store: payloads to the stream, records to their groups, and the metadata last.

use super::guard::{Failure, guard};
use super::tables::WriteTables;
use super::{PAGE_BYTES, page_key};
use crate::digest::Digest;
use crate::error::StoreError;
use crate::metadata::Metadata;
use crate::record::{NodeRecord, PayloadPlace};
use crate::summary::Summary;
use redb::{Builder, Database};
use std::path::{Path, PathBuf};

/// Payload bytes after which the writer commits: what a kill can lose.
const COMMIT_BYTES: usize = 64 << 20;
/// redb's page cache while writing: more buys nothing, and the default is 1 GiB.
pub(crate) const WRITER_CACHE_BYTES: usize = 64 << 20;

/// Writes one store from beginning to end.
///
/// Bricks come as groups of siblings ([`StoreWriter::append`]), best in the order in which they
/// will be read. Until [`StoreWriter::finish`] returns, the file is an incomplete store that
/// [`crate::Store::open`] refuses.
pub struct StoreWriter {
    path: PathBuf,
    database: Database,
    /// The open transaction; none between a commit and the next write.
    transaction: Option<WriteTables>,
    stream: u16,
    /// The stream's last page, not full yet.
    page: Vec<u8>,
    page_number: u64,
    uncommitted_bytes: usize,
}

impl std::fmt::Debug for StoreWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StoreWriter").field("path", &self.path).finish_non_exhaustive()
    }
}

impl StoreWriter {
    /// Bytes of memory that a writer takes for a store of at most `store_bytes`: redb's cache, which
    /// a small store does not fill, and its own bookkeeping.
    pub fn memory_bytes(store_bytes: u64) -> u64 {
        store_bytes.min(WRITER_CACHE_BYTES as u64) + (8 << 20)
    }

    /// Creates an empty store in a new file.
    ///
    /// # Errors
    /// When the file exists or cannot be created.
    pub fn create(path: &Path) -> Result<Self, StoreError> {
        let file = std::fs::OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .open(path)
            .map_err(|source| StoreError::Io { path: path.to_owned(), source })?;
        let database = guard(|| {
            let backend = redb::backends::FileBackend::new(file)?;
            Builder::new().set_cache_size(WRITER_CACHE_BYTES).create_with_backend(backend)
        })
        .map_err(|failure| {
            // The empty file is of no use to anyone; the error below says what is wrong.
            let _ = std::fs::remove_file(path);
            failure.at(path)
        })?;
        Ok(Self {
            path: path.to_owned(),
            database,
            transaction: None,
            stream: 0,
            page: Vec::with_capacity(PAGE_BYTES),
            page_number: 0,
            uncommitted_bytes: 0,
        })
    }

    /// Appends bricks that share a parent: every child the parent has, in octant order. Writes
    /// each payload's place into its record.
    ///
    /// # Errors
    /// When the file cannot be written.
    ///
    /// # Panics
    /// When the bricks do not share a parent or are out of order.
    pub fn append(&mut self, siblings: &mut [(NodeRecord, Vec<u8>)]) -> Result<(), StoreError> {
        let Some(parent) = siblings.first().map(|(record, _)| record.key.parent()) else {
            return Ok(());
        };
        assert!(
            siblings.iter().all(|(record, _)| record.key.parent() == parent)
                && siblings.is_sorted_by_key(|(record, _)| record.key),
            "siblings share a parent and come in order"
        );
        let (stream, page, page_number) = (self.stream, &mut self.page, &mut self.page_number);
        let begun = begun(&mut self.transaction, &self.database);
        let write = begun.and_then(|transaction| {
            transaction.write(|nodes, payloads| {
                let mut group = Vec::with_capacity(siblings.len() * NodeRecord::BYTES);
                for (record, payload) in &mut *siblings {
                    record.place = PayloadPlace::default();
                    if !payload.is_empty() {
                        let offset = *page_number * PAGE_BYTES as u64 + page.len() as u64;
                        record.place =
                            PayloadPlace { stream, offset, length: payload.len() as u32 };
                    }
                    let mut rest = payload.as_slice();
                    while !rest.is_empty() {
                        let (now, later) = rest.split_at(rest.len().min(PAGE_BYTES - page.len()));
                        page.extend_from_slice(now);
                        rest = later;
                        if page.len() == PAGE_BYTES {
                            payloads.insert(page_key(stream, *page_number), page.as_slice())?;
                            page.clear();
                            *page_number += 1;
                        }
                    }
                    group.extend_from_slice(&record.to_bytes());
                }
                nodes.insert(parent.to_u64(), group.as_slice())?;
                Ok(())
            })
        });
        write.map_err(|failure| failure.at(&self.path))?;
        self.uncommitted_bytes += siblings.iter().map(|(_, payload)| payload.len()).sum::<usize>();
        if self.uncommitted_bytes >= COMMIT_BYTES { self.commit() } else { Ok(()) }
    }

    /// Makes everything appended so far durable.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn commit(&mut self) -> Result<(), StoreError> {
        self.flush_page()?;
        if let Some(transaction) = self.transaction.take() {
            transaction.commit().map_err(|failure| failure.at(&self.path))?;
        }
        self.uncommitted_bytes = 0;
        Ok(())
    }

    /// Sums up the records, writes the metadata, marks the store complete, and closes the file
    /// compacted. Returns the metadata as written: with levels, errors and digest.
    ///
    /// # Errors
    /// When the file cannot be written, or the metadata describes no volume.
    pub fn finish(mut self, mut metadata: Metadata) -> Result<Metadata, StoreError> {
        self.commit()?;
        let geometry = metadata.geometry().map_err(|error| StoreError::MetadataDamaged {
            path: self.path.clone(),
            what: error.to_string(),
        })?;
        let mut summary = Summary::new(&geometry);
        let mut digest = Digest::default();
        let mut bytes = Vec::new();
        let write = begun(&mut self.transaction, &self.database).and_then(|transaction| {
            transaction.visit_nodes(|group| {
                for record in group.chunks(NodeRecord::BYTES).filter_map(NodeRecord::from_bytes) {
                    summary.add(&record);
                    digest.add(&record);
                }
            })?;
            summary.write_into(&mut metadata);
            metadata.complete = true;
            metadata.digest = digest.finish(&metadata);
            bytes = metadata.to_bytes();
            transaction.set_metadata(&bytes)
        });
        write.map_err(|failure| failure.at(&self.path))?;
        // A store that cannot be read again must not become complete.
        if let Err(error) = Metadata::from_bytes(&bytes) {
            let what = error.to_string();
            return Err(StoreError::MetadataDamaged { path: self.path, what });
        }
        self.commit()?;
        let Self { path, mut database, .. } = self;
        guard(|| {
            database.compact()?;
            Ok::<_, redb::Error>(database.close()?)
        })
        .map_err(|failure| failure.at(&path))?;
        Ok(metadata)
    }

    /// Writes the page that is not full yet: no record may be committed before its payload.
    fn flush_page(&mut self) -> Result<(), StoreError> {
        if self.page.is_empty() {
            return Ok(());
        }
        let key = page_key(self.stream, self.page_number);
        let page = self.page.as_slice();
        begun(&mut self.transaction, &self.database)
            .and_then(|transaction| {
                transaction
                    .write(|_, payloads| payloads.insert(key, page).map(drop).map_err(Into::into))
            })
            .map_err(|failure| failure.at(&self.path))
    }
}

/// The open transaction, begun where there is none.
fn begun<'a>(
    transaction: &'a mut Option<WriteTables>,
    database: &Database,
) -> Result<&'a WriteTables, Failure> {
    if transaction.is_none() {
        *transaction = Some(WriteTables::begin(database)?);
    }
    Ok(transaction.as_ref().expect("it was begun above"))
}
