//! Refinement: from the last frame's tree to this frame's (2008 text, section 4; 2010 text, section 5).
//!
//! First every node in use is judged anew, from the root down: how large its voxels are, whether anything
//! needs it. What has not been needed for some frames is let go. Then the leaves that are too coarse go
//! through a queue, largest voxels first. A leaf is refined when its voxels are larger than the accuracy, it
//! may be seen, and was seen; but only when the bricks of those of its children that will be drawn are in
//! core and there is room for them. Else they are asked for, and it stays a leaf.
//!
//! Room goes strictly by the queue's order. The first that does not fit, not even in place of what is less urgent,
//! ends the refinement: so a larger budget never gives a coarser cut.

use super::nodes::{Child, Lookup, NodeSource, NodeSummary};
use super::projection::ViewSet;
use super::transfer::Appearance;
use super::tree::{NONE, Node, Presence, Tree};
use crate::key::NodeKey;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// When a node is fine enough.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Criterion {
    /// When its voxels are at most `accuracy` pixels large.
    #[default]
    ProjectedSize,
    /// Also when the error of showing it in place of full resolution is bounded by `tolerance`: the node
    /// record's bound on deviation, times the steepness of the transfer function in the node's range, through
    /// the whole brick, as an opacity of 0 to 1. With [`Deviation::Largest`] that holds for every sample,
    /// with [`Deviation::RootMeanSquare`] for the typical one.
    MeasuredError {
        /// The error that is borne, 0 to 1: 1/255 is one step of a display.
        tolerance: f64,
        /// Which of the record's bounds counts.
        deviation: Deviation,
    },
}

/// Which bound of a node record a [`Criterion::MeasuredError`] goes by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Deviation {
    /// The bound on the root mean square.
    RootMeanSquare,
    /// The bound on the largest deviation.
    Largest,
}

/// How fine a view is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Pixels that a voxel may cover; 1 is full quality, 2 half of it in each direction.
    pub accuracy: f64,
    /// What else makes a node fine enough.
    pub criterion: Criterion,
}

impl Default for Quality {
    fn default() -> Self {
        Self { accuracy: 1.0, criterion: Criterion::ProjectedSize }
    }
}

/// What a frame wants.
#[derive(Debug, Clone, Copy)]
pub(super) struct Demand<'a> {
    pub(super) views: &'a ViewSet,
    pub(super) appearance: &'a Appearance,
    pub(super) quality: Quality,
    /// Whether only what was seen is refined.
    pub(super) only_seen: bool,
    /// Frames for which children stay that are not needed.
    pub(super) linger_frames: u32,
    /// Bricks that may wait for data or uploads before the rest is left for a later frame: what bounds a frame's time.
    pub(super) waiting_limit: usize,
    /// Whether inner nodes keep their bricks, for filtering and to fall back upon.
    pub(super) keep_inner: bool,
    /// Whether appearance or criterion differ from the last frame's.
    pub(super) appearance_changed: bool,
    /// Whether anything of the demand differs from the last frame's.
    pub(super) changed: bool,
}

/// Who holds the bricks.
pub(super) trait Holder {
    /// Bricks that can be taken besides those taken already.
    fn room(&self) -> usize;
    /// Whether a brick could be taken now.
    fn is_ready(&mut self, key: NodeKey) -> bool;
    /// Whether a brick is known to be unreadable.
    fn is_damaged(&self, key: NodeKey) -> bool;
    /// Whether the frame's budget allows for the uploads that taking these takes.
    fn can_upload(&self, keys: &[NodeKey]) -> bool;
    /// Takes bricks that are ready: one slot for each.
    fn take(&mut self, keys: &[NodeKey], slots: &mut Vec<u32>);
    /// Gives a brick back.
    fn give_back(&mut self, key: NodeKey, slot: u32);
    /// Asks for the bricks of some children of a node, a bit an octant.
    fn request(&mut self, parent: NodeKey, octants: u8);
}

