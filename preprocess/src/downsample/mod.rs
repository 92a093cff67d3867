//! One step of the pyramid: 2x2x2 cells become one, and how far the coarse cell lies from the fine.

mod deviation;
mod mean;

pub(crate) use deviation::{StepDeviation, step_deviation};
pub(crate) use mean::mean;

use octree_store::{Geometry, NodeKey};

/// A brick's in-volume core, as a box inside the brick's samples.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Core {
    /// Samples along a side of the brick.
    pub(crate) side: usize,
    /// First core sample along every axis.
    pub(crate) overlap: usize,
    /// In-volume core voxels along x, y, z.
    pub(crate) extent: [usize; 3],
}

impl Core {
    pub(crate) fn of(geometry: &Geometry, key: NodeKey) -> Self {
        Self {
            side: geometry.brick_side(),
            overlap: geometry.overlap() as usize,
            extent: geometry.core_region(key).dims_xyz().map(|n| n as usize),
        }
    }

    /// The samples of core row (y, z), as a range of the brick's samples.
    #[inline]
    pub(crate) fn row(&self, y: usize, z: usize) -> std::ops::Range<usize> {
        let start = ((z + self.overlap) * self.side + y + self.overlap) * self.side + self.overlap;
        start..start + self.extent[0]
    }

    /// All core rows, z slowest.
    pub(crate) fn rows(self) -> impl Iterator<Item = std::ops::Range<usize>> + Clone {
        let [_, ny, nz] = self.extent;
        (0..nz).flat_map(move |z| (0..ny).map(move |y| self.row(y, z)))
    }

    /// Cells of the next level along x, y, z.
    pub(crate) fn coarse_extent(&self) -> [usize; 3] {
        self.extent.map(|n| n.div_ceil(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use octree_store::Sample;
    use proptest::prelude::*;

    /// The definition, one cell at a time, in exact integers: sums, and a tie to the even side.
    fn mean_twin(cells: &[i64]) -> i64 {
        let (sum, n) = (cells.iter().sum::<i64>(), cells.len() as i64);
        let floor = sum.div_euclid(n);
        match (2 * sum.rem_euclid(n)).cmp(&n) {
            std::cmp::Ordering::Less => floor,
            std::cmp::Ordering::Greater => floor + 1,
            std::cmp::Ordering::Equal => floor + floor.rem_euclid(2),
        }
    }

    fn check<T: Sample>(geometry: &Geometry, key: NodeKey, brick: &[T]) {
        let core = Core::of(geometry, key);
        let mut coarse = Vec::new();
        mean(brick, &core, &mut coarse);
        let [cx, cy, cz] = core.coarse_extent();
        let at = |[x, y, z]: [usize; 3]| brick[core.row(y, z)][x].to_f64();
        let (mut twin_squares, mut twin_amax) = (0.0, 0.0_f64);
        for (i, cell) in coarse.iter().enumerate() {
            let [x, y, z] = [i % cx, i / cx % cy, i / cx / cy];
            let mut cells = Vec::new();
            for fine in (0..8).map(|o| [2 * x + (o & 1), 2 * y + (o >> 1 & 1), 2 * z + (o >> 2)]) {
                if (0..3).all(|axis| fine[axis] < core.extent[axis]) {
                    cells.push(at(fine) as i64);
                    let region = geometry.core_region(key);
                    let level = key.level();
                    let weight: u64 = (0..3)
                        .map(|axis| {
                            let v = region.min[axis] + fine[axis] as u64;
                            ((v + 1) << level).min(geometry.dims_xyz()[axis]) - (v << level)
                        })
                        .product();
                    let deviation = at(fine) - cell.to_f64();
                    twin_squares += weight as f64 * deviation * deviation;
                    twin_amax = twin_amax.max(deviation.abs());
                }
            }
            assert_eq!(cell.to_f64() as i64, mean_twin(&cells), "{:?} of {cells:?}", T::TYPE);
        }
        assert_eq!(coarse.len(), cx * cy * cz);
        let step = step_deviation(brick, &core, &coarse, geometry, key);
        assert_eq!(step.amax, twin_amax);
        let twin_rms = (twin_squares / geometry.voxels_beneath(key) as f64).sqrt();
        assert!((step.rms - twin_rms).abs() <= 1e-9 * twin_rms);
    }

    proptest! {
        #[test]
        fn integers_equal_the_naive_twin(
            dims in [1_u64..40, 1_u64..40, 1_u64..40], level in 0_u8..3, seed in any::<u64>(),
        ) {
            let geometry = Geometry::new(dims, 8, 1).unwrap();
            let level = level.min(geometry.top_level());
            let key = NodeKey::new(level, geometry.grid_at(level).map(|n| n - 1));
            let mut state = seed | 1;
            let mut next = || {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                state
            };
            let n = geometry.brick_samples();
            check(&geometry, key, &(0..n).map(|_| next() as u8).collect::<Vec<_>>());
            check(&geometry, key, &(0..n).map(|_| next() as i16).collect::<Vec<_>>());
            check(&geometry, key, &(0..n).map(|_| next() as u16).collect::<Vec<_>>());
            check(&geometry, key, &(0..n).map(|_| next() as u32).collect::<Vec<_>>());
            check(&geometry, key, &(0..n).map(|_| next() as i32).collect::<Vec<_>>());
        }
    }
}
