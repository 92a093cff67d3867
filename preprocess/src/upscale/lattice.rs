//! Steps of a separable interpolation, on rows padded to whole vectors.
//!
//! A box of samples is stretched along x, then y, then z, the first step on the fewest samples:
//! 4 (1/f^2 + 1/f + 1) multiplications a new voxel, 5.25 for f = 4, instead of 64. Along y and z a new
//! row is a weighted sum of rows; only along x do neighbours mix.
//!
//! Everything here is inlined into kernels that are compiled for several instruction sets. Sums have a
//! fixed order that is the same read from either end: mirrored samples give mirrored results.

use super::real::Real;
use super::weights::Stencils;

/// Samples of a padded row come in blocks of so many: a vector of the widest instruction set.
pub(super) const LANES: usize = 16;

/// Blocks that hold so many samples.
pub(super) fn blocks(samples: usize) -> usize {
    samples.div_ceil(LANES)
}

/// For each new voxel along an axis, where its taps are and what they weigh.
#[derive(Debug, Default)]
pub(super) struct Axis<F, const N: usize>(Vec<([usize; N], [F; N])>);

impl<F: Real, const N: usize> Axis<F, N> {
    /// New voxels `first..first + count`, of samples counted from `first_sample` on.
    pub(super) fn set(
        &mut self,
        stencils: &Stencils<F, N>,
        first: u64,
        count: usize,
        first_sample: i64,
    ) {
        let factor = stencils.len() as u64;
        self.0.clear();
        self.0.extend((first..first + count as u64).map(|o| {
            let stencil = &stencils[(o % factor) as usize];
            let own = (o / factor) as i64 - first_sample;
            (stencil.taps.map(|tap| (own + tap) as usize), stencil.weights)
        }));
    }

    /// New voxels.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// Taps and weights of a new voxel.
    #[inline(always)]
    pub(super) fn at(&self, index: usize) -> ([usize; N], [F; N]) {
        self.0[index]
    }
}

/// The weighted sum of the taps; with `flat`, taps that are all the same give just that, to the bit.
#[inline(always)]
fn weigh<F: Real, const N: usize>(v: [F; N], w: [F; N], flat: bool) -> F {
    if N == 2 {
        return w[0] * v[0] + w[1] * v[1];
    }
    let sum = (w[0] * v[0] + w[3] * v[3]) + (w[1] * v[1] + w[2] * v[2]);
    let same = flat && v[0] == v[1] && v[1] == v[2] && v[2] == v[3];
    if same { v[1] } else { sum }
}

/// Stretches a row along x.
#[inline(always)]
pub(super) fn stretch_row<F: Real, const N: usize>(
    row: &[F],
    axis: &Axis<F, N>,
    flat: bool,
    out: &mut [[F; LANES]],
) {
    for (out, (taps, weights)) in out.as_flattened_mut().iter_mut().zip(&axis.0) {
        *out = weigh(taps.map(|tap| row[tap]), *weights, flat);
    }
}

/// Sums the rows `taps` of `rows`, each `out.len()` blocks long, with their weights.
#[inline(always)]
pub(super) fn weigh_rows<F: Real, const N: usize>(
    rows: &[[F; LANES]],
    taps: [usize; N],
    weights: [F; N],
    flat: bool,
    out: &mut [[F; LANES]],
) {
    // Flat slices of one length: so the compiler reads whole vectors.
    let length = out.len() * LANES;
    let rows = taps.map(|tap| &rows.as_flattened()[tap * length..][..length]);
    for (i, out) in out.as_flattened_mut().iter_mut().enumerate() {
        *out = weigh(rows.map(|row| row[i]), weights, flat);
    }
}
