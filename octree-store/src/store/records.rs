//! Where a store's records come from: its index, or, where that may be damaged, what is found of them in the file.

use super::guard::Failure;
use super::remains::FoundRecords;
use super::tables::ReadTables;
use redb::ReadOnlyDatabase;
use std::ops::RangeInclusive;

/// The records of a store that is open.
pub(super) enum Records {
    /// Its index.
    Index {
        tables: Box<ReadTables>,
        /// What the tables read from.
        _database: ReadOnlyDatabase,
    },
    /// Those that are whole, wherever they lie.
    Found(FoundRecords),
}

impl Records {
    /// The records beneath one parent, in octant order. One that was not found is zeros.
    pub(super) fn nodes(&self, parent: u64) -> Result<Option<Vec<u8>>, Failure> {
        match self {
            Self::Index { tables, .. } => tables.nodes(parent),
            Self::Found(found) => found.nodes(parent),
        }
    }

    /// Calls `visit` with (parent, records) in key order until it returns false.
    pub(super) fn visit_nodes(
        &self,
        parents: RangeInclusive<u64>,
        mut visit: impl FnMut(u64, &[u8]) -> bool,
    ) -> Result<(), Failure> {
        match self {
            Self::Index { tables, .. } => tables.visit_nodes(parents, visit),
            Self::Found(found) => found.visit_nodes(parents, &mut visit),
        }
    }
}
