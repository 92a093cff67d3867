//! Which stores there are: looked up by name alone, so that no request can name a file.
//!
//! Folders are looked at again and again. A store that is new or was replaced is opened, one that is gone is
//! forgotten; requests under way keep the one that they began with. What cannot be opened harms only itself.

use crate::dataset::{Dataset, Named, PIN_DIGITS};
use crate::problem::Problem;
use octree_store::{Store, StoreError};
use std::collections::BTreeMap;
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

/// A store by name, open or not.
#[derive(Debug, Clone)]
pub(crate) enum Entry {
    Open(Arc<Dataset>),
    Broken(Problem),
}

#[derive(Debug, Clone)]
struct Listed {
    path: PathBuf,
    fingerprint: Fingerprint,
    entry: Entry,
}

/// All stores that are served.
#[derive(Debug)]
pub(crate) struct Catalog {
    roots: Vec<PathBuf>,
    entries: RwLock<Arc<BTreeMap<String, Listed>>>,
    scanning: Mutex<()>,
    next_id: AtomicU64,
}

impl Catalog {
    /// Stores and folders, looked at for the first time.
    pub(crate) fn new(roots: Vec<PathBuf>) -> Self {
        let catalog = Self {
            roots,
            entries: RwLock::default(),
            scanning: Mutex::default(),
            next_id: AtomicU64::new(0),
        };
        catalog.rescan();
        catalog
    }

    fn snapshot(&self) -> Arc<BTreeMap<String, Listed>> {
        Arc::clone(&self.entries.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Looks at folders and stores again. Reads files: for a thread that may wait.
    pub(crate) fn rescan(&self) {
        let _one_at_a_time = self.scanning.lock().unwrap_or_else(PoisonError::into_inner);
        let before = self.snapshot();
        let mut found = BTreeMap::new();
        for path in self.files() {
            let Some(name) = path.file_stem().and_then(|stem| stem.to_str()) else {
                tracing::warn!(path = %path.display(), "passed over: its name is no UTF-8");
                continue;
            };
            if let Some(Listed { path: other, .. }) = found.get(name) {
                if *other != path {
                    tracing::debug!(path = %path.display(), other = %other.display(), "passed over: \
                        another store has its name");
                }
                continue;
            }
            let Ok(meta) = std::fs::metadata(&path) else { continue };
            let fingerprint = Fingerprint {
                device: meta.dev(),
                inode: meta.ino(),
                bytes: meta.len(),
                modified: (meta.mtime(), meta.mtime_nsec()),
            };
            let same = |old: &&Listed| old.path == path && old.fingerprint == fingerprint;
            let entry = match before.get(name).filter(same) {
                Some(old) => old.entry.clone(),
                None => self.open(name, &path, meta.len()),
            };
            found.insert(name.to_owned(), Listed { path, fingerprint, entry });
        }
        *self.entries.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(found);
    }

    /// The stores' files: those that were named, and those that lie in folders that were.
    fn files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        for root in &self.roots {
            if !root.is_dir() {
                files.push(root.clone());
                continue;
            }
            let Ok(folder) = std::fs::read_dir(root) else { continue };
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

    fn open(&self, name: &str, path: &Path, bytes: u64) -> Entry {
        match Store::open(path) {
            Ok(store) => {
                tracing::info!(dataset = name, "opened");
                let id = self.next_id.fetch_add(1, Ordering::Relaxed);
                Entry::Open(Arc::new(Dataset::new(id, name.to_owned(), store, bytes)))
            }
            Err(error) => {
                tracing::warn!(dataset = name, %error, "cannot be opened");
                Entry::Broken(problem(&error))
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

fn problem(error: &StoreError) -> Problem {
    Problem::of_store(error)
}
