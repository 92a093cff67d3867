//! The end of writing a store: records are summed up, metadata and the table of records come behind the payloads, and
//! the first page is written when all of it is durable.

use super::guard::Failure;
use super::record_table::RecordTable;
use super::superblock::{SUPERBLOCK_BYTES, Superblock};
use super::tables::{Group, ReadTables, visit_all};
use super::writer::io_at;
use crate::digest::Digest;
use crate::disk::DiskFile;
use crate::error::StoreError;
use crate::geometry::Geometry;
use crate::metadata::Metadata;
use crate::record::NodeRecord;
use crate::summary::Summary;
use std::io;
use std::path::Path;

/// Bytes of the table that are written at a time.
const BUFFER_BYTES: usize = 1 << 20;

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
    /// Puts the sums of all records and the digest into the metadata.
    pub(super) fn sum_up(
        &self,
        geometry: &Geometry,
        metadata: &mut Metadata,
    ) -> Result<(), StoreError> {
        let mut summary = Summary::new(geometry, metadata);
        let mut digest = Digest::default();
        let mut count = 0;
        let add = |group: &[u8]| {
            for bytes in group.chunks(NodeRecord::BYTES) {
                let record = NodeRecord::from_bytes(bytes).ok_or_else(|| {
                    Failure::Corrupt("the work index holds a record that is damaged".into())
                })?;
                if !geometry.contains(record.key) || geometry.rank(record.key) != count {
                    let what = format!("{} is not the next of the volume's bricks", record.key);
                    return Err(Failure::Corrupt(what));
                }
                count += 1;
                summary.add(&record);
                digest.add(&record);
            }
            Ok(())
        };
        let summed = visit_all(self.committed, &self.groups, add);
        summed.map_err(|failure| failure.at(self.work_path))?;
        if count != geometry.bricks() {
            return Err(unusable(self.path, "bricks are missing"));
        }
        summary.write_into(metadata);
        metadata.complete = true;
        let digest = digest.finish(&metadata.to_json());
        metadata.digest = digest.map_err(|error| unusable(self.path, &error.to_string()))?;
        Ok(())
    }

    /// Writes the metadata frame, the table, the frame once more, and the first page.
    pub(super) fn write_behind(
        &self,
        file: &DiskFile,
        payload_bytes: u64,
        geometry: &Geometry,
        frame: &[u8],
    ) -> Result<(), StoreError> {
        let io = |source| io_at(self.path, source);
        let mut superblock = Superblock { payload_bytes, ..Superblock::unfinished() };
        let metadata_offset = superblock.metadata_offset();
        superblock.index_offset =
            (metadata_offset + frame.len() as u64).next_multiple_of(SUPERBLOCK_BYTES);
        superblock.index_bytes =
            RecordTable::bytes(geometry).ok_or_else(|| unusable(self.path, "too many bricks"))?;
        // What a torn write has left behind the payloads goes.
        file.set_len(metadata_offset).map_err(io)?;
        file.write_all_at(frame, metadata_offset).map_err(io)?;
        self.write_table(file, superblock.index_offset)?;
        file.write_all_at(frame, superblock.copy_offset()).map_err(io)?;
        // Everything that the first page speaks of is durable before it does.
        file.sync_all().map_err(io)?;
        superblock.write(file).map_err(io)?;
        file.sync_all().map_err(io)
    }

    fn write_table(&self, file: &DiskFile, offset: u64) -> Result<(), StoreError> {
        let mut waiting = Vec::with_capacity(BUFFER_BYTES + 8 * NodeRecord::BYTES);
        let mut at = offset;
        let mut flush = |waiting: &mut Vec<u8>| {
            file.write_all_at(waiting, at)?;
            at += waiting.len() as u64;
            waiting.clear();
            Ok::<_, io::Error>(())
        };
        // What fails is either the work index, which is read, or the store's file, which is written.
        let mut written = Ok(());
        let read = visit_all(self.committed, &self.groups, |group| {
            waiting.extend_from_slice(group);
            if waiting.len() >= BUFFER_BYTES && written.is_ok() {
                written = flush(&mut waiting);
            }
            Ok(())
        });
        read.map_err(|failure| failure.at(self.work_path))?;
        written.and_then(|()| flush(&mut waiting)).map_err(|source| io_at(self.path, source))
    }
}

fn unusable(path: &Path, what: &str) -> StoreError {
    StoreError::MetadataDamaged { path: path.to_owned(), what: what.into() }
}
