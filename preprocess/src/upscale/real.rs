//! The two types that voxels are computed in: f32 for 8- and 16-bit integers and f32, f64 for the
//! wider types, which f32 would round to 24 bits.

use octree_store::Sample;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// A type to compute in.
pub(super) trait Real:
    Copy
    + Default
    + PartialOrd
    + Debug
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + AddAssign
    + 'static
{
    /// A sample's value; exact for the types that are computed in this one.
    fn of<T: Sample>(sample: T) -> Self;
    /// The nearest value.
    fn near(value: f64) -> Self;
    /// The value, exactly.
    fn wide(self) -> f64;
    /// The value of an f32, exactly.
    fn of_f32(value: f32) -> Self;
    /// The nearest whole number, halves to the even one; for what a kernel makes of integers.
    fn round(self) -> Self;
    /// The absolute value.
    fn abs(self) -> Self;
    /// The sample of this value: for integers a whole one within the type's range.
    fn sample<T: Sample>(self) -> T;
    /// Whether it is neither NaN nor infinite.
    fn finite(self) -> bool;
}

/// Adding 1.5 * 2^23 to a small f32 leaves its whole part, in two's complement, in the low bits.
const WHOLE_F32: f32 = 12_582_912.0;
/// 1.5 * 2^52: the same for f64.
const WHOLE_F64: f64 = 6_755_399_441_055_744.0;

impl Real for f32 {
    #[inline(always)]
    fn of<T: Sample>(sample: T) -> Self {
        sample.to_f32()
    }
    #[inline(always)]
    fn near(value: f64) -> Self {
        value as Self
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn of_f32(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn round(self) -> Self {
        (self + WHOLE_F32) - WHOLE_F32
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn sample<T: Sample>(self) -> T {
        if T::TYPE.is_integer() {
            let whole = (self + WHOLE_F32).to_bits().wrapping_sub(WHOLE_F32.to_bits());
            T::from_i32(whole.cast_signed())
        } else {
            T::from_f64(f64::from(self))
        }
    }
    #[inline(always)]
    fn finite(self) -> bool {
        self.is_finite()
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of<T: Sample>(sample: T) -> Self {
        sample.to_f64()
    }
    #[inline(always)]
    fn near(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
    #[inline(always)]
    fn of_f32(value: f32) -> Self {
        Self::from(value)
    }
    #[inline(always)]
    fn round(self) -> Self {
        (self + WHOLE_F64) - WHOLE_F64
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn sample<T: Sample>(self) -> T {
        T::from_f64(self)
    }
    #[inline(always)]
    fn finite(self) -> bool {
        self.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_half_to_even_for_all_that_a_kernel_makes_of_integers() {
        for quarter in -400_000_i32..400_000 {
            let v = quarter as f32 / 4.0;
            assert_eq!(Real::round(v), v.round_ties_even(), "{v}");
            assert_eq!(Real::round(f64::from(v)), f64::from(v).round_ties_even());
        }
        for v in [-1.5e10_f64, 1.5e10, 4_294_967_295.5, -2_147_483_648.5] {
            assert_eq!(Real::round(v), v.round_ties_even());
        }
        for v in [-32_768_i16, -1, 0, 1, 32_767] {
            assert_eq!(f32::of(v).sample::<i16>(), v);
        }
        assert_eq!(65_535.0_f32.sample::<u16>(), 65_535);
    }
}
