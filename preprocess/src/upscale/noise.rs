//! The detail's noise: octaves between the source's Nyquist frequency and the new one, and nothing else.
//!
//! An octave is white noise on a lattice less its own low-pass part, stretched to the new voxels
//! ([`super::octave`] says which). At last each source voxel's own mean is taken away, so that averaging
//! gives the source back.
//!
//! White noise is a hash of seed, octave and place, without tables. Along x it repeats after 2^32 cells,
//! along y and z after 2^64: beyond any volume.

use super::lattice::{LINE, Row, Stretch, WIDTH};
use super::octave::{Octave, octaves};
use super::weights::{REACH, Stencils};
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
    /// The noise: z, then y of the new voxels.
    pub(super) values: Vec<Row<f32>>,
    /// Rows of a slice.
    pub(super) height: usize,
    cells: Planes<WIDTH, { WIDTH + 16 }>,
    coarse: Planes<LINE, { LINE + 16 }>,
    stretch: Stretch<f32, 4>,
}

/// Planes of a lattice: as many as its filter sees at once. Of `L` cells along x `W` are left when the
/// filter has taken what it needs at their ends.
#[derive(Debug, Default)]
struct Planes<const W: usize, const L: usize> {
    white: Vec<[f32; L]>,
    /// Filtered along x and y.
    low: Vec<[f32; W]>,
    /// One plane, filtered along x.
    low_x: Vec<[f32; W]>,
}

impl Noise {
    /// The noise of a seed for volumes enlarged so many times.
    pub(super) fn new(seed: u64, factor: usize) -> Self {
        Self { seed, factor, octaves: octaves(factor) }
    }

    /// Bytes that a thread takes for tiles of `side` new voxels along an axis.
    pub(super) fn thread_bytes(factor: u64, side: u64) -> u64 {
        let made = side + 2 * factor;
        // What is made; an octave stretched along x; planes of two lattices.
        let rows = made.pow(2) + (made / 2 + 6).pow(2) + 40 * (made + 10);
        4 * WIDTH as u64 * rows
    }

    /// Fills `scratch` with the noise of `voxels` source voxels along x, y, z from `first` on.
    pub(super) fn fill(&self, first: [u64; 3], voxels: [usize; 3], scratch: &mut NoiseScratch) {
        let [_, height, depth] = voxels.map(|n| n * self.factor);
        scratch.height = height;
        scratch.values.clear();
        scratch.values.resize(height * depth, [0.0; WIDTH]);
        for octave in &self.octaves {
            // The cells wanted.
            let around = if octave.stretch.is_some() { REACH } else { 0 };
            let origin = first.map(|v| (v * octave.cells as u64).cast_signed() - around as i64);
            let [_, ny, nz] = voxels.map(|n| n * octave.cells + 2 * around);
            let lattice = Lattice { octave, seed: self.seed, origin, ny, nz };
            match (&octave.stretch, octave.low_pass.len()) {
                (Some(stencils), _) => add_stretched(&lattice, stencils, scratch),
                (None, 4) => add_cells(&lattice, NEAR, scratch),
                (None, _) => add_cells(&lattice, FAR, scratch),
            }
        }
        take_means_away(self.factor, voxels, scratch);
    }
}

/// Some of an octave's cells: from `origin` on, and how many along y and z.
struct Lattice<'a> {
    octave: &'a Octave,
    seed: u64,
    origin: [i64; 3],
    ny: usize,
    nz: usize,
}

/// The distances at which a low-pass filter has its weights, 0 left out: to a half, and to a third.
const NEAR: [usize; 2] = [1, 3];
const FAR: [usize; 4] = [1, 2, 4, 5];

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

