//! Writing a store: payloads to the file, records to a work index beside it, and both put together
//! at the end (`finish.rs`).

use super::committer::{Commit, Committer};
use super::finish::AllRecords;
use super::guard::{Failure, guard};
use super::payload_file::PayloadFile;
use super::superblock::{SUPERBLOCK_BYTES, Superblock};
use super::tables::{Group, ReadTables};
use super::work_backend::WorkBackend;
use crate::disk::{Disk, DiskFile};
use crate::error::StoreError;
use crate::key::NodeKey;
use crate::metadata::Metadata;
use crate::record::{NodeRecord, PayloadPlace};
use redb::{Builder, Database};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// redb's page cache while writing; records are small, and come nearly in order.
const WRITER_CACHE_BYTES: usize = 8 << 20;

/// Writes one store from beginning to end.
///
/// Bricks come as groups of siblings ([`StoreWriter::append`]), best in the order in which they
/// will be read. Until [`StoreWriter::finish`] returns, the file is an incomplete store that
/// [`crate::Store::open`] refuses. Its records are in a redb file of their own until then; what was
/// committed ([`StoreWriter::commit`]) survives a power cut, and [`StoreWriter::resume`] goes on
/// from there.
#[derive(Debug)]
pub struct StoreWriter {
    path: PathBuf,
    file: Arc<DiskFile>,
    payloads: PayloadFile,
    work_path: PathBuf,
    committer: Committer,
    /// Records that no commit has taken yet.
    groups: Vec<Group>,
    uncommitted_bytes: u64,
}

/// What a store in the making holds already.
#[derive(Debug)]
pub struct Committed {
    /// The caller's own state at the last commit.
    pub state: Vec<u8>,
    /// What the caller wanted to be kept of each parent, in key order.
    pub progress: Vec<(NodeKey, Vec<u8>)>,
}

impl StoreWriter {
    /// Bytes of memory that a writer takes for a store of so many bricks, of which the records of
    /// `waiting` wait for a commit or are being committed.
    ///
    /// Measured: a record takes 160 bytes while it waits, and about as many in redb's cache of the work index, up to
    /// its limit; there twice as many again when that is put in order and read at the end, with a few bytes a record.
    pub fn memory_bytes(bricks: u64, waiting: u64) -> u64 {
        const RECORD_BYTES: u64 = 160;
        let cache = WRITER_CACHE_BYTES as u64;
        let records = RECORD_BYTES * bricks;
        let index = records.min(2 * cache) + 5 * bricks;
        (256 << 10)
            + records.min(cache)
            + index.max(RECORD_BYTES * waiting)
            + PayloadFile::BUFFER_BYTES as u64
    }

    /// Creates an empty store in a new file, with a work index in another. `synced` are files that
    /// every commit makes durable too.
    ///
    /// # Errors
    /// When a file exists or cannot be created.
    pub fn create(
        path: &Path,
        work_path: &Path,
        synced: Vec<DiskFile>,
    ) -> Result<Self, StoreError> {
        let file = Disk::default().create_new(path).map_err(|source| io_at(path, source))?;
        lock(&file, path)?;
        Self::create_in(file, path, work_path, synced).inspect_err(|_| {
            // A file without content is of no use to anyone; the error says what is wrong.
            let _ = std::fs::remove_file(path);
        })
    }

    /// As [`StoreWriter::create`], in the empty file at `path`, which the caller has opened and locked.
    ///
    /// # Errors
    /// When the work index exists or cannot be created, or the file cannot be written.
    pub fn create_in(
        file: DiskFile,
        path: &Path,
        work_path: &Path,
        synced: Vec<DiskFile>,
    ) -> Result<Self, StoreError> {
        Superblock::unfinished().write(&file).map_err(|source| io_at(path, source))?;
        let work = file.disk().create_new(work_path).map_err(|source| io_at(work_path, source))?;
        let database = create_database(work, work_path, false)?;
        Self::new(path, work_path, file, database, synced, 0)
    }

    /// Goes on with a store in the making; `None` where nothing of it was committed. What was
    /// appended after the last commit is cut off.
    ///
    /// # Errors
    /// When a file cannot be read or written, is in use, or is no store in the making.
    pub fn resume(
        path: &Path,
        work_path: &Path,
        synced: Vec<DiskFile>,
    ) -> Result<Option<(Self, Committed)>, StoreError> {
        let file = Disk::default().open_to_write(path).map_err(|source| io_at(path, source))?;
        lock(&file, path)?;
        Self::resume_in(file, path, work_path, synced)
    }

