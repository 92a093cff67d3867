//! The octaves that noise is made of: their lattices, filters and strengths.
//!
//! In the manner of wavelet noise (R. L. Cook and T. DeRose, "Wavelet noise", SIGGRAPH 2005) an octave
//! is white noise on a lattice less its own low-pass part: of m cells a source voxel the half (of 3
//! cells two thirds) of the frequencies that are the highest. The low-pass filter is the Catmull-Rom
//! kernel, sampled: 7 taps (or 11). Lattices of 2 and 4 cells a voxel are stretched to the new voxels by
//! the tricubic kernel. Every octave has the same energy (pink noise); together their mean square is 1.

use super::kernel::CubicKernel;
use super::weights::{REACH, Stencils, cubic};

/// One octave.
#[derive(Debug)]
pub(super) struct Octave {
    /// Its number: octaves differ.
    pub(super) number: u64,
    /// Lattice cells along a source voxel.
    pub(super) cells: usize,
    /// The low-pass filter: weights at distance 0, 1, 2 … cells.
    pub(super) low_pass: Vec<f32>,
    /// From a hash, as a signed integer, to the value of a cell.
    pub(super) scale: f32,
    /// From the lattice to the new voxels, where these are finer.
    pub(super) stretch: Option<Stencils<f32, 4>>,
}

/// The octaves for volumes enlarged so many times.
pub(super) fn octaves(factor: usize) -> Vec<Octave> {
    let cells: &[usize] = match factor {
        3 => &[3],
        4 => &[2, 4],
        8 => &[2, 4, 8],
        _ => &[2],
    };
    let share = 1.0 / cells.len() as f64;
    cells
        .iter()
        .enumerate()
        .map(|(number, &cells)| {
            let ratio = if cells == 3 { 3 } else { 2 };
            let low_pass = low_pass(ratio);
            let stretch =
                (cells < factor).then(|| cubic::<f64>(factor / cells, CubicKernel::CatmullRom));
            let gain = (share / mean_square(cells, factor, &low_pass, stretch.as_ref())).sqrt();
            Octave {
                number: number as u64,
                cells,
                low_pass: low_pass.iter().map(|w| *w as f32).collect(),
                // Uniform from -2^31 to 2^31 has a mean square of 2^62 / 3.
                scale: (gain * 3_f64.sqrt() / 2_147_483_648.0) as f32,
                stretch: stretch.is_some().then(|| cubic(factor / cells, CubicKernel::CatmullRom)),
            }
        })
        .collect()
}

/// The Catmull-Rom kernel at multiples of 1/ratio, over the ratio: it passes what a lattice `ratio`
/// times coarser can hold, and its weights sum to 1. Every ratio-th of them is 0.
fn low_pass(ratio: u32) -> Vec<f64> {
    let ratio = f64::from(ratio);
    let weights = (0..12).map(|k| CubicKernel::CatmullRom.at(f64::from(k) / ratio) / ratio);
    let mut weights: Vec<f64> = weights.collect();
    while weights.last() == Some(&0.0) {
        weights.pop();
    }
    weights
}

/// The mean square, over the places within a source voxel, of what becomes of white noise of mean square
/// 1 on the lattice.
///
/// All steps are separable or differences of separable ones: with U the stretching, L the low-pass filter
/// and P the mean over a voxel, the noise is (1 - P) U (1 - L) = U - UL - PU + PUL of the white noise, and
/// the mean of products of two such terms is that of an axis, cubed.
fn mean_square(
    cells: usize,
    factor: usize,
    low_pass: &[f64],
    stretch: Option<&Stencils<f64, 4>>,
) -> f64 {
    // Columns are lattice cells, from `around` before the voxel to `around` after it.
    let around = REACH + low_pass.len();
    let columns = cells + 2 * around;
    let mut u = vec![vec![0.0; columns]; factor];
    for (place, row) in u.iter_mut().enumerate() {
        match stretch {
            None => row[place + around] = 1.0,
            Some(stencils) => {
                let stencil = &stencils[place % stencils.len()];
                let own = (place / stencils.len() + around) as i64;
                for (tap, weight) in stencil.taps.iter().zip(stencil.weights) {
                    row[(own + tap) as usize] += weight;
                }
            }
        }
    }
    let filtered = |row: &Vec<f64>| -> Vec<f64> {
        let weight = |a: usize, b: usize| low_pass.get(a.abs_diff(b)).copied().unwrap_or(0.0);
        (0..columns).map(|j| (0..columns).map(|i| row[i] * weight(i, j)).sum()).collect()
    };
    let mean = |rows: &[Vec<f64>]| -> Vec<Vec<f64>> {
        let mean = |j: usize| rows.iter().map(|row| row[j]).sum::<f64>() / factor as f64;
        vec![(0..columns).map(mean).collect(); factor]
    };
    let ul: Vec<_> = u.iter().map(filtered).collect();
    let (pu, pul) = (mean(&u), mean(&ul));
    let terms = [(1.0, u), (-1.0, ul), (-1.0, pu), (1.0, pul)];
    let mut sum = 0.0;
    for (sign_a, a) in &terms {
        for (sign_b, b) in &terms {
            let pairs = a.iter().flatten().zip(b.iter().flatten());
            let product = pairs.map(|(a, b)| a * b).sum::<f64>() / factor as f64;
            sum += sign_a * sign_b * product * product * product;
        }
    }
    sum
}
