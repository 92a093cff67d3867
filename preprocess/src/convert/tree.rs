//! What a node says of its descendants: child mask, subtree range, bounds on the deviation of its
//! level. Octets come level by level upwards, so a node's children are known when it comes.

use super::brick::BrickOutput;
use crate::walk::Octet;
use octree_store::{BrickState, Geometry, NodeKey, NodeRecord, WeightedRms};
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
    /// RMS over children of (bound + step), weighted by their level-0 voxels.
    lod_rms: WeightedRms,
    lod_amax: f64,
}

/// A bound that is computed is rounded; this keeps it a bound, and a number.
fn bounded(bound: f64) -> f64 {
    (bound * (1.0 + 1e-12)).min(f64::MAX)
}

impl Tree {
    pub(super) fn new(geometry: Geometry, empty_value: f64) -> Self {
        Self { geometry, empty_value, pending: HashMap::new() }
    }

    /// Completes the records of an octet, and keeps what their parent will need.
    pub(super) fn complete(&mut self, octet: Octet<BrickOutput>) -> Vec<(NodeRecord, Vec<u8>)> {
        let mut bricks = Vec::with_capacity(octet.len());
        let mut beneath = Beneath {
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            lod_rms: WeightedRms::default(),
            lod_amax: 0.0,
        };
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
                record.lod_rms_bound = bounded(children.lod_rms.value());
                record.lod_amax_bound = bounded(children.lod_amax);
            }
            // |level 0 - parent's cell| <= |level 0 - own cell| + |own cell - parent's cell|.
            beneath.min = beneath.min.min(record.subtree_min);
            beneath.max = beneath.max.max(record.subtree_max);
            let rms = (record.lod_rms_bound + visited.step.rms).min(f64::MAX);
            beneath.lod_rms.add(voxels, rms);
            beneath.lod_amax = beneath.lod_amax.max(record.lod_amax_bound + visited.step.amax);
            bricks.push((record, payload));
        }
        if let Some(parent) = parent.filter(|parent| self.geometry.contains(*parent)) {
            self.pending.insert(parent, beneath);
        }
        bricks
    }
}