    /// As [`StoreWriter::resume`], of the file at `path`, which the caller has opened and locked.
    ///
    /// # Errors
    /// When a file cannot be read or written, or is no store in the making. All of the work index is
    /// checked against its checksums.
    pub fn resume_in(
        file: DiskFile,
        path: &Path,
        work_path: &Path,
        synced: Vec<DiskFile>,
    ) -> Result<Option<(Self, Committed)>, StoreError> {
        let work =
            file.disk().open_to_write(work_path).map_err(|source| io_at(work_path, source))?;
        if !is_begun(&work).map_err(|source| io_at(work_path, source))? {
            return Ok(None);
        }
        let database = create_database(work, work_path, true)?;
        let at_work = |failure: Failure| failure.at(work_path);
        let Some(tables) = ReadTables::open(&database).map_err(at_work)? else {
            return Ok(None);
        };
        let Some(state) = tables.state().map_err(at_work)? else { return Ok(None) };
        let mut progress = Vec::new();
        tables
            .visit_progress(|parent, bytes| {
                progress.extend(NodeKey::from_u64(parent).map(|key| (key, bytes.to_vec())));
                true
            })
            .map_err(at_work)?;
        drop(tables);
        let Some((payload_bytes, state)) = split_state(&state) else {
            let what = "its state is cut short".into();
            return Err(StoreError::MetadataDamaged { path: work_path.to_owned(), what });
        };
        let length = file.length().map_err(|source| io_at(path, source))?;
        if length < SUPERBLOCK_BYTES + payload_bytes {
            let what = format!(
                "it has {length} bytes, and {} were committed",
                SUPERBLOCK_BYTES + payload_bytes
            );
            return Err(StoreError::MetadataDamaged { path: path.to_owned(), what });
        }
        file.set_len(SUPERBLOCK_BYTES + payload_bytes).map_err(|source| io_at(path, source))?;
        Superblock::unfinished().write(&file).map_err(|source| io_at(path, source))?;
        let writer = Self::new(path, work_path, file, database, synced, payload_bytes)?;
        Ok(Some((writer, Committed { state: state.to_vec(), progress })))
    }

    fn new(
        path: &Path,
        work_path: &Path,
        file: DiskFile,
        database: Database,
        synced: Vec<DiskFile>,
        payload_bytes: u64,
    ) -> Result<Self, StoreError> {
        let file = Arc::new(file);
        let payloads = PayloadFile::open(Arc::clone(&file), payload_bytes)
            .map_err(|source| io_at(path, source))?;
        let mut files: Vec<_> = synced.into_iter().map(Arc::new).collect();
        files.push(Arc::clone(&file));
        Ok(Self {
            path: path.to_owned(),
            work_path: work_path.to_owned(),
            committer: Committer::start(database, files, work_path)?,
            file,
            payloads,
            groups: Vec::new(),
            uncommitted_bytes: 0,
        })
    }

    /// Bytes of payload that were appended since the last commit.
    pub fn uncommitted_bytes(&self) -> u64 {
        self.uncommitted_bytes
    }

    /// Appends bricks that share a parent: every child the parent has, in octant order. `payloads`
    /// holds their payloads one after the other, as long as the records say; each one's place is
    /// written into its record. `progress` is what is to be kept of the parent for one who resumes;
    /// it may be empty.
    ///
    /// # Errors
    /// When the file cannot be written.
    ///
    /// # Panics
    /// When the bricks do not share a parent or are out of order, or the payloads have another length.
    pub fn append(
        &mut self,
        siblings: &mut [NodeRecord],
        payloads: &[u8],
        progress: Vec<u8>,
    ) -> Result<(), StoreError> {
        let Some(parent) = siblings.first().map(|record| record.key.parent()) else {
            return Ok(());
        };
        assert!(
            siblings.iter().all(|record| record.key.parent() == parent)
                && siblings.is_sorted_by_key(|record| record.key),
            "siblings share a parent and come in order"
        );
        let begin = self.payloads.bytes();
        let mut offset = begin;
        let mut records = Vec::with_capacity(siblings.len() * NodeRecord::BYTES);
        for record in siblings {
            let length = record.place.length;
            record.place = match length {
                0 => PayloadPlace::default(),
                _ => PayloadPlace { stream: 0, offset, length },
            };
            offset += u64::from(length);
            records.extend_from_slice(&record.to_bytes());
        }
        assert_eq!(offset - begin, payloads.len() as u64, "the records' lengths");
        self.payloads.append(payloads).map_err(|source| io_at(&self.path, source))?;
        self.uncommitted_bytes += payloads.len() as u64;
        self.groups.push(Group { parent: parent.to_u64(), records, progress });
        Ok(())
    }

