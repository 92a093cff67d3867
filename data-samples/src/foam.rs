//! An isotropic random field with a fixed period in voxels; its zero surface makes the foam's walls.
//!
//! The field is a sum of plane waves with wavelengths of 32 to 52 voxels, whose directions cover
//! the half sphere: g(x, y, z) = sqrt(2 / n) sum cos(2 pi (kx x + ky y + kz z + phase)), nearly
//! Gaussian with variance 1. The trick that makes it fast: the waves come in groups that share
//! kx. With b the angle without kx x, a group is C cos(kx x) - S sin(kx x), where C and S (the
//! sums of cos b and sin b) are the same for a whole row. So a voxel costs two multiplications a
//! group, not a wave, and the sines along x come from a table made once.

use crate::{
    noise::uniform,
    trig::{fixed_turns, sin_cos},
};

/// Voxels that are computed together; a multiple of every vector width we may meet.
pub(crate) const CHUNK: usize = 32;
const GROUPS: usize = 12;
const WAVES_IN_GROUP: usize = 5;
const WAVELENGTHS_VOXELS: (f64, f64) = (32.0, 52.0);
const MEAN_WAVELENGTH_VOXELS: f64 = 41.0;

/// Mean of |gradient of g| per voxel: 2 pi / wavelength, over sqrt(3) per component, times the mean
/// length of a three-dimensional normal vector, sqrt(8 / pi). Turns a value of g into a distance.
pub(crate) const MEAN_SLOPE_PER_VOXEL: f32 = 0.1412;

/// Frequencies of a wave across x, in fixed-point turns per voxel.
#[derive(Debug, Clone, Copy)]
struct Wave {
    y_turns: u64,
    z_turns: u64,
    phase: u64,
}

/// One chunk of the x axis: cos(kx x) and sin(kx x) of every group.
type ChunkTable = [([f32; CHUNK], [f32; CHUNK]); GROUPS];

/// The factors of cos(kx x) and sin(kx x) of every group, for one row.
pub(crate) type RowFactors = [(f32, f32); GROUPS];

/// The field.
#[derive(Debug)]
pub(crate) struct Foam {
    x_turns: [u64; GROUPS],
    waves: [[Wave; WAVES_IN_GROUP]; GROUPS],
    tables: Vec<ChunkTable>,
}

impl Foam {
    /// The field of `seed`, ready for rows of `nx` voxels.
    pub(crate) fn new(seed: u64, nx: usize) -> Self {
        let mut x_turns = [0; GROUPS];
        let mut waves = [[Wave { y_turns: 0, z_turns: 0, phase: 0 }; WAVES_IN_GROUP]; GROUPS];
        let mut draws = (0..).map(|index| uniform(seed, index));
        let mut draw = || draws.next().unwrap_or_default();
        for (group, (x_turns, waves)) in x_turns.iter_mut().zip(&mut waves).enumerate() {
            // Uniform on the sphere is uniform in the cosine to the x axis; one stratum a group.
            let k_x = (group as f64 + draw()) / GROUPS as f64 / MEAN_WAVELENGTH_VOXELS;
            *x_turns = fixed_turns(k_x);
            for (nth, wave) in waves.iter_mut().enumerate() {
                let (shortest, longest) = WAVELENGTHS_VOXELS;
                let k = 1.0 / (shortest + draw() * (longest - shortest));
                let k_across = (k * k - k_x * k_x).max(0.0).sqrt();
                let azimuth = (nth as f64 + draw()) / WAVES_IN_GROUP as f64; // one stratum a wave
                let (sin, cos) = sin_cos(fixed_turns(azimuth - 0.5));
                *wave = Wave {
                    y_turns: fixed_turns(k_across * cos),
                    z_turns: fixed_turns(k_across * sin),
                    phase: fixed_turns(draw() - 0.5),
                };
            }
        }
        let tables =
            (0..nx.div_ceil(CHUNK)).map(|chunk| chunk_table(&x_turns, chunk * CHUNK)).collect();
        Self { x_turns, waves, tables }
    }

    /// What the rows' inner loop needs to know of y and z.
    pub(crate) fn row_factors(&self, y: usize, z: usize) -> RowFactors {
        let norm = (2.0 / (GROUPS * WAVES_IN_GROUP) as f64).sqrt();
        self.waves.map(|waves| {
            let (mut sin_sum, mut cos_sum) = (0.0, 0.0);
            for wave in waves {
                let (sin, cos) = sin_cos(wave.phase_at(y, z));
                sin_sum += sin;
                cos_sum += cos;
            }
            ((cos_sum * norm) as f32, (-sin_sum * norm) as f32)
        })
    }

    /// g at the 32 voxels of a chunk. Panics never: `chunk` counts from 0 below nx / 32, rounded up.
    pub(crate) fn chunk(&self, factors: &RowFactors, chunk: usize) -> [f32; CHUNK] {
        let mut g = [0.0; CHUNK];
        for ((c, s), (cos, sin)) in factors.iter().zip(&self.tables[chunk]) {
            for ((g, cos), sin) in g.iter_mut().zip(cos).zip(sin) {
                *g += c * cos + s * sin;
            }
        }
        g
    }

