//! Where a store's records come from: its table, or, where that may be damaged, what is found of them in the file.

use super::record_table::RecordTable;
use super::remains::FoundRecords;
use crate::key::NodeKey;
use std::io;

/// The records of a store that is open. One that is not there is zeros.
#[derive(Debug)]
pub(super) enum Records {
    /// Its table.
    Table(RecordTable),
    /// Those that are whole, wherever they lie.
    Found(FoundRecords),
}

impl Records {
    /// The records beneath a node, one after the other in octant order.
    pub(super) fn group(&self, parent: NodeKey) -> io::Result<Vec<u8>> {
        match self {
            Self::Table(table) => table.group(parent),
            Self::Found(found) => Ok(found.group(parent)),
        }
    }

    /// Calls `visit` with each node of a level and the bytes of its record, in key order, until it returns false.
    pub(super) fn visit(
        &self,
        level: u8,
        visit: &mut dyn FnMut(NodeKey, &[u8]) -> bool,
    ) -> Result<(), (NodeKey, io::Error)> {
        match self {
            Self::Table(table) => table.visit(level, visit),
            Self::Found(found) => {
                found.visit(level, visit);
                Ok(())
            }
        }
    }
}
