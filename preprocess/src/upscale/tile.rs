//! The kernel: a box of source samples becomes a box of new voxels.

use super::contrast::contrasts;
use super::lattice::{Axis, LANES, blocks, stretch_row, weigh_rows};
use super::real::Real;
use super::weights::{Stencils, cubic, linear};
use crate::upscale::Upscale;
use multiversion::multiversion;
use octree_store::{Region, Sample};

/// The weights of an upscaling, in the type that is computed in.
#[derive(Debug)]
pub(super) struct Kernels<F> {
    pub(super) cubic: Stencils<F, 4>,
    linear: Stencils<F, 2>,
}

impl<F: Real> Kernels<F> {
    pub(super) fn new(upscale: &Upscale) -> Self {
        let factor = upscale.factor() as usize;
        Self { cubic: cubic(factor, upscale.kernel()), linear: linear(factor) }
    }
}

/// What a thread keeps from tile to tile: the source samples, and what becomes of them axis by axis.
#[derive(Debug, Default)]
pub(super) struct TileScratch<F> {
    /// Source samples, x fastest.
    pub(super) samples: Vec<F>,
    pub(super) dims_xyz: [usize; 3],
    values: Stretch<F, 4>,
    contrasts: Vec<F>,
    amplitudes: Stretch<F, 2>,
    in_core: Vec<[u32; LANES]>,
}

/// Samples on their way: stretched along x, then along y too for one row of new voxels.
#[derive(Debug, Default)]
struct Stretch<F, const N: usize> {
    axes: [Axis<F, N>; 3],
    /// z, then y of the source, then new x.
    along_x: Vec<[F; LANES]>,
    /// z of the source, then new x.
    along_y: Vec<[F; LANES]>,
    /// New x.
    row: Vec<[F; LANES]>,
}

impl<F: Real, const N: usize> Stretch<F, N> {
    fn set(&mut self, stencils: &Stencils<F, N>, tile: &Region, source_dims_xyz: [usize; 3]) {
        let first = first_samples(tile, stencils.len() as u64);
        let dims = tile.dims_xyz();
        for (axis, stretched) in self.axes.iter_mut().enumerate() {
            stretched.set(stencils, tile.min[axis], dims[axis] as usize, first[axis]);
        }
        let [_, ny, nz] = source_dims_xyz;
        let row = blocks(self.axes[0].len());
        self.along_x.resize(nz * ny * row, [F::default(); LANES]);
        self.along_y.resize(nz * row, [F::default(); LANES]);
        self.row.resize(row, [F::default(); LANES]);
    }

    #[inline(always)]
    fn stretch_x(&mut self, samples: &[F], nx: usize, flat: bool) {
        let row = self.row.len();
        for (samples, out) in samples.chunks_exact(nx).zip(self.along_x.chunks_exact_mut(row)) {
            stretch_row(samples, &self.axes[0], flat, out);
        }
    }

    #[inline(always)]
    fn stretch_y(&mut self, y: usize, ny: usize, flat: bool) {
        let row = self.row.len();
        let (taps, weights) = self.axes[1].at(y);
        for (slice, out) in
            self.along_x.chunks_exact(ny * row).zip(self.along_y.chunks_exact_mut(row))
        {
            weigh_rows(slice, taps, weights, flat, out);
        }
    }

    #[inline(always)]
    fn stretch_z(&mut self, z: usize, flat: bool) {
        let (taps, weights) = self.axes[2].at(z);
        weigh_rows(&self.along_y, taps, weights, flat, &mut self.row);
    }
}

/// Noise for a tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileNoise<'a> {
    /// x fastest; rows go on for at least [`LANES`] values after the tile's end.
    pub(super) values: &'a [f32],
    /// Values from row to row, and rows from slice to slice.
    pub(super) stride: usize,
    pub(super) rows: usize,
    /// Where the tile begins.
    pub(super) first_xyz: [usize; 3],
    /// The detail's RMS over the local contrast.
    pub(super) amplitude: f64,
}

