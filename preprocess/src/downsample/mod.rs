//! One step of the pyramid: 2x2x2 cells become one, and how far the coarse cell lies from the fine.

mod deviation;
mod extremum;
mod mean;
mod mode;
mod nearest;

pub(crate) use deviation::{StepDeviation, step_deviation};

use octree_store::{DownsampleFilter, Geometry, NodeKey, Sample};

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

/// Writes one cell for every 2x2x2 block of a brick's core; `coarse` becomes
/// [`Core::coarse_extent`] cells, x fastest.
pub(crate) fn downsample<T: Sample>(
    filter: DownsampleFilter,
    brick: &[T],
    core: &Core,
    coarse: &mut Vec<T>,
) {
    coarse.clear();
    coarse.resize(core.coarse_extent().iter().product(), T::default());
    let blocks = Blocks { brick, core };
    match filter {
        DownsampleFilter::Mean => mean::mean(blocks, coarse),
        DownsampleFilter::Max => extremum::extremum::<T, true>(blocks, coarse),
        DownsampleFilter::Min => extremum::extremum::<T, false>(blocks, coarse),
        DownsampleFilter::Mode => mode::mode(blocks, coarse),
        DownsampleFilter::Nearest => nearest::nearest(blocks, coarse),
    }
}

/// The 2x2x2 blocks of a brick's core. At an odd edge a block has four, two or one cell.
#[derive(Debug, Clone, Copy)]
struct Blocks<'a, T> {
    brick: &'a [T],
    core: &'a Core,
}

impl<'a, T: Sample> Blocks<'a, T> {
    /// Blocks along x.
    #[inline(always)]
    fn width(&self) -> usize {
        self.core.coarse_extent()[0]
    }

    /// The up to four rows of cells that row `i` of blocks has, y faster than z, and their number.
    #[inline(always)]
    fn rows(&self, i: usize) -> ([&'a [T]; 4], usize) {
        let cy = self.core.coarse_extent()[1];
        self.rows_at(i % cy, i / cy)
    }

    /// The up to four rows of cells of the blocks at (y, z).
    #[inline(always)]
    fn rows_at(&self, y: usize, z: usize) -> ([&'a [T]; 4], usize) {
        let [_, ny, nz] = self.core.extent;
        let (y, z) = (2 * y, 2 * z);
        let mut rows = [&self.brick[..0]; 4];
        let mut count = 0;
        for z in z..(z + 2).min(nz) {
            for y in y..(y + 2).min(ny) {
                rows[count] = &self.brick[self.core.row(y, z)];
                count += 1;
            }
        }
        (rows, count)
    }

    /// The up to eight cells of block `x` of row `i`, x fastest, and their number.
    #[inline(always)]
    fn cells(&self, i: usize, x: usize) -> ([T; 8], usize) {
        let (rows, count) = self.rows(i);
        let mut cells = [T::default(); 8];
        let mut found = 0;
        for row in &rows[..count] {
            for &cell in &row[2 * x..(2 * x + 2).min(row.len())] {
                cells[found] = cell;
                found += 1;
            }
        }
        (cells, found)
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
        downsample(DownsampleFilter::Mean, brick, &core, &mut coarse);
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

    /// A block's cell by the filter's definition.
    fn twin<T: Sample>(filter: DownsampleFilter, cells: &[T]) -> T {
        let chosen =
            |pick: fn(&T) -> bool| -> Vec<T> { cells.iter().copied().filter(pick).collect() };
        let mut finite = chosen(|cell| cell.is_finite());
        finite.sort_by(|a, b| a.partial_cmp(b).unwrap());
        let mut ordered = if finite.is_empty() { chosen(|cell| !cell.is_nan()) } else { finite };
        ordered.sort_by(|a, b| a.partial_cmp(b).unwrap());
        match filter {
            DownsampleFilter::Nearest => cells[0],
            DownsampleFilter::Max => ordered.last().copied().unwrap_or(cells[0]),
            DownsampleFilter::Min => ordered.first().copied().unwrap_or(cells[0]),
            DownsampleFilter::Mode if !ordered.iter().any(|cell| cell.is_finite()) => cells[0],
            DownsampleFilter::Mode => {
                let runs: Vec<_> = ordered.chunk_by(|a, b| a == b).collect();
                let most = runs.iter().map(|run| run.len()).max().unwrap();
                runs.iter().find(|run| run.len() == most).unwrap()[0]
            }
            DownsampleFilter::Mean => {
                let of = if ordered.iter().any(|cell| cell.is_finite()) { &ordered } else { cells };
                T::from_f64(of.iter().map(|cell| cell.to_f64()).sum::<f64>() / of.len() as f64)
            }
        }
    }

    fn assert_twins<T: Sample>(geometry: &Geometry, key: NodeKey, bits: &[u8]) {
        let core = Core::of(geometry, key);
        // Few values, so that some come more than once, and the extremes of the type.
        let mut values: Vec<T> = (0..5).map(T::from_i32).collect();
        values.push(T::from_i32(if T::LEAST.to_f64() < 0.0 { -3 } else { 9 }));
        if T::TYPE.is_integer() {
            values.extend([T::LEAST, T::GREATEST]);
        } else {
            values.extend([f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::NAN].map(T::from_f64));
        }
        let brick: Vec<T> = (0..geometry.brick_samples())
            .map(|i| values[usize::from(bits[i % bits.len()]) % values.len()])
            .collect();
        let [cx, cy, _] = core.coarse_extent();
        let mut coarse = Vec::new();
        for filter in DownsampleFilter::ALL {
            downsample(filter, &brick, &core, &mut coarse);
            for (i, &cell) in coarse.iter().enumerate() {
                let [x, y, z] = [i % cx, i / cx % cy, i / cx / cy];
                let cells: Vec<T> = (0..8)
                    .map(|o| [2 * x + (o & 1), 2 * y + (o >> 1 & 1), 2 * z + (o >> 2)])
                    .filter(|at| (0..3).all(|axis| at[axis] < core.extent[axis]))
                    .map(|[x, y, z]| brick[core.row(y, z)][x])
                    .collect();
                let twin = twin(filter, &cells);
                assert!(cell == twin || cell.is_nan() && twin.is_nan(), "{filter:?} {cells:?}");
                let new = !cells.iter().any(|other| other.same_bits(cell));
                assert!(filter == DownsampleFilter::Mean || !new, "{filter:?} made {cell}");
            }
        }
    }

    proptest! {
        #[test]
        fn every_filter_equals_its_naive_twin(
            dims in [1_u64..40, 1_u64..40, 1_u64..40], half_core in 4_u32..8,
            bits in proptest::collection::vec(any::<u8>(), 200..999),
        ) {
            let geometry = Geometry::new(dims, 2 * half_core, 1).unwrap();
            for brick in [[0; 3], geometry.grid_at(0).map(|n| n - 1)] {
                let key = NodeKey::new(0, brick);
                for sample_type in octree_store::SampleType::ALL {
                    octree_store::with_sample_type!(sample_type, T => {
                        assert_twins::<T>(&geometry, key, &bits);
                    });
                }
            }
        }
    }
}
