//! How far what a reader gets lies from the source: RMS and AMAX as sums that can be merged.

use crate::exact_sum::ExactSum;
use crate::sample::Sample;

/// Errors of a set of voxels, in source units: the sum of their squares and their largest.
///
/// RMS is the root mean square and AMAX the absolute maximum of (what a reader gets - source).
/// Voxels whose source is NaN or infinite have no error and are not counted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ErrorSum {
    /// Voxels measured.
    pub voxels: u64,
    /// Sum of the squared errors. Of the errors x 2^-600 where AMAX is above 2^500, and x 2^600 where
    /// it is below 2^-450: their squares would overflow or vanish otherwise.
    pub squares: f64,
    /// Largest absolute error.
    pub amax: f64,
}

/// What errors are multiplied by before they are squared: a power of two that follows from the largest.
#[inline]
pub(crate) fn scale(amax: f64) -> f64 {
    const HUGE: f64 = power_of_two(500);
    const TINY: f64 = power_of_two(-450);
    if amax > HUGE {
        const { power_of_two(-600) }
    } else if amax < TINY {
        const { power_of_two(600) }
    } else {
        1.0
    }
}

const fn power_of_two(exponent: i64) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

impl ErrorSum {
    /// Counts one voxel's error.
    #[inline]
    pub fn add(&mut self, error: f64) {
        // The difference of the widest values overflows.
        let error = error.clamp(f64::MIN, f64::MAX);
        self.voxels += 1;
        let amax = self.amax.max(error.abs());
        self.squares = self.squares_in_scale_of(amax);
        self.amax = amax;
        let scaled = error * scale(amax);
        self.squares += scaled * scaled;
    }

    /// `squares` in the scale of a sum whose AMAX is `amax`, which is not below this one's.
    #[inline]
    pub(crate) fn squares_in_scale_of(&self, amax: f64) -> f64 {
        let ratio = scale(amax) / scale(self.amax);
        // Twice, because the square of the ratio underflows.
        if ratio == 1.0 { self.squares } else { self.squares * ratio * ratio }
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

    /// What stands for so many voxels of which the RMS alone is known.
    pub(crate) fn of_rms(voxels: u64, rms: f64) -> Self {
        let scaled = rms * scale(rms);
        Self { voxels, squares: voxels as f64 * (scaled * scaled), amax: rms }
    }

    /// The sum of the squared errors in source units; infinite where f64 cannot hold it.
    pub fn energy(&self) -> f64 {
        let scale = scale(self.amax);
        self.squares / scale / scale
    }

    /// The root mean square error; 0 where nothing was measured.
    pub fn rms(&self) -> f64 {
        if self.voxels == 0 {
            return 0.0;
        }
        ((self.squares / self.voxels as f64).sqrt() / scale(self.amax)).min(f64::MAX)
    }

    /// Peak signal to noise ratio in dB with `peak` = value range; `None` without error or range.
    pub fn psnr_db(&self, peak: f64) -> Option<f64> {
        let rms = self.rms();
        (rms > 0.0 && peak > 0.0).then(|| 20.0 * (peak / rms).log10())
    }
}

/// Errors of many bricks, summed apart for each scale of the squares, and exactly: neither order nor
/// grouping matters.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ErrorTotal {
    voxels: u64,
    tiny: Part,
    plain: Part,
    huge: Part,
}

/// Bricks of one scale.
#[derive(Debug, Clone, Default, PartialEq)]
struct Part {
    squares: ExactSum,
    amax: f64,
}

impl ErrorTotal {
    /// Adds a brick's errors.
    pub fn add(&mut self, error: &ErrorSum) {
        self.voxels += error.voxels;
        let part = match scale(error.amax) {
            up if up > 1.0 => &mut self.tiny,
            down if down < 1.0 => &mut self.huge,
            _ => &mut self.plain,
        };
        part.squares.add(error.squares);
        part.amax = part.amax.max(error.amax);
    }

    /// Adds the errors of other bricks.
    pub fn merge(&mut self, other: &Self) {
        self.voxels += other.voxels;
        for (part, other) in [
            (&mut self.tiny, &other.tiny),
            (&mut self.plain, &other.plain),
            (&mut self.huge, &other.huge),
        ] {
            part.squares.merge(&other.squares);
            part.amax = part.amax.max(other.amax);
        }
    }

