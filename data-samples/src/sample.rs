//! The sample types a phantom can be written in, and the order of their bytes.

use std::fmt;

/// A sample type of a raw file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SampleType {
    /// Unsigned, 8 bits.
    U8,
    /// Unsigned, 16 bits.
    U16,
    /// IEEE 754 binary32.
    F32,
}

impl SampleType {
    /// Every type, in the order of their sizes.
    pub const ALL: [Self; 3] = [Self::U8, Self::U16, Self::F32];

    /// The name used in file names and on the command line: `u8`, `u16`, `f32`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::F32 => "f32",
        }
    }

    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    /// The smallest and the largest finite value.
    pub const fn range(self) -> (f64, f64) {
        match self {
            Self::U8 => (0.0, 255.0),
            Self::U16 => (0.0, 65535.0),
            Self::F32 => (f32::MIN as f64, f32::MAX as f64),
        }
    }
}

impl fmt::Display for SampleType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Which byte of a sample comes first in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ByteOrder {
    /// Least significant first.
    #[default]
    Little,
    /// Most significant first.
    Big,
}

/// A Rust type that a phantom can fill a buffer with: `u8`, `u16` or `f32`.
///
/// The trait is sealed; the three types are what the readers of such files understand.
pub trait Sample: Copy + Default + Send + Sync + sealed::Sealed + 'static {
    /// The same type as a value.
    const TYPE: SampleType;

    /// The nearest value of the type, halves upwards, clamped to its finite range.
    fn from_f64(value: f64) -> Self;

    /// A micro-CT value, which is a `u16` by nature: `u16` keeps it, `f32` holds the same number,
    /// `u8` keeps the high byte.
    fn from_micro_ct(value: u16) -> Self;

    /// Writes the samples' bytes to the start of `out`, in the given order, as many as fit.
    fn write_bytes(samples: &[Self], order: ByteOrder, out: &mut [u8]);
}

macro_rules! samples {
    ($($type:ident, $name:ident, $from_f64:expr, $from_micro_ct:expr;)*) => {$(
        impl sealed::Sealed for $type {}

        impl Sample for $type {
            const TYPE: SampleType = SampleType::$name;

            fn from_f64(value: f64) -> Self {
                let (min, max) = Self::TYPE.range();
                $from_f64(value.clamp(min, max))
            }

            fn from_micro_ct(value: u16) -> Self {
                $from_micro_ct(value)
            }

            fn write_bytes(samples: &[Self], order: ByteOrder, out: &mut [u8]) {
                let places = out.as_chunks_mut().0.iter_mut();
                match order {
                    ByteOrder::Little => {
                        places.zip(samples).for_each(|(place, s)| *place = s.to_le_bytes());
                    }
                    ByteOrder::Big => {
                        places.zip(samples).for_each(|(place, s)| *place = s.to_be_bytes());
                    }
                }
            }
        }
    )*};
}

samples! {
    u8, U8, |v: f64| (v + 0.5) as u8, |v: u16| (v >> 8) as u8;
    u16, U16, |v: f64| (v + 0.5) as u16, |v: u16| v;
    f32, F32, |v: f64| v as f32, f32::from;
}

mod sealed {
    pub trait Sealed {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_round_halves_up_and_clamp() {
        let cases = [(-3.0, 0), (0.49, 0), (0.5, 1), (254.5, 255), (255.4, 255), (1e9, 255)];
        for (value, expected) in cases {
            assert_eq!(u8::from_f64(value), expected, "{value}");
        }
        assert_eq!(u16::from_f64(65_535.9), 65_535);
        assert_eq!(f32::from_f64(1e300), f32::MAX);
        assert_eq!(f32::from_f64(0.1), 0.1_f32);
    }

    #[test]
    fn a_micro_ct_value_keeps_its_high_byte_in_u8() {
        assert_eq!(u8::from_micro_ct(0xABCD), 0xAB);
        assert_eq!(u16::from_micro_ct(0xABCD), 0xABCD);
        assert_eq!(f32::from_micro_ct(0xABCD), 43_981.0);
    }

    #[test]
    fn bytes_come_in_the_order_asked_for() {
        let mut bytes = [0; 4];
        u16::write_bytes(&[0x0102, 0x0304], ByteOrder::Little, &mut bytes);
        assert_eq!(bytes, [2, 1, 4, 3]);
        u16::write_bytes(&[0x0102, 0x0304], ByteOrder::Big, &mut bytes);
        assert_eq!(bytes, [1, 2, 3, 4]);
        f32::write_bytes(&[1.0], ByteOrder::Big, &mut bytes);
        assert_eq!(bytes, [0x3F, 0x80, 0, 0]);
    }
}
