//! How often each value occurs in a store: the values that a reader gets, at one level.

use crate::downsample::Core;
use crate::error::PreprocessError;
use octree_store::{BrickScratch, BrickState, NodeRecord, Sample, Store, with_sample_type};
use rayon::prelude::*;
use serde::Serialize;

/// Counts of values in equal bins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Histogram {
    /// The schema's name and version.
    pub schema: &'static str,
    /// The level whose voxels are counted.
    pub level: u8,
    /// Least value.
    pub value_min: f64,
    /// Greatest value.
    pub value_max: f64,
    /// Edges of the bins, one more than there are bins; each bin holds its lower edge, and the last
    /// its upper edge too.
    pub edges: Vec<f64>,
    /// Voxels in each bin.
    pub counts: Vec<u64>,
    /// Voxels that are NaN or infinite: in no bin.
    pub not_finite: u64,
}

impl Histogram {
    /// The value below which a share of the voxels lies, 0..=1, linear within a bin.
    pub fn quantile(&self, share: f64) -> f64 {
        let total: u64 = self.counts.iter().sum();
        let wanted = share.clamp(0.0, 1.0) * total as f64;
        let mut below = 0.0;
        for (bin, &count) in self.counts.iter().enumerate() {
            let count = count as f64;
            if count > 0.0 && below + count >= wanted {
                let within = ((wanted - below) / count).clamp(0.0, 1.0);
                return self.edges[bin] + within * (self.edges[bin + 1] - self.edges[bin]);
            }
            below += count;
        }
        self.value_max
    }
}

/// Counts the voxels of a level in `bins` equal bins over the values that occur in it.
///
/// # Errors
/// When a brick cannot be read.
pub fn histogram(store: &Store, level: u8, bins: usize) -> Result<Histogram, PreprocessError> {
    with_sample_type!(store.metadata().sample_type, T => histogram_typed::<T>(store, level, bins))
}

fn histogram_typed<T: Sample>(
    store: &Store,
    level: u8,
    bins: usize,
) -> Result<Histogram, PreprocessError> {
    let bins = bins.max(1);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    store.visit_level(level, |record| {
        let empty = record.state == BrickState::Empty;
        let value = store.metadata().empty_value;
        let (min, max) = if empty { (value, value) } else { (record.brick_min, record.brick_max) };
        (low, high) = (low.min(min), high.max(max));
        true
    })?;
    // A record may say anything; of numbers that are none no bins can be made.
    (low, high) = (low.clamp(-f64::MAX, f64::MAX), high.clamp(-f64::MAX, f64::MAX));
    // Widened where there is one value only, so that bins have a width. Halves, because the range of
    // f64 extremes overflows.
    let width = (high / 2.0 - low / 2.0) / bins as f64 * 2.0;
    let (width, start) = if width > 0.0 { (width, low) } else { (1.0 / bins as f64, low - 0.5) };
    let geometry = store.geometry();
    let count = |(mut counts, mut brick, mut scratch): Counting<T>, record: &NodeRecord| {
        store.decode_brick_core(record, &mut scratch, &mut brick)?;
        for row in Core::of(geometry, record.key).rows() {
            for v in &brick[row] {
                let bin = if v.is_finite() {
                    (((v.to_f64() / 2.0 - start / 2.0) / (width / 2.0)) as usize).min(bins - 1)
                } else {
                    bins
                };
                counts[bin] += 1;
            }
        }
        Ok::<_, PreprocessError>((counts, brick, scratch))
    };
    let begin = || {
        (
            vec![0_u64; bins + 1],
            vec![T::default(); geometry.brick_samples()],
            BrickScratch::default(),
        )
    };
    let add = |mut a: Vec<u64>, b: Vec<u64>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    let count_batch = |records: &[NodeRecord]| {
        records
            .par_iter()
            .try_fold(begin, count)
            .map(|counting| counting.map(|(counts, ..)| counts))
            .try_reduce(|| vec![0; bins + 1], |a, b| Ok(add(a, b)))
    };
    let mut counts = vec![0; bins + 1];
    let mut batch: Vec<NodeRecord> = Vec::with_capacity(BATCH);
    let mut outcome = Ok(());
    store.visit_level(level, |record| {
        batch.push(*record);
        if batch.len() == BATCH {
            match count_batch(&batch) {
                Ok(more) => counts = add(std::mem::take(&mut counts), more),
                Err(error) => outcome = Err(error),
            }
            batch.clear();
        }
        outcome.is_ok()
    })?;
    outcome?;
    counts = add(counts, count_batch(&batch)?);
    let not_finite = counts.pop().unwrap_or(0);
    let edges = (0..=bins).map(|i| edge(start, width, i));
    Ok(Histogram {
        schema: "octavo.histogram/1",
        level,
        value_min: low,
        value_max: high,
        edges: edges.collect(),
        counts,
        not_finite,
    })
}

/// Where a bin begins. What is added may overflow where the sum does not: then both are one operation.
fn edge(start: f64, width: f64, bin: usize) -> f64 {
    let sum = start + width * bin as f64;
    if sum.is_finite() { sum } else { width.mul_add(bin as f64, start).clamp(-f64::MAX, f64::MAX) }
}

/// Bricks that are counted together: their records are what is held of the volume.
const BATCH: usize = 4096;

/// Counts so far, and a thread's buffers.
type Counting<T> = (Vec<u64>, Vec<T>, BrickScratch);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_of_the_widest_range_are_finite_and_rise() {
        let (start, bins) = (-1.7e308, 256);
        let width = 1.7e308 / bins as f64 * 2.0;
        let edges: Vec<f64> = (0..=bins).map(|i| edge(start, width, i)).collect();
        assert!(edges.iter().all(|edge| edge.is_finite()) && edges.is_sorted());
        assert_eq!((edges[0], edges[128], edges[bins]), (-1.7e308, 0.0, 1.7e308));
        let edges: Vec<f64> = (0..=4).map(|i| edge(-f64::MAX, f64::MAX / 2.0, i)).collect();
        assert_eq!(edges, [-f64::MAX, -f64::MAX / 2.0, 0.0, f64::MAX / 2.0, f64::MAX]);
    }

    #[test]
    fn quantiles_are_linear_within_a_bin() {
        let histogram = Histogram {
            schema: "octavo.histogram/1",
            level: 0,
            value_min: 0.0,
            value_max: 30.0,
            edges: vec![0.0, 10.0, 20.0, 30.0],
            counts: vec![1, 0, 3],
            not_finite: 0,
        };
        assert_eq!(histogram.quantile(0.0), 0.0);
        assert_eq!(histogram.quantile(0.25), 10.0);
        assert_eq!(histogram.quantile(0.5), 20.0 + 10.0 / 3.0);
        assert_eq!(histogram.quantile(1.0), 30.0);
    }
}
