//! The local contrast: how much a source voxel differs from its neighbours.
//!
//! It is the mean absolute difference from the six face neighbours. That is 0 just where all seven are
//! equal, needs no squares (which overflow) and no sums of squares (which cancel), and grows with
//! noise, edges and ramps alike. New voxels get it by linear interpolation between eight source
//! voxels, all of whose neighbours are among the 64 of the tricubic kernel: where those are equal
//! there is no detail.

use super::lattice::Line;
use super::real::Real;

/// Writes `scale` times the contrast of every voxel of a box of lines, z, then y, that has all six
/// neighbours in the box.
#[inline(always)]
pub(super) fn contrasts<F: Real>(
    samples: &[Line<F>],
    [ny, nz]: [usize; 2],
    scale: f64,
    contrasts: &mut [Line<F>],
) {
    let sixth = F::near(scale / 6.0);
    for z in 1..nz - 1 {
        for y in 1..ny - 1 {
            let at = z * ny + y;
            let own = &samples[at];
            let (below, above) = (&samples[at - 1], &samples[at + 1]);
            let (before, behind) = (&samples[at - ny], &samples[at + ny]);
            let out = &mut contrasts[at];
            for x in 1..out.len() - 1 {
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
    use crate::upscale::lattice::LINE;

    #[test]
    fn contrast_is_the_mean_step_to_six_neighbours_and_zero_where_they_are_equal() {
        let mut samples = [[7.0_f32; LINE]; 25];
        samples[12][20] = 13.0;
        let mut found = [[0.0; LINE]; 25];
        contrasts(&samples, [5; 2], 2.0, &mut found);
        for (at, line) in found.into_iter().enumerate() {
            for (x, contrast) in line.into_iter().enumerate() {
                let expected = match (at, x) {
                    (12, 20) => 12.0,
                    (12, 19 | 21) | (11 | 13 | 7 | 17, 20) => 2.0,
                    _ => 0.0,
                };
                assert_eq!(contrast, expected, "sample {x} of line {at}");
            }
        }
    }
}
