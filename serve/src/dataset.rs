//! One store that is served, as far as it is known without its file.

use crate::answer::Lifetime;
use crate::product::Shape;
use crate::statistics::Statistics;
use octree_store::{Geometry, Metadata, NodeKey, Store};
use std::path::PathBuf;
use std::sync::OnceLock;

/// What is known of a store.
#[derive(Debug)]
pub(crate) struct Dataset {
    /// Tells a store from the one that it replaced.
    pub(crate) id: u64,
    pub(crate) name: String,
    pub(crate) path: PathBuf,
    pub(crate) metadata: Metadata,
    pub(crate) geometry: Geometry,
    pub(crate) file_bytes: u64,
    /// The version of the format in which it was written.
    pub(crate) format_version: u32,
    statistics: OnceLock<Statistics>,
}

impl Dataset {
    pub(crate) fn new(id: u64, name: String, store: &Store, file_bytes: u64) -> Self {
        Self {
            id,
            name,
            path: store.path().to_owned(),
            metadata: store.metadata().clone(),
            geometry: *store.geometry(),
            file_bytes,
            format_version: store.format_version(),
            statistics: OnceLock::new(),
        }
    }

    /// The first digits of the digest: enough to name the content in an address.
    pub(crate) fn version(&self) -> &str {
        let digest = &self.metadata.digest;
        digest.get(..PIN_DIGITS).unwrap_or(digest)
    }

    /// The tag of a brick in a shape: the digest covers every payload's checksum.
    pub(crate) fn etag(&self, key: NodeKey, shape: Shape) -> String {
        let digest = &self.metadata.digest;
        let digest = digest.get(..32).unwrap_or(digest);
        format!("{digest}-{}-{:x}", shape.tag(), key.to_u64())
    }

    /// What its values look like. Reads bricks of its store when it is first asked: for the decoding pool.
    pub(crate) fn statistics(&self, store: &Store) -> &Statistics {
        self.statistics.get_or_init(|| Statistics::of(store))
    }
}

/// Digits of the digest that an address has.
pub(crate) const PIN_DIGITS: usize = 16;

/// A dataset as an address named it.
#[derive(Debug, Clone)]
pub(crate) struct Named {
    pub(crate) dataset: std::sync::Arc<Dataset>,
    /// The address names the content too (`NAME@DIGEST`), so that answers never change.
    pub(crate) pinned: bool,
}

impl Named {
    pub(crate) fn lifetime(&self) -> Lifetime {
        if self.pinned { Lifetime::Immutable } else { Lifetime::Revalidate }
    }
}
