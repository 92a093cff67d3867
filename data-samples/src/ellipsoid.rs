//! An axis-parallel ellipsoid with a soft edge, and how much of a voxel it covers.
//!
//! With `q^2 = sum ((p_i - c_i) / r_i)^2` in voxels, the distance to the surface is to first order
//! (1 - q^2) / (2 |grad(q^2) / 2|) (Taubin, "Distance approximations for rasterizing implicit
//! curves", 1994), so that the edge is equally wide everywhere, also in a flat volume.

use crate::foam::CHUNK;

/// The edge goes from 0 to 1 over this many voxels.
pub(crate) const EDGE_VOXELS: f32 = 1.5;

/// An ellipsoid in voxels: the centre of voxel (i, j, k) is at (i, j, k).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ellipsoid {
    centre_xyz: [f32; 3],
    radius_xyz: [f32; 3],
}

/// An ellipsoid as one row of voxels sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RowEllipsoid {
    centre_x: f32,
    inverse_radius_x: f32,
    q2_yz: f32,
    gradient2_yz: f32,
    /// Beyond this q^2 the coverage is 0; see [`Ellipsoid::in_row`].
    q2_outside: f32,
    /// Below this q^2 the coverage is 1; negative if no voxel is that deep inside.
    q2_inside: f32,
}

/// What an ellipsoid does with a chunk of voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cover {
    None,
    Some,
    All,
}

impl Ellipsoid {
    /// From a centre and radii in the volume's own box, which goes from -1 to 1 on every axis.
    pub(crate) fn in_box(centre: [f32; 3], radius: [f32; 3], dims_xyz: [usize; 3]) -> Self {
        let half = dims_xyz.map(|n| n as f32 / 2.0);
        Self {
            centre_xyz: [0, 1, 2].map(|i| (centre[i] + 1.0) * half[i] - 0.5),
            radius_xyz: [0, 1, 2].map(|i| radius[i] * half[i]),
        }
    }

    /// The row's view. Where the edge can be is bounded: since
    /// |grad(q^2) / 2| <= q / r, r being the smallest radius, the distance is at least
    /// |1 - q^2| r / (2 q), which is one voxel or more beyond q = 1 +- 2 / r; the edge ends at 0.75.
    pub(crate) fn in_row(&self, y: usize, z: usize) -> RowEllipsoid {
        let [cx, cy, cz] = self.centre_xyz;
        let [rx, ry, rz] = self.radius_xyz;
        let (qy, qz) = ((y as f32 - cy) / ry, (z as f32 - cz) / rz);
        let (gy, gz) = (qy / ry, qz / rz);
        let margin = 2.0 / rx.min(ry).min(rz);
        let inner = 1.0 - margin;
        RowEllipsoid {
            centre_x: cx,
            inverse_radius_x: 1.0 / rx,
            q2_yz: qy * qy + qz * qz,
            gradient2_yz: gy * gy + gz * gz,
            q2_outside: (1.0 + margin) * (1.0 + margin),
            q2_inside: if inner > 0.0 { inner * inner } else { -1.0 },
        }
    }
}

impl RowEllipsoid {
    /// The part of voxel `x` that the ellipsoid covers, 0 to 1.
    pub(crate) fn coverage(&self, x: f32) -> f32 {
        let qx = (x - self.centre_x) * self.inverse_radius_x;
        let gx = qx * self.inverse_radius_x;
        let q2 = qx * qx + self.q2_yz;
        let slope = (gx * gx + self.gradient2_yz).sqrt();
        edge((1.0 - q2) / (2.0 * slope)) // 1 / 0 at the very centre is infinity: inside
    }

    /// Whether the chunk from `x0` is wholly outside, wholly inside, or has to be looked at.
    pub(crate) fn cover(&self, x0: usize) -> Cover {
        let first = x0 as f32 - self.centre_x;
        let last = first + (CHUNK - 1) as f32;
        let nearest = if first > 0.0 { first } else { last.min(0.0) };
        let farthest = first.abs().max(last.abs());
        let q2_at = |dx: f32| (dx * self.inverse_radius_x).powi(2) + self.q2_yz;
        if q2_at(nearest) > self.q2_outside {
            Cover::None
        } else if q2_at(farthest) < self.q2_inside {
            Cover::All
        } else {
            Cover::Some
        }
    }
}

/// Coverage at a signed distance in voxels, positive inside.
pub(crate) fn edge(distance_voxels: f32) -> f32 {
    (distance_voxels * (1.0 / EDGE_VOXELS) + 0.5).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipping_never_changes_a_coverage() {
        for dims in [[512, 512, 512], [200, 31, 90], [64, 9, 1200], [3000, 40, 6], [5, 4, 3]] {
            let body = Ellipsoid::in_box([0.05, -0.1, 0.0], [0.42, 0.3, 0.5], dims);
            let (mut skipped, mut looked_at) = (0, 0);
            for z in (0..dims[2]).step_by(7) {
                for y in 0..dims[1] {
                    let row = body.in_row(y, z);
                    for x0 in (0..dims[0]).step_by(CHUNK) {
                        let expected = match row.cover(x0) {
                            Cover::Some => {
                                looked_at += 1;
                                continue;
                            }
                            Cover::None => 0.0,
                            Cover::All => 1.0,
                        };
                        skipped += 1;
                        for x in x0..x0 + CHUNK {
                            assert_eq!(row.coverage(x as f32), expected, "{dims:?} {x} {y} {z}");
                        }
                    }
                }
            }
            assert!(dims[0] < 512 || skipped > looked_at, "{dims:?}: nothing is skipped");
        }
    }

    #[test]
    fn the_edge_is_as_wide_on_the_flat_side_as_on_the_sharp_one() {
        let dims = [400, 100, 100];
        let body = Ellipsoid::in_box([0.0; 3], [0.9, 0.8, 0.8], dims);
        let centre = [199.5_f32, 49.5, 49.5];
        for (axis, radius) in [(0, 180.0), (1, 40.0), (2, 40.0)] {
            for offset in [-2.0, -0.5, 0.0, 0.5, 2.0] {
                // Rows lie on whole y and z: shift the body, not the row.
                let mut shifted = body;
                shifted.centre_xyz = [200.0, 50.0, 50.0];
                shifted.centre_xyz[axis] -= radius + offset;
                let got = shifted.in_row(50, 50).coverage(200.0);
                let expected = (0.5 - offset / EDGE_VOXELS).clamp(0.0, 1.0);
                assert!((got - expected).abs() < 0.05, "axis {axis} offset {offset}: {got}");
            }
        }
        assert_eq!(body.centre_xyz, centre);
    }

    #[test]
    fn the_covered_volume_is_the_ellipsoids() {
        let dims = [120, 100, 80];
        let body = Ellipsoid::in_box([0.0; 3], [0.8; 3], dims);
        let mut sum = 0.0;
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                let row = body.in_row(y, z);
                sum += (0..dims[0]).map(|x| f64::from(row.coverage(x as f32))).sum::<f64>();
            }
        }
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 48.0 * 40.0 * 32.0;
        assert!((sum / exact - 1.0).abs() < 0.005, "{sum} for {exact}");
    }
}