/// The source sample that the first of a tile's samples is, on each axis; it may lie outside.
pub(super) fn first_samples(tile: &Region, factor: u64) -> [i64; 3] {
    tile.min.map(|o| (o / factor) as i64 - super::weights::REACH as i64)
}

/// How many source samples a tile needs along each axis.
pub(super) fn sample_dims(tile: &Region, factor: u64) -> [usize; 3] {
    let first = first_samples(tile, factor);
    [0, 1, 2].map(|axis| {
        let last = ((tile.max[axis] - 1) / factor) as i64 + super::weights::REACH as i64;
        (last - first[axis] + 1) as usize
    })
}

/// Where a tile's voxels go: an array of the voxels of `region`, x fastest.
#[derive(Debug)]
pub(super) struct Target<'a, T> {
    pub(super) out: &'a mut [T],
    pub(super) region: Region,
    /// Voxels of this region are counted where they are clamped.
    pub(super) core: Region,
}

/// Computes a tile from the samples in `scratch`; returns how many of its voxels in the core were
/// clamped to the type's range.
pub(super) fn make_tile<T: Sample, F: Real>(
    kernels: &Kernels<F>,
    scratch: &mut TileScratch<F>,
    tile: &Region,
    noise: Option<TileNoise<'_>>,
    target: &mut Target<'_, T>,
) -> u64 {
    let dims = scratch.dims_xyz;
    let first = scratch.samples[0];
    if first.finite() && scratch.samples.iter().all(|v| *v == first) {
        // All the same: so are the results, of every kernel, and there is no contrast.
        let value = first.sample();
        each_row(tile, target, |row, _| row.fill(value));
        return 0;
    }
    scratch.values.set(&kernels.cubic, tile, dims);
    if noise.is_some() {
        scratch.amplitudes.set(&kernels.linear, tile, dims);
        scratch.contrasts.resize(scratch.samples.len(), F::default());
    }
    let shared = tile.intersection(&target.core);
    let width = scratch.values.row.len();
    scratch.in_core.clear();
    scratch.in_core.resize(width, [0; LANES]);
    for x in shared.min[0]..shared.max[0] {
        scratch.in_core.as_flattened_mut()[(x - tile.min[0]) as usize] = 1;
    }
    let factor = kernels.cubic.len() as u64;
    compute_tile(scratch, tile, &shared, factor, noise, target)
}

/// Calls `fill` with each of a tile's rows in the target, and which (y, z) of the tile it is.
fn each_row<T>(tile: &Region, target: &mut Target<'_, T>, fill: impl Fn(&mut [T], [usize; 2])) {
    let [width, height, depth] = tile.dims_xyz().map(|n| n as usize);
    for z in 0..depth {
        for y in 0..height {
            let at = row_start(tile, &target.region, [y, z]);
            fill(&mut target.out[at..at + width], [y, z]);
        }
    }
}

