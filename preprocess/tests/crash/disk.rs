//! A disk that fails at an operation, or loses power there. It keeps what was made durable apart from what was not,
//! so that after a power cut it can leave anything that a real one may.

use octree_store::{Disk, Operation, Watch};
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A disk tears a write between its sectors.
const SECTOR: usize = 512;

/// What goes wrong at an operation; stops and lack of room come at those alone that change something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// It fails, a write after its first half; what follows works.
    Fails,
    /// It and all later ones that need room fail, until there is room again.
    NoRoom,
    /// It and all later ones are not done: the program is killed, or the power is cut.
    Stops,
}

/// What is left after the program was stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Left {
    /// All that was done before: the program was killed.
    All,
    /// What was made durable: the power was cut.
    Durable,
    /// What was made durable, and some of the rest, in any order and in parts.
    Some,
}

/// Numbers that look random and are the same in every run.
#[derive(Debug)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, limit: u64) -> u64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }
}

#[derive(Debug, Clone)]
enum Change {
    Bytes(usize, Vec<u8>),
    Length(usize),
}

#[derive(Debug, Clone)]
enum NameChange {
    Create(PathBuf, usize),
    Rename(PathBuf, PathBuf),
    Remove(PathBuf),
}

#[derive(Debug, Default)]
struct Content {
    durable: Vec<u8>,
    /// In order; none of them is durable.
    changes: Vec<Change>,
}

type Names = BTreeMap<PathBuf, usize>;

#[derive(Debug)]
struct State {
    fault: Option<(u64, Fault)>,
    operations: u64,
    /// Of them, those that change something.
    changes: u64,
    reached: bool,
    stopped: bool,
    full: bool,
    contents: Vec<Content>,
    names: Names,
    durable_names: Names,
    name_changes: Vec<NameChange>,
}

/// The disk that all files of one folder lie on.
#[derive(Debug)]
pub(crate) struct FaultyDisk {
    folder: PathBuf,
    state: Mutex<State>,
}

fn apply(names: &mut Names, change: &NameChange) {
    match change {
        NameChange::Create(path, content) => {
            names.insert(path.clone(), *content);
        }
        NameChange::Rename(from, to) => {
            if let Some(content) = names.remove(from) {
                names.insert(to.clone(), content);
            }
        }
        NameChange::Remove(path) => {
            names.remove(path);
        }
    }
}

fn change(bytes: &mut Vec<u8>, change: &Change) {
    match change {
        Change::Bytes(at, new) => {
            bytes.resize(bytes.len().max(at + new.len()), 0);
            bytes[*at..at + new.len()].copy_from_slice(new);
        }
        Change::Length(length) => bytes.resize(*length, 0),
    }
}

impl FaultyDisk {
    /// A disk with what lies in a folder now, all of it durable.
    pub(crate) fn new(folder: &Path, fault: Option<(u64, Fault)>) -> Arc<Self> {
        let mut state = State {
            fault,
            operations: 0,
            changes: 0,
            reached: false,
            stopped: false,
            full: false,
            contents: Vec::new(),
            names: Names::new(),
            durable_names: Names::new(),
            name_changes: Vec::new(),
        };
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let durable = fs::read(&path).unwrap();
            state.names.insert(path, state.contents.len());
            state.contents.push(Content { durable, changes: Vec::new() });
        }
        state.durable_names = state.names.clone();
        Arc::new(Self { folder: folder.to_owned(), state: Mutex::new(state) })
    }

    pub(crate) fn disk(self: &Arc<Self>) -> Disk {
        Disk::watched(Arc::clone(self) as Arc<dyn Watch>)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the operation came at which something goes wrong.
    pub(crate) fn was_reached(&self) -> bool {
        self.state().reached
    }

    /// How often a fault could have come so far.
    pub(crate) fn chances(&self, fault: Fault) -> u64 {
        self.state().chances(fault)
    }

    /// Puts into the folder what is left after the program was stopped.
    pub(crate) fn restart(&self, left: Left, random: &mut Random) {
        if left == Left::All {
            return;
        }
        let state = self.state();
        let mut names = state.durable_names.clone();
        let mut contents: Vec<Vec<u8>> =
            state.contents.iter().map(|content| content.durable.clone()).collect();
        if left == Left::Some {
            // Names change in order: file systems keep a journal of them.
            let changes = random.below(state.name_changes.len() as u64 + 1) as usize;
            state.name_changes[..changes].iter().for_each(|change| apply(&mut names, change));
            for (bytes, content) in contents.iter_mut().zip(&state.contents) {
                for one in &content.changes {
                    match (one, random.below(4)) {
                        (_, 0) => {}
                        // Some of its sectors.
                        (Change::Bytes(at, new), 1) => {
                            let mut begin = 0;
                            while begin < new.len() {
                                let end =
                                    ((at + begin) / SECTOR * SECTOR + SECTOR - at).min(new.len());
                                if random.below(2) == 0 {
                                    change(
                                        bytes,
                                        &Change::Bytes(at + begin, new[begin..end].to_vec()),
                                    );
                                }
                                begin = end;
                            }
                        }
                        _ => change(bytes, one),
                    }
                }
            }
        }
        for entry in fs::read_dir(&self.folder).unwrap() {
            fs::remove_file(entry.unwrap().path()).unwrap();
        }
        for (path, content) in names {
            fs::write(path, &contents[content]).unwrap();
        }
    }
}

