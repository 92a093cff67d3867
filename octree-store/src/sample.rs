//! The sample types a volume can have, as a trait for kernels and an enum for everything else.

use bytemuck::Pod;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The type of a volume's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SampleType {
    /// Unsigned 8-bit integer.
    U8,
    /// Signed 8-bit integer.
    I8,
    /// Unsigned 16-bit integer.
    U16,
    /// Signed 16-bit integer.
    I16,
    /// Unsigned 32-bit integer.
    U32,
    /// Signed 32-bit integer.
    I32,
    /// IEEE 754 single precision.
    F32,
    /// IEEE 754 double precision.
    F64,
}

impl SampleType {
    /// All of them.
    pub const ALL: [Self; 8] =
        [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::F32, Self::F64];

    /// Bytes of one sample.
    pub fn bytes(self) -> usize {
        crate::with_sample_type!(self, T => size_of::<T>())
    }

    /// Whether samples are integers.
    pub fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The name used on the command line and in JSON: `u8`, `i8`, … `f64`.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// The least and the greatest finite value.
    pub fn limits(self) -> (f64, f64) {
        crate::with_sample_type!(self, T => (T::LEAST.to_f64(), T::GREATEST.to_f64()))
    }
}

impl fmt::Display for SampleType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SampleType {
    type Err = String;

    /// Takes the short names (`u16`) and the long ones that raw files carry (`uint16`, `float32`).
    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text.to_ascii_lowercase().as_str() {
            "u8" | "uint8" => Self::U8,
            "i8" | "int8" => Self::I8,
            "u16" | "uint16" => Self::U16,
            "i16" | "int16" => Self::I16,
            "u32" | "uint32" => Self::U32,
            "i32" | "int32" => Self::I32,
            "f32" | "float32" | "float" => Self::F32,
            "f64" | "float64" | "double" => Self::F64,
            _ => {
                return Err(format!(
                    "unknown sample type '{text}': use one of u8, i8, u16, i16, u32, i32, f32, f64"
                ));
            }
        })
    }
}

/// Runs an expression with a name standing for the Rust type of a [`SampleType`].
///
/// ```
/// use octree_store::{SampleType, with_sample_type};
/// let bytes = with_sample_type!(SampleType::U16, T => size_of::<T>());
/// assert_eq!(bytes, 2);
/// ```
#[macro_export]
macro_rules! with_sample_type {
    ($sample_type:expr, $name:ident => $body:expr) => {
        $crate::with_sample_type!(@arms $sample_type, $name, $body,
            U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32, F64 f64)
    };
    (@arms $sample_type:expr, $name:ident, $body:expr, $($variant:ident $type:ty),*) => {
        match $sample_type {
            $($crate::SampleType::$variant => {
                type $name = $type;
                $body
            })*
        }
    };
}

mod sealed {
    pub trait Sealed {}
}

/// A scalar that bricks can be made of. Sealed: FORMAT.md names the eight types.
pub trait Sample:
    Pod + PartialOrd + Send + Sync + fmt::Debug + fmt::Display + Default + sealed::Sealed + 'static
{
    /// The type's name as a value.
    const TYPE: SampleType;
    /// The least finite value.
    const LEAST: Self;
    /// The greatest finite value.
    const GREATEST: Self;
    /// Whether the f32 kernels are exact enough: integers of 8 and 16 bits, and f32 itself.
    const FITS_F32: bool;
    /// The sample's bytes, little-endian.
    type Bytes: AsRef<[u8]> + AsMut<[u8]> + Default;

    /// The value as f64; exact for every type.
    fn to_f64(self) -> f64;
    /// The value as f32; exact where [`Sample::FITS_F32`].
    fn to_f32(self) -> f32;
    /// The value as i32; exact for integers of 8 and 16 bits.
    fn to_i32(self) -> i32;
    /// The value of this type; exact where it fits.
    fn from_i32(value: i32) -> Self;
    /// The nearest value of this type: integers round half to even and clamp, NaN becomes 0.
    fn from_f64(value: f64) -> Self;
    /// False for NaN and infinities only.
    fn is_finite(self) -> bool;
    /// True for NaN only.
    fn is_nan(self) -> bool;
    /// Whether the bits are equal: tells 0.0 from -0.0 and one NaN from another.
    fn same_bits(self, other: Self) -> bool;
    /// The sample of these little-endian bytes.
    fn from_le_slice(bytes: &[u8]) -> Self;
    /// The sample of these big-endian bytes.
    fn from_be_slice(bytes: &[u8]) -> Self;
    /// The sample's little-endian bytes.
    fn to_le_array(self) -> Self::Bytes;
    /// The buffer of this type inside a [`SampleBuffer`].
    fn wrap(samples: Vec<Self>) -> SampleBuffer;
    /// The samples inside a buffer of this type.
    fn unwrap(buffer: &SampleBuffer) -> Option<&[Self]>;
}

