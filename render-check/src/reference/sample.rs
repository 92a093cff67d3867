//! Values between voxels; beyond the volume its edge repeats.

use super::SourceVolume;
use crate::finite::finite;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// How values between voxels are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Linear along each axis, as textures do it.
    #[default]
    Trilinear,
    /// Catmull and Rom's cubic along each axis.
    Tricubic,
}

/// The value at a place in voxels; voxel (0, 0, 0) has its centre at (0.5, 0.5, 0.5).
/// What is no number is one of `range`, where that is given.
pub(super) fn value(
    volume: &SourceVolume,
    at: DVec3,
    interpolation: Interpolation,
    range: Option<[f64; 2]>,
) -> f64 {
    let voxel = |index: usize| {
        let value = volume.samples.get_f64(index);
        range.map_or(value, |range| finite(value, range))
    };
    match interpolation {
        Interpolation::Trilinear => weigh(volume.dims_xyz, voxel, at, 0, |t| [1.0 - t, t]),
        Interpolation::Tricubic => weigh(volume.dims_xyz, voxel, at, 1, cubic),
    }
}

/// Weights of the voxels at -1, 0, 1 and 2 for a place t between 0 and 1.
fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}

/// The sum of N^3 voxels from `before` below the place on, by weights along each axis.
fn weigh<const N: usize>(
    dims_xyz: [u64; 3],
    voxel: impl Fn(usize) -> f64,
    at: DVec3,
    before: i64,
    weights: impl Fn(f64) -> [f64; N],
) -> f64 {
    let at = at - 0.5;
    let below = at.floor();
    let weights = (at - below).to_array().map(weights);
    let [nx, ny, nz] = dims_xyz.map(|n| n as i64);
    let place = |axis: usize, i: usize, n: i64| {
        (below[axis] as i64 - before + i as i64).clamp(0, n - 1) as usize
    };
    // Differences from one voxel are summed, so that where all are the same it is that value exactly.
    let middle = N / 2;
    let base = voxel(
        ((place(2, middle, nz) * ny as usize + place(1, middle, ny)) * nx as usize)
            + place(0, middle, nx),
    );
    let mut sum = base;
    for k in 0..N {
        let z = place(2, k, nz) * ny as usize;
        for j in 0..N {
            let row = (z + place(1, j, ny)) * nx as usize;
            let mut along = 0.0;
            for (i, weight) in weights[0].iter().enumerate() {
                along += weight * (voxel(row + place(0, i, nx)) - base);
            }
            sum += weights[2][k] * weights[1][j] * along;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use octree_store::SampleBuffer;

    /// Both kinds repeat linear functions, and the cubic kind quadratic ones, between inner voxels; both go through voxels.
    #[test]
    fn polynomials_are_repeated() {
        let f = |x: f64, y: f64, z: f64| 3.0 + 2.0 * x - y + 0.5 * z;
        let g = |x: f64, y: f64, z: f64| x * x - 0.3 * y * y + z * z + x * y;
        let volume = |f: &dyn Fn(f64, f64, f64) -> f64| {
            let voxels = (0..512).map(|i| (i % 8, i / 8 % 8, i / 64));
            let values = voxels.map(|(x, y, z)| f(f64::from(x), f64::from(y), f64::from(z)));
            SourceVolume {
                dims_xyz: [8; 3],
                spacing_xyz: [1.0; 3],
                samples: SampleBuffer::F64(values.collect()),
            }
        };
        let (linear, quadratic) = (volume(&f), volume(&g));
        for i in 0..200 {
            let p = DVec3::new(0.37, 0.61, 0.83) * f64::from(i);
            let p = DVec3::splat(2.0) + (p - p.floor()) * 3.5;
            let [x, y, z] = (p - 0.5).to_array();
            for kind in [Interpolation::Trilinear, Interpolation::Tricubic] {
                assert!((value(&linear, p, kind, None) - f(x, y, z)).abs() < 1e-12);
            }
            assert!(
                (value(&quadratic, p, Interpolation::Tricubic, None) - g(x, y, z)).abs() < 1e-11
            );
        }
        assert_eq!(
            value(&quadratic, DVec3::splat(3.5), Interpolation::Trilinear, None),
            g(3.0, 3.0, 3.0)
        );
    }
}
