//! The tables of a work index, a redb database: the one file that names them (FORMAT.md, "Work in progress").

use super::guard::{Failure, guard};
use redb::{
    Database, Durability, ReadOnlyTable, ReadTransaction, ReadableDatabase, TableDefinition,
    TableError, WriteTransaction,
};

/// One value: how far the work is.
const META: TableDefinition<u64, &[u8]> = TableDefinition::new("meta");
/// Node records of up to eight siblings in octant order, keyed by their parent's [`crate::NodeKey`].
const NODES: TableDefinition<u64, &[u8]> = TableDefinition::new("nodes");
/// What is known of a parent before its own record is written.
const PROGRESS: TableDefinition<u64, &[u8]> = TableDefinition::new("progress");

const STATE_KEY: u64 = 1;

/// The tables of a snapshot of a work index.
pub(super) struct ReadTables {
    nodes: ReadOnlyTable<u64, &'static [u8]>,
    transaction: ReadTransaction,
}

impl ReadTables {
    /// `None` where nothing was ever committed.
    pub(super) fn open(database: &impl ReadableDatabase) -> Result<Option<Self>, Failure> {
        let transaction = guard(|| database.begin_read())?;
        let nodes = guard(|| existing(transaction.open_table(NODES)))?;
        Ok(nodes.map(|nodes| Self { nodes, transaction }))
    }

    /// How far the work is.
    pub(super) fn state(&self) -> Result<Option<Vec<u8>>, Failure> {
        let table = guard(|| self.transaction.open_table(META))?;
        guard(|| Ok::<_, redb::Error>(table.get(STATE_KEY)?.map(|value| value.value().to_vec())))
    }

    /// Calls `visit` with (parent, records) in key order until it returns false.
    fn visit_nodes(&self, visit: impl FnMut(u64, &[u8]) -> bool) -> Result<(), Failure> {
        Self::visit(&self.nodes, visit)
    }

    /// Calls `visit` with (parent, what is known of it), until it returns false.
    /// Where nothing was kept of any parent there is no such table.
    pub(super) fn visit_progress(
        &self,
        visit: impl FnMut(u64, &[u8]) -> bool,
    ) -> Result<(), Failure> {
        let table = guard(|| existing(self.transaction.open_table(PROGRESS)))?;
        let Some(table) = table else { return Ok(()) };
        Self::visit(&table, visit)
    }

    fn visit(
        table: &ReadOnlyTable<u64, &'static [u8]>,
        mut visit: impl FnMut(u64, &[u8]) -> bool,
    ) -> Result<(), Failure> {
        let mut values = guard(|| table.range(0..=u64::MAX))?;
        loop {
            let next = guard(|| {
                let Some((key, value)) = values.next().transpose()? else { return Ok(None) };
                Ok::<_, redb::Error>(Some((key.value(), value.value().to_vec())))
            })?;
            match next {
                Some((key, value)) if visit(key, &value) => {}
                _ => return Ok(()),
            }
        }
    }
}

/// A table, or `None` where there is none of its name.
fn existing<T>(table: Result<T, TableError>) -> Result<Option<T>, TableError> {
    match table {
        Err(TableError::TableDoesNotExist(_)) => Ok(None),
        table => table.map(Some),
    }
}

/// The records of one octet, and what is known of its parent.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub(super) parent: u64,
    pub(super) records: Vec<u8>,
    /// Empty where nothing is to be kept.
    pub(super) progress: Vec<u8>,
}

/// Calls `visit` with the records of one parent after the other, in key order: of groups that were `committed` to a
/// work index, and of `last`, in key order too, which no commit has taken.
pub(super) fn visit_all(
    committed: Option<&ReadTables>,
    last: &[Group],
    mut visit: impl FnMut(&[u8]) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let mut last = last.iter().peekable();
    let mut outcome = Ok(());
    if let Some(committed) = committed {
        committed.visit_nodes(|parent, records| {
            while let Some(group) = last.next_if(|group| group.parent < parent)
                && outcome.is_ok()
            {
                outcome = visit(&group.records);
            }
            if outcome.is_ok() {
                outcome = visit(records);
            }
            outcome.is_ok()
        })?;
    }
    outcome?;
    last.try_for_each(|group| visit(&group.records))
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
        for table in [META, NODES] {
            guard(|| transaction.open_table(table).map(drop))?;
        }
        Ok(Self(transaction))
    }

    /// Writes groups of records.
    pub(super) fn write_groups(&self, groups: &[Group]) -> Result<(), Failure> {
        guard(|| {
            let mut nodes = self.0.open_table(NODES)?;
            for group in groups {
                nodes.insert(group.parent, group.records.as_slice())?;
            }
            let mut kept = groups.iter().filter(|group| !group.progress.is_empty()).peekable();
            if kept.peek().is_some() {
                let mut progress = self.0.open_table(PROGRESS)?;
                for group in kept {
                    progress.insert(group.parent, group.progress.as_slice())?;
                }
            }
            Ok::<_, redb::Error>(())
        })
    }

    pub(super) fn set_state(&self, bytes: &[u8]) -> Result<(), Failure> {
        guard(|| {
            self.0.open_table(META)?.insert(STATE_KEY, bytes)?;
            Ok::<_, redb::Error>(())
        })
    }

    pub(super) fn commit(self) -> Result<(), Failure> {
        guard(|| self.0.commit())
    }
}
