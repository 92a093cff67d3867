//! Which stores there are: looked up by name alone, so that no request can name a file.
//!
//! Folders are looked at again and again. A store that is new or was replaced is opened, one that is gone is
//! forgotten; requests under way keep the one that they began with. What cannot be opened harms only itself.

use crate::dataset::{Dataset, Named, PIN_DIGITS};
use crate::handles::Handles;
use crate::problem::Problem;
use octree_store::StoreError;
use std::collections::{BTreeMap, HashSet};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

/// Tells a file from the one that was there before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Fingerprint {
    device: u64,
    inode: u64,
    bytes: u64,
    modified: (i64, i64),
}

impl Fingerprint {
    fn of(path: &Path) -> io::Result<Self> {
        let meta = std::fs::metadata(path)?;
        Ok(Self {
            device: meta.dev(),
            inode: meta.ino(),
            bytes: meta.len(),
            modified: (meta.mtime(), meta.mtime_nsec()),
        })
    }
}

/// A store by name, open or not.
#[derive(Debug, Clone)]
pub(crate) enum Entry {
    Open(Arc<Dataset>),
    Broken(Problem),
}

#[derive(Debug, Clone)]
struct Listed {
    path: PathBuf,
    /// None where the file is to be opened again, whether it changed or not.
    fingerprint: Option<Fingerprint>,
    entry: Entry,
}

/// All stores that are served.
#[derive(Debug)]
pub(crate) struct Catalog {
    roots: Vec<PathBuf>,
    entries: RwLock<Arc<BTreeMap<String, Listed>>>,
    /// Held by who looks: files that were passed over, and said to be.
    scanning: Mutex<HashSet<PathBuf>>,
    next_id: AtomicU64,
    pub(crate) handles: Handles,
}

impl Catalog {
    /// Stores and folders, looked at for the first time; so many stores are open at once.
    pub(crate) fn new(roots: Vec<PathBuf>, open_stores: usize) -> Self {
        let catalog = Self {
            roots,
            entries: RwLock::default(),
            scanning: Mutex::default(),
            next_id: AtomicU64::new(0),
            handles: Handles::new(open_stores),
        };
        catalog.rescan();
        catalog
    }

    fn snapshot(&self) -> Arc<BTreeMap<String, Listed>> {
        Arc::clone(&self.entries.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Looks at folders and stores again. Reads files: for a thread that may wait.
    pub(crate) fn rescan(&self) {
        let mut told = self.scanning.lock().unwrap_or_else(PoisonError::into_inner);
        let before = self.snapshot();
        let (mut found, mut passed) = (BTreeMap::new(), HashSet::new());
        let mut pass_over = |path: PathBuf, why: &str| {
            if !told.contains(&path) {
                tracing::warn!(path = %path.display(), "passed over: {why}");
            }
            passed.insert(path);
        };
        for path in self.files(&before) {
            let Some(name) = path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned)
            else {
                pass_over(path, "its name is no UTF-8");
                continue;
            };
            if let Some(Listed { path: other, .. }) = found.get(&name) {
                if *other != path {
                    pass_over(path, &format!("{} has its name", other.display()));
                }
                continue;
            }
            let old = before.get(&name).filter(|old| old.path == path);
            let listed = match (Fingerprint::of(&path), old) {
                (Ok(now), Some(old)) if old.fingerprint == Some(now) => old.clone(),
                (Ok(now), old) => {
                    let again = old.is_some_and(|old| old.fingerprint.is_none());
                    self.open(&name, path, now, again)
                }
                (Err(error), _) if error.kind() == io::ErrorKind::NotFound => continue,
                // Nothing says that it changed.
                (Err(_), Some(old)) => old.clone(),
                (Err(_), None) => continue,
            };
            found.insert(name, listed);
        }
        *told = passed;
        let served: HashSet<u64> = found
            .values()
            .filter_map(|listed| match &listed.entry {
                Entry::Open(dataset) => Some(dataset.id),
                Entry::Broken(_) => None,
            })
            .collect();
        *self.entries.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(found);
        self.handles.retain(|id| served.contains(&id));
    }

    /// The stores' files: those that were named, and those that lie in folders that were. Of a folder that cannot be
    /// read now, those that it had before.
    fn files(&self, before: &BTreeMap<String, Listed>) -> Vec<PathBuf> {
        let mut files = Vec::new();
        for root in &self.roots {
            if !root.is_dir() {
                files.push(root.clone());
                continue;
            }
            let Ok(folder) = std::fs::read_dir(root) else {
                let known = before.values().map(|listed| &listed.path);
                files.extend(known.filter(|path| path.parent() == Some(root)).cloned());
                continue;
            };
            let mut inside: Vec<PathBuf> = folder
                .filter_map(|entry| Some(entry.ok()?.path()))
                .filter(|path| path.extension().is_some_and(|extension| extension == "octavo"))
                // A link could lead out of the folder, and only what is in it is to be served.
                .filter(|path| path.symlink_metadata().is_ok_and(|meta| meta.is_file()))
                .collect();
            inside.sort();
            files.extend(inside);
        }
        files
    }

    /// Opens a store, `again` where that failed before and was said.
    fn open(&self, name: &str, path: PathBuf, fingerprint: Fingerprint, again: bool) -> Listed {
        match Handles::open(&path) {
            Ok(store) => {
                tracing::info!(dataset = name, "opened");
                let id = self.next_id.fetch_add(1, Ordering::Relaxed);
                let dataset = Dataset::new(id, name.to_owned(), &store, fingerprint.bytes);
                self.handles.keep(id, store);
                let entry = Entry::Open(Arc::new(dataset));
                Listed { path, fingerprint: Some(fingerprint), entry }
            }
            Err(error) => {
                if !again {
                    tracing::warn!(dataset = name, %error, "cannot be opened");
                }
                // The system may read it the next time, and the file be the same.
                let lasting = !matches!(error, StoreError::Io { .. });
                let entry = Entry::Broken(Problem::of_store(&error));
                Listed { path, fingerprint: lasting.then_some(fingerprint), entry }
            }
        }
    }

    /// All stores, by name.
    pub(crate) fn list(&self) -> Vec<(String, Entry)> {
        let entries = self.snapshot();
        entries.iter().map(|(name, listed)| (name.clone(), listed.entry.clone())).collect()
    }

    /// The store that an address names: `NAME`, or `NAME@` and the first 16 digits of its digest.
    pub(crate) fn find(&self, name: &str) -> Result<Named, Problem> {
        let entries = self.snapshot();
        if let Some(listed) = entries.get(name) {
            return match &listed.entry {
                Entry::Open(dataset) => Ok(Named { dataset: Arc::clone(dataset), pinned: false }),
                Entry::Broken(problem) => Err(problem.clone()),
            };
        }
        if let Some((name, pin)) = name.rsplit_once('@')
            && pin.len() == PIN_DIGITS
            && let Some(Listed { entry: Entry::Open(dataset), .. }) = entries.get(name)
        {
            return if dataset.version() == pin {
                Ok(Named { dataset: Arc::clone(dataset), pinned: true })
            } else {
                Err(Problem::absent("the dataset has been replaced by one of other content"))
            };
        }
        Err(Problem::absent("no dataset has this name"))
    }
}
