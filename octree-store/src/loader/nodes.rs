//! What the loader must know of a node, and where it learns it.
//!
//! Choosing a cut needs no samples: ranges of values, bounds on deviation, and which children exist are
//! enough. [`NodeSource`] gives these; a store does it by reading ([`StoreNodes`]), the asynchronous loader from
//! what its threads have read, a simulation by making them up.

use super::brick::texel_range;
use crate::error::StoreError;
use crate::geometry::Geometry;
use crate::key::NodeKey;
use crate::metadata::Metadata;
use crate::record::{BrickState, NodeRecord};
use crate::store::Store;
use std::collections::HashMap;
use std::sync::Arc;

/// What refinement must know of one node. Values are in source units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeSummary {
    /// Stored, uniform or empty; a lost brick counts as stored.
    pub state: BrickState,
    /// The values of the texels 0 and 1 of its brick as it is uploaded; of a uniform or empty brick, its value twice.
    pub texel_range: [f64; 2],
    /// Least and greatest value of the node and all beneath it.
    pub subtree_range: [f64; 2],
    /// Bound on the RMS deviation from full resolution.
    pub lod_rms_bound: f64,
    /// Bound on the largest deviation from full resolution.
    pub lod_amax_bound: f64,
    /// Bytes of its payload in the store; 0 where it has none.
    pub payload_bytes: u32,
}

impl NodeSummary {
    /// What a record says, in a store with this metadata.
    pub fn of(record: &NodeRecord, metadata: &Metadata) -> Self {
        let texel_range = match record.state {
            BrickState::Stored => texel_range(record, metadata),
            BrickState::Lost => [record.brick_min, record.brick_max],
            BrickState::Uniform => [record.brick_min; 2],
            BrickState::Empty => [metadata.empty_value; 2],
        };
        // A lost brick is asked for as a stored one is, and found damaged: what stands above is shown in its place.
        let state = match record.state {
            BrickState::Lost => BrickState::Stored,
            state => state,
        };
        Self {
            state,
            texel_range,
            subtree_range: [record.subtree_min, record.subtree_max],
            lod_rms_bound: record.lod_rms_bound,
            lod_amax_bound: record.lod_amax_bound,
            payload_bytes: record.place.length,
        }
    }
}

/// What is known of one child.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Child {
    /// It lies outside the volume.
    #[default]
    Absent,
    /// It is there.
    Known(NodeSummary),
    /// It is there, but its record cannot be read: nothing is known of it or of what lies beneath.
    Damaged,
}

/// A node's eight children, in octant order.
pub type Siblings = [Child; 8];

/// The answer of a [`NodeSource`].
#[derive(Debug, Clone)]
pub enum Lookup<T> {
    /// Here it is.
    Ready(T),
    /// Not in core: ask again in a later frame.
    Pending,
}

/// Where node summaries come from.
pub trait NodeSource {
    /// The volume's folding.
    fn geometry(&self) -> &Geometry;
    /// World size of a voxel.
    fn spacing_xyz(&self) -> [f64; 3];
    /// The top level's node.
    fn root(&mut self) -> Lookup<Child>;
    /// The children of a node above level 0.
    fn children(&mut self, parent: NodeKey) -> Lookup<Arc<Siblings>>;
}

/// A store's nodes, read when they are asked for and kept.
///
/// For one who wants a cut at once: a server answering a request. What cannot be read counts as damaged,
/// and the errors are kept for the caller.
#[derive(Debug)]
pub struct StoreNodes<'a> {
    store: &'a Store,
    read: HashMap<NodeKey, Arc<Siblings>>,
    errors: Vec<(NodeKey, StoreError)>,
}

impl<'a> StoreNodes<'a> {
    /// The nodes of a store, none of them read yet.
    pub fn new(store: &'a Store) -> Self {
        Self { store, read: HashMap::new(), errors: Vec::new() }
    }

    /// What could not be read so far.
    pub fn errors(&self) -> &[(NodeKey, StoreError)] {
        &self.errors
    }
}

impl NodeSource for StoreNodes<'_> {
    fn geometry(&self) -> &Geometry {
        self.store.geometry()
    }

    fn spacing_xyz(&self) -> [f64; 3] {
        self.store.metadata().spacing_xyz
    }

    fn root(&mut self) -> Lookup<Child> {
        let key = self.store.geometry().root();
        Lookup::Ready(match self.store.node(key) {
            Ok(record) => Child::Known(NodeSummary::of(&record, self.store.metadata())),
            Err(error) => {
                self.errors.push((key, error));
                Child::Damaged
            }
        })
    }

    fn children(&mut self, parent: NodeKey) -> Lookup<Arc<Siblings>> {
        let Self { store, read, errors } = self;
        let siblings = read.entry(parent).or_insert_with(|| {
            let records = sorted(read_children(store, parent), parent, errors);
            Arc::new(summaries(&records, store.metadata()))
        });
        Lookup::Ready(Arc::clone(siblings))
    }
}

/// The record of a child as far as it can be read.
#[derive(Debug, Clone, Copy, Default)]
pub(super) enum ChildRecord {
    #[default]
    Absent,
    Known(NodeRecord),
    Damaged,
}

/// The records of a node's children. Where one is damaged the others are read one by one, so that it
/// harms only itself.
pub(super) fn read_children(
    store: &Store,
    parent: NodeKey,
) -> [Option<Result<NodeRecord, StoreError>>; 8] {
    if parent.level() == 0 {
        return [const { None }; 8];
    }
    if let Ok(children) = store.children(parent) {
        return std::array::from_fn(|octant| children.get(octant).map(|record| Ok(*record)));
    }
    parent.children().map(|key| store.geometry().contains(key).then(|| store.node(key)))
}

/// Sorts records from errors.
pub(super) fn sorted(
    records: [Option<Result<NodeRecord, StoreError>>; 8],
    parent: NodeKey,
    errors: &mut Vec<(NodeKey, StoreError)>,
) -> [ChildRecord; 8] {
    let mut found = [ChildRecord::Absent; 8];
    for (octant, record) in records.into_iter().enumerate() {
        found[octant] = match record {
            None => ChildRecord::Absent,
            Some(Ok(record)) => ChildRecord::Known(record),
            Some(Err(error)) => {
                errors.push((parent.children()[octant], error));
                ChildRecord::Damaged
            }
        };
    }
    found
}

/// What the loader must know of these records.
pub(super) fn summaries(records: &[ChildRecord; 8], metadata: &Metadata) -> Siblings {
    records.map(|record| match record {
        ChildRecord::Absent => Child::Absent,
        ChildRecord::Known(record) => Child::Known(NodeSummary::of(&record, metadata)),
        ChildRecord::Damaged => Child::Damaged,
    })
}
