//! What a node says of its descendants: child mask, subtree range, bounds on the deviation of its
//! level. Octets come level by level upwards, so a node's children are known when it comes.

use super::brick::BrickOutput;
use crate::walk::Octet;
use octree_store::{BrickState, Geometry, NodeKey, NodeRecord};
use std::collections::HashMap;

/// Nodes whose children have come, and which have not come themselves.
#[derive(Debug)]
pub(super) struct Tree {
    geometry: Geometry,
    empty_value: f64,
    pending: HashMap<NodeKey, Beneath>,
}

/// What the children of a node add up to.
#[derive(Debug, Clone, Copy)]
struct Beneath {
    min: f64,
    max: f64,
    /// Sum over children of level-0 voxels x (bound + step)^2.
    lod_squares: f64,
    lod_amax: f64,
}

/// A bound that is computed is rounded; this keeps it a bound.
const ROUNDING: f64 = 1.0 + 1e-12;

impl Tree {
    pub(super) fn new(geometry: Geometry, empty_value: f64) -> Self {
        Self { geometry, empty_value, pending: HashMap::new() }
    }

    /// Completes the records of an octet, and keeps what their parent will need.
    pub(super) fn complete(&mut self, octet: Octet<BrickOutput>) -> Vec<(NodeRecord, Vec<u8>)> {
        let mut bricks = Vec::with_capacity(octet.len());
        let mut beneath =
            Beneath { min: f64::INFINITY, max: f64::NEG_INFINITY, lod_squares: 0.0, lod_amax: 0.0 };
        let parent = octet.first().map(|visited| visited.key.parent());
        for visited in octet {
            let BrickOutput { mut record, payload, .. } = visited.output;
            record.child_mask = self.geometry.child_mask(record.key);
            let voxels = self.geometry.voxels_beneath(record.key) as f64;
            if record.state == BrickState::Empty {
                record.subtree_min = record.subtree_min.min(self.empty_value);
                record.subtree_max = record.subtree_max.max(self.empty_value);
            }
            if let Some(children) = self.pending.remove(&record.key) {
                record.subtree_min = record.subtree_min.min(children.min);
                record.subtree_max = record.subtree_max.max(children.max);
                record.lod_rms_bound = (children.lod_squares / voxels).sqrt() * ROUNDING;
                record.lod_amax_bound = children.lod_amax * ROUNDING;
            }
            // |level 0 - parent's cell| <= |level 0 - own cell| + |own cell - parent's cell|.
            let step_rms = (visited.step.squares / voxels).sqrt();
            beneath.min = beneath.min.min(record.subtree_min);
            beneath.max = beneath.max.max(record.subtree_max);
            beneath.lod_squares += voxels * (record.lod_rms_bound + step_rms).powi(2);
            beneath.lod_amax = beneath.lod_amax.max(record.lod_amax_bound + visited.step.amax);
            bricks.push((record, payload));
        }
        if let Some(parent) = parent.filter(|parent| self.geometry.contains(*parent)) {
            self.pending.insert(parent, beneath);
        }
        bricks
    }
}
