//! The phantom that looks like a micro-CT scan: a casing filled with foam, a dense core with a
//! denser kernel and a filled void, soft edges, noise everywhere.
//!
//! Bodies scale with the volume; the foam's pores do not (about 40 voxels), nor do the edges
//! (1.5 voxels) and the noise. So a 4096^3 volume is as hard on a converter as a 512^3 one, and
//! any part of a large one looks like a scan.
//!
//! A row is computed in chunks of 32 voxels. Most chunks lie wholly inside or outside a body;
//! the rest compute its coverage. [`MicroCt::voxel`] is the same without chunks.

use crate::{
    ellipsoid::{Cover, Ellipsoid, RowEllipsoid, edge},
    foam::{CHUNK, Foam, MEAN_SLOPE_PER_VOXEL, RowFactors},
    noise::RowNoise,
};

/// The value outside the part and in the foam's pores.
pub const AIR: u16 = 2_000;
/// The value of the foam's walls.
pub const WALL: u16 = 22_000;
/// The value of the casing.
pub const CASING: u16 = 30_000;
/// The value of the dense core.
pub const CORE: u16 = 38_000;
/// The value of the kernel within the core.
pub const KERNEL: u16 = 45_000;
/// The value of the filling of the void.
pub const VOID_FILLING: u16 = 20_000;
/// The noise's standard deviation, unless another is asked for.
pub const DEFAULT_NOISE_SIGMA: f64 = 400.0;

/// Half the thickness of a foam wall.
const HALF_WALL_VOXELS: f32 = 3.0;

/// What a body is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Material {
    Solid(f32),
    Foam,
}

/// Centre and radii in the volume's box (-1 to 1, in x, y, z), from the outermost to the last put in.
const BODIES: [([f32; 3], [f32; 3], Material); 5] = [
    ([0.0, 0.0, 0.0], [0.92, 0.90, 0.94], Material::Solid(CASING as f32)),
    ([0.0, 0.0, 0.0], [0.84, 0.82, 0.86], Material::Foam),
    ([0.05, -0.05, 0.1], [0.40, 0.36, 0.42], Material::Solid(CORE as f32)),
    ([0.05, -0.08, 0.12], [0.20, 0.16, 0.22], Material::Solid(KERNEL as f32)),
    ([0.15, 0.12, 0.0], [0.16, 0.10, 0.12], Material::Solid(VOID_FILLING as f32)),
];

/// A micro-CT phantom of given size.
#[derive(Debug)]
pub(crate) struct MicroCt {
    seed: u64,
    noise_factor: f32,
    bodies: [(Ellipsoid, Material); BODIES.len()],
    foam: Foam,
}

impl MicroCt {
    pub(crate) fn new(seed: u64, noise_sigma: f64, dims_xyz: [usize; 3]) -> Self {
        Self {
            seed,
            noise_factor: noise_sigma as f32 / RowNoise::SIGMA,
            bodies: BODIES.map(|(centre, radius, material)| {
                (Ellipsoid::in_box(centre, radius, dims_xyz), material)
            }),
            foam: Foam::new(seed, dims_xyz[0]),
        }
    }

    /// Fills `out` with the row's voxels from x = 0.
    pub(crate) fn row(&self, y: usize, z: usize, out: &mut [u16]) {
        let bodies = self.bodies.map(|(body, material)| (body.in_row(y, z), material));
        let factors = self.foam.row_factors(y, z);
        let noise = RowNoise::new(self.seed, y, z);
        for (chunk, out) in out.chunks_mut(CHUNK).enumerate() {
            let x0 = chunk * CHUNK;
            let values = self.clean_chunk(&bodies, &factors, chunk);
            if self.noise_factor > 0.0 {
                for (i, (out, value)) in out.iter_mut().zip(values).enumerate() {
                    *out = rounded(value + self.noise_factor * noise.at(x0 + i));
                }
            } else {
                out.iter_mut().zip(values).for_each(|(out, value)| *out = rounded(value));
            }
        }
    }

    /// A chunk without noise: every body in turn covers what is there.
    fn clean_chunk(
        &self,
        bodies: &[(RowEllipsoid, Material); BODIES.len()],
        factors: &RowFactors,
        chunk: usize,
    ) -> [f32; CHUNK] {
        let x0 = chunk * CHUNK;
        let covers = bodies.map(|(body, _)| body.cover(x0));
        // What a wholly covering body hides need not be computed.
        let start = covers.iter().rposition(|&cover| cover == Cover::All).unwrap_or(0);
        let mut values = [f32::from(AIR); CHUNK];
        for (&(body, material), cover) in bodies.iter().zip(covers).skip(start) {
            if cover == Cover::None {
                continue;
            }
            let inside = match material {
                Material::Solid(value) => [value; CHUNK],
                Material::Foam => self.foam.chunk(factors, chunk).map(foam_value),
            };
            if cover == Cover::All {
                values = inside;
                continue;
            }
            for (i, (value, inside)) in values.iter_mut().zip(inside).enumerate() {
                *value = lerp(*value, inside, body.coverage((x0 + i) as f32));
            }
        }
        values
    }

    /// One voxel: the slow twin of [`MicroCt::row`], bit for bit.
    pub(crate) fn voxel(&self, x: usize, y: usize, z: usize) -> u16 {
        let mut value = f32::from(AIR);
        for (body, material) in self.bodies {
            let inside = match material {
                Material::Solid(value) => value,
                Material::Foam => foam_value(self.foam.at(x, y, z)),
            };
            value = lerp(value, inside, body.in_row(y, z).coverage(x as f32));
        }
        rounded(value + self.noise_factor * RowNoise::new(self.seed, y, z).at(x))
    }
}

