//! Reading a store: from any number of threads, and several processes at once.

use super::records::Records;
use super::superblock::{SUPERBLOCK_BYTES, Superblock};
use crate::disk::{Disk, DiskFile};
use crate::encoding::decode::{DecodeScratch, Decoding};
use crate::encoding::payload;
use crate::error::{Damage, StoreError};
use crate::geometry::Geometry;
use crate::key::NodeKey;
use crate::metadata::{FORMAT_VERSION, Metadata};
use crate::record::{BrickState, NodeRecord, PayloadPlace};
use crate::sample::{Sample, SampleBuffer};
use crate::with_sample_type;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Buffers that reading keeps from brick to brick: one a thread.
#[derive(Debug, Default)]
pub struct BrickScratch {
    pub(super) payload: Vec<u8>,
    pub(super) decode: DecodeScratch,
    /// The core of the brick that is read, and of a neighbour, where overlap is assembled.
    pub(super) core: Vec<u64>,
    pub(super) neighbour: Vec<u64>,
}

/// The records of a node's children, in octant order.
#[derive(Debug, Clone, Copy)]
pub struct Children {
    records: [Option<NodeRecord>; 8],
}

impl Children {
    /// The child in octant `x + 2y + 4z`, if it exists.
    pub fn get(&self, octant: usize) -> Option<&NodeRecord> {
        self.records.get(octant)?.as_ref()
    }

    /// The children that exist.
    pub fn iter(&self) -> impl Iterator<Item = &NodeRecord> {
        self.records.iter().flatten()
    }
}

/// A complete store, open for reading.
///
/// All methods take `&self` and may be called from any number of threads; no lock is held while
/// a brick is decoded.
pub struct Store {
    pub(super) path: PathBuf,
    pub(super) file: Arc<DiskFile>,
    /// Its first page, if that is whole.
    pub(super) superblock: Option<Superblock>,
    /// Bytes of the payload stream.
    pub(super) payload_bytes: u64,
    pub(super) metadata: Metadata,
    /// The metadata as they are stored.
    pub(super) json: Vec<u8>,
    pub(super) geometry: Geometry,
    pub(super) records: Records,
}

impl std::fmt::Debug for Store {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Store").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Store {
    /// The store's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The disk that it lies on.
    pub fn disk(&self) -> &Disk {
        self.file.disk()
    }

    /// What the volume is and how it was converted.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The version of the format in which it was written; the present one where a damaged store no longer says.
    pub fn format_version(&self) -> u32 {
        self.superblock.map_or(FORMAT_VERSION, |superblock| superblock.version)
    }

    /// The volume's folding into bricks.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The record of a node.
    ///
    /// # Errors
    /// [`StoreError::Absent`] where the volume has no such node; [`StoreError::Damaged`] where
    /// it must have a record and none that is whole can be read.
    pub fn node(&self, key: NodeKey) -> Result<NodeRecord, StoreError> {
        if !self.geometry.contains(key) {
            return Err(StoreError::Absent { path: self.path.clone(), key });
        }
        self.record_in(&self.siblings(key)?, key)
    }

    /// The records of all children of a node, in one read.
    ///
    /// # Errors
    /// As [`Store::node`], for the node or any child.
    pub fn children(&self, parent: NodeKey) -> Result<Children, StoreError> {
        self.children_or(parent, Err)
    }

    /// As [`Store::children`], without those that are damaged.
    pub(crate) fn whole_children(&self, parent: NodeKey) -> Result<Children, StoreError> {
        self.children_or(parent, |error| match error {
            StoreError::Damaged { .. } => Ok(()),
            other => Err(other),
        })
    }

    /// The records of all children but those that `pass_over` passes over.
    fn children_or(
        &self,
        parent: NodeKey,
        pass_over: impl Fn(StoreError) -> Result<(), StoreError>,
    ) -> Result<Children, StoreError> {
        let mut records = [None; 8];
        if !self.geometry.contains(parent) {
            return Err(StoreError::Absent { path: self.path.clone(), key: parent });
        }
        if parent.level() > 0 {
            let group = match self.group(parent) {
                Ok(group) => group,
                Err(error) => pass_over(error).map(|()| Vec::new())?,
            };
            for (octant, child) in parent.children().into_iter().enumerate() {
                if self.geometry.contains(child) {
                    match self.record_in(&group, child) {
                        Ok(record) => records[octant] = Some(record),
                        Err(error) => pass_over(error)?,
                    }
                }
            }
        }
        Ok(Children { records })
    }

