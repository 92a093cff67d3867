//! The mean of the 2x2x2 cells that exist: at an odd edge there are four, two or one of them.
//!
//! Integers round half to even, so that repeated halving has no bias. In float volumes the mean is
//! over the finite cells; where there is none it is the IEEE mean of all.

use super::Blocks;
use multiversion::multiversion;
use octree_store::Sample;

/// Writes the mean of every block.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn mean<T: Sample>(blocks: Blocks<'_, T>, coarse: &mut [T]) {
    let Blocks { brick, core } = blocks;
    let [nx, ny, nz] = core.extent;
    let [cx, cy, _] = core.coarse_extent();
    let small = T::TYPE.is_integer() && size_of::<T>() <= 2;
    for (z, slice) in coarse.chunks_exact_mut(cx * cy).enumerate() {
        for (y, out) in slice.chunks_exact_mut(cx).enumerate() {
            let (pairs, odd) = out.split_at_mut(nx / 2);
            if small && 2 * y + 1 < ny && 2 * z + 1 < nz {
                let row = |dy, dz| &brick[core.row(2 * y + dy, 2 * z + dz)];
                mean_of_rows([row(0, 0), row(1, 0), row(0, 1), row(1, 1)], pairs);
                for out in odd {
                    let last = |dy, dz| row(dy, dz)[nx - 1];
                    let cells = [last(0, 0), last(1, 0), last(0, 1), last(1, 1)];
                    *out = mean_of(cells.into_iter());
                }
                continue;
            }
            let (rows, count) = blocks.rows_at(y, z);
            let rows = &rows[..count];
            for (x, out) in pairs.iter_mut().enumerate() {
                *out = mean_of(rows.iter().flat_map(|row| [row[2 * x], row[2 * x + 1]]));
            }
            for out in odd {
                *out = mean_of(rows.iter().map(|row| row[nx - 1]));
            }
        }
    }
}

/// Means of 2x2x2 small integers out of four rows, in pieces whose length the compiler knows.
#[inline(always)]
fn mean_of_rows<T: Sample>(rows: [&[T]; 4], out: &mut [T]) {
    let (out_pieces, out) = out.as_chunks_mut::<16>();
    let [a, b, c, d] = rows.map(|row| row.as_chunks::<32>().0);
    for ((((out, a), b), c), d) in out_pieces.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        mean_of_pieces([a, b, c, d], out);
    }
    let at = 32 * out_pieces.len();
    let rows = rows.map(|row| &row[at..]);
    for (x, out) in out.iter_mut().enumerate() {
        let mut sum = 0;
        for row in rows {
            sum += row[2 * x].to_i32() + row[2 * x + 1].to_i32();
        }
        *out = T::from_i32(half_to_even(sum));
    }
}

#[inline(always)]
fn mean_of_pieces<T: Sample>(rows: [&[T; 32]; 4], out: &mut [T; 16]) {
    let mut sums = [0_i32; 32];
    for row in rows {
        for (sum, v) in sums.iter_mut().zip(row) {
            *sum += v.to_i32();
        }
    }
    for (x, out) in out.iter_mut().enumerate() {
        *out = T::from_i32(half_to_even(sums[2 * x] + sums[2 * x + 1]));
    }
}

/// An eighth of a sum: add 3, and 1 more where the quotient is odd.
#[inline(always)]
fn half_to_even(sum: i32) -> i32 {
    (sum + 3 + (sum >> 3 & 1)) >> 3
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

#[cfg(test)]
mod tests {
    use super::*;

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
