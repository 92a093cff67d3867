//! The `max-error=E` encoding: per brick the fewest bits whose error is at most E in source units.
//!
//! Code q reads as `base + (first + q) * step`, clamped to the brick's range. Of integers the step is
//! `2 floor(E) + 1`, so that every integer is within floor(E) of a value, exactly; E = 0 keeps them all. Of
//! floats it is 2 E, less a little for rounding to the sample's type, and every sample of the brick is
//! looked at: where one is off by more than E the brick is stored lossless, as it is where codes would
//! need more than 16 bits.
//!
//! The values lie evenly in the brick's range ([`Anchor::Brick`]: the fewest codes, and no value outside
//! the range), or at the multiples of the step ([`Anchor::Lattice`]: where bricks meet they agree).
//! NaN takes code 0; infinities clamp.

mod kernels;
#[cfg(test)]
mod laws;

use super::MaxError;
use super::words::Word;
use crate::error_sum::ErrorSum;
use crate::sample::Sample;
use kernels::{Small, add_errors, decode_f64, decode_small, quantise_f64, quantise_small, worst};
use std::ops::Range;

/// Where the values of codes lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Evenly in the brick's range.
    Brick,
    /// At multiples of the step, the same in all bricks.
    Lattice,
}

/// Maps one brick's range to codes and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiser<T> {
    min: T,
    max: T,
    max_error: f64,
    base: f64,
    /// The number of code 0 on the lattice, a whole number.
    first: f64,
    step: f64,
    /// The greatest code.
    last: u16,
}

/// Whole numbers up to this are exact, and so are halves.
const EXACT: f64 = 2_251_799_813_685_248.0; // 2^51
/// Samples that are decoded at a time: a brick's longest row.
const ROW: usize = 128;

impl<T: Sample> Quantiser<T> {
    /// A quantiser for the finite range `min..=max`; `None` where it would need more than 16 bits, or
    /// cannot hold the bound.
    pub fn new(min: T, max: T, max_error: MaxError, anchor: Anchor) -> Option<Self> {
        let (low, high) = (min.to_f64(), max.to_f64());
        let integer = T::TYPE.is_integer();
        let step = if integer {
            // An error above the type's span bounds no more than the span itself.
            let span = 2_f64.powi(8 * size_of::<T>() as i32) - 1.0;
            2.0 * max_error.get().floor().min(span) + 1.0
        } else {
            // Room for rounding: a sample half way between two values is off by more than half a step
            // once these are rounded to f32 (24 bits; codes have up to 16) or f64.
            let room = if T::FITS_F32 { 1.0 / 128.0 } else { 2_f64.powi(-20) };
            2.0 * (max_error.get() * (1.0 - room)).min(f64::MAX / 8.0)
        };
        let range = high - low;
        if !(0.0..=f64::MAX).contains(&range) || step <= 0.0 {
            return None;
        }
        let (base, first, count) = match anchor {
            Anchor::Brick => {
                let count = (range / step).floor() + 1.0;
                // What the codes reach beyond the range is shared by both ends.
                let reach = (count - 1.0) * step;
                let base = if integer {
                    low - ((reach - range) / 2.0).ceil()
                } else {
                    low - (reach - range) / 2.0
                };
                (base, 0.0, count)
            }
            Anchor::Lattice => {
                let [first, last] = [low, high].map(|v| lattice::<T>(v, step));
                if first.abs().max(last.abs()) > EXACT {
                    return None;
                }
                (0.0, first, last - first + 1.0)
            }
        };
        if count > 65_536.0 {
            return None;
        }
        Some(Self {
            min,
            max,
            max_error: max_error.get(),
            base,
            first,
            step,
            last: (count - 1.0) as u16,
        })
    }

    /// Bits of a code: the fewest that hold all of them, 0 where there is one.
    pub fn bits(&self) -> u8 {
        (u16::BITS - self.last.leading_zeros()) as u8
    }

    /// The greatest code.
    pub fn last(&self) -> u16 {
        self.last
    }

    /// `(scale, offset)` such that code q reads as `scale * q + offset`, but for clamping to the range
    /// and rounding.
    pub fn value_map(&self) -> (f64, f64) {
        (self.step, self.base + self.first * self.step)
    }

    /// Writes the code of every sample.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub(crate) fn quantise<W: Word>(&self, samples: &[T], codes: &mut [W]) {
        assert_eq!(samples.len(), codes.len());
        if let Some(Small { base, step, last, .. }) = self.small_integers() {
            quantise_small(samples, base - step / 2, (1.0 / self.step) as f32, last, codes);
        } else {
            let Self { base, first, step, last, .. } = *self;
            quantise_f64(samples, [base, first, step, f64::from(last)], codes);
        }
    }

    /// Writes what a reader gets for every code; codes above the greatest read as it.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub(crate) fn decode<W: Word>(&self, codes: &[W], samples: &mut [T]) {
        assert_eq!(samples.len(), codes.len());
        if let Some(small) = self.small_integers() {
            decode_small(small, codes, samples);
        } else {
            decode_f64(*self, codes, samples);
        }
    }

    /// What a reader gets for one code: the obvious way.
    pub fn value(&self, code: u16) -> T {
        let at = self.base + (self.first + f64::from(code.min(self.last))) * self.step;
        T::from_f64(at.max(self.min.to_f64()).min(self.max.to_f64()))
    }

    /// Whether every finite sample reads as something within the bound. Integers always do.
    pub(crate) fn holds<W: Word>(&self, samples: &[T], codes: &[W]) -> bool {
        T::TYPE.is_integer() || worst(*self, samples, codes) <= self.max_error
    }

    /// Counts the errors of samples whose codes are known, over some spans of them.
    pub(crate) fn errors<W: Word>(
        &self,
        samples: &[T],
        codes: &[W],
        spans: impl Iterator<Item = Range<usize>>,
    ) -> ErrorSum {
        let mut sum = ErrorSum::default();
        let mut decoded = [T::default(); ROW];
        for span in spans {
            for (samples, codes) in samples[span.clone()].chunks(ROW).zip(codes[span].chunks(ROW)) {
                self.decode(codes, &mut decoded[..codes.len()]);
                add_errors(&mut sum, samples, &decoded[..codes.len()]);
            }
        }
        sum
    }

    /// The numbers of integers of 8 and 16 bits, which have kernels of their own.
    fn small_integers(&self) -> Option<Small> {
        let small = T::TYPE.is_integer() && size_of::<T>() <= 2;
        small.then(|| Small {
            base: (self.base + self.first * self.step) as i32,
            step: self.step as i32,
            last: i32::from(self.last),
            min: self.min.to_i32(),
            max: self.max.to_i32(),
        })
    }
}

/// The number of the lattice's value that is nearest.
fn lattice<T: Sample>(v: f64, step: f64) -> f64 {
    if T::TYPE.is_integer() {
        // The step is odd: there are no ties, and v + half the step is exact.
        ((v + (step - 1.0) / 2.0) / step).floor()
    } else {
        (v / step).round_ties_even()
    }
}
