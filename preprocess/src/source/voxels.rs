//! Voxels as a file stores them, and their way to the type that a reader gets.

use octree_store::{Sample, SampleType, with_sample_type};

/// How a file stores its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoredFormat {
    /// The type in the file.
    pub stored: SampleType,
    /// Whether the most significant byte comes first.
    pub big_endian: bool,
    /// Real value = stored * slope + intercept; the samples then become f32.
    pub scaling: Option<(f64, f64)>,
}

impl StoredFormat {
    /// The type that a reader gets: the stored one, or f32 where values are scaled.
    pub fn sample_type(&self) -> SampleType {
        if self.scaling.is_some() { SampleType::F32 } else { self.stored }
    }

    /// Whether stored bytes are little-endian samples already, so that nothing is left to be done.
    pub(crate) fn is_plain(&self) -> bool {
        self.scaling.is_none() && (!self.big_endian || self.stored.bytes() == 1)
    }

    /// Turns stored bytes into samples; `bytes` holds `out.len()` stored samples.
    ///
    /// # Panics
    /// When `T` is not [`StoredFormat::sample_type`].
    #[inline(always)]
    pub fn read_into<T: Sample>(&self, bytes: &[u8], out: &mut [T]) {
        assert_eq!(T::TYPE, self.sample_type());
        if let Some((slope, intercept)) = self.scaling {
            with_sample_type!(self.stored, S => {
                self.each::<S, T>(bytes, out, |v| T::from_f64(v.to_f64() * slope + intercept));
            });
        } else {
            self.each::<T, T>(bytes, out, |v| v);
        }
    }

    #[inline(always)]
    fn each<S: Sample, T: Sample>(&self, bytes: &[u8], out: &mut [T], value: impl Fn(S) -> T) {
        // As many as there are samples: where the compiler knows their number, it knows this too.
        let stored = bytes[..size_of::<S>() * out.len()].chunks_exact(size_of::<S>());
        if self.big_endian {
            for (out, bytes) in out.iter_mut().zip(stored) {
                *out = value(S::from_be_slice(bytes));
            }
        } else {
            for (out, bytes) in out.iter_mut().zip(stored) {
                *out = value(S::from_le_slice(bytes));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_byte_orders_give_the_same_samples() {
        let little = StoredFormat { stored: SampleType::I16, big_endian: false, scaling: None };
        let big = StoredFormat { big_endian: true, ..little };
        let mut samples = [0_i16; 2];
        little.read_into(&[0x34, 0x12, 0xfe, 0xff], &mut samples);
        assert_eq!(samples, [0x1234, -2]);
        big.read_into(&[0x12, 0x34, 0xff, 0xfe], &mut samples);
        assert_eq!(samples, [0x1234, -2]);
    }

    #[test]
    fn scaled_values_are_real_ones() {
        let format =
            StoredFormat { stored: SampleType::U8, big_endian: false, scaling: Some((0.5, -10.0)) };
        assert_eq!(format.sample_type(), SampleType::F32);
        let mut samples = [0_f32; 3];
        format.read_into(&[0, 1, 255], &mut samples);
        assert_eq!(samples, [-10.0, -9.5, 117.5]);
    }
}
