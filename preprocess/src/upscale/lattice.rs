//! Steps of a separable interpolation, on rows of one length.
//!
//! A box of samples is stretched along x, then z, then y, the first step on the fewest samples:
//! 4 (1/f^2 + 1/f + 1) multiplications a new voxel, 5.25 for f = 4, instead of 64. Along y and z a new
//! row is a weighted sum of rows; only along x do neighbours mix, phase by phase.
//!
//! Everything here is inlined into kernels that are compiled for several instruction sets. Rows have
//! a length that the compiler knows, and no rest: it makes whole vectors of them. Sums have a fixed order
//! that is the same read from either end: mirrored samples give mirrored results.

use super::real::Real;
use super::weights::{REACH, Stencil, Stencils};
use std::ops::Range;

/// Samples before they are stretched along x: half a [`Row`], and what taps reach beyond it.
pub(super) type Line<F> = [F; LINE];

/// New voxels along x, of whole source voxels; the last may mean nothing.
pub(super) type Row<F> = [F; WIDTH];

/// The length of a [`Row`]: whole vectors of any instruction set, and whole voxels of the factors 2, 4, 8.
pub(super) const WIDTH: usize = 80;

/// The length of a [`Line`].
pub(super) const LINE: usize = 48;

/// For each new voxel along an axis, where its taps are and what they weigh.
#[derive(Debug, Default)]
struct Axis<F, const N: usize>(Vec<([usize; N], [F; N])>);

impl<F: Real, const N: usize> Axis<F, N> {
    /// The new voxels of a range, of samples counted from `first_sample` on.
    fn set(&mut self, stencils: &Stencils<F, N>, new: Range<u64>, first_sample: i64) {
        let factor = stencils.len() as u64;
        self.0.clear();
        self.0.extend(new.map(|o| {
            let stencil = &stencils[(o % factor) as usize];
            let own = (o / factor) as i64 - first_sample;
            (stencil.taps.map(|tap| (own + tap) as usize), stencil.weights)
        }));
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

/// Stretches a line along x, from its sample [`REACH`] on.
#[inline(always)]
fn stretch_line<F: Real, const N: usize>(
    line: &Line<F>,
    stencils: &Stencils<F, N>,
    flat: bool,
    out: &mut Row<F>,
) {
    match stencils.len() {
        2 => stretch_by::<F, N, 2>(line, stencils, flat, out),
        3 => stretch_by::<F, N, 3>(line, stencils, flat, out),
        4 => stretch_by::<F, N, 4>(line, stencils, flat, out),
        _ => stretch_by::<F, N, 8>(line, stencils, flat, out),
    }
}

#[inline(always)]
fn stretch_by<F: Real, const N: usize, const FACTOR: usize>(
    line: &Line<F>,
    stencils: &[Stencil<F, N>],
    flat: bool,
    out: &mut Row<F>,
) {
    let mut phases = [[F::default(); WIDTH / 2]; FACTOR];
    for (values, stencil) in phases.iter_mut().zip(stencils) {
        let taps = stencil.taps.map(|tap| &line[REACH.wrapping_add_signed(tap as isize)..]);
        let taps = taps.map(|line| &line[..WIDTH / FACTOR]);
        for (i, value) in values[..WIDTH / FACTOR].iter_mut().enumerate() {
            *value = weigh(taps.map(|line| line[i]), stencil.weights, flat);
        }
    }
    for (i, voxel) in out.as_chunks_mut::<FACTOR>().0.iter_mut().enumerate() {
        *voxel = std::array::from_fn(|phase| phases[phase][i]);
    }
}

/// Rows that are summed with their weights.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weighed<'a, F, const N: usize> {
    rows: [&'a Row<F>; N],
    weights: [F; N],
}

impl<F: Real, const N: usize> Weighed<'_, F, N> {
    /// A value of the sum.
    #[inline(always)]
    pub(super) fn lane(&self, i: usize, flat: bool) -> F {
        weigh(self.rows.map(|row| row[i]), self.weights, flat)
    }
}

/// A box stretched along x, then for one slice of new voxels along z: what is left to do is a weighted sum
/// of rows.
#[derive(Debug, Default)]
pub(super) struct Stretch<F, const N: usize> {
    y: Axis<F, N>,
    z: Axis<F, N>,
    /// Rows of a slice of the source.
    ny: usize,
    /// z, then y of the source.
    along_x: Vec<Row<F>>,
    /// y of the source.
    along_z: Vec<Row<F>>,
}

impl<F: Real, const N: usize> Stretch<F, N> {
    /// New voxels `new[0]` along y and `new[1]` along z, of samples `first` on, `count` of them.
    pub(super) fn set(
        &mut self,
        stencils: &Stencils<F, N>,
        new_yz: [Range<u64>; 2],
        first_yz: [i64; 2],
        [ny, nz]: [usize; 2],
    ) {
        let [y, z] = new_yz;
        self.y.set(stencils, y, first_yz[0]);
        self.z.set(stencils, z, first_yz[1]);
        self.ny = ny;
        self.along_x.resize(nz * ny, [F::default(); WIDTH]);
        self.along_z.resize(ny, [F::default(); WIDTH]);
    }

    /// Stretches line y of slice z along x.
    #[inline(always)]
    pub(super) fn set_line(
        &mut self,
        [y, z]: [usize; 2],
        line: &Line<F>,
        stencils: &Stencils<F, N>,
        flat: bool,
    ) {
        stretch_line(line, stencils, flat, &mut self.along_x[z * self.ny + y]);
    }

    /// Makes new slice z the one that rows are asked of.
    #[inline(always)]
    pub(super) fn stretch_z(&mut self, z: usize, flat: bool) {
        let (taps, weights) = self.z.0[z];
        let slices = taps.map(|tap| &self.along_x[tap * self.ny..][..self.ny]);
        for (y, out) in self.along_z.iter_mut().enumerate() {
            let sum = Weighed { rows: slices.map(|slice| &slice[y]), weights };
            for (i, out) in out.iter_mut().enumerate() {
                *out = sum.lane(i, flat);
            }
        }
    }

    /// New row y.
    #[inline(always)]
    pub(super) fn row(&self, y: usize) -> Weighed<'_, F, N> {
        let (taps, weights) = self.y.0[y];
        Weighed { rows: taps.map(|tap| &self.along_z[tap]), weights }
    }
}
