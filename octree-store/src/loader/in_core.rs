//! What is in core: node summaries and bricks, as the refinement sees them.
//!
//! Nothing here reads: what is not there is noted, and asked for at the end of the frame.

use super::cache::BrickCache;
use super::demand::Holder;
use super::fetch::Job;
use super::frame::Upload;
use super::lru::Lru;
use super::nodes::{Child, Lookup, NodeSource, Siblings};
use super::slots::SlotPool;
use super::tree::NONE;
use crate::geometry::Geometry;
use crate::key::NodeKey;
use std::collections::HashSet;
use std::sync::Arc;

/// Groups of siblings whose summaries are kept beside the tree's own: about 600 bytes each.
const RECORD_GROUPS: usize = 1 << 17;

/// Node summaries that the threads have read.
#[derive(Debug)]
pub(super) struct Records {
    pub(super) geometry: Geometry,
    pub(super) spacing_xyz: [f64; 3],
    pub(super) groups: Lru<NodeKey, Arc<Siblings>>,
    pub(super) root: Option<Child>,
    /// Groups that were asked for and not there.
    pub(super) wanted: Vec<NodeKey>,
}

impl Records {
    pub(super) fn insert(&mut self, parent: NodeKey, siblings: Arc<Siblings>) {
        if parent == self.geometry.root().parent() {
            self.root = Some(siblings[0]);
            return;
        }
        self.groups.insert(parent, siblings);
        if self.groups.len() > RECORD_GROUPS {
            self.groups.pop_oldest();
        }
    }
}

impl NodeSource for Records {
    fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    fn spacing_xyz(&self) -> [f64; 3] {
        self.spacing_xyz
    }

    fn root(&mut self) -> Lookup<Child> {
        let Some(root) = self.root else {
            self.wanted.push(self.geometry.root().parent());
            return Lookup::Pending;
        };
        Lookup::Ready(root)
    }

    fn children(&mut self, parent: NodeKey) -> Lookup<Arc<Siblings>> {
        if let Some(siblings) = self.groups.get(parent) {
            return Lookup::Ready(Arc::clone(siblings));
        }
        self.wanted.push(parent);
        Lookup::Pending
    }
}

/// The two caches, and what a frame does with them.
#[derive(Debug)]
pub(super) struct Pools {
    pub(super) slots: SlotPool,
    pub(super) memory: BrickCache,
    /// Bricks that a cut may have: what fits both.
    pub(super) capacity: usize,
    /// Bricks that may be on their way, or there and not taken: memory is kept free for them.
    pub(super) arriving: usize,
    pub(super) brick_bytes: usize,
    pub(super) uploads_per_frame: usize,
    pub(super) damaged: HashSet<NodeKey>,
    pub(super) uploads: Vec<Upload>,
    pub(super) freed: Vec<(NodeKey, u32)>,
    pub(super) jobs: Vec<Job>,
}

impl Holder for Pools {
    fn room(&self) -> usize {
        self.capacity.saturating_sub(self.slots.pinned())
    }

    fn is_ready(&mut self, key: NodeKey) -> bool {
        self.slots.contains(key) || self.memory.contains(key)
    }

    fn is_damaged(&self, key: NodeKey) -> bool {
        self.damaged.contains(&key)
    }

    fn can_upload(&self, keys: &[NodeKey]) -> bool {
        let needed = keys.iter().filter(|key| !self.slots.contains(**key)).count();
        self.uploads.len() + needed <= self.uploads_per_frame
    }

    fn take(&mut self, keys: &[NodeKey], slots: &mut Vec<u32>) {
        slots.resize(keys.len(), NONE);
        // Those in place first, so that the others do not take their slots.
        for (key, slot) in keys.iter().zip(slots.iter_mut()) {
            if let Some(found) = self.slots.pin(*key) {
                *slot = found;
                self.memory.pin(*key);
            }
        }
        for (key, slot) in keys.iter().zip(slots.iter_mut()) {
            if *slot != NONE {
                continue;
            }
            let Some(brick) = self.memory.get(*key).map(Arc::clone) else { continue };
            if let Some(found) = self.slots.place(*key) {
                *slot = found;
                self.memory.pin(*key);
                self.memory.statistics.hits += 1;
                self.uploads.push(Upload { slot: found, key: *key, brick });
            }
        }
    }

    fn give_back(&mut self, key: NodeKey, slot: u32) {
        self.slots.unpin(key);
        self.memory.unpin(key);
        self.freed.push((key, slot));
    }

    fn request(&mut self, parent: NodeKey, octants: u8) {
        self.jobs.push(Job { parent, octants });
    }
}