macro_rules! samples {
    ($($variant:ident $type:ident $fits_f32:literal $finite:expr, $nan:expr;)*) => {
        $(
            impl sealed::Sealed for $type {}
            #[allow(
                clippy::cast_lossless, clippy::unnecessary_cast, trivial_numeric_casts,
                reason = "one text for eight types: for some the cast is infallible or no cast"
            )]
            impl Sample for $type {
                const TYPE: SampleType = SampleType::$variant;
                const LEAST: Self = $type::MIN;
                const GREATEST: Self = $type::MAX;
                const FITS_F32: bool = $fits_f32;
                type Bytes = [u8; size_of::<$type>()];

                #[inline(always)]
                fn to_f64(self) -> f64 { self as f64 }
                #[inline(always)]
                fn to_f32(self) -> f32 { self as f32 }
                #[inline(always)]
                fn to_i32(self) -> i32 { self as i32 }
                #[inline(always)]
                fn from_i32(value: i32) -> Self { value as $type }
                #[inline(always)]
                fn from_f64(value: f64) -> Self {
                    if Self::TYPE.is_integer() { value.round_ties_even() as $type } else { value as $type }
                }
                #[inline(always)]
                fn is_finite(self) -> bool { $finite(self) }
                #[inline(always)]
                fn is_nan(self) -> bool { $nan(self) }
                #[inline(always)]
                fn same_bits(self, other: Self) -> bool { self.to_le_bytes() == other.to_le_bytes() }
                #[inline(always)]
                fn from_le_slice(bytes: &[u8]) -> Self {
                    let mut array = Self::Bytes::default();
                    array.copy_from_slice(bytes);
                    $type::from_le_bytes(array)
                }
                #[inline(always)]
                fn from_be_slice(bytes: &[u8]) -> Self {
                    let mut array = Self::Bytes::default();
                    array.copy_from_slice(bytes);
                    $type::from_be_bytes(array)
                }
                #[inline(always)]
                fn to_le_array(self) -> Self::Bytes { self.to_le_bytes() }
                fn wrap(samples: Vec<Self>) -> SampleBuffer { SampleBuffer::$variant(samples) }
                fn unwrap(buffer: &SampleBuffer) -> Option<&[Self]> {
                    if let SampleBuffer::$variant(samples) = buffer { Some(samples) } else { None }
                }
            }
        )*

        /// Owned samples of a type known only at run time; x fastest wherever they fill a box.
        #[derive(Debug, Clone, PartialEq)]
        pub enum SampleBuffer {
            $(
                #[doc = concat!("Samples of type `", stringify!($type), "`.")]
                $variant(Vec<$type>),
            )*
        }

        impl SampleBuffer {
            /// The type of the samples.
            pub fn sample_type(&self) -> SampleType {
                match self { $(Self::$variant(_) => SampleType::$variant,)* }
            }
            /// How many samples there are.
            pub fn len(&self) -> usize {
                match self { $(Self::$variant(samples) => samples.len(),)* }
            }
            /// Sample `index` as f64, exactly.
            pub fn get_f64(&self, index: usize) -> f64 {
                match self { $(Self::$variant(samples) => samples[index].to_f64(),)* }
            }
            /// The samples' little-endian bytes.
            pub fn to_le_bytes(&self) -> Vec<u8> {
                match self { $(Self::$variant(samples) => to_le_bytes(samples),)* }
            }
        }
    };
}

impl SampleBuffer {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

samples! {
    U8 u8 true |_| true, |_| false;
    I8 i8 true |_| true, |_| false;
    U16 u16 true |_| true, |_| false;
    I16 i16 true |_| true, |_| false;
    U32 u32 false |_| true, |_| false;
    I32 i32 false |_| true, |_| false;
    F32 f32 true f32::is_finite, f32::is_nan;
    F64 f64 false f64::is_finite, f64::is_nan;
}

/// The samples' little-endian bytes, in order.
pub fn to_le_bytes<T: Sample>(samples: &[T]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(size_of_val(samples));
    for sample in samples {
        bytes.extend_from_slice(sample.to_le_array().as_ref());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_round_half_to_even_and_clamp() {
        assert_eq!(u8::from_f64(2.5), 2);
        assert_eq!(u8::from_f64(3.5), 4);
        assert_eq!(i16::from_f64(-2.5), -2);
        assert_eq!(u16::from_f64(1e9), 65535);
        assert_eq!(i8::from_f64(-1e9), -128);
        assert_eq!(u32::from_f64(f64::NAN), 0);
        assert_eq!(i32::from_f64(2_147_483_647.0), i32::MAX);
        assert_eq!(f32::from_f64(0.1), 0.1_f32);
    }

    #[test]
    fn bytes_come_back_in_both_orders() {
        for sample_type in SampleType::ALL {
            with_sample_type!(sample_type, T => {
                for value in [T::LEAST, T::GREATEST, T::from_f64(1.0)] {
                    let mut bytes = value.to_le_array();
                    assert!(T::from_le_slice(bytes.as_ref()).same_bits(value));
                    bytes.as_mut().reverse();
                    assert!(T::from_be_slice(bytes.as_ref()).same_bits(value));
                }
                assert_eq!(sample_type.name().parse(), Ok(sample_type));
                assert_eq!(sample_type.bytes(), size_of::<T>());
            });
        }
    }

    #[test]
    fn signed_zeros_differ_in_bits_alone() {
        assert!(0.0_f32 == -0.0 && !0.0_f32.same_bits(-0.0));
        assert!(f64::NAN.same_bits(f64::NAN));
    }
}
