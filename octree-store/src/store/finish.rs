//! The end of writing a store: records are summed up, metadata and index come behind the payloads, and the first
//! page is written when all of it is durable.

use super::guard::{Failure, guard};
use super::index_backend::IndexBackend;
use super::superblock::{SUPERBLOCK_BYTES, Superblock};
use super::tables::{Group, ReadTables, WriteTables, visit_all};
use super::writer::{WRITER_CACHE_BYTES, io_at};
use crate::digest::Digest;
use crate::error::StoreError;
use crate::metadata::Metadata;
use crate::record::NodeRecord;
use crate::summary::Summary;
use redb::Builder;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

/// All records of a store whose payloads are in its file.
pub(super) struct AllRecords<'a> {
    pub(super) path: &'a Path,
    pub(super) work_path: &'a Path,
    /// Those in the work index.
    pub(super) committed: Option<&'a ReadTables>,
    /// Those that no commit has taken, in key order.
    pub(super) groups: Vec<Group>,
}

impl AllRecords<'_> {
    /// Puts the sums of all records and the digest into the metadata; gives its frame.
    pub(super) fn sum_up(&self, metadata: &mut Metadata) -> Result<Vec<u8>, StoreError> {
        let unusable =
            |what: String| StoreError::MetadataDamaged { path: self.path.to_owned(), what };
        let geometry = metadata.geometry().map_err(|error| unusable(error.to_string()))?;
        let mut summary = Summary::new(&geometry, metadata);
        let mut digest = Digest::default();
        let add = |_, group: &[u8]| {
            for bytes in group.chunks(NodeRecord::BYTES) {
                let record = NodeRecord::from_bytes(bytes).ok_or_else(|| {
                    Failure::Corrupt("the work index holds a record that is damaged".into())
                })?;
                summary.add(&record);
                digest.add(&record);
            }
            Ok(())
        };
        visit_all(self.committed, &self.groups, add)
            .map_err(|failure| failure.at(self.work_path))?;
        summary.write_into(metadata);
        metadata.complete = true;
        let digest = digest.finish(&metadata.to_json());
        metadata.digest = digest.map_err(|error| unusable(error.to_string()))?;
        let frame = metadata.to_bytes();
        // A store that cannot be read again must not become complete.
        Metadata::from_bytes(&frame).map_err(|error| unusable(error.to_string()))?;
        Ok(frame)
    }

    /// Writes a copy of the metadata frame, the index, and the first page.
    pub(super) fn write_behind(
        &self,
        file: &Arc<File>,
        payload_bytes: u64,
        frame: &[u8],
    ) -> Result<(), StoreError> {
        let io = |source| io_at(self.path, source);
        let copy_offset = Superblock::end_of_payloads(payload_bytes);
        let index_offset = (copy_offset + frame.len() as u64).next_multiple_of(SUPERBLOCK_BYTES);
        // What a torn write has left behind the payloads goes.
        file.set_len(copy_offset).map_err(io)?;
        file.write_all_at(frame, copy_offset).map_err(io)?;
        file.set_len(index_offset).map_err(io)?;
        let index = IndexBackend::writing(Arc::clone(file), index_offset);
        self.write_index(index, frame).map_err(|failure| failure.at(self.path))?;
        // Everything that the first page speaks of is durable before it does.
        let complete = || {
            file.sync_all()?;
            let index_bytes = file.metadata()?.len() - index_offset;
            let version = Superblock::unfinished().version;
            Superblock { version, payload_bytes, index_offset, index_bytes }.write(file)?;
            file.sync_all()
        };
        complete().map_err(io)
    }

    fn write_index(&self, index: IndexBackend, frame: &[u8]) -> Result<(), Failure> {
        let mut index =
            guard(|| Builder::new().set_cache_size(WRITER_CACHE_BYTES).create_with_backend(index))?;
        let transaction = WriteTables::begin(&index)?;
        transaction.copy_nodes(self.committed, &self.groups)?;
        transaction.set_metadata(frame)?;
        transaction.commit()?;
        guard(|| {
            index.compact()?;
            Ok::<_, redb::Error>(index.close()?)
        })
    }
}
