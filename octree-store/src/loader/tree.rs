//! The part of the octree that is in use: the cut and all above it, kept from frame to frame.
//!
//! Siblings lie side by side in groups of eight, absent ones among them, so that a child is found by
//! adding its octant. Groups that are let go are used again; a node's place stays the same while it lives.

use super::nodes::{Child, NodeSummary};
use crate::key::NodeKey;
use crate::record::BrickState;

/// Stands for no node and for no slot.
pub(super) const NONE: u32 = u32::MAX;

/// What a place in the tree holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Presence {
    /// Nothing: outside the volume, or let go.
    Absent,
    /// A node.
    Present,
    /// A node of which nothing can be read, its record being damaged.
    Unreadable,
}

/// One node in use.
#[derive(Debug, Clone)]
pub(super) struct Node {
    /// Projected size of its voxels in pixels; below 0 where no view sees it.
    pub(super) size: f32,
    pub(super) brick_xyz: [u32; 3],
    pub(super) parent: u32,
    /// The first of its eight children; `NONE` of a leaf.
    pub(super) first_child: u32,
    /// Where the renderer has its brick; `NONE` where it has not.
    pub(super) slot: u32,
    /// The last feedback in which it, or one beneath it, was visible; 0 for never.
    pub(super) seen: u32,
    /// The last frame in which its children were wanted.
    pub(super) needed: u32,
    pub(super) level: u8,
    pub(super) presence: Presence,
    /// Nothing of its subtree can be seen under the present appearance.
    pub(super) empty: bool,
    /// Its brick cannot be read.
    pub(super) damaged: bool,
    /// How often its children were let go for want of visibility since the view last changed.
    pub(super) tries: u8,
    /// Which of its octants were visible in feedback `seen`; all where that was not told.
    pub(super) seen_octants: u8,
    /// Bound on the error of showing this level, 0 to 1 (see `Criterion`).
    pub(super) error: f32,
    pub(super) key: NodeKey,
    pub(super) summary: NodeSummary,
}

impl Node {
    pub(super) fn is_leaf(&self) -> bool {
        self.first_child == NONE
    }

    pub(super) fn is_present(&self) -> bool {
        self.presence != Presence::Absent
    }

    pub(super) fn in_view(&self) -> bool {
        self.size >= 0.0
    }

    /// Whether it needs a brick to be shown.
    pub(super) fn needs_brick(&self) -> bool {
        self.presence == Presence::Present
            && self.summary.state == BrickState::Stored
            && !self.empty
            && !self.damaged
    }

    /// Whether it needs a brick and the renderer has it not.
    pub(super) fn lacks_brick(&self) -> bool {
        self.needs_brick() && self.slot == NONE
    }
}

/// The nodes in use. The root is at place 0.
#[derive(Debug)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    free_groups: Vec<u32>,
}

const NOTHING: NodeSummary = NodeSummary {
    state: BrickState::Empty,
    texel_range: [0.0; 2],
    subtree_range: [0.0; 2],
    lod_rms_bound: 0.0,
    lod_amax_bound: 0.0,
    payload_bytes: 0,
};

fn node(key: NodeKey, parent: u32, child: Child) -> Node {
    let (presence, summary) = match child {
        Child::Absent => (Presence::Absent, NOTHING),
        Child::Known(summary) => (Presence::Present, summary),
        Child::Damaged => (Presence::Unreadable, NOTHING),
    };
    Node {
        size: -1.0,
        brick_xyz: key.brick_xyz().map(|v| v as u32),
        parent,
        first_child: NONE,
        slot: NONE,
        seen: 0,
        needed: 0,
        level: key.level(),
        presence,
        empty: false,
        damaged: presence == Presence::Unreadable,
        tries: 0,
        seen_octants: 0,
        error: 0.0,
        key,
        summary,
    }
}

impl Tree {
    /// A tree of nothing but its root.
    pub(super) fn new(root: NodeKey, child: Child) -> Self {
        // The root stands in a group of its own, so that groups begin at multiples of eight.
        let nodes = (0..8)
            .map(|octant| node(root, NONE, if octant == 0 { child } else { Child::Absent }))
            .collect();
        Self { nodes, free_groups: Vec::new() }
    }

    pub(super) fn get(&self, place: u32) -> &Node {
        &self.nodes[place as usize]
    }

    pub(super) fn get_mut(&mut self, place: u32) -> &mut Node {
        &mut self.nodes[place as usize]
    }

    /// The places that may hold a node.
    pub(super) fn places(&self) -> std::ops::Range<u32> {
        0..self.nodes.len() as u32
    }

    /// The eight children of an inner node.
    pub(super) fn children(&self, place: u32) -> std::ops::Range<u32> {
        let first = self.get(place).first_child;
        if first == NONE { 0..0 } else { first..first + 8 }
    }

    /// Gives a leaf its children.
    pub(super) fn split(&mut self, place: u32, children: &[Child; 8]) {
        let keys = self.get(place).key.children();
        let made = (0..8).map(|octant| node(keys[octant], place, children[octant]));
        let first = if let Some(first) = self.free_groups.pop() {
            for (to, child) in self.nodes[first as usize..].iter_mut().zip(made) {
                *to = child;
            }
            first
        } else {
            let first = self.nodes.len() as u32;
            self.nodes.extend(made);
            first
        };
        self.get_mut(place).first_child = first;
    }

    /// Lets go of a node's children and all beneath them; calls `freed` with each node that goes.
    pub(super) fn merge(&mut self, place: u32, freed: &mut impl FnMut(&Node)) {
        for child in self.children(place) {
            if !self.get(child).is_leaf() {
                self.merge(child, freed);
            }
            let node = self.get_mut(child);
            if node.is_present() {
                freed(node);
            }
            node.presence = Presence::Absent;
        }
        let node = self.get_mut(place);
        if node.first_child != NONE {
            let first = std::mem::replace(&mut node.first_child, NONE);
            self.free_groups.push(first);
        }
    }
}

impl Tree {
    /// The place of a node, if it is in use.
    pub(super) fn find(&self, key: NodeKey) -> Option<u32> {
        let mut place = 0;
        let top = self.get(0).level;
        let xyz = key.brick_xyz();
        for level in (key.level()..top).rev() {
            let first = self.get(place).first_child;
            if first == NONE {
                return None;
            }
            let bit = |axis: usize| (xyz[axis] >> (level - key.level()) & 1) as u32;
            place = first + bit(0) + 2 * bit(1) + 4 * bit(2);
        }
        let node = self.get(place);
        (node.is_present() && node.key == key).then_some(place)
    }
}