impl State {
    /// A stop before a read leaves what a stop before the next change does, and a read needs no room.
    fn chances(&self, fault: Fault) -> u64 {
        if fault == Fault::Fails { self.operations } else { self.changes }
    }

    /// The error with which an operation fails, if it is to.
    fn fails(&mut self, operation: Operation<'_>) -> Option<io::Error> {
        if self.stopped {
            return Some(io::Error::other("the program was stopped"));
        }
        let needs_room = match operation {
            Operation::Create(_) | Operation::Write { .. } => true,
            Operation::SetLength { path, bytes } => self.names.get(path).is_none_or(|content| {
                let content = &self.contents[*content];
                let mut all = content.durable.clone();
                content.changes.iter().for_each(|one| change(&mut all, one));
                bytes > all.len() as u64
            }),
            _ => false,
        };
        if self.full && needs_room {
            return Some(io::ErrorKind::StorageFull.into());
        }
        let reads = matches!(operation, Operation::Read { .. });
        self.operations += 1;
        self.changes += u64::from(!reads);
        let (_, fault) = self.fault.filter(|&(at, fault)| {
            at == self.chances(fault) && !(reads && fault != Fault::Fails)
        })?;
        self.reached = true;
        match fault {
            Fault::Fails => {}
            Fault::NoRoom => {
                self.full = true;
                return needs_room.then(|| io::ErrorKind::StorageFull.into());
            }
            Fault::Stops => self.stopped = true,
        }
        if let Operation::Write { path, offset, bytes } = operation {
            // It was on its way.
            let part = if fault == Fault::Stops { bytes } else { &bytes[..bytes.len() / 2] };
            if fault == Fault::Fails {
                let file = fs::File::options().write(true).open(path).unwrap();
                file.write_all_at(part, offset).unwrap();
            }
            self.change(path, Change::Bytes(offset as usize, part.to_vec()));
        }
        // The system's error for a disk that fails.
        Some(io::Error::from_raw_os_error(5))
    }

    fn change(&mut self, path: &Path, change: Change) {
        if let Some(content) = self.names.get(path) {
            self.contents[*content].changes.push(change);
        }
    }

    fn change_names(&mut self, change: NameChange) {
        apply(&mut self.names, &change);
        self.name_changes.push(change);
    }
}

impl Watch for FaultyDisk {
    fn before(&self, operation: Operation<'_>) -> io::Result<()> {
        let mut state = self.state();
        if let Some(error) = state.fails(operation) {
            return Err(error);
        }
        match operation {
            Operation::Read { .. } => {}
            Operation::Write { path, offset, bytes } => {
                state.change(path, Change::Bytes(offset as usize, bytes.to_vec()));
            }
            Operation::SetLength { path, bytes } => {
                state.change(path, Change::Length(bytes as usize));
            }
            Operation::Sync(path) => {
                if let Some(&content) = state.names.get(path) {
                    let Content { durable, changes } = &mut state.contents[content];
                    for one in &std::mem::take(changes) {
                        change(durable, one);
                    }
                }
            }
            Operation::Create(path) => {
                let content = state.contents.len();
                state.contents.push(Content::default());
                state.change_names(NameChange::Create(path.to_owned(), content));
            }
            Operation::Rename { from, to } => {
                state.change_names(NameChange::Rename(from.to_owned(), to.to_owned()));
            }
            Operation::Remove(path) => state.change_names(NameChange::Remove(path.to_owned())),
            Operation::SyncFolder(_) => {
                state.durable_names = state.names.clone();
                state.name_changes.clear();
            }
        }
        Ok(())
    }
}
