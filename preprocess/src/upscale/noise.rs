//! The detail's noise: octaves between the source's Nyquist frequency and the new one, and nothing else.
//!
//! An octave is white noise on a lattice less its own low-pass part, stretched to the new voxels
//! ([`super::octave`] says which). At last each source voxel's own mean is taken away, so that averaging
//! gives the source back.
//!
//! White noise is a hash of seed, octave and place, without tables. Along x it repeats after 2^32 cells,
//! along y and z after 2^64: beyond any volume.

use super::lattice::{Axis, LANES, blocks, stretch_row, weigh_rows};
use super::octave::{Octave, octaves};
use super::weights::REACH;
use multiversion::multiversion;

/// The noise of a seed at a factor.
#[derive(Debug)]
pub(super) struct Noise {
    seed: u64,
    factor: usize,
    octaves: Vec<Octave>,
}

/// What a thread keeps.
#[derive(Debug, Default)]
pub(super) struct NoiseScratch {
    /// The noise: z, y, x of the new voxels, rows of [`NoiseScratch::stride`].
    pub(super) values: Vec<[f32; LANES]>,
    /// Blocks of a row.
    row: usize,
    /// Rows of a slice.
    pub(super) rows: usize,
    white: Vec<[f32; LANES]>,
    low: Vec<[f32; LANES]>,
    plane: Vec<[f32; LANES]>,
    line: Vec<f32>,
    axes: [Axis<f32, 4>; 3],
    along_x: Vec<[f32; LANES]>,
    along_y: Vec<[f32; LANES]>,
}

impl NoiseScratch {
    /// Values from row to row.
    pub(super) fn stride(&self) -> usize {
        self.row * LANES
    }
}

impl Noise {
    /// The noise of a seed for volumes enlarged so many times.
    pub(super) fn new(seed: u64, factor: usize) -> Self {
        Self { seed, factor, octaves: octaves(factor) }
    }

    /// Fills `scratch` with the noise of `voxels` source voxels along x, y, z from `first` on.
    pub(super) fn fill(&self, first: [u64; 3], voxels: [usize; 3], scratch: &mut NoiseScratch) {
        let [width, height, depth] = voxels.map(|n| n * self.factor);
        // One block more than the row: who reads whole blocks may begin anywhere.
        scratch.row = blocks(width) + 1;
        scratch.rows = height;
        scratch.values.clear();
        scratch.values.resize(scratch.row * height * depth, [0.0; LANES]);
        for octave in &self.octaves {
            match octave.low_pass.len() {
                4 => add_octave::<2>(octave, self.seed, [1, 3], first, voxels, scratch),
                _ => add_octave::<4>(octave, self.seed, [1, 2, 4, 5], first, voxels, scratch),
            }
        }
        take_means_away(self.factor, voxels, scratch);
    }
}

/// Mixes 64 bits: the finaliser of splitmix64 (G. Steele, D. Lea, C. Flood, OOPSLA 2014).
fn mix64(mut h: u64) -> u64 {
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ (h >> 31)
}

/// What tells the cells' rows of an octave apart.
fn row_key(seed: u64, octave: u64, [y, z]: [i64; 2]) -> [u32; 2] {
    const STEP: u64 = 0x9e37_79b9_7f4a_7c15;
    let key = mix64(seed.wrapping_add(STEP.wrapping_mul(octave + 1)));
    let key = mix64(key.wrapping_add(STEP).wrapping_add(z.cast_unsigned()));
    let key = mix64(key.wrapping_add(STEP).wrapping_add(y.cast_unsigned()));
    [key as u32, (key >> 32) as u32]
}

/// Mixes the place along x with its row's key: `lowbias32` (C. Wellons, "Prospecting for hash
/// functions", 2018), with the key's second half let in between.
#[inline(always)]
fn cell_hash(x: u32, [first, second]: [u32; 2]) -> i32 {
    let mut h = x.wrapping_add(first);
    h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d) ^ second;
    h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
    (h ^ (h >> 16)).cast_signed()
}

/// The middle's weight times the middle, plus for each pair of equally far ones their weight times
/// their sum.
#[inline(always)]
fn filter_lane<const PAIRS: usize>(
    middle: f32,
    pairs: [[f32; 2]; PAIRS],
    weight: f32,
    weights: [f32; PAIRS],
) -> f32 {
    let mut sum = weight * middle;
    for k in 0..PAIRS {
        sum += weights[k] * (pairs[k][0] + pairs[k][1]);
    }
    sum
}

