//! Phantoms whose every value is a short formula.

use crate::Kind;

/// The value at voxel (x, y, z), before it is rounded and clamped to the sample type.
///
/// Sums are taken from left to right in f64, so that any language gets the same bits. A micro-CT
/// phantom is not analytic; it answers 0 here and is computed elsewhere.
pub(crate) fn value(kind: &Kind, dims_xyz: [usize; 3], x: usize, y: usize, z: usize) -> f64 {
    match *kind {
        Kind::Ramp { slope_xyz: [a, b, c] } => a * x as f64 + b * y as f64 + c * z as f64,
        Kind::Sphere { radius_voxels, inside, outside } => {
            // The centre may lie between two voxels: twice the offset is a whole number.
            let twice = |i: usize, n: usize| (2 * i) as f64 - (n - 1) as f64;
            let [dx, dy, dz] =
                [twice(x, dims_xyz[0]), twice(y, dims_xyz[1]), twice(z, dims_xyz[2])];
            let diameter = 2.0 * radius_voxels;
            if dx * dx + dy * dy + dz * dz <= diameter * diameter { inside } else { outside }
        }
        Kind::HotVoxel { at_xyz, hot, background } => {
            let at = at_xyz.unwrap_or(dims_xyz.map(|n| n / 2));
            if at == [x, y, z] { hot } else { background }
        }
        Kind::Constant { value } => value,
        Kind::MicroCt { .. } => 0.0,
    }
}
