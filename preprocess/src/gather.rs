//! From voxels to a brick's samples: core and overlap, the edge repeated outside the volume.

use crate::level_window::LevelWindow;
use crate::source::MappedVoxels;
use crate::window::Window;
use octree_store::{Geometry, NodeKey, Sample};

/// Voxels of a level that can be read row by row, from any thread.
pub(crate) trait Rows<T>: Sync {
    /// Reads `out.len()` voxels from (x, y, z) along x; all lie inside the level.
    fn read_row(&self, xyz: [u64; 3], out: &mut [T]);

    /// Fills `bricks` with the samples of all children of `parent`, one brick after the other in octant
    /// order, where that is quicker than one by one; returns how many of their core voxels were clamped
    /// to the type's range, or `None` where it did nothing.
    fn read_octet(&self, geometry: &Geometry, parent: NodeKey, bricks: &mut [T]) -> Option<u64>
    where
        Self: Sized,
        T: Sample,
    {
        gather_octet(self, geometry, parent, bricks).then_some(0)
    }
}

impl<T: Sample> Rows<T> for MappedVoxels<'_> {
    #[inline(always)]
    fn read_row(&self, xyz: [u64; 3], out: &mut [T]) {
        MappedVoxels::read_row(self, xyz, out);
    }
}

impl<T: Sample> Rows<T> for Window<T> {
    #[inline(always)]
    fn read_row(&self, [x, y, z]: [u64; 3], out: &mut [T]) {
        let row = self.row(y, z);
        out.copy_from_slice(&row[x as usize..x as usize + out.len()]);
    }
}

impl<T: Sample> Rows<T> for LevelWindow {
    #[inline(always)]
    fn read_row(&self, xyz: [u64; 3], out: &mut [T]) {
        LevelWindow::read_row(self, xyz, out);
    }
}

/// Fills `brick` with the samples of `key`, x fastest.
pub(crate) fn gather<T: Sample>(
    rows: &impl Rows<T>,
    geometry: &Geometry,
    key: NodeKey,
    brick: &mut [T],
) {
    let side = geometry.brick_side();
    let dims = geometry.dims_at(key.level()).map(|dim| dim as i64);
    let origin = geometry.sample_origin(key);
    let inside = |axis: usize, i: usize| (origin[axis] + i as i64).clamp(0, dims[axis] - 1) as u64;
    // The samples along x that lie inside: the others repeat the first and the last of them.
    let first = (-origin[0]).max(0) as usize;
    let last = (dims[0] - origin[0]).min(side as i64) as usize;
    let x = inside(0, first);
    for (z, slice) in brick.chunks_exact_mut(side * side).enumerate() {
        let z = inside(2, z);
        if (first, last) == (0, USUAL_SIDE) && side == USUAL_SIDE {
            for (y, row) in slice.as_chunks_mut::<USUAL_SIDE>().0.iter_mut().enumerate() {
                rows.read_row([x, inside(1, y), z], row);
            }
            continue;
        }
        for (y, row) in slice.chunks_exact_mut(side).enumerate() {
            rows.read_row([x, inside(1, y), z], &mut row[first..last]);
            let (left, right) = (row[first], row[last - 1]);
            row[..first].fill(left);
            row[last..].fill(right);
        }
    }
}

/// Fills `bricks` with the samples of all children of `parent`, one brick after the other in octant
/// order, where there are eight usual bricks; else it does nothing and says so. Each row is read once
/// for the up to eight bricks that share it: half the way of [`gather`] through the source's pages.
pub(crate) fn gather_octet<T: Sample>(
    rows: &impl Rows<T>,
    geometry: &Geometry,
    parent: NodeKey,
    bricks: &mut [T],
) -> bool {
    let [child, .., last_child] = parent.children();
    let usual = geometry.brick_side() == USUAL_SIDE && geometry.core() == USUAL_CORE as u32;
    if !usual || !geometry.contains(last_child) {
        return false;
    }
    let dims = geometry.dims_at(child.level()).map(|dim| dim as i64);
    let origin = geometry.sample_origin(child);
    let inside = |axis: usize, i: usize| (origin[axis] + i as i64).clamp(0, dims[axis] - 1) as u64;
    let first = (-origin[0]).max(0) as usize;
    let last = (dims[0] - origin[0]).min(PAIR as i64) as usize;
    let x = inside(0, first);
    let (bricks, _) = bricks.as_chunks_mut::<USUAL_SIDE>();
    if (first, last) == (0, PAIR) {
        // Rows of a length that the compiler knows, in a loop of their own.
        spread(bricks, |dy, dz, row| rows.read_row([x, inside(1, dy), inside(2, dz)], row));
    } else {
        spread(bricks, |dy, dz, row| {
            rows.read_row([x, inside(1, dy), inside(2, dz)], &mut row[first..last]);
            let (left, right) = (row[first], row[last - 1]);
            row[..first].fill(left);
            row[last..].fill(right);
        });
    }
    true
}

