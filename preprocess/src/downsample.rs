//! One step of the pyramid: 2x2x2 cells become one, and how far the coarse cell lies from the fine.
//!
//! The mean is over the cells that exist: at an odd edge there are four, two or one of them. Integers
//! round half to even, so that repeated halving has no bias. In float volumes the mean is over the
//! finite cells; where there is none it is the IEEE mean of all.

use multiversion::multiversion;
use octree_store::encoding::finite_range;
use octree_store::{Geometry, NodeKey, Sample, SampleType};

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

/// Writes the mean of every 2x2x2 block of a brick's core; `coarse` becomes
/// [`Core::coarse_extent`] cells, x fastest.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(crate) fn mean<T: Sample>(brick: &[T], core: &Core, coarse: &mut Vec<T>) {
    let [cx, cy, cz] = core.coarse_extent();
    coarse.clear();
    coarse.resize(cx * cy * cz, T::default());
    let [nx, ny, nz] = core.extent;
    for (i, out) in coarse.chunks_exact_mut(cx).enumerate() {
        let (y, z) = (2 * (i % cy), 2 * (i / cy));
        let (ys, zs) = ((ny - y).min(2), (nz - z).min(2));
        let mut rows = [&brick[..0]; 4];
        let mut count = 0;
        for dz in 0..zs {
            for dy in 0..ys {
                rows[count] = &brick[core.row(y + dy, z + dz)];
                count += 1;
            }
        }
        let (pairs, odd) = out.split_at_mut(nx / 2);
        match (count, T::TYPE.is_integer() && size_of::<T>() <= 2) {
            (4, true) => {
                for (x, out) in pairs.iter_mut().enumerate() {
                    let sum: i32 =
                        rows.iter().map(|row| row[2 * x].to_i32() + row[2 * x + 1].to_i32()).sum();
                    // Half to even: add 3, and 1 more where the quotient is odd.
                    *out = T::from_i32((sum + 3 + (sum >> 3 & 1)) >> 3);
                }
            }
            _ => {
                for (x, out) in pairs.iter_mut().enumerate() {
                    *out =
                        mean_of(rows[..count].iter().flat_map(|row| [row[2 * x], row[2 * x + 1]]));
                }
            }
        }
        for out in odd {
            *out = mean_of(rows[..count].iter().map(|row| row[nx - 1]));
        }
    }
}

/// The mean of at most eight cells: exact sums in f64 for every integer type, one rounding.
fn mean_of<T: Sample>(cells: impl Iterator<Item = T> + Clone) -> T {
    let finite = cells.clone().filter(|cell| cell.is_finite());
    let (sum, count) = finite.fold((0.0, 0), |(sum, n), cell| (sum + cell.to_f64(), n + 1));
    if count > 0 {
        let mean: f64 = sum / f64::from(count);
        // Eight f64 extremes may overflow; a mean never leaves the range of what it is of.
        return T::from_f64(if mean.is_finite() { mean } else { mean_of_halves(cells) });
    }
    let (sum, count) = cells.fold((0.0, 0), |(sum, n), cell| (sum + cell.to_f64(), n + 1));
    T::from_f64(sum / f64::from(count))
}

/// The mean of finite cells whose sum overflows f64.
fn mean_of_halves<T: Sample>(cells: impl Iterator<Item = T> + Clone) -> f64 {
    let finite = cells.filter(|cell| cell.is_finite());
    let count = finite.clone().count() as f64;
    finite.map(|cell| cell.to_f64() / count).sum()
}

/// (fine cell - coarse cell that holds it), each fine cell weighted by its level-0 voxels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct StepDeviation {
    /// Root mean square deviation.
    pub(crate) rms: f64,
    /// Largest absolute deviation.
    pub(crate) amax: f64,
}