    /// g at one voxel: the slow twin of [`Foam::chunk`], bit for bit.
    pub(crate) fn at(&self, x: usize, y: usize, z: usize) -> f32 {
        let mut g = 0.0;
        for ((c, s), x_turns) in self.row_factors(y, z).into_iter().zip(self.x_turns) {
            let (sin, cos) = sin_cos(x_turns.wrapping_mul(x as u64));
            g += c * cos as f32 + s * sin as f32;
        }
        g
    }

    /// g at one voxel, straight from the definition.
    #[cfg(test)]
    fn at_by_definition(&self, x: usize, y: usize, z: usize) -> f64 {
        let mut sum = 0.0;
        for (waves, x_turns) in self.waves.iter().zip(self.x_turns) {
            for wave in waves {
                let phase = wave.phase_at(y, z).wrapping_add(x_turns.wrapping_mul(x as u64));
                sum += (phase as f64 / 18_446_744_073_709_551_616.0 * std::f64::consts::TAU).cos();
            }
        }
        sum * (2.0 / (GROUPS * WAVES_IN_GROUP) as f64).sqrt()
    }
}

impl Wave {
    fn phase_at(self, y: usize, z: usize) -> u64 {
        self.phase
            .wrapping_add(self.y_turns.wrapping_mul(y as u64))
            .wrapping_add(self.z_turns.wrapping_mul(z as u64))
    }
}

fn chunk_table(x_turns: &[u64; GROUPS], x0: usize) -> ChunkTable {
    x_turns.map(|turns| {
        let (mut cos_table, mut sin_table) = ([0.0; CHUNK], [0.0; CHUNK]);
        for (i, (cos_place, sin_place)) in cos_table.iter_mut().zip(&mut sin_table).enumerate() {
            let (sin, cos) = sin_cos(turns.wrapping_mul((x0 + i) as u64));
            (*cos_place, *sin_place) = (cos as f32, sin as f32);
        }
        (cos_table, sin_table)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunk_and_voxel_agree_bit_for_bit_and_both_with_the_definition() {
        let foam = Foam::new(5, 100);
        for (y, z) in [(0, 0), (17, 3), (1000, 99_999)] {
            let factors = foam.row_factors(y, z);
            for x in 0..100 {
                let g = foam.chunk(&factors, x / CHUNK)[x % CHUNK];
                assert_eq!(g.to_bits(), foam.at(x, y, z).to_bits(), "at {x} {y} {z}");
                let exact = foam.at_by_definition(x, y, z);
                assert!((f64::from(g) - exact).abs() < 1e-5, "at {x} {y} {z}: {g} for {exact}");
            }
        }
    }

    #[test]
    fn the_field_is_normalised_and_its_slope_is_the_stated_one() {
        for seed in 0..4 {
            let foam = Foam::new(seed, 1);
            let places = (0..20_000_u64).map(|i| {
                let place = |axis| (uniform(99, 3 * i + axis) * 4000.0) as usize + 1;
                [place(0), place(1), place(2)]
            });
            let (mut sum, mut squares, mut slopes) = (0.0, 0.0, 0.0);
            for [x, y, z] in places {
                let at = |x, y, z| f64::from(foam.at(x, y, z));
                let g = at(x, y, z);
                sum += g;
                squares += g * g;
                let dx = (at(x + 1, y, z) - at(x - 1, y, z)) / 2.0;
                let dy = (at(x, y + 1, z) - at(x, y - 1, z)) / 2.0;
                let dz = (at(x, y, z + 1) - at(x, y, z - 1)) / 2.0;
                slopes += (dx * dx + dy * dy + dz * dz).sqrt();
            }
            let (mean, square, slope) = (sum / 2e4, squares / 2e4, slopes / 2e4);
            assert!(mean.abs() < 0.05, "seed {seed}: mean {mean}");
            assert!((square - 1.0).abs() < 0.1, "seed {seed}: variance {square}");
            let expected = f64::from(MEAN_SLOPE_PER_VOXEL);
            assert!((slope / expected - 1.0).abs() < 0.1, "seed {seed}: slope {slope}");
        }
    }

    #[test]
    fn the_period_is_about_forty_voxels_along_every_axis_at_any_place() {
        // A wave sum of period p crosses zero 2 / (p sqrt 3) times a voxel along a line.
        let foam = Foam::new(1, 1);
        for start in [0, 1_000_000] {
            for axis in 0..3 {
                let line = |t: usize, other: usize| {
                    let mut at = [other, 2 * other + 7, 3 * other + 11];
                    at[axis] = start + t;
                    foam.at(at[0], at[1], at[2]) > 0.0
                };
                let crossings: usize = (0..40)
                    .map(|i| (1..2000).filter(|&t| line(t, 97 * i) != line(t - 1, 97 * i)).count())
                    .sum();
                let period = 2.0 * 40.0 * 2000.0 / crossings as f64 / 3.0_f64.sqrt();
                assert!((36.0..46.0).contains(&period), "axis {axis} from {start}: {period}");
            }
        }
    }
}