fn foam_value(g: f32) -> f32 {
    let wall = edge(HALF_WALL_VOXELS - g.abs() * (1.0 / MEAN_SLOPE_PER_VOXEL));
    lerp(f32::from(AIR), f32::from(WALL), wall)
}

/// Exactly `a` at t = 0 and exactly `b` at t = 1, so that a covered body leaves no trace.
fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a * (1.0 - t) + b * t
}

/// To the nearest, halves upwards; the conversion clamps to 0..=65535.
fn rounded(value: f32) -> u16 {
    (value + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(phantom: &MicroCt, dims: [usize; 3]) -> Vec<u16> {
        let mut all = vec![0; dims.iter().product()];
        for (i, row) in all.chunks_mut(dims[0]).enumerate() {
            phantom.row(i % dims[1], i / dims[1], row);
        }
        all
    }

    fn share(voxels: &[u16], value: u16) -> f64 {
        voxels.iter().filter(|&&v| v == value).count() as f64 / voxels.len() as f64
    }

    #[test]
    fn rows_and_voxels_agree_bit_for_bit() {
        for dims in [[150, 70, 60], [33, 90, 5], [1, 1, 1], [7, 3, 200]] {
            let phantom = MicroCt::new(11, 400.0, dims);
            let all = rows(&phantom, dims);
            for (i, &got) in all.iter().enumerate() {
                let (x, y, z) = (i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]);
                assert_eq!(got, phantom.voxel(x, y, z), "{dims:?} at {x} {y} {z}");
            }
        }
    }

    #[test]
    fn without_noise_every_value_lies_between_two_materials() {
        let dims = [160, 150, 140];
        let all = rows(&MicroCt::new(1, 0.0, dims), dims);
        assert!(all.iter().all(|v| (AIR..=KERNEL).contains(v)));
        // Most voxels are pure, and every material has its fair part.
        let materials = [AIR, WALL, CASING, CORE, KERNEL, VOID_FILLING];
        let shares = materials.map(|value| share(&all, value));
        assert!(shares.iter().sum::<f64>() > 0.75, "{shares:?}");
        let at_least = [0.45, 0.04, 0.06, 0.02, 0.002, 0.0004];
        for ((value, share), least) in materials.into_iter().zip(shares).zip(at_least) {
            assert!(share > least, "{share} of the volume is {value}, less than {least}");
        }
    }

    #[test]
    fn known_places_hold_known_materials() {
        let dims = [600, 500, 400];
        let phantom = MicroCt::new(1, 0.0, dims);
        let at = |u: [f64; 3]| {
            let [x, y, z] = [0, 1, 2].map(|i| (f64::midpoint(u[i], 1.0) * dims[i] as f64) as usize);
            phantom.voxel(x, y, z)
        };
        assert_eq!(at([-0.99, -0.99, -0.99]), AIR);
        assert_eq!(at([0.88, 0.0, 0.0]), CASING);
        assert_eq!(at([-0.3, -0.05, 0.1]), CORE);
        assert_eq!(at([0.0, -0.1, 0.2]), KERNEL);
        assert_eq!(at([0.15, 0.12, 0.0]), VOID_FILLING);
    }

    #[test]
    fn the_foam_is_as_dense_at_every_size() {
        // The middle of the lower part, between core and casing, in volumes of three sizes.
        let wall_shares = [256, 512, 1024].map(|n| {
            let phantom = MicroCt::new(3, 0.0, [n; 3]);
            let mut row = vec![0; n];
            let (mut walls, mut pores) = (0, 0);
            for i in 0..400 {
                phantom.row(n / 4 + i % 20 * (n / 40), n * 3 / 20 + i / 20 * (n / 200), &mut row);
                let middle = &row[n * 2 / 5..n * 3 / 5];
                walls += middle.iter().filter(|&&v| v > 12_000).count();
                pores += middle.iter().filter(|&&v| v <= 12_000).count();
            }
            walls as f64 / (walls + pores) as f64
        });
        for share in wall_shares {
            assert!((0.24..0.44).contains(&share), "{wall_shares:?}");
        }
    }

    #[test]
    fn noise_has_the_sigma_asked_for_and_no_bias() {
        let dims = [128, 64, 64];
        for sigma in [400.0, 50.0] {
            let (noisy, clean) = (MicroCt::new(4, sigma, dims), MicroCt::new(4, 0.0, dims));
            let (noisy, clean) = (rows(&noisy, dims), rows(&clean, dims));
            let errors = noisy.iter().zip(&clean).map(|(&a, &b)| f64::from(a) - f64::from(b));
            let n = noisy.len() as f64;
            let mean = errors.clone().sum::<f64>() / n;
            let got = (errors.map(|e| e * e).sum::<f64>() / n).sqrt();
            assert!(mean.abs() < 0.01 * sigma, "sigma {sigma}: mean {mean}");
            assert!((got / sigma - 1.0).abs() < 0.02, "sigma {sigma}: {got}");
        }
    }

    #[test]
    fn noise_far_beyond_the_type_clamps_instead_of_wrapping() {
        let dims = [64, 8, 8];
        let all = rows(&MicroCt::new(4, 1e6, dims), dims);
        let (zeros, tops) = (share(&all, 0), share(&all, u16::MAX));
        assert!(zeros > 0.4 && tops > 0.4, "{zeros} {tops}");
    }
}
