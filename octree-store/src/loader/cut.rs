//! The cut for a view, chosen at once: for a server's answer, for tests and for planning.
//!
//! The same refinement as the loader's, over a source that answers at once; nothing is loaded, and only
//! leaves count against the budget.

use super::camera::{ClipBox, View};
use super::demand::{Change, Demand, Holder, Quality};
use super::nodes::{NodeSource, NodeSummary};
use super::projection::ViewSet;
use super::refine::Refiner;
use super::transfer::Appearance;
use super::tree::Presence;
use crate::key::NodeKey;
use crate::record::BrickState;
use std::collections::HashSet;

/// What one leaf of a cut is to a renderer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum LeafKind {
    /// It has a payload that the view needs.
    Brick,
    /// Every sample of it has one value, and it needs no payload.
    Uniform,
    /// Nothing of it can be seen under the appearance.
    Empty,
    /// No view sees it.
    OutOfView,
    /// It is damaged: its parent is shown in its place.
    Damaged,
}

/// One leaf of a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutLeaf {
    /// The node.
    pub key: NodeKey,
    /// What it is to a renderer.
    pub kind: LeafKind,
    /// The projected size of its voxels in pixels; below 0 out of view.
    pub voxel_pixels: f32,
    /// Bytes of its payload in the store.
    pub payload_bytes: u32,
}

/// Nodes that cover a volume once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cut {
    /// The leaves, coarse to fine; of one level, those with the largest voxels first.
    pub leaves: Vec<CutLeaf>,
    /// Whether the budget held it coarser than was asked for.
    pub limited: bool,
    /// Leaves that would be finer if the source had answered at once.
    pub pending: usize,
}

impl Cut {
    /// The bricks that the view needs and one who has the bricks `have` lacks, coarse to fine.
    pub fn lacking<'a>(&'a self, have: &'a HashSet<NodeKey>) -> impl Iterator<Item = &'a CutLeaf> {
        self.leaves.iter().filter(|leaf| leaf.kind == LeafKind::Brick && !have.contains(&leaf.key))
    }

    /// How many bricks the view needs.
    pub fn bricks(&self) -> usize {
        self.leaves.iter().filter(|leaf| leaf.kind == LeafKind::Brick).count()
    }
}

/// What is to be shown, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene<'a> {
    /// One or several cameras; the cut is the finest that any of them asks for.
    pub views: &'a [View],
    /// Only what lies in this box is shown.
    pub clip: Option<ClipBox>,
    /// Transfer function or isovalue.
    pub appearance: &'a Appearance,
    /// How fine.
    pub quality: Quality,
}

/// The cut of a volume that a scene needs, of at most `budget_bricks` bricks. (The top level's brick is
/// always in it.)
///
/// The cut is the same for the same arguments, and at least as fine everywhere for a larger budget or a
/// smaller accuracy.
pub fn select_cut(source: &mut impl NodeSource, scene: &Scene, budget_bricks: usize) -> Cut {
    let views = ViewSet::new(scene.views, scene.clip, source.geometry(), source.spacing_xyz());
    let demand = Demand {
        views: &views,
        appearance: scene.appearance,
        quality: scene.quality,
        only_seen: false,
        linger_frames: 0,
        waiting_limit: usize::MAX,
        keep_inner: false,
        change: Change::Appearance,
    };
    let mut refiner = Refiner::new();
    let mut counter = Counter { room: budget_bricks.max(1) };
    let outcome = refiner.update(&demand, source, &mut counter);
    let mut leaves = Vec::new();
    if let Some(tree) = refiner.tree() {
        for node in tree.places().map(|place| tree.get(place)) {
            if node.is_present() && node.is_leaf() {
                leaves.push(CutLeaf {
                    key: node.key,
                    kind: match node.presence {
                        _ if node.empty => LeafKind::Empty,
                        Presence::Unreadable => LeafKind::Damaged,
                        _ if !node.in_view() => LeafKind::OutOfView,
                        _ => kind_of(&node.summary),
                    },
                    voxel_pixels: node.size,
                    payload_bytes: node.summary.payload_bytes,
                });
            }
        }
    }
    leaves.sort_by(|a, b| {
        (b.key.level().cmp(&a.key.level()))
            .then(b.voxel_pixels.total_cmp(&a.voxel_pixels))
            .then(a.key.cmp(&b.key))
    });
    Cut { leaves, limited: outcome.starved, pending: outcome.waiting }
}

fn kind_of(summary: &NodeSummary) -> LeafKind {
    if summary.state == BrickState::Stored { LeafKind::Brick } else { LeafKind::Uniform }
}

/// Holds no bricks, and counts them.
struct Counter {
    room: usize,
}

impl Holder for Counter {
    fn room(&self) -> usize {
        self.room
    }

    fn is_ready(&mut self, _: NodeKey) -> bool {
        true
    }

    fn is_damaged(&self, _: NodeKey) -> bool {
        false
    }

    fn can_upload(&self, _: &[NodeKey]) -> bool {
        true
    }

    fn take(&mut self, keys: &[NodeKey], slots: &mut Vec<u32>) {
        self.room = self.room.saturating_sub(keys.len());
        slots.resize(keys.len(), 0);
    }

    fn give_back(&mut self, _: NodeKey, _: u32) {
        self.room += 1;
    }

    fn request(&mut self, _: NodeKey, _: u8) {}
}