    /// Begins to make everything appended so far durable, with the caller's own `state`, which
    /// [`StoreWriter::resume`] gives back. `mark` is what [`StoreWriter::durable_mark`] answers then.
    ///
    /// # Errors
    /// When this commit or an earlier one cannot be written.
    pub fn commit(&mut self, state: &[u8], mark: u64) -> Result<(), StoreError> {
        let groups = std::mem::take(&mut self.groups);
        self.payloads.flush().map_err(|source| io_at(&self.path, source))?;
        let state = [&self.payloads.bytes().to_le_bytes(), state].concat();
        self.uncommitted_bytes = 0;
        self.committer.send(Commit { groups, state, mark })
    }

    /// The mark of the last commit that is durable; 0 before the first.
    ///
    /// # Errors
    /// When a commit could not be written.
    pub fn durable_mark(&mut self) -> Result<u64, StoreError> {
        self.committer.mark()
    }

    /// The mark of the last commit that is known to be durable, whatever became of later ones; 0 before the first.
    pub fn last_durable_mark(&self) -> u64 {
        self.committer.last_mark()
    }

    /// Waits until every commit that was begun is durable.
    ///
    /// # Errors
    /// When one of them cannot be written.
    pub fn wait(&mut self) -> Result<(), StoreError> {
        self.committer.wait()
    }

    /// Sums up the records, writes metadata and records behind the payloads, and marks the store complete.
    /// Returns the metadata as written: with levels, errors and digest. The work index stays: it is
    /// of no use once the store has its final name.
    ///
    /// # Errors
    /// When the file cannot be written, the metadata describes no volume, or bricks of it are missing.
    pub fn finish(mut self, mut metadata: Metadata) -> Result<Metadata, StoreError> {
        self.payloads.flush().map_err(|source| io_at(&self.path, source))?;
        // What no commit has taken does not go into the work index: records there that its state does
        // not count would mislead one who resumes after a kill in here.
        let Self { path, work_path, file, payloads, committer, mut groups, .. } = self;
        let payload_bytes = payloads.bytes();
        let work = committer.finish()?;
        groups.sort_unstable_by_key(|group| group.parent);
        let committed = ReadTables::open(&work).map_err(|failure| failure.at(&work_path))?;
        let all = AllRecords {
            path: &path,
            work_path: &work_path,
            committed: committed.as_ref(),
            groups,
        };
        let unusable = |what: String| StoreError::MetadataDamaged { path: path.clone(), what };
        let geometry = metadata.geometry().map_err(|error| unusable(error.to_string()))?;
        all.sum_up(&geometry, &mut metadata)?;
        let frame = metadata.to_bytes();
        // A store that cannot be read again must not become complete.
        Metadata::from_bytes(&frame).map_err(|error| unusable(error.to_string()))?;
        all.write_behind(&file, payload_bytes, &geometry, &frame)?;
        Ok(metadata)
    }
}

pub(super) fn io_at(path: &Path, source: io::Error) -> StoreError {
    StoreError::Io { path: path.to_owned(), source }
}

/// Locks a file that is being written; the lock goes with the file.
fn lock(file: &DiskFile, path: &Path) -> Result<(), StoreError> {
    match file.file().try_lock() {
        Ok(()) => Ok(()),
        Err(std::fs::TryLockError::WouldBlock) => Err(StoreError::InUse { path: path.to_owned() }),
        Err(std::fs::TryLockError::Error(source)) => Err(io_at(path, source)),
    }
}

/// Whether redb's file was ever ready to hold anything: its first bytes are written last, so that a kill
/// before that leaves zeros.
fn is_begun(file: &DiskFile) -> io::Result<bool> {
    let mut magic = [0; 9];
    match file.read_exact_at(&mut magic, 0) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        read => read.map(|()| magic != [0; 9]),
    }
}

/// Opens redb's file, in order after a kill, or a new one; `checked` reads all of it.
fn create_database(file: DiskFile, path: &Path, checked: bool) -> Result<Database, StoreError> {
    guard(|| {
        Builder::new()
            .set_cache_size(WRITER_CACHE_BYTES)
            .set_check_integrity_on_open(checked)
            .create_with_backend(WorkBackend(file))
    })
    .map_err(|failure| failure.at(path))
}

/// The payload's length and the caller's state.
fn split_state(state: &[u8]) -> Option<(u64, &[u8])> {
    let (length, state) = state.split_first_chunk::<8>()?;
    Some((u64::from_le_bytes(*length), state))
}