/// Adds an octave. Its low-pass filter has its weights at the distances 0 and `distances`.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn add_octave<const PAIRS: usize>(
    octave: &Octave,
    seed: u64,
    distances: [usize; PAIRS],
    first: [u64; 3],
    voxels: [usize; 3],
    scratch: &mut NoiseScratch,
) {
    let NoiseScratch { values, row, white, low, plane, line, axes, along_x, along_y, .. } = scratch;
    let far = octave.low_pass.len() - 1;
    let weight = octave.low_pass[0];
    let weights = distances.map(|k| octave.low_pass[k]);
    let around = if octave.stretch.is_some() { REACH } else { 0 };
    // The lattice cells wanted, and the first of them.
    let [nx, ny, nz] = voxels.map(|n| n * octave.cells + 2 * around);
    let origin = first.map(|v| (v * octave.cells as u64).cast_signed() - around as i64);
    let length = blocks(nx);
    white.resize(length * ny * nz, [0.0; LANES]);
    low.resize(length * ny * (nz + 2 * far), [0.0; LANES]);
    plane.resize(length * (ny + 2 * far), [0.0; LANES]);
    line.resize(length * LANES + 2 * far, 0.0);
    for z in 0..nz + 2 * far {
        let at_z = origin[2] + z as i64 - far as i64;
        let kept_z = z.checked_sub(far).filter(|z| *z < nz);
        for y in 0..ny + 2 * far {
            let at_y = origin[1] + y as i64 - far as i64;
            let key = row_key(seed, octave.number, [at_y, at_z]);
            let x = (origin[0] - far as i64) as u32;
            for (i, value) in line.iter_mut().enumerate() {
                *value = cell_hash(x.wrapping_add(i as u32), key) as f32 * octave.scale;
            }
            if let (Some(z), Some(y)) = (kept_z, y.checked_sub(far).filter(|y| *y < ny)) {
                white[(z * ny + y) * length..][..length]
                    .as_flattened_mut()
                    .copy_from_slice(&line[far..far + length * LANES]);
            }
            let out = plane[y * length..][..length].as_flattened_mut();
            let count = out.len();
            let middle = &line[far..far + count];
            let pairs = distances
                .map(|k| [&line[far - k..far - k + count], &line[far + k..far + k + count]]);
            for i in 0..count {
                let pairs = pairs.map(|pair| [pair[0][i], pair[1][i]]);
                out[i] = filter_lane(middle[i], pairs, weight, weights);
            }
        }
        for y in 0..ny {
            let out = &mut low[(z * ny + y) * length..][..length];
            let row = |y: usize| plane[y * length..][..length].as_flattened();
            let pairs = distances.map(|k| [row(y + far - k), row(y + far + k)]);
            let middle = row(y + far);
            for (i, out) in out.as_flattened_mut().iter_mut().enumerate() {
                let pairs = pairs.map(|pair| [pair[0][i], pair[1][i]]);
                *out = filter_lane(middle[i], pairs, weight, weights);
            }
        }
    }
    for z in 0..nz {
        for y in 0..ny {
            let out = &mut white[(z * ny + y) * length..][..length];
            let row = |z: usize| low[(z * ny + y) * length..][..length].as_flattened();
            let pairs = distances.map(|k| [row(z + far - k), row(z + far + k)]);
            let middle = row(z + far);
            for (i, out) in out.as_flattened_mut().iter_mut().enumerate() {
                let pairs = pairs.map(|pair| [pair[0][i], pair[1][i]]);
                *out -= filter_lane(middle[i], pairs, weight, weights);
            }
        }
    }
    let Some(stencils) = &octave.stretch else {
        for (out, cells) in values.chunks_exact_mut(*row).zip(white.chunks_exact(length)) {
            add(out, cells);
        }
        return;
    };
    let stretched = voxels.map(|n| n * octave.cells * stencils.len());
    for (axis, count) in axes.iter_mut().zip(stretched) {
        axis.set(stencils, 0, count, -(around as i64));
    }
    let wide = blocks(stretched[0]);
    along_x.resize(wide * ny * nz, [0.0; LANES]);
    along_y.resize(wide * nz, [0.0; LANES]);
    line.resize(wide * LANES, 0.0);
    for (cells, out) in white.chunks_exact(length).zip(along_x.chunks_exact_mut(wide)) {
        stretch_row(cells.as_flattened(), &axes[0], false, out);
    }
    plane.resize(wide, [0.0; LANES]);
    let sum = &mut plane[..wide];
    for y in 0..stretched[1] {
        let (taps, by) = axes[1].at(y);
        for (slice, out) in along_x.chunks_exact(ny * wide).zip(along_y.chunks_exact_mut(wide)) {
            weigh_rows(slice, taps, by, false, out);
        }
        for z in 0..stretched[2] {
            let (taps, by) = axes[2].at(z);
            weigh_rows(along_y, taps, by, false, sum);
            add(&mut values[(z * stretched[1] + y) * *row..][..wide], sum);
        }
    }
}

