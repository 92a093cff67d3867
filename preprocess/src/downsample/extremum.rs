//! The greatest or the least of the 2x2x2 cells that exist: no bright or dark detail is lost.
//!
//! In float volumes it is that of the finite cells; where there is none, that of all but NaN, and NaN
//! only where all cells are.

use super::Blocks;
use multiversion::multiversion;
use octree_store::Sample;

/// Writes the greatest (`GREATEST`) or the least cell of every block.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn extremum<T: Sample, const GREATEST: bool>(blocks: Blocks<'_, T>, coarse: &mut [T]) {
    for (i, out) in coarse.chunks_exact_mut(blocks.width()).enumerate() {
        let (rows, count) = blocks.rows(i);
        for (x, out) in out.iter_mut().enumerate() {
            let pair = 2 * x..(2 * x + 2).min(rows[0].len());
            let mut best = if GREATEST { T::LEAST } else { T::GREATEST };
            let mut any = T::TYPE.is_integer();
            for row in &rows[..count] {
                for &cell in &row[pair.clone()] {
                    any |= cell.is_finite();
                    let better = if GREATEST { cell > best } else { cell < best };
                    best = if better && cell.is_finite() { cell } else { best };
                }
            }
            *out = if any { best } else { of_no_numbers::<T, GREATEST>(&blocks, i, x) };
        }
    }
}

/// The extremum of cells of which none is finite.
#[cold]
fn of_no_numbers<T: Sample, const GREATEST: bool>(blocks: &Blocks<'_, T>, i: usize, x: usize) -> T {
    let (cells, count) = blocks.cells(i, x);
    let mut best = cells[0];
    for &cell in &cells[1..count] {
        let better = if GREATEST { cell > best } else { cell < best };
        if better || best.is_nan() {
            best = cell;
        }
    }
    best
}
