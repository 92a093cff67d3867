//! Sums over all records: what the metadata says of levels, errors and dropped voxels.
//!
//! The sums are exact and made from the records alone, so they depend neither on threads nor on the
//! order of work, and a verification can make them anew.

use crate::error_sum::{ErrorSum, ErrorTotal};
use crate::geometry::Geometry;
use crate::metadata::{LevelSummary, Metadata};
use crate::overlap_bound::OverlapBounds;
use crate::record::{BrickState, NodeRecord};
use std::collections::BTreeMap;

/// Records being summed up.
#[derive(Debug)]
pub(crate) struct Summary {
    geometry: Geometry,
    levels: Vec<LevelSums>,
    dropped: ErrorTotal,
    /// Least and greatest sample of dropped bricks.
    dropped_range: Option<(f64, f64)>,
    /// Voxels in dropped bricks, those that are no numbers included.
    dropped_voxels: u64,
}

#[derive(Debug)]
struct LevelSums {
    stored: u64,
    uniform: u64,
    empty: u64,
    lost: u64,
    payload_bytes: u64,
    bits: BTreeMap<u8, u64>,
    kept: ErrorTotal,
    lod_rms: ErrorTotal,
    lod_amax: f64,
    overlap: OverlapBounds,
}

impl LevelSums {
    fn new(metadata: &Metadata) -> Self {
        Self {
            stored: 0,
            uniform: 0,
            empty: 0,
            lost: 0,
            payload_bytes: 0,
            bits: BTreeMap::new(),
            kept: ErrorTotal::default(),
            lod_rms: ErrorTotal::default(),
            lod_amax: 0.0,
            overlap: OverlapBounds::new(metadata),
        }
    }
}

impl Summary {
    /// Of a store with this metadata; what it says of sums does not matter.
    pub(crate) fn new(geometry: &Geometry, metadata: &Metadata) -> Self {
        let levels = geometry.levels().map(|_| LevelSums::new(metadata)).collect();
        Self {
            geometry: *geometry,
            levels,
            dropped: ErrorTotal::default(),
            dropped_range: None,
            dropped_voxels: 0,
        }
    }

    /// Adds the next record in key order; records outside the geometry are passed over.
    pub(crate) fn add(&mut self, record: &NodeRecord) {
        let Some(level) = self.levels.get_mut(usize::from(record.key.level())) else { return };
        if !self.geometry.contains(record.key) {
            return;
        }
        match record.state {
            BrickState::Stored => {
                level.stored += 1;
                *level.bits.entry(record.bits).or_insert(0) += 1;
            }
            BrickState::Uniform => level.uniform += 1,
            BrickState::Empty => level.empty += 1,
            BrickState::Lost => level.lost += 1,
        }
        level.payload_bytes += u64::from(record.place.length);
        level.overlap.add(record);
        if record.state != BrickState::Empty {
            // Of lost bricks nothing was measured: they add nothing.
            level.kept.add(&record.error);
        } else if record.key.level() == 0 {
            self.dropped.add(&record.error);
            self.dropped_range = Some(match self.dropped_range {
                None => (record.brick_min, record.brick_max),
                Some((min, max)) => (min.min(record.brick_min), max.max(record.brick_max)),
            });
            self.dropped_voxels += self.geometry.core_region(record.key).voxels();
        }
        let voxels = self.geometry.voxels_beneath(record.key);
        level.lod_rms.add(&ErrorSum::of_rms(voxels, record.lod_rms_bound));
        level.lod_amax = level.lod_amax.max(record.lod_amax_bound);
    }

    /// Writes the sums into the metadata.
    pub(crate) fn write_into(&self, metadata: &mut Metadata) {
        metadata.levels =
            (0_u8..).zip(&self.levels).map(|(level, sums)| self.level(level, sums)).collect();
        metadata.payload_bytes = self.levels.iter().map(|level| level.payload_bytes).sum();
        let dropped = self.dropped.total();
        metadata.dropped_voxels = self.dropped_voxels;
        metadata.dropped_rms = dropped.rms();
        metadata.dropped_amax = dropped.amax;
        metadata.dropped_energy = dropped.energy().min(f64::MAX);
        metadata.dropped_min = self.dropped_range.map(|(min, _)| min);
        metadata.dropped_max = self.dropped_range.map(|(_, max)| max);
    }

    fn level(&self, level: u8, sums: &LevelSums) -> LevelSummary {
        let kept = sums.kept.total();
        LevelSummary {
            level,
            dims_xyz: self.geometry.dims_at(level),
            grid_xyz: self.geometry.grid_at(level),
            stored: sums.stored,
            uniform: sums.uniform,
            empty: sums.empty,
            lost: sums.lost,
            payload_bytes: sums.payload_bytes,
            bits: sums.bits.clone(),
            rms: kept.rms(),
            amax: kept.amax,
            lod_rms_bound: sums.lod_rms.total().rms(),
            lod_amax_bound: sums.lod_amax,
            overlap_amax_bound: sums.overlap.amax(),
            overlap_extra_amax_bound: sums.overlap.extra_amax(),
        }
    }
}
