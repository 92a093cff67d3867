//! The local contrast: how much a source voxel differs from its neighbours.
//!
//! It is the mean absolute difference from the six face neighbours. That is 0 just where all seven are
//! equal, needs no squares (which overflow) and no sums of squares (which cancel), and grows with
//! noise, edges and ramps alike. New voxels get it by linear interpolation between eight source
//! voxels, all of whose neighbours are among the 64 of the tricubic kernel: where those are equal
//! there is no detail.

use super::real::Real;

/// Writes `scale` times the contrast of every voxel of a box of `dims_xyz` samples, x fastest, that has all
/// six neighbours in the box.
#[inline(always)]
pub(super) fn contrasts<F: Real>(
    samples: &[F],
    dims_xyz: [usize; 3],
    scale: f64,
    contrasts: &mut [F],
) {
    let [nx, ny, nz] = dims_xyz;
    let sixth = F::near(scale / 6.0);
    for z in 1..nz - 1 {
        for y in 1..ny - 1 {
            let first = (z * ny + y) * nx;
            let row = |first: usize| &samples[first..first + nx];
            let own = row(first);
            let (below, above) = (row(first - nx), row(first + nx));
            let (before, behind) = (row(first - nx * ny), row(first + nx * ny));
            let out = &mut contrasts[first..first + nx];
            for x in 1..nx - 1 {
                let step = |other: F| (other - own[x]).abs();
                let sum = (step(own[x - 1]) + step(own[x + 1]))
                    + (step(below[x]) + step(above[x]))
                    + (step(before[x]) + step(behind[x]));
                out[x] = sum * sixth;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contrast_is_the_mean_step_to_six_neighbours_and_zero_where_they_are_equal() {
        let mut samples = [7.0_f32; 125];
        samples[62] = 13.0;
        let mut found = [0.0; 125];
        contrasts(&samples, [5; 3], 2.0, &mut found);
        for (at, contrast) in found.into_iter().enumerate() {
            let expected = match at {
                62 => 12.0,
                61 | 63 | 57 | 67 | 37 | 87 => 2.0,
                _ => 0.0,
            };
            assert_eq!(contrast, expected, "sample {at}");
        }
    }
}
