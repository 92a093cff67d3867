//! What a frame wants of the refinement, who holds the bricks, and what came of it.

use super::projection::ViewSet;
use super::transfer::Appearance;
use crate::key::NodeKey;

/// When a node is fine enough.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Criterion {
    /// When its voxels are at most `accuracy` pixels large.
    #[default]
    ProjectedSize,
    /// Also when the error of showing it in place of full resolution is bounded by `tolerance`: the node
    /// record's bound on deviation, times the steepness of the transfer function in the node's range, through
    /// the whole brick, as an opacity of 0 to 1. With [`Deviation::Largest`] that holds for every sample,
    /// with [`Deviation::RootMeanSquare`] for the typical one. An isosurface's place is bounded only where
    /// nothing deviates.
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

impl Quality {
    /// Whether it is the same to the bit: equality, but for numbers that are none.
    pub(super) fn is(&self, other: &Self) -> bool {
        let criterion = match (self.criterion, other.criterion) {
            (
                Criterion::MeasuredError { tolerance: a, deviation },
                Criterion::MeasuredError { tolerance: b, deviation: other },
            ) => a.to_bits() == b.to_bits() && deviation == other,
            (a, b) => a == b,
        };
        criterion && self.accuracy.to_bits() == other.accuracy.to_bits()
    }
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
    /// What differs from the last frame's.
    pub(super) change: Change,
}

/// How a demand differs from the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Change {
    /// Not at all.
    Nothing,
    /// In its views.
    Views,
    /// In what is shown, or how fine: emptiness and errors are to be found anew.
    Appearance,
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
