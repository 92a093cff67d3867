//! Bricks whose payloads hold their cores alone: on reading, the overlap comes from the neighbours of the
//! same level.
//!
//! An overlap sample is what its own brick reads there, clamped to the range of the brick that asks, so
//! that no sample leaves the range by which bricks are chosen. A neighbour that is damaged fails the read
//! with the neighbour's key: overlap is never made up.

use super::reader::{BrickScratch, Store};
use crate::encoding::words::buffer;
use crate::error::{Damage, StoreError};
use crate::geometry::Geometry;
use crate::key::NodeKey;
use crate::record::{BrickState, NodeRecord};
use crate::sample::Sample;
use std::ops::Range;

/// Samples along one axis that come from one brick.
#[derive(Debug, Clone)]
struct Run {
    /// The brick, counted from the one that asks: -1, 0 or 1.
    step: i64,
    /// The samples.
    samples: Range<usize>,
    /// The core sample of that brick that the first of them is.
    from: usize,
    /// Whether all are that same sample: outside the volume the edge repeats.
    repeated: bool,
}

/// The runs of a brick's samples along one axis, in order.
fn runs(geometry: &Geometry, key: NodeKey, axis: usize) -> Vec<Run> {
    let core = i64::from(geometry.core());
    let last = geometry.dims_at(key.level())[axis] as i64 - 1;
    let brick = key.brick_xyz()[axis] as i64;
    let origin = geometry.sample_origin(key)[axis];
    let mut runs: Vec<Run> = Vec::with_capacity(5);
    for sample in 0..geometry.brick_side() {
        let voxel = (origin + sample as i64).clamp(0, last);
        let (step, from) = (voxel / core - brick, (voxel % core) as usize);
        let inside = voxel == origin + sample as i64;
        match runs.last_mut() {
            Some(run) if run.step == step && inside && !run.repeated => run.samples.end += 1,
            Some(run) if run.step == step && !inside && run.repeated => run.samples.end += 1,
            _ => runs.push(Run { step, samples: sample..sample + 1, from, repeated: !inside }),
        }
    }
    runs
}

impl Store {
    /// Fills in the overlap of a stored brick whose core is in `samples`.
    pub(super) fn assemble_overlap<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<(), StoreError> {
        let geometry = *self.geometry();
        let (side, core) = (geometry.brick_side(), geometry.core() as usize);
        let (min, max) = (T::from_f64(record.brick_min), T::from_f64(record.brick_max));
        let runs = [0, 1, 2].map(|axis| runs(&geometry, record.key, axis));
        let edge = runs.iter().flatten().any(|run| run.repeated);
        let mut neighbours = Vec::with_capacity(26);
        for z in [-1, 0, 1] {
            for y in [-1, 0, 1] {
                for x in [-1, 0, 1] {
                    let step = [x, y, z];
                    let needed = (step != [0; 3] || edge)
                        && (0..3).all(|axis| runs[axis].iter().any(|run| run.step == step[axis]));
                    if needed {
                        let xyz = record.key.brick_xyz();
                        let at = |axis: usize| (xyz[axis] as i64 + step[axis]) as u64;
                        neighbours
                            .push((NodeKey::new(record.key.level(), [at(0), at(1), at(2)]), step));
                    }
                }
            }
        }
        // Siblings' records are read once.
        neighbours.sort_unstable_by_key(|(key, _)| *key);
        let mut siblings = None;
        let mut block = std::mem::take(&mut scratch.neighbour);
        for (key, step) in neighbours {
            let from: &mut [T] = typed(&mut block, core.pow(3));
            if key == record.key {
                // Its own core, for what repeats its edge.
                let overlap = geometry.overlap() as usize;
                for (row, to) in from.chunks_exact_mut(core).enumerate() {
                    let (y, z) = (row % core + overlap, row / core + overlap);
                    to.copy_from_slice(&samples[(z * side + y) * side + overlap..][..core]);
                }
            } else {
                let group = match siblings.take() {
                    Some((parent, group)) if parent == key.parent() => group,
                    _ => self.siblings(key)?,
                };
                let neighbour = self.record_in(&group, key)?;
                siblings = Some((key.parent(), group));
                self.decode_core_block(&neighbour, scratch, from)?;
            }
            let of = |axis: usize| runs[axis].iter().filter(move |run| run.step == step[axis]);
            for (zs, ys) in of(2).flat_map(|zs| of(1).map(move |ys| (zs, ys))) {
                for xs in of(0) {
                    if step == [0; 3] && !(xs.repeated || ys.repeated || zs.repeated) {
                        continue;
                    }
                    copy_box(from, core, samples, side, [xs, ys, zs], (min, max));
                }
            }
        }
        scratch.neighbour = block;
        Ok(())
    }

    /// A stored, uniform or empty brick's core alone, `core^3` samples.
    fn decode_core_block<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        core: &mut [T],
    ) -> Result<(), StoreError> {
        match record.state {
            BrickState::Uniform => core.fill(T::from_f64(record.brick_min)),
            BrickState::Empty => core.fill(T::from_f64(self.metadata().empty_value)),
            BrickState::Stored => self.decode_stored(record, scratch, core)?,
            BrickState::Lost => return Err(self.damaged(record.key, Damage::Lost)),
        }
        Ok(())
    }

    /// Reads and decodes a stored brick's core into its place in a whole brick's samples.
    pub(super) fn place_core<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<(), StoreError> {
        let geometry = *self.geometry();
        let (side, core) = (geometry.brick_side(), geometry.core() as usize);
        let overlap = geometry.overlap() as usize;
        let mut block = std::mem::take(&mut scratch.core);
        let from: &mut [T] = typed(&mut block, core.pow(3));
        let decoded = self.decode_stored(record, scratch, from);
        for (row, from) in from.chunks_exact(core).enumerate() {
            let (y, z) = (row % core + overlap, row / core + overlap);
            samples[(z * side + y) * side + overlap..][..core].copy_from_slice(from);
        }
        scratch.core = block;
        decoded
    }
}

/// So many samples of a buffer that serves all types.
fn typed<T: Sample>(bytes: &mut Vec<u64>, count: usize) -> &mut [T] {
    bytemuck::cast_slice_mut(&mut buffer::<u8>(bytes, count * size_of::<T>())[..])
}

/// Copies a box of a neighbour's core, clamped to the range of the brick that asks.
fn copy_box<T: Sample>(
    from: &[T],
    core: usize,
    samples: &mut [T],
    side: usize,
    [xs, ys, zs]: [&Run; 3],
    (min, max): (T, T),
) {
    let source = |run: &Run, sample: usize| {
        if run.repeated { run.from } else { run.from + sample - run.samples.start }
    };
    for z in zs.samples.clone() {
        for y in ys.samples.clone() {
            let row = &from[(source(zs, z) * core + source(ys, y)) * core..][..core];
            for x in xs.samples.clone() {
                let v = row[source(xs, x)];
                // NaN stays: it is in neither half.
                let v = if v < min { min } else { v };
                samples[(z * side + y) * side + x] = if v > max { max } else { v };
            }
        }
    }
}