impl Lattice<'_> {
    /// Calls `each` with the z, the y and the cells of every row of white noise less its low-pass part.
    #[inline(always)]
    fn each_row<const PAIRS: usize, const W: usize, const L: usize>(
        &self,
        distances: [usize; PAIRS],
        planes: &mut Planes<W, L>,
        mut each: impl FnMut(usize, usize, &[f32; W]),
    ) {
        let Self { octave, seed, origin, ny, nz } = *self;
        let Planes { white, low, low_x } = planes;
        let far = distances[PAIRS - 1];
        let weight = octave.low_pass[0];
        let weights = distances.map(|k| octave.low_pass[k]);
        let filter = |middle: &[f32], pairs: [[&[f32]; 2]; PAIRS], i: usize| {
            let mut sum = weight * middle[i];
            for ([before, after], weight) in pairs.into_iter().zip(weights) {
                sum += weight * (before[i] + after[i]);
            }
            sum
        };
        // Margins included.
        let wide = ny + 2 * far;
        let [x, y0, z0] = origin.map(|v| v - far as i64);
        white.resize((far + 1) * wide, [0.0; L]);
        low.resize((2 * far + 1) * ny, [0.0; W]);
        low_x.resize(wide, [0.0; W]);
        let mut band = [0.0; W];
        for z in 0..nz + 2 * far {
            // A whole plane before it is read: lines that were just written would have to be waited for.
            let plane = &mut white[z % (far + 1) * wide..][..wide];
            for (y, line) in plane.iter_mut().enumerate() {
                let key = row_key(seed, octave.number, [y0 + y as i64, z0 + z as i64]);
                for (i, value) in line.iter_mut().enumerate() {
                    let hash = cell_hash((x as u32).wrapping_add(i as u32), key);
                    *value = hash as f32 * octave.scale;
                }
            }
            for (line, out) in plane.iter().zip(&mut *low_x) {
                let from = |x: usize| &line[x..x + W];
                let pairs = distances.map(|k| [from(far - k), from(far + k)]);
                for (i, out) in out.iter_mut().enumerate() {
                    *out = filter(from(far), pairs, i);
                }
            }
            let plane = &mut low[z % (2 * far + 1) * ny..][..ny];
            for (y, out) in plane.iter_mut().enumerate() {
                let row = |y: usize| &low_x[y][..];
                let pairs = distances.map(|k| [row(y + far - k), row(y + far + k)]);
                for (i, out) in out.iter_mut().enumerate() {
                    *out = filter(row(y + far), pairs, i);
                }
            }
            let Some(done) = z.checked_sub(2 * far) else { continue };
            let middle = done + far;
            for y in 0..ny {
                let row = |z: usize| &low[z % (2 * far + 1) * ny + y][..];
                let pairs = distances.map(|k| [row(middle - k), row(middle + k)]);
                let white = &white[middle % (far + 1) * wide + far + y][far..far + W];
                for (i, out) in band.iter_mut().enumerate() {
                    *out = white[i] - filter(row(middle), pairs, i);
                }
                each(done, y, &band);
            }
        }
    }
}

/// Adds an octave whose cells are the new voxels.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn add_cells<const PAIRS: usize>(
    lattice: &Lattice<'_>,
    distances: [usize; PAIRS],
    scratch: &mut NoiseScratch,
) {
    let NoiseScratch { values, cells, .. } = scratch;
    lattice.each_row(distances, cells, |z, y, row| {
        add(&mut values[z * lattice.ny + y], row);
    });
}

/// Adds an octave whose cells are stretched to the new voxels.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn add_stretched(lattice: &Lattice<'_>, stencils: &Stencils<f32, 4>, scratch: &mut NoiseScratch) {
    let NoiseScratch { values, height, coarse, stretch, .. } = scratch;
    let depth = values.len() / *height;
    let new_yz = [*height, depth].map(|n| 0..n as u64);
    stretch.set(stencils, new_yz, [-(REACH as i64); 2], [lattice.ny, lattice.nz]);
    lattice.each_row(NEAR, coarse, |z, y, line| {
        stretch.set_line([y, z], line, stencils, false);
    });
    for (z, slice) in values.chunks_exact_mut(*height).enumerate() {
        stretch.stretch_z(z, false);
        for (y, out) in slice.iter_mut().enumerate() {
            let row = stretch.row(y);
            for (i, out) in out.iter_mut().enumerate() {
                *out += row.lane(i, false);
            }
        }
    }
}

#[inline(always)]
fn add(out: &mut Row<f32>, values: &Row<f32>) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += *value;
    }
}

/// Takes from every value the mean over the source voxel that it lies in.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn take_means_away(factor: usize, voxels: [usize; 3], scratch: &mut NoiseScratch) {
    let NoiseScratch { values, height, .. } = scratch;
    let [nx, ny, nz] = voxels;
    let whole = 1.0 / (factor * factor * factor) as f32;
    for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
        let rows = (0..factor * factor)
            .map(|i| (z * factor + i / factor) * *height + y * factor + i % factor);
        let mut sums = [0.0; WIDTH];
        for row in rows.clone() {
            add(&mut sums, &values[row]);
        }
        for voxel in sums[..nx * factor].chunks_exact_mut(factor) {
            let mut sum = 0.0;
            for value in voxel.iter() {
                sum += value;
            }
            voxel.fill(-sum * whole);
        }
        for row in rows {
            add(&mut values[row], &sums);
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
        scratch.values.iter().flat_map(|row| row[..voxels[0] * factor].to_vec()).collect()
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
            let side = 72 / factor;
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