/// Reads each row (y, z) of an octet once and copies it to the rows of all bricks that share it.
#[inline(always)]
fn spread<T: Sample>(bricks: &mut [[T; USUAL_SIDE]], read: impl Fn(usize, usize, &mut [T; PAIR])) {
    let mut row = [T::default(); PAIR];
    for dz in 0..PAIR {
        for dy in 0..PAIR {
            read(dy, dz, &mut row);
            let [low, high]: [&[T; USUAL_SIDE]; 2] = [
                row.first_chunk().expect("a pair is longer than a brick"),
                row.last_chunk().expect("a pair is longer than a brick"),
            ];
            for (bz, lz) in halves(dz) {
                for (by, ly) in halves(dy) {
                    // The brick's row: 4 bricks' worth of rows a half of z, 2 a half of y.
                    let at = ((4 * bz + 2 * by) * USUAL_SIDE + lz) * USUAL_SIDE + ly;
                    bricks[at] = *low;
                    bricks[at + USUAL_SIDE * USUAL_SIDE] = *high;
                }
            }
        }
    }
}

/// Which of two neighbouring bricks hold a sample of the pair, and where.
fn halves(at: usize) -> impl Iterator<Item = (usize, usize)> {
    [(0, Some(at)), (1, at.checked_sub(USUAL_CORE))]
        .into_iter()
        .filter_map(|(half, at)| Some((half, at.filter(|at| *at < USUAL_SIDE)?)))
}

/// Core samples along the usual brick.
const USUAL_CORE: usize = 32;
/// Samples along two usual bricks side by side.
const PAIR: usize = USUAL_SIDE + USUAL_CORE;

/// Samples along the usual brick: rows of a length that the compiler knows are copied in vectors,
/// without a call to the C library for each.
const USUAL_SIDE: usize = 36;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Everywhere;

    /// Each voxel's value names its place, so a wrong place shows.
    fn value([x, y, z]: [u64; 3]) -> u32 {
        (x + 1000 * y + 1_000_000 * z) as u32
    }

    impl Rows<u32> for Everywhere {
        fn read_row(&self, [x, y, z]: [u64; 3], out: &mut [u32]) {
            for (out, x) in out.iter_mut().zip(x..) {
                *out = value([x, y, z]);
            }
        }
    }

    proptest! {
        #[test]
        fn every_sample_is_the_nearest_voxel_of_the_volume(
            dims in [1_u64..80, 1_u64..80, 1_u64..80],
            half_core in 4_u32..17, overlap in 0_u32..5, level in 0_u8..3,
        ) {
            assert_nearest(dims, 2 * half_core, overlap, level);
        }

        #[test]
        fn every_sample_of_usual_bricks_is_the_nearest_voxel(
            dims in [30_u64..140, 30_u64..140, 30_u64..140],
        ) {
            assert_nearest(dims, 32, 2, 0);
        }
    }

    #[test]
    fn an_octet_gathered_at_once_is_its_bricks_gathered_apart() {
        let geometry = Geometry::new([140, 200, 260], 32, 2).unwrap();
        let samples = geometry.brick_samples();
        let (mut bricks, mut brick) = (vec![0; 8 * samples], vec![0; samples]);
        let mut at_once = 0;
        for (x, y, z) in
            (0..3).flat_map(|x| (0..4).flat_map(move |y| (0..5).map(move |z| (x, y, z))))
        {
            let parent = NodeKey::new(1, [x, y, z]);
            if !geometry.contains(parent)
                || !gather_octet(&Everywhere, &geometry, parent, &mut bricks)
            {
                continue;
            }
            at_once += 1;
            for (key, gathered) in parent.children().into_iter().zip(bricks.chunks_exact(samples)) {
                gather(&Everywhere, &geometry, key, &mut brick);
                assert!(gathered == brick, "{key}");
            }
        }
        assert_eq!(at_once, 2 * 3 * 4, "2 x 3 x 4 octets have all eight bricks");
    }

    fn assert_nearest(dims: [u64; 3], core: u32, overlap: u32, level: u8) {
        let geometry = Geometry::new(dims, core, overlap).unwrap();
        let level = level.min(geometry.top_level());
        let grid = geometry.grid_at(level);
        let side = geometry.brick_side();
        for key in [[0; 3], grid.map(|n| n - 1), grid.map(|n| n / 2)] {
            let key = NodeKey::new(level, key);
            let mut brick = vec![0; geometry.brick_samples()];
            gather(&Everywhere, &geometry, key, &mut brick);
            let level_dims = geometry.dims_at(level);
            for (i, sample) in brick.into_iter().enumerate() {
                let local = [i % side, i / side % side, i / side / side];
                let nearest = [0, 1, 2].map(|axis| {
                    let v = geometry.sample_origin(key)[axis] + local[axis] as i64;
                    v.clamp(0, level_dims[axis] as i64 - 1) as u64
                });
                assert_eq!(sample, value(nearest));
            }
        }
    }
}
