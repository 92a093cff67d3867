//! How far the cells of a level lie from those of the level above that hold them.
//!
//! [`by_rows`] measures any type, a row at a time, in f64. Integers up to 16 bits are first measured in
//! whole numbers, vectors of them; where those are exact in f64 too, both ways give the same bits.

use super::Core;
use multiversion::multiversion;
use octree_store::encoding::finite_range;
use octree_store::{Geometry, NodeKey, Sample, SampleType};

/// (fine cell - coarse cell that holds it), each fine cell weighted by its level-0 voxels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct StepDeviation {
    /// Root mean square deviation.
    pub(crate) rms: f64,
    /// Largest absolute deviation.
    pub(crate) amax: f64,
}

/// Measures one brick's step to its coarse cells. Cells that are not finite deviate by 0.
pub(crate) fn step_deviation<T: Sample>(
    brick: &[T],
    core: &Core,
    coarse: &[T],
    geometry: &Geometry,
    key: NodeKey,
) -> StepDeviation {
    let weights = Weights::of(geometry, key);
    if T::TYPE.is_integer() && size_of::<T>() <= 2 {
        let (squares, amax) = small_deviations(brick, core, coarse, weights);
        // Every partial sum is a whole number that f64 holds.
        if amax < 1 << 15 && weights.all * f64::from(amax).powi(2) <= (1_u64 << 53) as f64 {
            let rms = (squares as f64 / weights.all).sqrt();
            return StepDeviation { rms, amax: f64::from(amax) };
        }
    }
    by_rows(brick, core, coarse, weights)
}

/// Level-0 voxels of a cell along every axis, and of the last cell along each: only at the volume's
/// end can it hold fewer.
#[derive(Debug, Clone, Copy)]
struct Weights {
    full: u64,
    last: [u64; 3],
    /// Level-0 voxels of all cells.
    all: f64,
}

impl Weights {
    fn of(geometry: &Geometry, key: NodeKey) -> Self {
        let region = geometry.core_region(key);
        let full = 1_u64 << key.level();
        let last = [0, 1, 2].map(|axis| {
            let start = (region.max[axis] - 1) << key.level();
            full.min(geometry.dims_xyz()[axis] - start)
        });
        Self { full, last, all: geometry.voxels_beneath(key) as f64 }
    }
}

/// The deviation of any type: rows in f64, in order.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn by_rows<T: Sample>(
    brick: &[T],
    core: &Core,
    coarse: &[T],
    Weights { full, last, all }: Weights,
) -> StepDeviation {
    let [cx, cy, _] = core.coarse_extent();
    let [nx, ny, nz] = core.extent;
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
        let weight_z = if z + 1 == nz { last[2] } else { full };
        for y in 0..ny {
            let weight_y = if y + 1 == ny { last[1] } else { full };
            let fine = &brick[core.row(y, z)];
            let coarse = &coarse[(z / 2 * cy + y / 2) * cx..][..cx];
            // Whole rows where all their cells weigh the same, else the last cell apart.
            let body = if last[0] == full { nx } else { nx - 1 };
            let (squares, max) = squares_and_max(&fine[..body], coarse, scale);
            let (end, end_max) = squares_and_max(&fine[body..], &coarse[body / 2..], scale);
            let row = full as f64 * squares + last[0] as f64 * end;
            total += (weight_y * weight_z) as f64 * row;
            amax = amax.max(max).max(end_max);
        }
    }
    StepDeviation {
        rms: ((total / all).sqrt() / scale).min(f64::MAX),
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
            let (fine, coarse) = (fine.to_f64(), coarse.to_f64());
            // What is made larger may overflow, and what is made smaller may vanish.
            let deviation =
                if scale > 1.0 { (fine - coarse) * scale } else { fine * scale - coarse * scale };
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

/// Weighted squares and largest of (fine - coarse) of integers up to 16 bits. The squares are right
/// where they fit 64 bits and the largest is below 2^15.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn small_deviations<T: Sample>(
    brick: &[T],
    core: &Core,
    coarse: &[T],
    Weights { full, last, .. }: Weights,
) -> (u64, u16) {
    let [cx, cy, _] = core.coarse_extent();
    let [nx, ny, nz] = core.extent;
    // Pairs whose cells weigh the same together, the one or two that are left apart.
    let body = if last[0] == full { nx } else { nx - 1 } & !1;
    let rows = if last[1] == full { ny } else { ny - 1 };
    let mut total = 0_u64;
    let mut amax = 0;
    // Lanes that only whole vectors are added to stay vectors.
    let (mut lanes, mut rest) = (DeviationLanes::default(), DeviationLanes::default());
    for z in 0..nz {
        let weight_z = if z + 1 == nz { last[2] } else { full };
        for (ys, weight_y) in [(0..rows, full), (rows..ny, last[1])] {
            if ys.is_empty() {
                continue;
            }
            let mut ends = 0_u64;
            for y in ys {
                let fine = &brick[core.row(y, z)];
                let coarse = &coarse[(z / 2 * cy + y / 2) * cx..][..cx];
                add_row(&mut lanes, &mut rest, &fine[..body], coarse);
                for x in body..nx {
                    let deviation = from_least(fine[x]).abs_diff(from_least(coarse[x / 2]));
                    let weight = if x + 1 == nx { last[0] } else { full };
                    let square = u64::from(deviation) * u64::from(deviation);
                    ends = ends.wrapping_add(weight.wrapping_mul(square));
                    amax = amax.max(deviation);
                }
            }
            let squares = lanes.take_squares() + rest.take_squares();
            let row = full.wrapping_mul(squares).wrapping_add(ends);
            total = total.wrapping_add((weight_y.wrapping_mul(weight_z)).wrapping_mul(row));
        }
    }
    (total, amax.max(lanes.largest()).max(rest.largest()))
}

