//! What the camera will need if it goes on as it goes.
//!
//! Every view is carried on by its last motion, some frames ahead; leaves that would be too coarse there, and are
//! fine enough or out of view now, have their children read into memory. Such jobs stand behind
//! everything that is visible and too coarse now, and take only memory that nothing else asks for.

use super::demand::Quality;
use super::fetch::Job;
use super::nodes::{Child, Siblings};
use super::projection::{Projection, ViewSet};
use super::transfer::Appearance;
use super::tree::{NONE, Tree};
use crate::key::NodeKey;
use crate::record::BrickState;

/// The views carried on, or `None` where nothing moves or a view is another than before.
pub(super) fn views_ahead(
    now: &[Projection],
    before: &[Projection],
    frames: f64,
) -> Option<Vec<Projection>> {
    if now == before || now.len() != before.len() {
        return None;
    }
    now.iter().zip(before).map(|(now, before)| now.ahead(before, frames)).collect()
}

/// Jobs for what `ahead` would need and the tree has not, the most urgent first; at most `room` bricks. Where
/// `last_feedback` is told, leaves in view that it did not see are left alone.
#[allow(clippy::too_many_arguments, reason = "each is a different thing that a frame knows")]
pub(super) fn jobs<'a>(
    tree: &Tree,
    ahead: &ViewSet,
    appearance: &Appearance,
    quality: Quality,
    last_feedback: Option<u32>,
    known: impl Fn(NodeKey) -> Option<&'a Siblings>,
    in_core: impl Fn(NodeKey) -> bool,
    room: usize,
) -> Vec<Job> {
    let mut candidates = Vec::new();
    for node in tree.places().map(|place| tree.get(place)) {
        let hidden = node.in_view() && last_feedback.is_some_and(|last| node.seen != last);
        if !node.is_present() || !node.is_leaf() || node.empty || node.damaged || hidden {
            continue;
        }
        let Some(size) = ahead.voxel_size(node.level, node.brick_xyz) else { continue };
        if node.needs_brick() && node.slot == NONE && !node.in_view() && !in_core(node.key) {
            candidates.push((2.0 * size, node.key, false));
        } else if node.level > 0
            && size > quality.accuracy as f32
            && node.size <= quality.accuracy as f32
        {
            candidates.push((size, node.key, true));
        }
    }
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut jobs = Vec::new();
    let mut bricks = 0;
    for (_, key, children) in candidates {
        let job = if !children {
            Job { parent: key.parent(), octants: 1 << key.octant() }
        } else if let Some(siblings) = known(key) {
            let wanted = |octant: usize, child: &NodeKey| {
                let Child::Known(summary) = &siblings[octant] else { return false };
                let [low, high] = summary.subtree_range;
                summary.state == BrickState::Stored
                    && !appearance.is_empty(low, high)
                    && ahead
                        .voxel_size(child.level(), child.brick_xyz().map(|v| v as u32))
                        .is_some()
                    && !in_core(*child)
            };
            let children = key.children();
            let octants = (0..8)
                .filter(|&octant| wanted(octant, &children[octant]))
                .fold(0, |mask, octant| mask | 1 << octant);
            if octants == 0 {
                continue;
            }
            Job { parent: key, octants }
        } else {
            Job { parent: key, octants: 0 }
        };
        bricks += (job.octants.count_ones() as usize).max(1);
        if bricks > room {
            break;
        }
        jobs.push(job);
    }
    jobs
}
