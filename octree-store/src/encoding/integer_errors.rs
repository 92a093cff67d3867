//! The errors of quantised integers up to 16 bits, in vectors: decoded, compared and summed without
//! leaving the registers. [`super::quantised8::Quantiser::errors_by_table`] is the obvious way, and a
//! test holds them against each other.

use super::quantised8::decoded_integer;
use crate::error_sum::ErrorSum;
use crate::sample::Sample;
use multiversion::multiversion;
use std::ops::Range;

/// Samples to a row of [`ErrorLanes`]: the usual core's, and one vector of AVX-512.
const LANES: usize = 32;

/// Squares and largest of the errors of one place in every row, [`LANES`] places side by side: they
/// stay in vector registers from row to row.
#[derive(Clone, Copy)]
struct ErrorLanes {
    squares: [u32; LANES],
    largest: [u16; LANES],
}

impl ErrorLanes {
    /// Adds up to [`LANES`] errors. A loop for each step: the compiler makes a few vector
    /// instructions of each, and many shuffles of one loop with all.
    #[inline(always)]
    fn add<T: Sample, const N: usize>(
        &mut self,
        (min, range): (u16, u16),
        samples: &[T; N],
        codes: &[u8; N],
    ) {
        let mut errors = [0_u16; N];
        for i in 0..N {
            // Counted from the type's least value, so that 16 bits without a sign hold all types.
            let decoded = from_least(decoded_integer::<T>(min, range, codes[i]));
            errors[i] = decoded.abs_diff(from_least(samples[i]));
        }
        for (largest, error) in self.largest.iter_mut().zip(errors) {
            *largest = error.max(*largest);
        }
        for (sum, error) in self.squares.iter_mut().zip(errors) {
            // Not above 255: see `exact` below.
            *sum = sum.wrapping_add(u32::from(error.wrapping_mul(error)));
        }
    }
}

/// How far a small integer lies above the least of its type.
#[inline(always)]
fn from_least<T: Sample>(v: T) -> u16 {
    (v.to_i32() - T::LEAST.to_i32()) as u16
}

/// The errors of integers up to 16 bits: at most 65535 / 510 + 1, so that a square fits 16 bits, and a
/// lane's sum 32. `None` where they are larger, as only codes that are not the samples' own can make it.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn errors_of_integers<T: Sample>(
    min: u16,
    range: u16,
    samples: &[T],
    codes: &[u8],
    spans: impl Iterator<Item = Range<usize>>,
) -> Option<ErrorSum> {
    let none = ErrorLanes { squares: [0; LANES], largest: [0; LANES] };
    // Lanes that only whole rows are added to stay whole vectors.
    let (mut lanes, mut rest) = (none, none);
    let (mut voxels, mut added) = (0, 0);
    for span in spans {
        let (samples, codes) = (&samples[span.clone()], &codes[span]);
        voxels += samples.len() as u64;
        let (sample_rows, samples) = samples.as_chunks::<LANES>();
        let (code_rows, codes) = codes.as_chunks::<LANES>();
        for (samples, codes) in sample_rows.iter().zip(code_rows) {
            lanes.add((min, range), samples, codes);
        }
        let (sample_pieces, samples) = samples.as_chunks::<8>();
        let (code_pieces, codes) = codes.as_chunks::<8>();
        for (samples, codes) in sample_pieces.iter().zip(code_pieces) {
            rest.add((min, range), samples, codes);
        }
        for (sample, code) in samples.iter().zip(codes) {
            rest.add((min, range), &[*sample], &[*code]);
        }
        added += sample_rows.len() + sample_pieces.len() + samples.len();
    }
    let (mut squares, mut largest) = (0, 0);
    for lanes in [lanes, rest] {
        for i in 0..LANES {
            squares += u64::from(lanes.squares[i]);
            largest = lanes.largest[i].max(largest);
        }
    }
    let sum_bound = added as u64 * u64::from(largest).pow(2);
    let exact = largest <= 255 && u32::try_from(sum_bound).is_ok();
    exact.then(|| ErrorSum { voxels, squares: squares as f64, amax: f64::from(largest) })
}

#[cfg(test)]
mod tests {
    use crate::encoding::finite_range;
    use crate::encoding::quantised8::Quantiser;
    use crate::sample::{Sample, SampleType};
    use crate::with_sample_type;
    use proptest::prelude::*;

    fn assert_errors_equal_the_twin<T: Sample>(
        quantiser: Quantiser<T>,
        samples: &[T],
        codes: &[u8],
    ) {
        let n = samples.len();
        for spans in [[0..n, 0..0], [n / 5..n / 3, n / 2..n], [0..n.min(33), 0..n.min(7)]] {
            let spans = spans.into_iter();
            let twin = quantiser.errors_by_table(samples, codes, spans.clone());
            assert_eq!(quantiser.errors(samples, codes, spans), twin);
        }
    }

    proptest! {
        #[test]
        fn errors_of_integers_equal_those_by_table(
            bits in proptest::collection::vec(any::<u16>(), 2..300), narrow in 0_u32..16, other in any::<bool>(),
        ) {
            for sample_type in SampleType::ALL.into_iter().filter(|t| t.is_integer() && t.bytes() <= 2) {
                with_sample_type!(sample_type, T => {
                    let samples: Vec<T> = bits
                        .iter()
                        .map(|b| T::from_le_slice(&(b >> narrow).to_le_bytes()[..size_of::<T>()]))
                        .collect();
                    let (min, max) = finite_range(&samples).unwrap();
                    let quantiser = Quantiser::new(min, max);
                    let mut codes = vec![0; samples.len()];
                    quantiser.quantise(&samples, &mut codes);
                    // Codes of other samples have errors up to the whole range.
                    if other { codes.reverse(); }
                    assert_errors_equal_the_twin(quantiser, &samples, &codes);
                });
            }
        }
    }

    #[test]
    fn the_largest_brick_with_the_largest_errors_is_summed_without_overflow() {
        let quantiser = Quantiser::new(0, u16::MAX);
        let samples = vec![128_u16; 136 * 136 * 136];
        for code in [0, 1, 255] {
            assert_errors_equal_the_twin(quantiser, &samples, &vec![code; samples.len()]);
        }
    }
}
