//! The kernel: a box of source samples becomes a box of new voxels.

use super::contrast::contrasts;
use super::lattice::{LINE, Line, Row, Stretch, WIDTH};
use super::real::Real;
use super::weights::{REACH, Stencils, cubic, linear};
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
pub(super) struct TileScratch<T, F> {
    /// Source samples, z, then y; lines go on with their last sample.
    pub(super) samples: Vec<Line<F>>,
    pub(super) dims_xyz: [usize; 3],
    values: Stretch<F, 4>,
    contrasts: Vec<Line<F>>,
    amplitudes: Stretch<F, 2>,
    /// A slice's new voxels. They are copied together: a row that was just written would have to be waited for.
    slice: Vec<[T; WIDTH]>,
}

/// Noise for a tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileNoise<'a> {
    /// z, then y; of whole source voxels.
    pub(super) values: &'a [Row<f32>],
    /// Rows of a slice.
    pub(super) height: usize,
    /// The row and slice where the tile begins.
    pub(super) first_yz: [usize; 2],
    /// The detail's RMS over the local contrast.
    pub(super) amplitude: f64,
}

/// The source sample that the first of a tile's samples is, on each axis; it may lie outside.
pub(super) fn first_samples(tile: &Region, factor: u64) -> [i64; 3] {
    tile.min.map(|o| (o / factor) as i64 - REACH as i64)
}

/// How many source samples a tile needs along each axis.
pub(super) fn sample_dims(tile: &Region, factor: u64) -> [usize; 3] {
    let first = first_samples(tile, factor);
    [0, 1, 2].map(|axis| {
        let last = ((tile.max[axis] - 1) / factor) as i64 + REACH as i64;
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
    scratch: &mut TileScratch<T, F>,
    tile: &Region,
    noise: Option<TileNoise<'_>>,
    target: &mut Target<'_, T>,
) -> u64 {
    let dims = scratch.dims_xyz;
    let first = scratch.samples[0][0];
    if first.finite() && scratch.samples.as_flattened().iter().all(|v| *v == first) {
        // All the same: so are the results, of every kernel, and there is no contrast.
        let value = first.sample();
        each_row(tile, target, |row, _| row.fill(value));
        return 0;
    }
    let [_, first_y, first_z] = first_samples(tile, kernels.cubic.len() as u64);
    let new_yz = [1, 2].map(|axis| tile.min[axis]..tile.max[axis]);
    let (first_yz, count_yz) = ([first_y, first_z], [dims[1], dims[2]]);
    scratch.values.set(&kernels.cubic, new_yz.clone(), first_yz, count_yz);
    if noise.is_some() {
        scratch.amplitudes.set(&kernels.linear, new_yz, first_yz, count_yz);
        scratch.contrasts.resize(scratch.samples.len(), [F::default(); LINE]);
    }
    scratch.slice.resize(tile.dims_xyz()[1] as usize, [T::default(); WIDTH]);
    compute_tile(kernels, scratch, tile, noise, target)
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
    kernels: &Kernels<F>,
    scratch: &mut TileScratch<T, F>,
    tile: &Region,
    noise: Option<TileNoise<'_>>,
    target: &mut Target<'_, T>,
) -> u64 {
    let TileScratch { samples, dims_xyz, values, contrasts: steps, amplitudes, slice } = scratch;
    let [_, ny, nz] = *dims_xyz;
    let factor = kernels.cubic.len() as u64;
    // Integers are rounded in the end: what is flat comes out flat without more ado.
    let flat = !T::TYPE.is_integer();
    let lines = (0..nz).flat_map(|z| (0..ny).map(move |y| [y, z]));
    for (at, line) in lines.clone().zip(&*samples) {
        values.set_line(at, line, &kernels.cubic, flat);
    }
    if let Some(noise) = noise {
        contrasts(samples, [ny, nz], noise.amplitude, steps);
        for (at, line) in lines.zip(&*steps) {
            amplitudes.set_line(at, line, &kernels.linear, false);
        }
    }
    let core = tile.intersection(&target.core);
    let counted = |axis: usize, o: usize| {
        (core.min[axis]..core.max[axis]).contains(&(tile.min[axis] + o as u64))
    };
    // Rows begin with a whole source voxel.
    let left = (tile.min[0] % factor) as usize;
    let [width, _, depth] = tile.dims_xyz().map(|n| n as usize);
    let (mut in_core, mut clamped) = ([0; WIDTH], [0; WIDTH]);
    for x in 0..width {
        in_core[left + x] = u32::from(counted(0, x));
    }
    for z in 0..depth {
        values.stretch_z(z, flat);
        if noise.is_some() {
            amplitudes.stretch_z(z, false);
        }
        let mut finite = true;
        for (y, new) in slice.iter_mut().enumerate() {
            let in_core = if counted(1, y) && counted(2, z) { &in_core } else { &[0; WIDTH] };
            let row = values.row(y);
            finite &= if let Some(noise) = noise {
                let [first_y, first_z] = noise.first_yz;
                let noise = &noise.values[(first_z + z) * noise.height + first_y + y];
                let amplitude = amplitudes.row(y);
                let value =
                    |i: usize| row.lane(i, flat) + amplitude.lane(i, false) * F::of_f32(noise[i]);
                finish_row(value, in_core, &mut clamped, new)
            } else {
                finish_row(|i| row.lane(i, flat), in_core, &mut clamped, new)
            };
        }
        for (y, new) in slice.iter().enumerate() {
            let at = row_start(tile, &target.region, [y, z]);
            target.out[at..at + width].copy_from_slice(&new[left..left + width]);
        }
        if finite {
            continue;
        }
        // What is no number spreads no farther than the voxels that have it.
        for y in 0..slice.len() {
            let own = |axis: usize, o: usize| {
                ((tile.min[axis] + o as u64) / factor - tile.min[axis] / factor) as usize + REACH
            };
            let line = &samples[own(2, z) * ny + own(1, y)];
            let at = row_start(tile, &target.region, [y, z]);
            for (x, out) in target.out[at..at + width].iter_mut().enumerate() {
                if !out.is_finite() {
                    *out = line[own(0, x)].sample();
                }
            }
        }
    }
    clamped.iter().map(|lane| u64::from(*lane)).sum()
}

/// Makes a row of new voxels from their values. Integers are rounded, and clamped to the range of `T`; those
/// changes are counted where `counted` is 1. Returns whether all are numbers.
#[inline(always)]
fn finish_row<T: Sample, F: Real>(
    value: impl Fn(usize) -> F,
    counted: &[u32; WIDTH],
    clamped: &mut [u32; WIDTH],
    row: &mut [T; WIDTH],
) -> bool {
    let (least, greatest) = (F::of(T::LEAST), F::of(T::GREATEST));
    let mut finite = true;
    for i in 0..WIDTH {
        let value = value(i);
        if T::TYPE.is_integer() {
            let whole = value.round();
            let above = if whole < least { least } else { whole };
            let inside = if above > greatest { greatest } else { above };
            clamped[i] += counted[i] & u32::from(inside != whole);
            row[i] = inside.sample();
        } else {
            finite &= value.finite();
            row[i] = value.sample();
        }
    }
    finite
}