    /// The errors of all bricks.
    pub fn total(&self) -> ErrorSum {
        let Self { voxels, tiny, plain, huge } = self;
        let amax = tiny.amax.max(plain.amax).max(huge.amax);
        let squares = [tiny, plain, huge].map(|part| {
            let part = ErrorSum { voxels: 0, squares: part.squares.value(), amax: part.amax };
            part.squares_in_scale_of(amax)
        });
        ErrorSum { voxels: *voxels, squares: squares.into_iter().sum(), amax }
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
    fn an_error_that_overflows_is_the_greatest_there_is() {
        let mut sum = ErrorSum::default();
        sum.add_all(&[f64::MAX, f64::MIN], &[f64::MIN, f64::MAX]);
        assert_eq!((sum.voxels, sum.amax, sum.rms()), (2, f64::MAX, f64::MAX));
        let mut total = ErrorTotal::default();
        total.add(&sum);
        assert_eq!(total.total(), sum);
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
    fn errors_whose_squares_overflow_or_vanish_have_an_rms() {
        let mut sum = ErrorSum::default();
        // One after the other: below 2^-450, within, and above 2^500, then just above where it changes.
        let at_the_edges = [1.1 * 2_f64.powi(498), 1.1 * 2_f64.powi(-452)];
        for unit in [1e-250, 1.0, 1e200, 2_f64.powi(499)].into_iter().chain(at_the_edges) {
            for order in [[3.0, 4.0], [4.0, 3.0]] {
                let mut sum = ErrorSum::default();
                for error in order {
                    sum.add(error * unit);
                }
                assert!((sum.rms() / (unit * 12.5_f64.sqrt()) - 1.0).abs() < 1e-15, "{unit}");
                assert_eq!(sum.amax, 4.0 * unit);
            }
        }
        for error in [1e-250, 1.0, 3e200, -4e200, 0.0, 0.0] {
            sum.add(error);
        }
        assert!((sum.rms() / (5e200 / 6_f64.sqrt()) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_total_over_bricks_of_every_scale_is_that_of_all_voxels() {
        for unit in [1e-250, 1.0, 2_f64.powi(499), 1e200] {
            let mut total = ErrorTotal::default();
            for errors in [[3.0, 1.0], [4.0, 0.0], [0.0, 0.0]] {
                let mut brick = ErrorSum::default();
                for error in errors {
                    brick.add(error * unit);
                }
                total.add(&brick);
            }
            let total = total.total();
            assert!((total.rms() / (unit * (26.0_f64 / 6.0).sqrt()) - 1.0).abs() < 1e-15, "{unit}");
            assert_eq!((total.voxels, total.amax), (6, 4.0 * unit));
        }
    }

    #[test]
    fn totals_can_be_merged_in_any_grouping() {
        let brick = |errors: &[f64]| {
            let mut brick = ErrorSum::default();
            for error in errors {
                brick.add(*error);
            }
            brick
        };
        // Squares of every scale whose plain sum would depend on the order.
        let bricks =
            [&[1e-250, 3e-240][..], &[0.1], &[1e15, 0.3], &[1e200], &[7e8], &[]].map(brick);
        let mut whole = ErrorTotal::default();
        for brick in &bricks {
            whole.add(brick);
        }
        for cut in 0..bricks.len() {
            let (mut left, mut right) = (ErrorTotal::default(), ErrorTotal::default());
            for brick in bricks[..cut].iter().rev() {
                left.add(brick);
            }
            for brick in bricks[cut..].iter().rev() {
                right.add(brick);
            }
            right.merge(&left);
            assert_eq!(right, whole);
            assert_eq!(right.total(), whole.total());
        }
    }

    #[test]
    fn a_known_rms_of_many_voxels_stands_for_them() {
        for unit in [1e-250, 1.0, 1e200] {
            let mut total = ErrorTotal::default();
            total.add(&ErrorSum::of_rms(3, 2.0 * unit));
            total.add(&ErrorSum::of_rms(1, 4.0 * unit));
            let expected = 7_f64.sqrt() * unit; // (3 x 4 + 16) / 4
            assert!((total.total().rms() / expected - 1.0).abs() < 1e-15, "{unit}");
        }
    }

    #[test]
    fn energy_is_the_sum_of_squares_in_source_units() {
        let of = |errors: [f64; 2]| {
            let mut sum = ErrorSum::default();
            for error in errors {
                sum.add(error);
            }
            sum.energy()
        };
        assert_eq!(of([3.0, 4.0]), 25.0);
        assert_eq!(of([2_f64.powi(-460), 0.0]), 2_f64.powi(-920));
        assert_eq!(of([2_f64.powi(505), 0.0]), 2_f64.powi(1010));
        assert_eq!(of([1e300, 0.0]), f64::INFINITY);
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
