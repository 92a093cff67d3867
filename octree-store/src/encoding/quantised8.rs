//! The `u8` encoding: eight bits a sample, linear over the brick's range (2010 text, section 5).
//!
//! `q = round((v - min) * 255 / (max - min))`, clamped; a reader gets `min + q * (max - min) / 255`,
//! rounded to the source's type, with 0 and 255 giving `min` and `max` exactly. For integers
//! `|decoded - v| <= (max - min) / 510 + 0.5`; for floats `(max - min) / 510` + 2 ulp of
//! `max(|min|, |max|, max - min)`.
//!
//! Quantising runs in f32 for 8/16-bit integers and f32, in f64 for wider types, and for the f32
//! ranges that would overflow or vanish in f32. Decoding is a table of 256 values made in f64,
//! and for integers up to 16 bits exact integer arithmetic, which a test holds against the table.

use super::integer_errors::errors_of_integers;
use crate::error_sum::ErrorSum;
use crate::sample::Sample;
use multiversion::multiversion;
use std::ops::Range;

/// Maps one brick's range to 0..=255 and back.
#[derive(Debug, Clone, Copy)]
pub struct Quantiser<T> {
    min: T,
    max: T,
}

/// Adding this to 0 <= x <= 255 leaves round-half-even(x) in the low mantissa bits.
const ROUND_F32: f32 = 8_388_608.0; // 2^23
const ROUND_F64: f64 = 4_503_599_627_370_496.0; // 2^52

impl<T: Sample> Quantiser<T> {
    /// A quantiser for the finite range `min..=max`.
    pub fn new(min: T, max: T) -> Self {
        Self { min, max }
    }

    /// Writes the code of every sample. NaN takes the code of `min`; infinities clamp.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub fn quantise(&self, samples: &[T], codes: &mut [u8]) {
        assert_eq!(samples.len(), codes.len());
        let range = self.max.to_f64() - self.min.to_f64();
        if range == 0.0 {
            codes.fill(0);
        } else if T::FITS_F32 && (1e-30..=1e38).contains(&range) {
            quantise_f32(samples, self.min.to_f32(), (255.0 / range) as f32, codes);
        } else {
            // A power of two keeps the range inside f64: exact but for bits that do not matter.
            let pre = match range {
                huge if huge > 1e300 => 2_f64.powi(-4),
                tiny if tiny < 1e-290 => 2_f64.powi(600),
                _ => 1.0,
            };
            let min = self.min.to_f64() * pre;
            quantise_f64(samples, pre, min, 255.0 / (self.max.to_f64() * pre - min), codes);
        }
    }

    /// Writes what a reader gets for every code.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub fn decode(&self, codes: &[u8], samples: &mut [T]) {
        assert_eq!(samples.len(), codes.len());
        if let Some((min, range)) = self.small_integers() {
            decode_integers(min, range, codes, samples);
        } else {
            let table = self.table();
            for (sample, &code) in samples.iter_mut().zip(codes) {
                *sample = table[usize::from(code)];
            }
        }
    }

    /// Counts the errors of samples whose codes are known, over some spans of them.
    pub fn errors(
        &self,
        samples: &[T],
        codes: &[u8],
        spans: impl Iterator<Item = Range<usize>> + Clone,
    ) -> ErrorSum {
        let small = self.small_integers();
        small
            .and_then(|(min, range)| errors_of_integers(min, range, samples, codes, spans.clone()))
            .unwrap_or_else(|| self.errors_by_table(samples, codes, spans))
    }

    /// As [`Quantiser::errors`], for any type: the obvious way.
    pub(super) fn errors_by_table(
        &self,
        samples: &[T],
        codes: &[u8],
        spans: impl Iterator<Item = Range<usize>>,
    ) -> ErrorSum {
        let table = self.table();
        let mut sum = ErrorSum::default();
        let mut decoded = [T::default(); ROW];
        for span in spans {
            for (samples, codes) in samples[span.clone()].chunks(ROW).zip(codes[span].chunks(ROW)) {
                for (decoded, &code) in decoded.iter_mut().zip(codes) {
                    *decoded = table[usize::from(code)];
                }
                sum.add_all(samples, &decoded);
            }
        }
        sum
    }

    /// Most that a finite sample within the range is off when it is read.
    pub fn error_bound(&self) -> f64 {
        // Halves, so that the widest f64 range does not overflow.
        let (low, high) = (self.min.to_f64() / 2.0, self.max.to_f64() / 2.0);
        let half_range = high - low;
        if T::TYPE.is_integer() && half_range <= 127.5 {
            // Every integer has a code of its own, or lies less than half from what one reads as.
            return 0.0;
        }
        let half_scale = low.abs().max(high.abs()).max(half_range);
        let epsilon = if T::FITS_F32 { f64::from(f32::EPSILON) } else { f64::EPSILON };
        let tiny = if T::FITS_F32 { f64::from(f32::from_bits(1)) } else { f64::from_bits(1) };
        let rounded = if T::TYPE.is_integer() { 0.5 } else { 0.0 };
        half_range / 255.0 + 2.0 * (half_scale * (2.0 * epsilon)).max(tiny) + rounded
    }

    /// Minimum (its low 16 bits) and range of integers of 8 and 16 bits, which have a kernel of
    /// their own.
    fn small_integers(&self) -> Option<(u16, u16)> {
        let small = T::TYPE.is_integer() && size_of::<T>() <= 2;
        let (min, max) = (self.min.to_i32(), self.max.to_i32());
        small.then(|| (min as u16, max.abs_diff(min) as u16))
    }

    /// What a reader gets for each of the 256 codes.
    pub fn table(&self) -> [T; 256] {
        let (min, max) = (self.min.to_f64(), self.max.to_f64());
        // A power of two keeps 255 * (max - min) inside f64 for the widest range.
        let post = if max - min > 1e300 { 2_f64.powi(10) } else { 1.0 };
        let (low, range) = (min / post, max / post - min / post);
        let mut table = [self.min; 256];
        for (q, value) in table.iter_mut().enumerate() {
            // `range / 255` first would lose the last bits of the product.
            let exact = (low + q as f64 * range / 255.0) * post;
            *value = T::from_f64(exact.clamp(min, max));
        }
        table[255] = self.max;
        table
    }
}

