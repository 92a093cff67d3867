//! The records of a finished store: one after the other in key order, so that a node's place is its rank.
//!
//! Nothing but arithmetic leads to a record, and each names its node and has a checksum. So what is damaged
//! harms the records that it lies in, and no bytes of a file can make a reader go astray, wait, or take memory.

use crate::disk::DiskFile;
use crate::geometry::Geometry;
use crate::key::NodeKey;
use crate::record::NodeRecord;
use std::io;
use std::sync::Arc;

/// Records that are read at a time by one who wants all of a level.
const BLOCK: usize = 512;

/// The table in its file.
#[derive(Debug)]
pub(super) struct RecordTable {
    pub(super) file: Arc<DiskFile>,
    /// Where it begins.
    pub(super) offset: u64,
    pub(super) geometry: Geometry,
}

impl RecordTable {
    /// Bytes of the table of a volume.
    pub(super) fn bytes(geometry: &Geometry) -> Option<u64> {
        geometry.bricks().checked_mul(NodeRecord::BYTES as u64)
    }

    /// The records beneath a node, in octant order; all that the volume has.
    pub(super) fn group(&self, parent: NodeKey) -> io::Result<Vec<u8>> {
        let children = parent.children().into_iter().filter(|key| self.geometry.contains(*key));
        let mut bytes = vec![0; NodeRecord::BYTES * children.count()];
        // The first child exists wherever its parent does.
        self.read(parent.children()[0], &mut bytes)?;
        Ok(bytes)
    }

    /// Calls `visit` with each node of a level and the bytes of its record, in key order, until it returns false.
    /// Of records that cannot be read the error has the first.
    pub(super) fn visit(
        &self,
        level: u8,
        visit: &mut dyn FnMut(NodeKey, &[u8]) -> bool,
    ) -> Result<(), (NodeKey, io::Error)> {
        let mut keys = self.geometry.keys_at(level).peekable();
        let mut left = self.geometry.bricks_at(level);
        let mut bytes = Vec::new();
        while let Some(first) = keys.peek().copied() {
            let count = left.min(BLOCK as u64);
            left -= count;
            bytes.resize(NodeRecord::BYTES * count as usize, 0);
            self.read(first, &mut bytes).map_err(|error| (first, error))?;
            for (record, key) in bytes.chunks_exact(NodeRecord::BYTES).zip(&mut keys) {
                if !visit(key, record) {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Reads records from that of `first` on.
    fn read(&self, first: NodeKey, bytes: &mut [u8]) -> io::Result<()> {
        let at = self.geometry.rank(first) * NodeRecord::BYTES as u64;
        self.file.read_exact_at(bytes, self.offset + at)
    }
}
