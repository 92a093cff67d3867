//! What a node says of its descendants: child mask, subtree range, bounds on the deviation of its
//! level. Octets come level by level upwards, so a node's children are known when it comes.

use super::brick::BrickOutput;
use crate::walk::Visited;
use octree_store::{BrickState, Geometry, NodeKey, NodeRecord, WeightedRms};
use std::collections::HashMap;

/// Nodes whose children have come, and which have not come themselves.
#[derive(Debug)]
pub(crate) struct Tree {
    geometry: Geometry,
    empty_value: f64,
    pending: HashMap<NodeKey, Beneath>,
}

/// What the children of a node add up to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Beneath {
    min: f64,
    max: f64,
    /// RMS over children of (bound + step), weighted by their level-0 voxels.
    lod_rms: WeightedRms,
    lod_amax: f64,
}

impl Beneath {
    /// Bytes of [`Beneath::to_bytes`].
    pub(crate) const BYTES: usize = 56;

    /// The numbers as bytes, for one who resumes.
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        let Self { min, max, lod_rms, lod_amax } = self;
        let [scale, sum, error, weight] = lod_rms.to_parts();
        [min, max, scale, sum, error, weight, lod_amax]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect()
    }

    /// The numbers of these bytes.
    pub(crate) fn from_bytes(bytes: &[u8; Self::BYTES]) -> Self {
        let mut v = [0.0; Self::BYTES / 8];
        for (v, bytes) in v.iter_mut().zip(bytes.as_chunks::<8>().0) {
            *v = f64::from_le_bytes(*bytes);
        }
        let [min, max, scale, sum, error, weight, lod_amax] = v;
        let lod_rms = WeightedRms::from_parts([scale, sum, error, weight]);
        Self { min, max, lod_rms, lod_amax }
    }
}

/// A bound that is computed is rounded; this keeps it a bound, and a number.
fn bounded(bound: f64) -> f64 {
    (bound * (1.0 + 1e-12)).min(f64::MAX)
}

impl Tree {
    pub(crate) fn new(
        geometry: Geometry,
        empty_value: f64,
        pending: HashMap<NodeKey, Beneath>,
    ) -> Self {
        Self { geometry, empty_value, pending }
    }

    /// Completes the records of an octet; says, and keeps, what their parent will need. There is none
    /// above the top level.
    pub(crate) fn complete(
        &mut self,
        octet: &[Visited<BrickOutput>],
    ) -> (Vec<NodeRecord>, Option<Beneath>) {
        let mut records = Vec::with_capacity(octet.len());
        let mut beneath = Beneath {
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            lod_rms: WeightedRms::default(),
            lod_amax: 0.0,
        };
        for visited in octet {
            let mut record = visited.output.record;
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
            records.push(record);
        }
        let parent = octet.first().map(|visited| visited.key.parent());
        let parent = parent.filter(|parent| self.geometry.contains(*parent));
        if let Some(parent) = parent {
            self.pending.insert(parent, beneath);
        }
        (records, parent.map(|_| beneath))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_for_a_parent_comes_back_to_the_bit() {
        let mut lod_rms = WeightedRms::default();
        lod_rms.add(3.0, 0.1);
        lod_rms.add(5.0, 1e200);
        let beneath = Beneath { min: -0.0, max: f64::MAX, lod_rms, lod_amax: 0.3 };
        let bytes = beneath.to_bytes();
        let back = Beneath::from_bytes(bytes.as_slice().try_into().unwrap());
        assert_eq!((back, back.to_bytes()), (beneath, bytes));
    }
}