/// Samples that are decoded at a time: a brick's longest row.
const ROW: usize = 128;

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
#[allow(clippy::manual_clamp, reason = "`max` turns NaN into 0, which `clamp` would keep")]
fn quantise_f32<T: Sample>(samples: &[T], min: f32, scale: f32, codes: &mut [u8]) {
    for (code, sample) in codes.iter_mut().zip(samples) {
        let x = ((sample.to_f32() - min) * scale).max(0.0).min(255.0);
        *code = (x + ROUND_F32).to_bits() as u8;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
#[allow(clippy::manual_clamp, reason = "`max` turns NaN into 0, which `clamp` would keep")]
fn quantise_f64<T: Sample>(samples: &[T], pre: f64, min: f64, scale: f64, codes: &mut [u8]) {
    for (code, sample) in codes.iter_mut().zip(samples) {
        let x = ((sample.to_f64() * pre - min) * scale).max(0.0).min(255.0);
        *code = (x + ROUND_F64).to_bits() as u8;
    }
}

/// `min + round(q * range / 255)` in 16-bit integers: 255 is odd, so there are no ties.
///
/// With c = 257 q, q * range / 255 = c * range / 65535, and for A = c * range + 32639 (a half less
/// a bit) = 65536 h + l, floor(A / 65535) = h + (h + l >= 65535).
#[inline(always)]
pub(super) fn decoded_integer<T: Sample>(min: u16, range: u16, code: u8) -> T {
    // 257 q as two equal bytes: written as a product it would merge with the next one, and the
    // compiler would miss the 16-bit multiplication that has it in one instruction.
    let c = u16::from(code) << 8 | u16::from(code);
    let product = u32::from(c) * u32::from(range);
    let (low, carry) = (product as u16).overflowing_add(32_639);
    let high = (product >> 16) as u16 + u16::from(carry);
    let rounded = high.wrapping_add(u16::from(low >= !high));
    T::from_i32(i32::from(min.wrapping_add(rounded)))
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn decode_integers<T: Sample>(min: u16, range: u16, codes: &[u8], samples: &mut [T]) {
    for (sample, &code) in samples.iter_mut().zip(codes) {
        *sample = decoded_integer(min, range, code);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::finite_range;
    use crate::sample::SampleType;
    use crate::with_sample_type;
    use proptest::prelude::*;

    /// The formula as DESIGN gives it, in f64, a sample at a time.
    fn decoded_twin<T: Sample>(v: T, min: T, max: T) -> f64 {
        let (v, min, max) = (v.to_f64(), min.to_f64(), max.to_f64());
        let q = ((v - min) * 255.0 / (max - min)).round().clamp(0.0, 255.0);
        min + q * (max - min) / 255.0
    }

    fn round_trip<T: Sample>(samples: &[T]) -> Vec<T> {
        let (min, max) = finite_range(samples).unwrap();
        let quantiser = Quantiser::new(min, max);
        let mut codes = vec![0; samples.len()];
        quantiser.quantise(samples, &mut codes);
        let mut decoded = vec![T::default(); samples.len()];
        quantiser.decode(&codes, &mut decoded);
        decoded
    }

    fn assert_laws<T: Sample>(samples: &[T]) {
        let (min, max) = finite_range(samples).unwrap();
        let decoded = round_trip(samples);
        for (&v, &d) in samples.iter().zip(&decoded) {
            let error = (d.to_f64() / 2.0 - v.to_f64() / 2.0).abs() * 2.0;
            assert!(
                error <= Quantiser::new(min, max).error_bound(),
                "{v} became {d} in {min}..{max}"
            );
        }
        assert_eq!(finite_range(&decoded), Some((min, max)), "the ends come back exactly");
        assert_eq!(round_trip(&decoded), decoded, "requantising changes nothing");
        let table = Quantiser::new(min, max).table();
        assert!(table.windows(2).all(|pair| pair[0] <= pair[1]), "decoding is monotone");
    }

    proptest! {
        #[test]
        fn integers_stay_within_the_bound(bits in proptest::collection::vec(any::<u64>(), 2..200)) {
            for sample_type in SampleType::ALL.into_iter().filter(|t| t.is_integer()) {
                with_sample_type!(sample_type, T => {
                    let samples: Vec<T> =
                        bits.iter().map(|b| T::from_le_slice(&b.to_le_bytes()[..size_of::<T>()])).collect();
                    assert_laws(&samples);
                });
            }
        }

        #[test]
        fn narrow_integer_ranges_stay_within_the_bound(
            base in any::<u16>(), range in 1_u16..1200, at in proptest::collection::vec(0.0..1.0, 2..200),
        ) {
            let samples: Vec<u16> =
                at.iter().map(|t: &f64| base.saturating_add((t * f64::from(range)) as u16)).collect();
            assert_laws(&samples);
        }

        #[test]
        fn floats_of_any_bits_stay_within_the_bound(bits in proptest::collection::vec(any::<u64>(), 2..100)) {
            let wide: Vec<f64> = bits.iter().map(|&b| f64::from_bits(b)).filter(|v| v.is_finite()).collect();
            let narrow: Vec<f32> =
                bits.iter().map(|&b| f32::from_bits(b as u32)).filter(|v| v.is_finite()).collect();
            if wide.len() > 1 { assert_laws(&wide); }
            if narrow.len() > 1 { assert_laws(&narrow); }
        }

        #[test]
        fn ordinary_floats_stay_within_the_bound(
            base in -1e6_f32..1e6, range in 1e-3_f32..1e6,
            at in proptest::collection::vec(0.0_f32..1.0, 2..200),
        ) {
            assert_laws(&at.iter().map(|t| base + t * range).collect::<Vec<f32>>());
            assert_laws(&at.iter().map(|t| f64::from(base) + f64::from(t * range)).collect::<Vec<f64>>());
        }

        #[test]
        fn the_kernel_equals_the_formula(
            min in any::<u16>(), max in any::<u16>(), at in proptest::collection::vec(0.0..=1.0, 1..100),
        ) {
            let (min, max) = (min.min(max), min.max(max));
            prop_assume!(min < max);
            let mut samples = vec![min, max];
            samples.extend(at.iter().map(|t: &f64| min + (t * f64::from(max - min)) as u16));
            for (v, d) in samples.iter().zip(round_trip(&samples)) {
                // On a tie the kernel may take the other neighbour: half a step more.
                let step = f64::from(max - min) / 255.0;
                let twin = decoded_twin(*v, min, max);
                let error = (f64::from(d) - f64::from(*v)).abs();
                prop_assert!((twin - f64::from(d)).abs() <= 0.5 || error <= step / 2.0 + 0.5);
            }
        }
    }

    #[test]
    fn integer_decoding_is_the_table_for_every_range_and_code() {
        let codes: Vec<u8> = (0..=255).collect();
        let mut decoded = [0_u16; 256];
        for range in 1..=u16::MAX {
            let quantiser = Quantiser::new(0, range);
            quantiser.decode(&codes, &mut decoded);
            assert_eq!(decoded, quantiser.table(), "{range}");
        }
        for (min, max) in [(i16::MIN, i16::MAX), (-5, 300), (i16::MIN, i16::MIN + 1)] {
            let mut decoded = [0_i16; 256];
            let quantiser = Quantiser::new(min, max);
            quantiser.decode(&codes, &mut decoded);
            assert_eq!(decoded, quantiser.table());
        }
        let mut decoded = [0_i8; 256];
        let quantiser = Quantiser::new(i8::MIN, i8::MAX);
        quantiser.decode(&codes, &mut decoded);
        assert_eq!(decoded, quantiser.table());
    }

    #[test]
    fn errors_over_spans_are_those_of_the_decoded_samples() {
        let samples: Vec<u16> = (0..900_u32).map(|i| (i * 7919 % 50_021) as u16).collect();
        let quantiser = Quantiser::new(0, 50_020);
        let mut codes = vec![0; samples.len()];
        quantiser.quantise(&samples, &mut codes);
        let mut decoded = vec![0; samples.len()];
        quantiser.decode(&codes, &mut decoded);
        let mut expected = ErrorSum::default();
        expected.add_all(&samples[5..300], &decoded[5..300]);
        expected.add_all(&samples[310..311], &decoded[310..311]);
        let spans = [5..300, 310..311].into_iter();
        assert_eq!(quantiser.errors(&samples, &codes, spans), expected);
    }

    #[test]
    fn extremes_hold() {
        assert_laws(&[f32::MIN, -1.0, 0.0, 1.0, f32::MAX]); // the range overflows f32
        assert_laws(&[f64::MIN, 0.0, 1e300, f64::MAX]); // the range overflows f64
        assert_laws(&[0.0, f32::from_bits(1), f32::from_bits(100)]); // denormal range
        assert_laws(&[0.0, f64::from_bits(1), f64::from_bits(1000)]);
        assert_laws(&[1e30_f32, 1e-30, 0.0, -0.0]);
        assert_laws(&[i16::MIN, -1, 0, i16::MAX]);
        assert_laws(&[0, 1, u32::MAX - 1, u32::MAX]);
        assert_laws(&[i32::MIN, 0, (1 << 24) + 1, i32::MAX]);
    }

    #[test]
    fn not_a_number_becomes_the_minimum_and_infinities_clamp() {
        let samples = [2.0_f32, f32::NAN, 4.0, f32::INFINITY, f32::NEG_INFINITY];
        assert_eq!(round_trip(&samples), [2.0, 2.0, 4.0, 4.0, 2.0]);
    }

    #[test]
    fn a_range_of_up_to_255_integers_is_lossless() {
        for range in [1_u16, 2, 100, 254, 255] {
            let samples: Vec<u16> = (0..=range).map(|i| 40_000 + i).collect();
            assert_eq!(round_trip(&samples), samples);
        }
    }
}