    /// Calls `visit` for every record of a level in key order until it returns false.
    ///
    /// # Errors
    /// As [`Store::node`], for any node of the level.
    pub fn visit_level(
        &self,
        level: u8,
        mut visit: impl FnMut(&NodeRecord) -> bool,
    ) -> Result<(), StoreError> {
        let top = self.geometry.top_level();
        if level > top {
            // A level above the top has no node; the first of them stands for it.
            let key = NodeKey::first_of_level(top + 1);
            return Err(StoreError::Absent { path: self.path.clone(), key });
        }
        let mut outcome = Ok(());
        let read = self.records.visit(level, &mut |key, bytes| match self.record(key, bytes) {
            Ok(record) => visit(&record),
            Err(error) => {
                outcome = Err(error);
                false
            }
        });
        read.map_err(|(key, source)| self.at(key, source))?;
        outcome
    }

    /// A brick's payload as it is stored, checked against its checksum; empty where it has none.
    ///
    /// # Errors
    /// [`StoreError::Damaged`] where it is not what was written.
    pub fn read_payload<'a>(
        &self,
        record: &NodeRecord,
        scratch: &'a mut BrickScratch,
    ) -> Result<&'a [u8], StoreError> {
        let BrickScratch { payload, .. } = scratch;
        self.fetch_payload(record, payload)?;
        Ok(payload)
    }

    /// Reads and decodes a brick into the caller's buffer, overlap included, x fastest; returns
    /// its record. Uniform and empty bricks are filled in.
    ///
    /// # Errors
    /// As [`Store::node`] and [`Store::decode_brick`].
    pub fn read_brick<T: Sample>(
        &self,
        key: NodeKey,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<NodeRecord, StoreError> {
        let record = self.node(key)?;
        self.decode_brick(&record, scratch, samples)?;
        Ok(record)
    }

    /// Reads and decodes the brick of a record into the caller's buffer of
    /// [`Geometry::brick_samples`] samples. Where the store's payloads hold cores alone, the overlap is
    /// assembled from up to 26 neighbours, which are read too.
    ///
    /// # Errors
    /// When the payload, or a neighbour that has overlap for it, is damaged (the error has the key of the
    /// one that is), the store's samples are not `T`, or the buffer does not fit.
    pub fn decode_brick<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<(), StoreError> {
        self.decode_brick_core(record, scratch, samples)?;
        let stored = record.state == BrickState::Stored && record.bits > 0;
        if stored && !self.metadata.stored_overlap && self.geometry.overlap() > 0 {
            self.assemble_overlap(record, scratch, samples)?;
        }
        Ok(())
    }

    /// As [`Store::decode_brick`], for one who needs no overlap: the samples around the core are left
    /// as they were where they are not in the payload, and no neighbour is read.
    ///
    /// # Errors
    /// As [`Store::decode_brick`], but for neighbours.
    pub fn decode_brick_core<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<(), StoreError> {
        self.check_type::<T>()?;
        let expected = self.geometry.brick_samples();
        if samples.len() != expected {
            return Err(StoreError::BufferLength { expected, found: samples.len() });
        }
        match record.state {
            BrickState::Uniform => samples.fill(T::from_f64(record.brick_min)),
            BrickState::Empty => samples.fill(T::from_f64(self.metadata.empty_value)),
            BrickState::Stored if self.metadata.stored_overlap || record.bits == 0 => {
                self.decode_stored(record, scratch, samples)?;
            }
            BrickState::Stored => self.place_core(record, scratch, samples)?,
            BrickState::Lost => return Err(self.damaged(record.key, Damage::Lost)),
        }
        Ok(())
    }

    /// As [`Store::read_brick`], without what is not in the payload: see [`Store::decode_brick_core`].
    ///
    /// # Errors
    /// As [`Store::node`] and [`Store::decode_brick_core`].
    pub fn read_brick_core<T: Sample>(
        &self,
        key: NodeKey,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<NodeRecord, StoreError> {
        let record = self.node(key)?;
        self.decode_brick_core(&record, scratch, samples)?;
        Ok(record)
    }

    /// Reads and decodes what is in the payload of a stored brick.
    pub(super) fn decode_stored<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<(), StoreError> {
        let BrickScratch { payload, decode, .. } = scratch;
        self.fetch_payload(record, payload)?;
        self.decoding()
            .decode(record, payload, decode, samples)
            .map_err(|damage| self.damaged(record.key, damage))
    }

    /// The bytes of the records of a node and its siblings.
    pub(super) fn siblings(&self, key: NodeKey) -> Result<Vec<u8>, StoreError> {
        self.records.group(key.parent()).map_err(|source| self.at(key, source))
    }

    /// The bytes of the records beneath a node.
    fn group(&self, parent: NodeKey) -> Result<Vec<u8>, StoreError> {
        self.records.group(parent).map_err(|source| self.at(parent.children()[0], source))
    }

    /// Reads and decodes a brick of whatever type the store has.
    ///
    /// # Errors
    /// As [`Store::read_brick`].
    pub fn read_brick_samples(
        &self,
        key: NodeKey,
    ) -> Result<(NodeRecord, SampleBuffer), StoreError> {
        with_sample_type!(self.metadata.sample_type, T => {
            let mut samples = vec![T::default(); self.geometry.brick_samples()];
            let record = self.read_brick(key, &mut BrickScratch::default(), &mut samples)?;
            Ok((record, T::wrap(samples)))
        })
    }

    /// What payloads depend on.
    pub(super) fn decoding(&self) -> Decoding {
        Decoding::of(&self.metadata)
    }

    /// Checks that the store's samples are `T`.
    pub(crate) fn check_type<T: Sample>(&self) -> Result<(), StoreError> {
        let stored = self.metadata.sample_type;
        if T::TYPE == stored {
            Ok(())
        } else {
            Err(StoreError::SampleType { stored, asked: T::TYPE })
        }
    }

    /// The error for a damaged node of this store.
    pub(crate) fn damaged(&self, key: NodeKey, damage: Damage) -> StoreError {
        StoreError::Damaged { path: self.path.clone(), key, damage }
    }

    /// The record of `key` among its siblings' bytes.
    pub(super) fn record_in(&self, group: &[u8], key: NodeKey) -> Result<NodeRecord, StoreError> {
        let siblings = key.parent().children();
        let before =
            siblings[..key.octant()].iter().filter(|k| self.geometry.contains(**k)).count();
        let bytes = group
            .get(before * NodeRecord::BYTES..(before + 1) * NodeRecord::BYTES)
            .ok_or_else(|| self.damaged(key, Damage::RecordMissing))?;
        self.record(key, bytes)
    }

    /// The record of `key` that these bytes should be.
    fn record(&self, key: NodeKey, bytes: &[u8]) -> Result<NodeRecord, StoreError> {
        match NodeRecord::from_bytes(bytes) {
            Some(record) if record.key == key => Ok(record),
            Some(_) => Err(self.damaged(key, Damage::RecordOfAnotherNode)),
            None if bytes.iter().all(|byte| *byte == 0) => {
                Err(self.damaged(key, Damage::RecordMissing))
            }
            None => Err(self.damaged(key, Damage::RecordChecksum)),
        }
    }

    /// Reads a record's payload and checks it.
    pub(super) fn fetch_payload(
        &self,
        record: &NodeRecord,
        payload: &mut Vec<u8>,
    ) -> Result<(), StoreError> {
        let PayloadPlace { stream, offset, length } = record.place;
        if record.state == BrickState::Lost {
            return Err(self.damaged(record.key, Damage::Lost));
        }
        payload.clear();
        if length == 0 {
            return Ok(());
        }
        // What a damaged record asks for must not be allocated before it is there.
        let end = offset.checked_add(u64::from(length)).filter(|end| *end <= self.payload_bytes);
        let limit = 2 * self.geometry.brick_samples() * self.metadata.sample_type.bytes() + 1024;
        if length as usize > limit {
            return Err(self.damaged(record.key, Damage::Tree { what: "its payload's length" }));
        }
        if stream != 0 || end.is_none() {
            return Err(self.damaged(record.key, Damage::PayloadMissing { stream, offset }));
        }
        payload.resize(length as usize, 0);
        self.file.read_exact_at(payload, SUPERBLOCK_BYTES + offset).map_err(|source| {
            if source.kind() == io::ErrorKind::UnexpectedEof {
                self.damaged(record.key, Damage::PayloadMissing { stream, offset })
            } else {
                self.unreadable(record.key, source)
            }
        })?;
        payload::check(record, payload).map_err(|damage| self.damaged(record.key, damage))
    }

    /// The error for records that could not be read.
    fn at(&self, key: NodeKey, source: io::Error) -> StoreError {
        if source.kind() == io::ErrorKind::UnexpectedEof {
            self.damaged(key, Damage::RecordMissing)
        } else {
            self.unreadable(key, source)
        }
    }

    /// The error for what the system does not give back. Of a store's remains that is one damage more.
    fn unreadable(&self, key: NodeKey, source: io::Error) -> StoreError {
        match self.records {
            Records::Table(_) => StoreError::Unreadable { path: self.path.clone(), key, source },
            Records::Found(_) => self.damaged(key, Damage::Unreadable { what: source.to_string() }),
        }
    }
}
