//! What comes first: the order in which leaves get room, and in which others make it.
//!
//! Larger voxels first, then coarser nodes, then keys: a total order in which parents stand before their children.
//! Leaves are refined from its front; children are let go from its back.

use super::demand::Holder;
use super::tree::{NONE, Node, Tree};
use crate::key::NodeKey;
use std::cmp::Ordering;

/// A leaf that is to be refined, or to get its own brick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) priority: f32,
    pub(super) level: u8,
    pub(super) key: NodeKey,
    pub(super) place: u32,
}

impl Candidate {
    pub(super) fn of(node: &Node, place: u32) -> Self {
        Self { priority: node.size, level: node.level, key: node.key, place }
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl Ord for Candidate {
    /// Larger voxels first, then coarser nodes: parents come before their children.
    fn cmp(&self, other: &Self) -> Ordering {
        self.priority
            .total_cmp(&other.priority)
            .then(self.level.cmp(&other.level))
            .then(other.key.cmp(&self.key))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Nodes whose children may make room, least urgent first; listed when room is first short in a frame.
#[derive(Debug, Default)]
pub(super) struct Evictable {
    nodes: Vec<Candidate>,
    /// Bricks that the nodes before this one hold in their children; one more than nodes.
    bricks_before: Vec<usize>,
    next: usize,
    listed: bool,
}

impl Evictable {
    /// Begins a frame.
    pub(super) fn clear(&mut self) {
        self.listed = false;
    }

    /// Bricks that would be given back if everything less urgent than a candidate were let go. What was not needed
    /// in `frame` is the least urgent of all.
    pub(super) fn bricks(&mut self, tree: &Tree, frame: u32, candidate: &Candidate) -> usize {
        self.list(tree, frame);
        let less_urgent = self.nodes.partition_point(|node| node < candidate);
        self.bricks_before[less_urgent.max(self.next)] - self.bricks_before[self.next]
    }

    /// Lets go of the least urgent children, if `which` says so.
    pub(super) fn evict_one(
        &mut self,
        tree: &mut Tree,
        frame: u32,
        which: impl Fn(&Candidate) -> bool,
        holder: &mut impl Holder,
    ) -> bool {
        self.list(tree, frame);
        let Some(least) = self.nodes.get(self.next).filter(|least| which(least)) else {
            return false;
        };
        self.next += 1;
        tree.merge(least.place, &mut |child| {
            if child.slot != NONE {
                holder.give_back(child.key, child.slot);
            }
        });
        true
    }

    fn list(&mut self, tree: &Tree, frame: u32) {
        let Self { nodes, bricks_before, next, listed } = self;
        if std::mem::replace(listed, true) {
            return;
        }
        nodes.clear();
        for place in tree.places() {
            let node = tree.get(place);
            if node.is_present() && !node.is_leaf() {
                let mut candidate = Candidate::of(node, place);
                if node.needed != frame {
                    candidate.priority = -1.0;
                }
                nodes.push(candidate);
            }
        }
        nodes.sort_unstable();
        bricks_before.clear();
        bricks_before.push(0);
        let mut sum = 0;
        for node in nodes.iter() {
            sum += tree.children(node.place).filter(|&c| tree.get(c).slot != NONE).count();
            bricks_before.push(sum);
        }
        *next = 0;
    }
}
