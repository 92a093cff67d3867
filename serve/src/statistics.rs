//! What the values look like: percentiles for display windows, and a histogram.
//!
//! Taken from the finest level of at most a million voxels. That is an estimate, made for pictures; the metadata has the
//! exact range and mean.

use octree_store::{
    BrickScratch, Geometry, NodeKey, Region, Sample, SampleType, Store, with_sample_type,
};
use serde::Serialize;

/// Voxels that are looked at, at most.
const VOXEL_LIMIT: u64 = 1 << 20;

/// Bins of the histogram.
const BINS: usize = 256;

/// Values of one level, summed up.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Statistics {
    /// The level that was looked at.
    pub(crate) level: u8,
    /// Bricks of it that could not be read, and are not counted.
    pub(crate) damaged: u64,
    /// 0.1 % of the finite values lie below the first, and 0.1 % above the second.
    pub(crate) window: [f64; 2],
    /// The histogram's ends.
    pub(crate) range: [f64; 2],
    /// Values in bins of equal width.
    pub(crate) counts: Vec<u64>,
}

impl Statistics {
    /// Looks at a store's values. What is damaged is left out, and counted.
    pub(crate) fn of(store: &Store) -> Self {
        let geometry = store.geometry();
        let few = |level: &u8| geometry.dims_at(*level).iter().product::<u64>() <= VOXEL_LIMIT;
        let level = geometry.levels().find(few).unwrap_or(geometry.top_level());
        let (mut values, damaged) = with_sample_type!(store.metadata().sample_type, T => {
            finite_values::<T>(store, level)
        });
        let mut at = |share: f64| {
            let index = ((values.len().saturating_sub(1)) as f64 * share).round() as usize;
            if values.is_empty() {
                return 0.0;
            }
            *values.select_nth_unstable_by(index, f64::total_cmp).1
        };
        let window = [at(0.001), at(0.999)];
        let range = [at(0.0), at(1.0)];
        let mut counts = vec![0; BINS];
        // Halves, because the widest range overflows.
        let width = range[1] / 2.0 - range[0] / 2.0;
        for value in &values {
            let share = if width > 0.0 { (value / 2.0 - range[0] / 2.0) / width } else { 0.0 };
            counts[((share * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        Self {
            level,
            damaged,
            window: widened(window, store.metadata().sample_type),
            range,
            counts,
        }
    }
}

/// A window of which the ends differ.
pub(crate) fn widened([low, high]: [f64; 2], sample_type: SampleType) -> [f64; 2] {
    if high > low {
        return [low, high];
    }
    let (_, greatest) = sample_type.limits();
    if low + 1.0 > low && low < greatest { [low, low + 1.0] } else { [low - low.abs() / 2.0, low] }
}

fn finite_values<T: Sample>(store: &Store, level: u8) -> (Vec<f64>, u64) {
    let geometry: &Geometry = store.geometry();
    let [nx, ny, nz] = geometry.grid_at(level);
    let (mut values, mut damaged) = (Vec::new(), 0);
    let mut samples = vec![T::default(); geometry.brick_samples()];
    let mut scratch = BrickScratch::default();
    let side = geometry.brick_side();
    for brick in 0..nx * ny * nz {
        let key = NodeKey::new(level, [brick % nx, brick / nx % ny, brick / nx / ny]);
        if store.read_brick_core(key, &mut scratch, &mut samples).is_err() {
            damaged += 1;
            continue;
        }
        let Region { min, max } = geometry.core_region(key);
        let overlap = geometry.overlap() as usize;
        let [cx, cy, cz] = [0, 1, 2].map(|axis| (max[axis] - min[axis]) as usize);
        for z in 0..cz {
            for y in 0..cy {
                let from = ((z + overlap) * side + y + overlap) * side + overlap;
                let row = &samples[from..from + cx];
                values.extend(row.iter().filter(|v| v.is_finite()).map(|v| v.to_f64()));
            }
        }
    }
    (values, damaged)
}