/// Adds an even number of fine cells, and the coarse cells that hold them.
#[inline(always)]
fn add_row<T: Sample>(
    lanes: &mut DeviationLanes,
    rest: &mut DeviationLanes,
    fine: &[T],
    coarse: &[T],
) {
    let (fine_pieces, fine) = fine.as_chunks::<32>();
    let (coarse_pieces, _) = coarse.as_chunks::<16>();
    for (fine, coarse) in fine_pieces.iter().zip(coarse_pieces) {
        lanes.add_piece(fine, coarse);
    }
    let coarse = &coarse[16 * fine_pieces.len()..];
    let (fine_pieces, fine) = fine.as_chunks::<8>();
    let (coarse_pieces, _) = coarse.as_chunks::<4>();
    for (fine, coarse) in fine_pieces.iter().zip(coarse_pieces) {
        rest.add_piece(fine, coarse);
    }
    let coarse = &coarse[4 * fine_pieces.len()..];
    for (fine, coarse) in fine.as_chunks::<2>().0.iter().zip(coarse) {
        rest.add_piece(fine, &[*coarse]);
    }
}

/// Squares and largest deviations, two places of a row to a lane. The squares' low and high halves
/// are summed apart, as together they would not fit 32 bits.
#[derive(Default)]
struct DeviationLanes {
    low: [u32; 16],
    high: [u32; 16],
    largest: [u16; 32],
}

impl DeviationLanes {
    /// A loop for each step: the compiler makes a few vector instructions of each.
    #[inline(always)]
    fn add_piece<T: Sample, const FINE: usize, const COARSE: usize>(
        &mut self,
        fine: &[T; FINE],
        coarse: &[T; COARSE],
    ) {
        let mut doubled = [0_u16; FINE];
        for i in 0..COARSE {
            doubled[2 * i] = from_least(coarse[i]);
            doubled[2 * i + 1] = from_least(coarse[i]);
        }
        let mut deviations = [0_u16; FINE];
        for i in 0..FINE {
            deviations[i] = from_least(fine[i]).abs_diff(doubled[i]);
        }
        for (largest, deviation) in self.largest.iter_mut().zip(deviations) {
            *largest = deviation.max(*largest);
        }
        for i in 0..COARSE {
            // Below 2^15, else the sum is not used; then this is one instruction.
            let [a, b] = [deviations[2 * i], deviations[2 * i + 1]].map(|d| i32::from(d as i16));
            let squares = (a * a).wrapping_add(b * b) as u32;
            self.low[i] += squares & 0xffff;
            self.high[i] += squares >> 16;
        }
    }

    /// The sum of the squares so far; the next begins at 0.
    #[inline(always)]
    fn take_squares(&mut self) -> u64 {
        let mut squares = 0;
        for i in 0..16 {
            squares += u64::from(self.low[i]) + (u64::from(self.high[i]) << 16);
        }
        (self.low, self.high) = ([0; 16], [0; 16]);
        squares
    }

    #[inline(always)]
    fn largest(&self) -> u16 {
        let mut largest = 0;
        for lane in self.largest {
            largest = lane.max(largest);
        }
        largest
    }
}

/// How far a small integer lies above the least of its type: 16 bits without a sign hold all.
#[inline(always)]
fn from_least<T: Sample>(v: T) -> u16 {
    (v.to_i32() - T::LEAST.to_i32()) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check<T: Sample>(geometry: &Geometry, key: NodeKey, value: impl Fn(u64) -> T) {
        let core = Core::of(geometry, key);
        let fine: Vec<T> = (0..geometry.brick_samples() as u64).map(&value).collect();
        let cells = core.coarse_extent().iter().product::<usize>() as u64;
        let coarse: Vec<T> = (0..cells).map(|i| value(!i)).collect();
        let fast = step_deviation(&fine, &core, &coarse, geometry, key);
        assert_eq!(fast, by_rows(&fine, &core, &coarse, Weights::of(geometry, key)));
    }

    proptest! {
        #[test]
        fn whole_numbers_give_the_bits_that_rows_give(
            dims in [1_u64..150, 1_u64..90, 1_u64..80], half_core in 4_u32..24,
            overlap in 0_u32..3, level in 0_u8..4, seed in any::<u64>(), range in 1_u64..65_536,
        ) {
            let geometry = Geometry::new(dims, 2 * half_core, overlap).unwrap();
            let level = level.min(geometry.top_level());
            let random = |i: u64| i.wrapping_add(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            for brick in [geometry.grid_at(level).map(|n| n - 1), [0; 3]] {
                let key = NodeKey::new(level, brick);
                check(&geometry, key, |i| (random(i) % range) as u16);
                check(&geometry, key, |i| (random(i) % range) as i16);
                check(&geometry, key, |i| (random(i) % range) as u8);
                check(&geometry, key, |i| (random(i) % range) as i8);
            }
        }
    }
}
