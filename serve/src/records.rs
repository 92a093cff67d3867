//! Node records of many nodes, siblings in one read.

use octree_store::{NodeKey, NodeRecord, Store, StoreError};

/// The records of nodes of the store. Siblings that follow each other take one read, unless one is damaged.
pub(crate) fn records(
    store: &Store,
    keys: impl Iterator<Item = NodeKey>,
) -> impl Iterator<Item = (NodeKey, Result<NodeRecord, StoreError>)> {
    let mut family = None;
    keys.map(move |key| {
        let parent = key.parent();
        if store.geometry().root() == key {
            return (key, store.node(key));
        }
        if family.as_ref().is_none_or(|(of, _)| *of != parent) {
            family = Some((parent, store.children(parent).ok()));
        }
        let known =
            family.as_ref().and_then(|(_, children)| children.as_ref()?.get(key.octant()).copied());
        (key, known.map_or_else(|| store.node(key), Ok))
    })
}
