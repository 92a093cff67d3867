//! How far what a reader gets lies from the source: RMS and AMAX as sums that can be merged.

use crate::sample::Sample;

/// Errors of a set of voxels, in source units: the sum of their squares and their largest.
///
/// RMS is the root mean square and AMAX the absolute maximum of (what a reader gets - source).
/// Voxels whose source is NaN or infinite have no error and are not counted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ErrorSum {
    /// Voxels measured.
    pub voxels: u64,
    /// Sum of the squared errors.
    pub squares: f64,
    /// Largest absolute error.
    pub amax: f64,
}

impl ErrorSum {
    /// Counts one voxel's error.
    #[inline]
    pub fn add(&mut self, error: f64) {
        self.voxels += 1;
        self.squares += error * error;
        self.amax = self.amax.max(error.abs());
    }

    /// Counts (decoded - source) of every finite source sample, in order. Squares of integers up to
    /// 16 bits are summed exactly, a call at a time.
    #[inline(always)]
    pub fn add_all<T: Sample>(&mut self, source: &[T], decoded: &[T]) {
        if T::TYPE.is_integer() && size_of::<T>() <= 2 {
            let (mut squares, mut amax) = (0_u64, 0_u32);
            for (source, decoded) in source.iter().zip(decoded) {
                let error = decoded.to_i32().abs_diff(source.to_i32());
                squares += u64::from(error) * u64::from(error);
                amax = amax.max(error);
            }
            self.voxels += source.len() as u64;
            self.squares += squares as f64;
            self.amax = self.amax.max(f64::from(amax));
        } else {
            for (source, decoded) in source.iter().zip(decoded) {
                if source.is_finite() {
                    self.add(decoded.to_f64() - source.to_f64());
                }
            }
        }
    }

    /// The root mean square error; 0 where nothing was measured.
    pub fn rms(&self) -> f64 {
        if self.voxels == 0 { 0.0 } else { (self.squares / self.voxels as f64).sqrt() }
    }

    /// Peak signal to noise ratio in dB with `peak` = value range; `None` without error or range.
    pub fn psnr_db(&self, peak: f64) -> Option<f64> {
        let rms = self.rms();
        (rms > 0.0 && peak > 0.0).then(|| 20.0 * (peak / rms).log10())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rms_and_amax_follow_their_definitions() {
        let mut sum = ErrorSum::default();
        for error in [3.0, -4.0, 0.0, 0.0] {
            sum.add(error);
        }
        assert_eq!(sum.rms(), 2.5); // sqrt((9 + 16) / 4)
        assert_eq!(sum.amax, 4.0);
        assert_eq!(sum.psnr_db(25.0), Some(20.0)); // 20 log10(25 / 2.5)
    }

    #[test]
    fn exact_and_float_sums_agree() {
        let (source, decoded) = ([0_u16, 3, 65535, 9], [1_u16, 3, 0, 7]);
        let mut exact = ErrorSum::default();
        exact.add_all(&source, &decoded);
        let mut float = ErrorSum::default();
        float.add_all(&source.map(f64::from), &decoded.map(f64::from));
        assert_eq!(exact, float);
        assert_eq!((exact.voxels, exact.amax), (4, 65535.0));
        assert_eq!(exact.squares, 1.0 + 65535.0 * 65535.0 + 4.0);
    }

    #[test]
    fn voxels_that_are_no_numbers_are_not_counted() {
        let mut sum = ErrorSum::default();
        sum.add_all(&[1.0_f32, f32::NAN, f32::INFINITY], &[2.0, 1.0, 1.0]);
        assert_eq!((sum.voxels, sum.squares), (1, 1.0));
    }

    #[test]
    fn nothing_measured_is_no_error() {
        assert_eq!(ErrorSum::default().rms(), 0.0);
        assert_eq!(ErrorSum::default().psnr_db(1.0), None);
    }
}
