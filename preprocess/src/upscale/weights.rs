//! Weights as data: for each place within a source voxel, which samples make a new voxel, and how much.
//!
//! New voxel o = i f + p is centred at `i + (p + 0.5) / f - 0.5`: one of f places (phases), so f sets of
//! weights do for an axis, whatever its length. They are made in f64 and rounded; the largest of
//! a set then takes what is left to a sum of 1. Phases p and f - 1 - p mirror each other exactly.
//!
//! Tricubic interpolation uses four taps (R. G. Keys, "Cubic convolution interpolation for digital
//! image processing", IEEE ASSP 29(6), 1981, for the separable form), the local contrast two.

use super::kernel::CubicKernel;
use super::real::Real;

/// The taps and weights of one phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stencil<F, const N: usize> {
    /// Samples, counted from the one that the new voxel lies in.
    pub(super) taps: [i64; N],
    pub(super) weights: [F; N],
}

/// The stencils of all phases, in order.
pub(super) type Stencils<F, const N: usize> = Vec<Stencil<F, N>>;

/// How many samples beyond its own a cubic stencil reaches.
pub(super) const REACH: usize = 2;

/// Four taps of a cubic kernel, for each of `factor` phases.
pub(super) fn cubic<F: Real>(factor: usize, kernel: CubicKernel) -> Stencils<F, 4> {
    phases(factor, |t| {
        if t == 0.0 {
            // A new voxel on an old one has three taps; told as four so that left and right are
            // treated alike. An interpolating kernel gives the old one.
            let [middle, side] = [0.0, 1.0].map(|x| kernel.at(x));
            Stencil { taps: [-1, 0, 0, 1], weights: rounded([side, middle, 0.0, side]) }
        } else {
            let weights = [1.0 + t, t, 1.0 - t, 2.0 - t].map(|x| kernel.at(x));
            Stencil { taps: [-1, 0, 1, 2], weights: rounded(weights) }
        }
    })
}

/// Two taps of linear interpolation, for each of `factor` phases.
pub(super) fn linear<F: Real>(factor: usize) -> Stencils<F, 2> {
    phases(factor, |t| {
        let taps = if t == 0.0 { [0, 0] } else { [0, 1] };
        Stencil { taps, weights: rounded([1.0 - t, t]) }
    })
}

/// Makes the phases at and after the middle of a voxel by their distance from it, 0 to 0.5, and the
/// others by mirroring them.
fn phases<F: Real, const N: usize>(
    factor: usize,
    stencil: impl Fn(f64) -> Stencil<F, N>,
) -> Stencils<F, N> {
    (0..factor)
        .map(|phase| {
            let mirrored = factor - 1 - phase;
            let late = phase.max(mirrored);
            // (late + 0.5) / factor - 0.5, whole numbers first: exactly 0 in the middle.
            let t = (2 * late + 1 - factor) as f64 / (2 * factor) as f64;
            let Stencil { mut taps, mut weights } = stencil(t);
            if phase < late {
                taps.reverse();
                taps = taps.map(|tap| -tap);
                weights.reverse();
            }
            Stencil { taps, weights }
        })
        .collect()
}

/// The weights in the type that is computed in, their sum as near to 1 as it goes.
fn rounded<F: Real, const N: usize>(weights: [f64; N]) -> [F; N] {
    let mut rounded = weights.map(F::near);
    let largest = (0..N).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
    let others: f64 = (0..N).filter(|k| *k != largest).map(|k| rounded[k].wide()).sum();
    rounded[largest] = F::near(1.0 - others);
    rounded
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::upscale::Upscale;

    fn check<F: Real, const N: usize>(stencils: &Stencils<F, N>, ulp: f64) {
        for (phase, stencil) in stencils.iter().enumerate() {
            let sum: f64 = stencil.weights.iter().map(|w| w.wide()).sum();
            assert!((sum - 1.0).abs() <= ulp, "phase {phase}: {sum}");
            let mut mirror = stencils[stencils.len() - 1 - phase];
            mirror.taps.reverse();
            mirror.taps = mirror.taps.map(|tap| -tap);
            mirror.weights.reverse();
            // The voxel in the middle has its centre twice, once with weight 0.
            let same = if mirror.taps == [-1, 0, 0, 1][..] {
                mirror.weights[0] == stencil.weights[0]
            } else {
                mirror == *stencil
            };
            assert!(same || N == 2 && mirror.taps[0] == mirror.taps[1], "phase {phase}");
        }
    }

    #[test]
    fn weights_sum_to_one_within_an_ulp_and_mirror_exactly() {
        for factor in Upscale::FACTORS.map(|f| f as usize) {
            for kernel in CubicKernel::ALL {
                check(&cubic::<f32>(factor, kernel), f64::from(f32::EPSILON) / 2.0);
                check(&cubic::<f64>(factor, kernel), f64::EPSILON);
            }
            check(&linear::<f32>(factor), f64::from(f32::EPSILON) / 2.0);
        }
    }

    #[test]
    fn weights_are_the_kernel_at_the_distance_of_each_tap() {
        for factor in Upscale::FACTORS.map(|f| f as usize) {
            for kernel in CubicKernel::ALL {
                for (phase, stencil) in cubic::<f64>(factor, kernel).iter().enumerate() {
                    let place = (phase as f64 + 0.5) / factor as f64 - 0.5;
                    for tap in -2..=2_i64 {
                        let weight: f64 = (0..4)
                            .filter(|k| stencil.taps[*k] == tap)
                            .map(|k| stencil.weights[k])
                            .sum();
                        let expected = kernel.at(place - tap as f64);
                        assert!((weight - expected).abs() < 1e-14, "{kernel} {factor} {phase}");
                    }
                }
            }
        }
    }
}