/// Measures one brick's step to its coarse cells. Cells that are not finite deviate by 0.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(crate) fn step_deviation<T: Sample>(
    brick: &[T],
    core: &Core,
    coarse: &[T],
    geometry: &Geometry,
    key: NodeKey,
) -> StepDeviation {
    let [cx, cy, _] = core.coarse_extent();
    let [nx, ny, nz] = core.extent;
    let region = geometry.core_region(key);
    let full = 1_u64 << key.level();
    // Along each axis only the volume's last cell can hold fewer voxels.
    let last_weight: [u64; 3] = [0, 1, 2].map(|axis| {
        let start = (region.max[axis] - 1) << key.level();
        full.min(geometry.dims_xyz()[axis] - start)
    });
    // Squares of the widest and the narrowest f64 ranges would overflow or vanish: a power of two
    // keeps them within.
    let range = if T::TYPE == SampleType::F64 { finite_range(brick) } else { None };
    let scale = match range.map(|(min, max)| max.to_f64() - min.to_f64()) {
        Some(wide) if wide > 1e150 => 2_f64.powi(-600),
        Some(narrow) if narrow < 1e-140 => 2_f64.powi(600),
        _ => 1.0,
    };
    let (mut total, mut amax) = (0.0, 0.0_f64);
    for z in 0..nz {
        let weight_z = if z + 1 == nz { last_weight[2] } else { full };
        for y in 0..ny {
            let weight_y = if y + 1 == ny { last_weight[1] } else { full };
            let fine = &brick[core.row(y, z)];
            let coarse = &coarse[(z / 2 * cy + y / 2) * cx..][..cx];
            // Whole rows where all their cells weigh the same, else the last cell apart.
            let body = if last_weight[0] == full { nx } else { nx - 1 };
            let (squares, max) = squares_and_max(&fine[..body], coarse, scale);
            let (end, end_max) = squares_and_max(&fine[body..], &coarse[body / 2..], scale);
            let row = full as f64 * squares + last_weight[0] as f64 * end;
            total += (weight_y * weight_z) as f64 * row;
            amax = amax.max(max).max(end_max);
        }
    }
    let voxels = geometry.voxels_beneath(key) as f64;
    StepDeviation {
        rms: ((total / voxels).sqrt() / scale).min(f64::MAX),
        amax: (amax / scale).min(f64::MAX),
    }
}

/// Squares and largest of (fine - coarse) x scale, two fine cells to a coarse one.
#[inline(always)]
fn squares_and_max<T: Sample>(fine: &[T], coarse: &[T], scale: f64) -> (f64, f64) {
    let pairs = fine.chunks_exact(2).zip(coarse);
    let odd = fine.chunks_exact(2).remainder().iter().zip(&coarse[fine.len() / 2..]);
    if T::TYPE.is_integer() && size_of::<T>() <= 2 {
        // At most 128 squares below 2^32.
        let (mut squares, mut max) = (0_u64, 0_u32);
        let mut add = |fine: T, coarse: T| {
            let deviation = fine.to_i32().abs_diff(coarse.to_i32());
            squares += u64::from(deviation * deviation);
            max = max.max(deviation);
        };
        for (pair, coarse) in pairs {
            add(pair[0], *coarse);
            add(pair[1], *coarse);
        }
        for (fine, coarse) in odd {
            add(*fine, *coarse);
        }
        return (squares as f64, f64::from(max));
    }
    let (mut squares, mut max) = (0.0, 0.0_f64);
    let mut add = |fine: T, coarse: T| {
        if fine.is_finite() && coarse.is_finite() {
            let deviation = fine.to_f64() * scale - coarse.to_f64() * scale;
            squares += deviation * deviation;
            max = max.max(deviation.abs());
        }
    };
    for (pair, coarse) in pairs {
        add(pair[0], *coarse);
        add(pair[1], *coarse);
    }
    for (fine, coarse) in odd {
        add(*fine, *coarse);
    }
    (squares, max)
}

#[cfg(test)]
mod tests {
    use super::*;
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

    #[test]
    fn ties_go_to_even_on_both_sides_of_zero() {
        let mean = |cells: &[i16]| mean_of(cells.iter().copied());
        assert_eq!([mean(&[0, 1]), mean(&[1, 2]), mean(&[-1, 0]), mean(&[-2, -1])], [0, 2, 0, -2]);
        // A checkerboard is the worst case: 0 and 65535 give 32767.5, and the even neighbour.
        assert_eq!(mean_of([0_u16, 65535, 0, 65535].into_iter()), 32768);
    }

    #[test]
    fn what_is_not_finite_is_left_out_of_the_mean() {
        let mean = |cells: &[f32]| mean_of(cells.iter().copied());
        assert_eq!(mean(&[1.0, f32::NAN, 3.0, f32::INFINITY]), 2.0);
        assert!(mean(&[f32::NAN, f32::NAN]).is_nan());
        assert_eq!(mean(&[f32::INFINITY, f32::INFINITY]), f32::INFINITY);
        assert_eq!(mean(&[f32::MAX; 8]), f32::MAX);
        assert_eq!(mean_of([f64::MAX; 8].into_iter()), f64::MAX);
    }
}