/// What came of a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Outcome {
    /// Nodes, slots or emptiness differ from before.
    pub(super) changed: bool,
    /// Leaves that wait for data.
    pub(super) waiting: usize,
    /// Leaves that wait for a frame with uploads left.
    pub(super) deferred: usize,
    /// Bricks of these leaves.
    pub(super) deferred_bricks: usize,
    /// Nodes whose children are not needed and have not been let go yet.
    pub(super) lingering: usize,
    /// Whether the refinement ended for want of room.
    pub(super) starved: bool,
    /// Bricks that were promised to leaves that wait.
    pub(super) reserved: usize,
}

/// A leaf that is to be refined, or to get its own brick.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    priority: f32,
    level: u8,
    key: NodeKey,
    place: u32,
}

impl Candidate {
    fn of(node: &Node, place: u32) -> Self {
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

/// Nodes whose children may make room, least urgent first.
#[derive(Debug, Default)]
struct Evictable {
    nodes: Vec<Candidate>,
    /// Bricks that the nodes before this one hold in their children; one more than nodes.
    bricks_before: Vec<usize>,
    next: usize,
    listed: bool,
}

/// How often children are let go for want of visibility before a view keeps to the coarser node.
const TRIES: u8 = 3;

/// The tree, and what refinement keeps from frame to frame.
#[derive(Debug)]
pub(super) struct Refiner {
    tree: Option<Tree>,
    frame: u32,
    /// The number of the last feedback.
    feedback: u32,
    /// The volume's range of values, for errors that are relative to it.
    volume_range: [f64; 2],
    candidates: BinaryHeap<Candidate>,
    stack: Vec<(u32, bool)>,
    evictable: Evictable,
    slots: Vec<u32>,
}

impl Refiner {
    pub(super) fn new() -> Self {
        Self {
            tree: None,
            frame: 0,
            feedback: 0,
            volume_range: [0.0; 2],
            candidates: BinaryHeap::new(),
            stack: Vec::new(),
            evictable: Evictable::default(),
            slots: Vec::new(),
        }
    }

    pub(super) fn tree(&self) -> Option<&Tree> {
        self.tree.as_ref()
    }

    /// The number of the last feedback.
    pub(super) fn feedback(&self) -> u32 {
        self.feedback
    }

    /// The tree, to mark in it what the next feedback saw, and that feedback's number.
    pub(super) fn begin_feedback(&mut self) -> Option<(&mut Tree, u32)> {
        self.feedback += 1;
        self.tree.as_mut().map(|tree| (tree, self.feedback))
    }

    /// Marks a node whose brick turned out to be unreadable.
    pub(super) fn mark_damaged(&mut self, key: NodeKey) {
        if let Some(tree) = &mut self.tree
            && let Some(place) = tree.find(key)
        {
            tree.get_mut(place).damaged = true;
        }
    }

    /// Gives damaged nodes another chance; those whose records were unreadable come anew with their siblings.
    pub(super) fn forget_damage(&mut self) {
        let Some(tree) = &mut self.tree else { return };
        for place in tree.places() {
            let node = tree.get_mut(place);
            node.damaged = node.presence == Presence::Unreadable;
        }
    }

    /// Makes the tree what this frame wants, as far as data, room and uploads go.
    pub(super) fn update(
        &mut self,
        demand: &Demand,
        source: &mut impl NodeSource,
        holder: &mut impl Holder,
    ) -> Outcome {
        self.frame += 1;
        let mut outcome = Outcome::default();
        let fresh = self.tree.is_none();
        if fresh {
            let key = source.geometry().root();
            let Lookup::Ready(root) = source.root() else {
                outcome.waiting = 1;
                return outcome;
            };
            if let Child::Known(summary) = &root {
                self.volume_range = summary.subtree_range;
            }
            self.tree = Some(Tree::new(key, root));
            outcome.changed = true;
        }
        let Some(mut tree) = self.tree.take() else { return outcome };
        self.judge(&mut tree, demand, fresh, holder, &mut outcome);
        self.refine(&mut tree, demand, source, holder, &mut outcome);
        self.tree = Some(tree);
        outcome
    }

    /// Judges every node in use; lets go of what is needed no more; lists what is too coarse.
    fn judge(
        &mut self,
        tree: &mut Tree,
        demand: &Demand,
        fresh: bool,
        holder: &mut impl Holder,
        outcome: &mut Outcome,
    ) {
        self.candidates.clear();
        self.stack.clear();
        self.stack.push((0, true));
        while let Some((place, live)) = self.stack.pop() {
            let node = tree.get_mut(place);
            let size = demand.views.voxel_size(node.level, node.brick_xyz);
            node.size = size.unwrap_or(-1.0);
            if demand.changed {
                node.tries = 0;
            }
            if (demand.appearance_changed || fresh) && node.presence == Presence::Present {
                let empty = is_empty(&node.summary, demand.appearance);
                outcome.changed |= empty != node.empty;
                node.empty = empty;
                node.error = self.error(&node.summary, node.level, demand);
            }
            let wanted = live && self.wants_children(node, demand);
            if !node.is_leaf() {
                if wanted {
                    node.needed = self.frame;
                } else if self.frame - node.needed > demand.linger_frames {
                    if live && demand.only_seen && too_coarse(node, demand) {
                        node.tries = node.tries.saturating_add(1);
                    }
                    tree.merge(place, &mut |child| {
                        if child.slot != NONE {
                            holder.give_back(child.key, child.slot);
                        }
                    });
                    outcome.changed = true;
                } else {
                    outcome.lingering += 1;
                }
            }
            let node = tree.get(place);
            if node.is_leaf() {
                self.judge_leaf(tree, place, live, demand, holder, outcome);
            } else {
                for child in tree.children(place) {
                    if tree.get(child).is_present() {
                        self.stack.push((child, wanted));
                    }
                }
            }
        }
    }

    fn judge_leaf(
        &mut self,
        tree: &mut Tree,
        place: u32,
        live: bool,
        demand: &Demand,
        holder: &mut impl Holder,
        outcome: &mut Outcome,
    ) {
        let node = tree.get_mut(place);
        // The root's brick is what everything falls back upon.
        let drawn = node.needs_brick() && (node.in_view() || place == 0);
        if node.slot != NONE && !drawn {
            holder.give_back(node.key, node.slot);
            node.slot = NONE;
            outcome.changed = true;
        }
        if live {
            self.push_if_wanted(tree, place, demand);
        }
    }

    /// Queues a leaf that lacks its own brick or is too coarse.
    fn push_if_wanted(&mut self, tree: &Tree, place: u32, demand: &Demand) {
        let node = tree.get(place);
        let parent = tree.get(if node.parent == NONE { place } else { node.parent });
        let urgent = if node.needs_brick() && node.slot == NONE {
            if place == 0 {
                let (priority, level) = (f32::INFINITY, u8::MAX);
                Candidate { priority, level, key: node.key, place }
            } else if node.in_view() && (!demand.only_seen || node.seen == self.feedback) {
                // As urgent as its siblings were, with which it would have come had it been in view.
                Candidate { place, ..Candidate::of(parent, node.parent) }
            } else {
                return;
            }
        } else if self.wants_children(node, demand) && (!demand.only_seen || node.tries < TRIES) {
            Candidate::of(node, place)
        } else {
            return;
        };
        self.candidates.push(urgent);
    }

    /// Whether a node's children should be shown in its place.
    fn wants_children(&self, node: &Node, demand: &Demand) -> bool {
        too_coarse(node, demand)
            && (!demand.only_seen || (node.seen == self.feedback && node.seen != 0))
    }

    fn error(&self, summary: &NodeSummary, level: u8, demand: &Demand) -> f32 {
        let Criterion::MeasuredError { deviation, .. } = demand.quality.criterion else {
            return 0.0;
        };
        let deviation = match deviation {
            Deviation::RootMeanSquare => summary.lod_rms_bound,
            Deviation::Largest => summary.lod_amax_bound,
        };
        let length = demand.views.brick_length(level);
        demand.appearance.error(summary.subtree_range, deviation, length, self.volume_range) as f32
    }

    /// Refines what is too coarse, the most urgent first.
    fn refine(
        &mut self,
        tree: &mut Tree,
        demand: &Demand,
        source: &mut impl NodeSource,
        holder: &mut impl Holder,
        outcome: &mut Outcome,
    ) {
        self.evictable.listed = false;
        let mut bricks_waiting = 0;
        while let Some(candidate) = self.candidates.pop() {
            if bricks_waiting >= demand.waiting_limit {
                break;
            }
            let place = candidate.place;
            let node = tree.get(place);
            let load = node.needs_brick() && node.slot == NONE;
            let (key, octants_seen) = (node.key, node.seen_octants);
            let holds = isize::from(!demand.keep_inner && node.slot != NONE);
            let mut children: [Child; 8] = [Child::Absent; 8];
            let mut wanted = Wanted::default();
            if load {
                wanted.keys[0] = key;
                wanted.octants[0] = key.octant() as u8;
                wanted.count = 1;
            } else {
                let Lookup::Ready(siblings) = source.children(key) else {
                    outcome.waiting += 1;
                    bricks_waiting += 1;
                    continue;
                };
                children = *siblings;
                if !children.iter().any(|child| matches!(child, Child::Known(_))) {
                    continue;
                }
                for (octant, child_key) in key.children().into_iter().enumerate() {
                    let Child::Known(child) = &children[octant] else { continue };
                    if child.state == crate::BrickState::Stored
                        && (!demand.only_seen || octants_seen >> octant & 1 == 1)
                        && !is_empty(child, demand.appearance)
                        && demand
                            .views
                            .voxel_size(child_key.level(), child_key.brick_xyz().map(|v| v as u32))
                            .is_some()
                        && !holder.is_damaged(child_key)
                    {
                        wanted.keys[wanted.count] = child_key;
                        wanted.octants[wanted.count] = octant as u8;
                        wanted.count += 1;
                    }
                }
            }
            let cost = wanted.count as isize - holds;
            // Whoever sets no limit has more room than an isize holds.
            let room =
                isize::try_from(holder.room()).unwrap_or(isize::MAX) - outcome.reserved as isize;
            if cost > 0 && room < cost {
                let evictable = self.evictable_bricks(tree, &candidate);
                if room.saturating_add(evictable as isize) < cost {
                    outcome.starved = true;
                    // What is less urgent than one that does not fit does not stay either, or the cut would
                    // depend on what was seen before.
                    while self.evict_one(tree, |least| *least <= candidate, holder) {
                        outcome.changed = true;
                    }
                    break;
                }
            }
            let keys = &wanted.keys[..wanted.count];
            let missing = (0..wanted.count)
                .filter(|&i| !holder.is_ready(keys[i]))
                .fold(0, |mask, i| mask | 1 << wanted.octants[i]);
            if missing != 0 {
                // The root's parent is no node of the volume, but siblings are named by it.
                holder.request(if load { key.parent() } else { key }, missing);
                outcome.waiting += 1;
                bricks_waiting += wanted.count;
                outcome.reserved += cost.max(0) as usize;
                continue;
            }
            if !holder.can_upload(keys) {
                outcome.deferred += 1;
                outcome.deferred_bricks += wanted.count;
                bricks_waiting += wanted.count;
                outcome.reserved += cost.max(0) as usize;
                continue;
            }
            if holds == 1 {
                let node = tree.get_mut(place);
                holder.give_back(key, std::mem::replace(&mut node.slot, NONE));
            }
            while holder.room() < wanted.count {
                if !self.evict_one(tree, |least| *least < candidate, holder) {
                    break;
                }
            }
            self.slots.clear();
            holder.take(keys, &mut self.slots);
            outcome.changed = true;
            if load {
                let node = tree.get_mut(place);
                node.slot = self.slots.first().copied().unwrap_or(NONE);
                // What was seen in its place was another brick: it is to be seen itself before it is refined.
                node.seen = 0;
                self.push_if_wanted(tree, place, demand);
                continue;
            }
            tree.split(place, &children);
            tree.get_mut(place).needed = self.frame;
            for (i, &slot) in self.slots.iter().enumerate() {
                let child = tree.get(place).first_child + u32::from(wanted.octants[i]);
                tree.get_mut(child).slot = slot;
            }
            for child in tree.children(place) {
                let node = tree.get_mut(child);
                if node.presence == Presence::Present {
                    let size = demand.views.voxel_size(node.level, node.brick_xyz);
                    node.size = size.unwrap_or(-1.0);
                    node.empty = is_empty(&node.summary, demand.appearance);
                    node.damaged = holder.is_damaged(node.key);
                    node.error = self.error(&node.summary, node.level, demand);
                    self.push_if_wanted(tree, child, demand);
                }
            }
        }
        self.candidates.clear();
    }

    /// Bricks that would be given back if everything less urgent than a candidate were let go.
    fn evictable_bricks(&mut self, tree: &Tree, candidate: &Candidate) -> usize {
        if !self.evictable.listed {
            self.list_evictable(tree);
        }
        let Evictable { nodes, bricks_before, next, .. } = &self.evictable;
        let less_urgent = nodes.partition_point(|node| node < candidate);
        bricks_before[less_urgent.max(*next)] - bricks_before[*next]
    }

    fn list_evictable(&mut self, tree: &Tree) {
        let Evictable { nodes, bricks_before, next, listed } = &mut self.evictable;
        nodes.clear();
        for place in tree.places() {
            let node = tree.get(place);
            if node.is_present() && !node.is_leaf() {
                let needed = node.needed == self.frame;
                let priority = if needed { node.size } else { -1.0 };
                nodes.push(Candidate { priority, level: node.level, key: node.key, place });
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
        (*next, *listed) = (0, true);
    }

    /// Lets go of the least urgent children, if `which` says so.
    fn evict_one(
        &mut self,
        tree: &mut Tree,
        which: impl Fn(&Candidate) -> bool,
        holder: &mut impl Holder,
    ) -> bool {
        if !self.evictable.listed {
            self.list_evictable(tree);
        }
        let Some(least) = self.evictable.nodes.get(self.evictable.next) else { return false };
        if !which(least) {
            return false;
        }
        self.evictable.next += 1;
        tree.merge(least.place, &mut |child| {
            if child.slot != NONE {
                holder.give_back(child.key, child.slot);
            }
        });
        true
    }
}

/// The bricks that a candidate needs.
#[derive(Debug)]
struct Wanted {
    keys: [NodeKey; 8],
    octants: [u8; 8],
    count: usize,
}

impl Default for Wanted {
    fn default() -> Self {
        Self { keys: [NodeKey::first_of_level(0); 8], octants: [0; 8], count: 0 }
    }
}

/// Whether a node, seen or not, falls short of what is asked for, and has anything finer beneath it.
fn too_coarse(node: &Node, demand: &Demand) -> bool {
    let [low, high] = node.summary.subtree_range;
    node.presence == Presence::Present
        && node.level > 0
        && node.size > demand.quality.accuracy as f32
        && !node.empty
        && !(node.summary.state == crate::BrickState::Uniform && low == high)
        && match demand.quality.criterion {
            Criterion::ProjectedSize => true,
            Criterion::MeasuredError { tolerance, .. } => node.error > tolerance as f32,
        }
}

/// Whether nothing of a node or of what lies beneath can be seen.
fn is_empty(summary: &NodeSummary, appearance: &Appearance) -> bool {
    appearance.is_empty(summary.subtree_range[0], summary.subtree_range[1])
}
