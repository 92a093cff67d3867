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

use super::demand::{Change, Criterion, Demand, Deviation, Holder, Outcome};
use super::nodes::{Child, Lookup, NodeSource, NodeSummary, Siblings};
use super::transfer::Appearance;
use super::tree::{NONE, Node, Presence, Tree};
use super::urgency::{Candidate, Evictable};
use crate::key::NodeKey;
use crate::record::BrickState;
use std::collections::BinaryHeap;
use std::sync::Arc;

/// How often children are let go for want of visibility before a view keeps to the coarser node.
const TRIES: u8 = 3;

/// The tree, and what refinement keeps from frame to frame.
#[derive(Debug)]
pub(super) struct Refiner {
    tree: Option<Tree>,
    frame: u32,
    /// The number of the last feedback.
    feedback: u32,
    /// Whether the tree was changed since the last frame.
    changed: bool,
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
            changed: false,
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

    /// Gives damaged nodes another chance. Groups with a record that was unreadable are let go, to come anew.
    pub(super) fn forget_damage(&mut self, holder: &mut impl Holder) {
        let Some(tree) = &mut self.tree else { return };
        if tree.get(0).presence == Presence::Unreadable {
            self.tree = None;
            return;
        }
        for place in tree.places() {
            let unreadable = |child| tree.get(child).presence == Presence::Unreadable;
            if tree.children(place).any(unreadable) {
                self.changed = true;
                tree.merge(place, &mut |child| {
                    if child.slot != NONE {
                        holder.give_back(child.key, child.slot);
                    }
                });
            }
            tree.get_mut(place).damaged = false;
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
        let changed = std::mem::take(&mut self.changed);
        let mut outcome = Outcome { changed, ..Outcome::default() };
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
            if demand.change != Change::Nothing {
                node.tries = 0;
            }
            if (demand.change == Change::Appearance || fresh) && node.presence == Presence::Present
            {
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
        let urgent = if node.lacks_brick() {
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
        self.evictable.clear();
        let mut bricks_waiting = 0;
        while let Some(candidate) = self.candidates.pop() {
            if bricks_waiting >= demand.waiting_limit {
                break;
            }
            // Room may have been made at its expense.
            if !still_there(tree, &candidate) {
                continue;
            }
            let node = tree.get(candidate.place);
            let (key, load) = (node.key, node.lacks_brick());
            let wanted = if load {
                Wanted::only(key)
            } else {
                let Lookup::Ready(siblings) = source.children(key) else {
                    outcome.waiting += 1;
                    bricks_waiting += 1;
                    continue;
                };
                if !siblings.iter().any(|child| matches!(child, Child::Known(_))) {
                    continue;
                }
                Wanted::children(node, siblings, demand, holder)
            };
            let held = isize::from(!load && !demand.keep_inner && node.slot != NONE);
            let cost = wanted.count as isize - held;
            // Whoever sets no limit has more room than an isize holds.
            let room =
                isize::try_from(holder.room()).unwrap_or(isize::MAX) - outcome.reserved as isize;
            if cost > 0 && room < cost {
                let evictable = self.evictable.bricks(tree, self.frame, &candidate);
                if room.saturating_add(evictable as isize) < cost {
                    outcome.starved = true;
                    // What is less urgent than one that does not fit does not stay either, or the cut would
                    // depend on what was seen before.
                    let which = |least: &Candidate| *least <= candidate;
                    while self.evictable.evict_one(tree, self.frame, which, holder) {
                        outcome.changed = true;
                    }
                    break;
                }
            }
            let missing = wanted.octants_where(|key| !holder.is_ready(key));
            if missing == 0 && holder.can_upload(wanted.keys()) {
                self.admit(tree, &candidate, &wanted, demand, holder);
                outcome.changed = true;
                continue;
            }
            if missing == 0 {
                outcome.deferred += 1;
                outcome.deferred_bricks += wanted.count;
            } else {
                // The root's parent is no node of the volume, but siblings are named by it.
                holder.request(if load { key.parent() } else { key }, missing);
                outcome.waiting += 1;
            }
            bricks_waiting += wanted.count;
            outcome.reserved += cost.max(0) as usize;
        }
        self.candidates.clear();
    }

    /// Takes the bricks that a candidate needs, all of which are ready, and refines it.
    fn admit(
        &mut self,
        tree: &mut Tree,
        candidate: &Candidate,
        wanted: &Wanted,
        demand: &Demand,
        holder: &mut impl Holder,
    ) {
        let place = candidate.place;
        let node = tree.get_mut(place);
        let load = node.lacks_brick();
        if !load && !demand.keep_inner && node.slot != NONE {
            holder.give_back(node.key, std::mem::replace(&mut node.slot, NONE));
        }
        while holder.room() < wanted.count {
            let which = |least: &Candidate| least < candidate;
            if !self.evictable.evict_one(tree, self.frame, which, holder) {
                break;
            }
        }
        self.slots.clear();
        holder.take(wanted.keys(), &mut self.slots);
        if load {
            let node = tree.get_mut(place);
            node.slot = self.slots.first().copied().unwrap_or(NONE);
            // What was seen in its place was another brick: it is to be seen itself before it is refined.
            node.seen = 0;
            self.push_if_wanted(tree, place, demand);
            return;
        }
        tree.split(place, &wanted.siblings);
        tree.get_mut(place).needed = self.frame;
        for (&octant, &slot) in wanted.octants.iter().zip(&self.slots) {
            let child = tree.get(place).first_child + u32::from(octant);
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
}

/// The bricks that a candidate needs: its own, or those of its children.
#[derive(Debug)]
struct Wanted {
    keys: [NodeKey; 8],
    octants: [u8; 8],
    count: usize,
    siblings: Arc<Siblings>,
}

impl Wanted {
    fn none(siblings: Arc<Siblings>) -> Self {
        Self { keys: [NodeKey::first_of_level(0); 8], octants: [0; 8], count: 0, siblings }
    }

    fn only(key: NodeKey) -> Self {
        let mut wanted = Self::none(Arc::default());
        wanted.push(key);
        wanted
    }

    /// Those children of a node that will be drawn with bricks of their own.
    fn children(
        node: &Node,
        siblings: Arc<Siblings>,
        demand: &Demand,
        holder: &impl Holder,
    ) -> Self {
        let mut wanted = Self::none(siblings);
        for (octant, key) in node.key.children().into_iter().enumerate() {
            let Child::Known(child) = &wanted.siblings[octant] else { continue };
            let xyz = key.brick_xyz().map(|v| v as u32);
            if child.state == BrickState::Stored
                && (!demand.only_seen || node.seen_octants >> octant & 1 == 1)
                && !is_empty(child, demand.appearance)
                && demand.views.voxel_size(key.level(), xyz).is_some()
                && !holder.is_damaged(key)
            {
                wanted.push(key);
            }
        }
        wanted
    }

    fn push(&mut self, key: NodeKey) {
        (self.keys[self.count], self.octants[self.count]) = (key, key.octant() as u8);
        self.count += 1;
    }

    fn keys(&self) -> &[NodeKey] {
        &self.keys[..self.count]
    }

    /// The octants of those for which `which` holds, a bit each.
    fn octants_where(&self, mut which: impl FnMut(NodeKey) -> bool) -> u8 {
        (0..self.count)
            .filter(|&i| which(self.keys[i]))
            .fold(0, |octants, i| octants | 1 << self.octants[i])
    }
}

/// Whether a candidate's node has not been let go since it was queued. One that lacks its brick was queued in its
/// parent's name.
fn still_there(tree: &Tree, candidate: &Candidate) -> bool {
    let node = tree.get(candidate.place);
    let named = node.key == candidate.key
        || (node.parent != NONE && tree.get(node.parent).key == candidate.key);
    node.is_present() && node.is_leaf() && named
}

/// Whether a node, seen or not, falls short of what is asked for, and has anything finer beneath it.
fn too_coarse(node: &Node, demand: &Demand) -> bool {
    let [low, high] = node.summary.subtree_range;
    node.presence == Presence::Present
        && node.level > 0
        && node.size > demand.quality.accuracy as f32
        && !node.empty
        && !(node.summary.state != BrickState::Stored && low == high)
        && match demand.quality.criterion {
            Criterion::ProjectedSize => true,
            Criterion::MeasuredError { tolerance, .. } => node.error > tolerance as f32,
        }
}

/// Whether nothing of a node or of what lies beneath can be seen.
fn is_empty(summary: &NodeSummary, appearance: &Appearance) -> bool {
    appearance.is_empty(summary.subtree_range[0], summary.subtree_range[1])
}
