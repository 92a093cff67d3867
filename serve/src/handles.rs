//! Open stores: few at a time, however many are served.
//!
//! An open store has a file descriptor; a folder of thousands would take them all. So what is known of a dataset is kept apart ([`Dataset`]), and its file is opened when bricks are
//! asked for; of the open ones those that were not used for longest are closed.

use crate::dataset::Dataset;
use crate::problem::Problem;
use octree_store::{Store, StoreError};
use quick_cache::sync::Cache;
use std::io;
use std::path::Path;
use std::sync::Arc;

/// The stores that are open, by their datasets' ids.
#[derive(Debug)]
pub(crate) struct Handles {
    open: Cache<u64, Arc<Store>>,
}

impl Handles {
    /// Keeps at most so many.
    pub(crate) fn new(limit: usize) -> Self {
        Self { open: Cache::new(limit.max(1)) }
    }

    /// Opens a store, to see what it is.
    pub(crate) fn open(path: &Path) -> Result<Store, StoreError> {
        Store::open(path)
    }

    /// Keeps the store of a dataset open.
    pub(crate) fn keep(&self, id: u64, store: Store) {
        self.open.insert(id, Arc::new(store));
    }

    /// Closes the stores of datasets that are not of these.
    pub(crate) fn retain(&self, served: impl Fn(u64) -> bool) {
        self.open.retain(|id, _| served(*id));
    }

    /// A dataset's store. Reads files: for a thread that may wait.
    pub(crate) fn of(&self, dataset: &Dataset) -> Result<Arc<Store>, Problem> {
        self.open.get_or_insert_with(&dataset.id, || {
            let store = Self::open(&dataset.path).map_err(|error| match error {
                StoreError::Io { source, .. } if source.kind() == io::ErrorKind::NotFound => {
                    Problem::absent("the dataset has been removed")
                }
                error => Problem::of_store(&error),
            })?;
            // The next look at the folder will know the new one by its own metadata.
            if store.metadata().digest != dataset.metadata.digest {
                return Err(Problem::busy("the dataset is being replaced"));
            }
            Ok(Arc::new(store))
        })
    }
}