#[inline(always)]
fn add(out: &mut [[f32; LANES]], values: &[[f32; LANES]]) {
    for (out, value) in out.as_flattened_mut().iter_mut().zip(values.as_flattened()) {
        *out += *value;
    }
}

/// Takes from every value the mean over the source voxel that it lies in.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn take_means_away(factor: usize, voxels: [usize; 3], scratch: &mut NoiseScratch) {
    let NoiseScratch { values, row, rows, plane, .. } = scratch;
    let [nx, ny, nz] = voxels;
    plane.resize(plane.len().max(*row), [0.0; LANES]);
    let sums = &mut plane[..*row];
    let whole = 1.0 / (factor * factor * factor) as f32;
    for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
        let starts = (0..factor * factor)
            .map(|i| ((z * factor + i / factor) * *rows + y * factor + i % factor) * *row);
        sums.fill([0.0; LANES]);
        for start in starts.clone() {
            add(sums, &values[start..start + *row]);
        }
        for voxel in sums.as_flattened_mut()[..nx * factor].chunks_exact_mut(factor) {
            let mut sum = 0.0;
            for value in voxel.iter() {
                sum += value;
            }
            voxel.fill(-sum * whole);
        }
        for start in starts {
            add(&mut values[start..start + *row], sums);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::upscale::Upscale;

    /// The noise of so many voxels, x fastest, without padding.
    fn noise(factor: usize, seed: u64, first: [u64; 3], voxels: [usize; 3]) -> Vec<f32> {
        let mut scratch = NoiseScratch::default();
        Noise::new(seed, factor).fill(first, voxels, &mut scratch);
        let stride = scratch.stride();
        let rows = scratch.values.as_flattened().chunks_exact(stride);
        rows.flat_map(|row| row[..voxels[0] * factor].to_vec()).collect()
    }

    fn factors() -> impl Iterator<Item = usize> {
        Upscale::FACTORS.into_iter().map(|factor| factor as usize)
    }

    #[test]
    fn noise_is_the_same_whoever_asks() {
        for factor in factors() {
            let whole = noise(factor, 5, [1 << 20, 7, 0], [6, 5, 4]);
            let part = noise(factor, 5, [(1 << 20) + 2, 9, 1], [3, 2, 2]);
            let [width, height] = [6 * factor, 5 * factor];
            for (i, v) in part.iter().enumerate() {
                let x = i % (3 * factor) + 2 * factor;
                let y = i / (3 * factor) % (2 * factor) + 2 * factor;
                let z = i / (6 * factor * factor) + factor;
                let same = whole[(z * height + y) * width + x];
                assert_eq!(v.to_bits(), same.to_bits(), "factor {factor} at {x},{y},{z}");
            }
            assert_ne!(whole, noise(factor, 6, [1 << 20, 7, 0], [6, 5, 4]), "another seed");
            assert_ne!(whole, noise(factor, 5, [1 << 21, 7, 0], [6, 5, 4]), "another place");
        }
    }

    #[test]
    fn its_mean_square_is_one_and_every_source_voxel_averages_to_nothing() {
        for factor in factors() {
            let side = 96 / factor;
            let values = noise(factor, 1, [3, 1, 4], [side; 3]);
            let square: f64 = values.iter().map(|v| f64::from(v * v)).sum();
            let square = square / values.len() as f64;
            assert!((square - 1.0).abs() < 0.02, "factor {factor}: {square}");
            let width = side * factor;
            for voxel in 0..side * side * side {
                let [x, y, z] =
                    [voxel % side, voxel / side % side, voxel / side / side].map(|v| v * factor);
                let mut mean = 0.0;
                for i in 0..factor * factor * factor {
                    let (dx, dy, dz) = (i % factor, i / factor % factor, i / factor / factor);
                    mean += f64::from(values[((z + dz) * width + y + dy) * width + x + dx]);
                }
                mean /= (factor * factor * factor) as f64;
                assert!(mean.abs() < 1e-6, "factor {factor}: {mean}");
            }
        }
    }

    #[test]
    fn hashes_of_neighbours_are_not_alike() {
        // Correlation over one step along each axis, of 2^18 cells: 1/512 is one sigma.
        let value = |x: u32, y: i64, z: i64| f64::from(cell_hash(x, row_key(9, 0, [y, z])));
        for step in [[1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [1, 1, 0]] {
            let (mut product, mut square) = (0.0, 0.0);
            for i in 0..1_u32 << 18 {
                let [x, y, z] = [i & 63, i >> 6 & 63, i >> 12];
                let (dx, dy, dz) = (step[0], i64::from(step[1]), i64::from(step[2]));
                let a = value(x, y.into(), z.into());
                product += a * value(x + dx, i64::from(y) + dy, i64::from(z) + dz);
                square += a * a;
            }
            assert!((product / square).abs() < 0.01, "{step:?}: {}", product / square);
        }
    }
}