/// Where row (y, z) of a tile begins in an array of the voxels of `region`.
#[inline(always)]
fn row_start(tile: &Region, region: &Region, [y, z]: [usize; 2]) -> usize {
    let [width, height, _] = region.dims_xyz().map(|n| n as usize);
    let [dx, dy, dz] = [0, 1, 2].map(|axis| (tile.min[axis] - region.min[axis]) as usize);
    ((dz + z) * height + dy + y) * width + dx
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn compute_tile<T: Sample, F: Real>(
    scratch: &mut TileScratch<F>,
    tile: &Region,
    core: &Region,
    factor: u64,
    noise: Option<TileNoise<'_>>,
    target: &mut Target<'_, T>,
) -> u64 {
    let TileScratch { samples, dims_xyz, values, contrasts: steps, amplitudes, in_core } = scratch;
    let [nx, ny, _] = *dims_xyz;
    // Integers are rounded in the end: what is flat comes out flat without more ado.
    let flat = !T::TYPE.is_integer();
    let [width, height, depth] = tile.dims_xyz().map(|n| n as usize);
    values.stretch_x(samples, nx, flat);
    if let Some(noise) = noise {
        contrasts(samples, *dims_xyz, noise.amplitude, steps);
        amplitudes.stretch_x(steps, nx, false);
    }
    let mut clamped = 0;
    for y in 0..height {
        values.stretch_y(y, ny, flat);
        if noise.is_some() {
            amplitudes.stretch_y(y, ny, false);
        }
        let in_rows = (core.min[1]..core.max[1]).contains(&(tile.min[1] + y as u64));
        for z in 0..depth {
            values.stretch_z(z, flat);
            if let Some(noise) = noise {
                amplitudes.stretch_z(z, false);
                let [x0, y0, z0] = noise.first_xyz;
                let first = ((z0 + z) * noise.rows + y0 + y) * noise.stride + x0;
                let row = &noise.values[first..][..values.row.len() * LANES];
                add_product(&mut values.row, &amplitudes.row, row.as_chunks::<LANES>().0);
            }
            let at = row_start(tile, &target.region, [y, z]);
            let out = &mut target.out[at..at + width];
            if T::TYPE.is_integer() {
                let in_slices = (core.min[2]..core.max[2]).contains(&(tile.min[2] + z as u64));
                if in_rows && in_slices {
                    clamped += u64::from(clamp_counting::<T, F>(&mut values.row, in_core));
                } else {
                    clamp::<T, F>(&mut values.row);
                }
                for (out, value) in out.iter_mut().zip(values.row.as_flattened()) {
                    *out = value.sample();
                }
            } else {
                let mut finite = true;
                for (out, value) in out.iter_mut().zip(values.row.as_flattened()) {
                    *out = value.sample();
                    finite &= value.finite();
                }
                if !finite {
                    let (row, slice) = (tile.min[1] + y as u64, tile.min[2] + z as u64);
                    let own = |o: u64, first: u64| (o / factor - first / factor) as usize + 2;
                    let line = own(slice, tile.min[2]) * ny + own(row, tile.min[1]);
                    for (out, x) in out.iter_mut().zip(tile.min[0]..) {
                        if !out.is_finite() {
                            *out = samples[line * nx + own(x, tile.min[0])].sample();
                        }
                    }
                }
            }
        }
    }
    clamped
}

/// Adds amplitude times noise.
#[inline(always)]
fn add_product<F: Real>(row: &mut [[F; LANES]], amplitudes: &[[F; LANES]], noise: &[[f32; LANES]]) {
    let factors = amplitudes.as_flattened().iter().zip(noise.as_flattened());
    for (value, (amplitude, noise)) in row.as_flattened_mut().iter_mut().zip(factors) {
        *value += *amplitude * F::of_f32(*noise);
    }
}

/// Rounds to whole numbers and clamps to the range of `T`.
#[inline(always)]
fn clamp<T: Sample, F: Real>(row: &mut [[F; LANES]]) {
    let (least, greatest) = (F::of(T::LEAST), F::of(T::GREATEST));
    for value in row.as_flattened_mut() {
        let whole = value.round();
        let above = if whole < least { least } else { whole };
        *value = if above > greatest { greatest } else { above };
    }
}

/// As [`clamp`]; returns how many it changes where `counted` is 1.
#[inline(always)]
fn clamp_counting<T: Sample, F: Real>(row: &mut [[F; LANES]], counted: &[[u32; LANES]]) -> u32 {
    let (least, greatest) = (F::of(T::LEAST), F::of(T::GREATEST));
    let mut clamped = 0;
    for (value, counted) in row.as_flattened_mut().iter_mut().zip(counted.as_flattened()) {
        let whole = value.round();
        let above = if whole < least { least } else { whole };
        let inside = if above > greatest { greatest } else { above };
        clamped += counted & u32::from(inside != whole);
        *value = inside;
    }
    clamped
}
