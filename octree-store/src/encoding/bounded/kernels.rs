//! The loops of the `max-error` encoding: integers of 8 and 16 bits in 32 bits, all other types in f64.
//!
//! Both give what the formula gives. That of integers is exact; that of floats is not, so [`worst`] looks at
//! every sample.

use super::Quantiser;
use crate::encoding::words::Word;
use crate::error_sum::ErrorSum;
use crate::sample::Sample;
use multiversion::multiversion;

/// Adding this to 0 <= x <= 65535 leaves round-half-even(x) in the low mantissa bits.
const ROUND: f64 = 4_503_599_627_370_496.0; // 2^52

/// The quantiser of a small integer type, in 32 bits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Small {
    /// What code 0 reads as before it is clamped.
    pub(super) base: i32,
    pub(super) step: i32,
    pub(super) last: i32,
    pub(super) min: i32,
    pub(super) max: i32,
}

/// `floor((v - start) / step)`. With x = v - start below 2^18 and a step below 2^18, (x + 1/2) / step is
/// at least 1 / (2 step) from a whole number, and f32 is wrong by less.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn quantise_small<T: Sample, W: Word>(
    samples: &[T],
    start: i32,
    inverse: f32,
    last: i32,
    codes: &mut [W],
) {
    for (code, sample) in codes.iter_mut().zip(samples) {
        let x = (sample.to_i32() - start) as f32 + 0.5;
        // Below 2^18, so the conversion never saturates.
        let q = ((x * inverse) as i32).min(last);
        *code = W::of_u16(q as u16);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn decode_small<T: Sample, W: Word>(small: Small, codes: &[W], samples: &mut [T]) {
    let Small { base, step, last, min, max } = small;
    for (sample, code) in samples.iter_mut().zip(codes) {
        let q = i32::from(code.to_u16()).min(last);
        *sample = T::from_i32((base + q * step).max(min).min(max));
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
#[allow(clippy::manual_clamp, reason = "`max` turns NaN into 0, which `clamp` would keep")]
pub(super) fn quantise_f64<T: Sample, W: Word>(
    samples: &[T],
    [base, first, step, last]: [f64; 4],
    codes: &mut [W],
) {
    for (code, sample) in codes.iter_mut().zip(samples) {
        let x = ((sample.to_f64() - base) / step - first).max(0.0).min(last);
        *code = W::of_u16((x + ROUND).to_bits() as u16);
    }
}

#[inline(always)]
fn value_f64<T: Sample>(quantiser: &Quantiser<T>, code: u16) -> T {
    let Quantiser { min, max, base, first, step, last, .. } = *quantiser;
    let at = base + (first + f64::from(code.min(last))) * step;
    T::from_f64(at.max(min.to_f64()).min(max.to_f64()))
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn decode_f64<T: Sample, W: Word>(
    quantiser: Quantiser<T>,
    codes: &[W],
    samples: &mut [T],
) {
    for (sample, code) in samples.iter_mut().zip(codes) {
        *sample = value_f64(&quantiser, code.to_u16());
    }
}

/// The largest error of a finite sample.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn worst<T: Sample, W: Word>(
    quantiser: Quantiser<T>,
    samples: &[T],
    codes: &[W],
) -> f64 {
    let mut worst = 0.0_f64;
    for (sample, code) in samples.iter().zip(codes) {
        let read = value_f64(&quantiser, code.to_u16());
        let error = if sample.is_finite() { (read.to_f64() - sample.to_f64()).abs() } else { 0.0 };
        worst = worst.max(error);
    }
    worst
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn add_errors<T: Sample>(sum: &mut ErrorSum, samples: &[T], decoded: &[T]) {
    sum.add_all(samples, decoded);
}
