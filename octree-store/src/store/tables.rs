//! The redb tables: the one file that names them (FORMAT.md, "Tables").

use super::guard::{Failure, guard};
use redb::{
    Database, Durability, ReadOnlyTable, ReadTransaction, ReadableDatabase, ReadableTable, Table,
    TableDefinition, WriteTransaction,
};
use std::ops::RangeInclusive;

/// One record: the metadata frame, under key 0.
const META: TableDefinition<u64, &[u8]> = TableDefinition::new("meta");
/// Node records of up to eight siblings in octant order, keyed by their parent's [`crate::NodeKey`].
const NODES: TableDefinition<u64, &[u8]> = TableDefinition::new("nodes");
/// Pages of the payload streams, keyed by stream and page number.
const PAYLOAD: TableDefinition<u64, &[u8]> = TableDefinition::new("payload");

const META_KEY: u64 = 0;

/// The tables of one snapshot of a store; shared freely between threads.
pub(super) struct ReadTables {
    nodes: ReadOnlyTable<u64, &'static [u8]>,
    payload: ReadOnlyTable<u64, &'static [u8]>,
    transaction: ReadTransaction,
}

impl ReadTables {
    pub(super) fn open(database: &impl ReadableDatabase) -> Result<Self, Failure> {
        let transaction = guard(|| database.begin_read())?;
        let nodes = guard(|| transaction.open_table(NODES))?;
        let payload = guard(|| transaction.open_table(PAYLOAD))?;
        Ok(Self { nodes, payload, transaction })
    }

    pub(super) fn metadata(&self) -> Result<Option<Vec<u8>>, Failure> {
        let meta = guard(|| self.transaction.open_table(META))?;
        guard(|| Ok::<_, redb::Error>(meta.get(META_KEY)?.map(|value| value.value().to_vec())))
    }

    /// The records beneath one parent. They are copied: looking at a damaged page can panic too.
    pub(super) fn nodes(&self, parent: u64) -> Result<Option<Vec<u8>>, Failure> {
        guard(|| Ok::<_, redb::Error>(self.nodes.get(parent)?.map(|value| value.value().to_vec())))
    }

    /// Calls `visit` with (parent, records) in key order until it returns false.
    pub(super) fn visit_nodes(
        &self,
        parents: RangeInclusive<u64>,
        mut visit: impl FnMut(u64, &[u8]) -> bool,
    ) -> Result<(), Failure> {
        let mut groups = guard(|| self.nodes.range(parents))?;
        loop {
            let next = guard(|| {
                let Some((parent, records)) = groups.next().transpose()? else { return Ok(None) };
                Ok::<_, redb::Error>(Some((parent.value(), records.value().to_vec())))
            })?;
            match next {
                Some((parent, records)) if visit(parent, &records) => {}
                _ => return Ok(()),
            }
        }
    }

    /// Calls `visit` with every page of a range of keys, in order, until it returns false.
    pub(super) fn visit_pages(
        &self,
        pages: RangeInclusive<u64>,
        mut visit: impl FnMut(u64, &[u8]) -> bool,
    ) -> Result<(), Failure> {
        guard(|| {
            for page in self.payload.range(pages)? {
                let (key, bytes) = page?;
                if !visit(key.value(), bytes.value()) {
                    break;
                }
            }
            Ok::<_, redb::Error>(())
        })
    }
}

/// One write transaction; nothing is durable before [`WriteTables::commit`].
pub(super) struct WriteTables(WriteTransaction);

impl WriteTables {
    /// Begins a transaction that will survive a power cut once committed.
    pub(super) fn begin(database: &Database) -> Result<Self, Failure> {
        let mut transaction = guard(|| database.begin_write())?;
        guard(|| transaction.set_durability(Durability::Immediate))?;
        // Opening after a kill then takes a millisecond instead of a scan of the file.
        transaction.set_quick_repair(true);
        for table in [META, NODES, PAYLOAD] {
            guard(|| transaction.open_table(table).map(drop))?;
        }
        Ok(Self(transaction))
    }

    /// Runs `write` with the nodes and payload tables.
    pub(super) fn write(
        &self,
        write: impl FnOnce(
            &mut Table<u64, &'static [u8]>,
            &mut Table<u64, &'static [u8]>,
        ) -> Result<(), redb::Error>,
    ) -> Result<(), Failure> {
        guard(|| write(&mut self.0.open_table(NODES)?, &mut self.0.open_table(PAYLOAD)?))
    }

    pub(super) fn set_metadata(&self, bytes: &[u8]) -> Result<(), Failure> {
        guard(|| {
            self.0.open_table(META)?.insert(META_KEY, bytes)?;
            Ok::<_, redb::Error>(())
        })
    }

    /// Calls `visit` with (parent, records) of the whole tree in key order.
    pub(super) fn visit_nodes(&self, mut visit: impl FnMut(&[u8])) -> Result<(), Failure> {
        guard(|| {
            for group in self.0.open_table(NODES)?.iter()? {
                visit(group?.1.value());
            }
            Ok::<_, redb::Error>(())
        })
    }

    pub(super) fn commit(self) -> Result<(), Failure> {
        guard(|| self.0.commit())
    }
}
