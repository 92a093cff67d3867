//! What is said of the source's values: range, mean, and how many are no numbers.

use crate::downsample::Core;
use multiversion::multiversion;
use octree_store::{CompensatedSum, ExactSum, Sample};
use serde::{Deserialize, Serialize};

/// Values of the in-volume core voxels of one brick.
#[derive(Debug, Clone, Default)]
pub(crate) struct BrickValues {
    finite: u64,
    sum: ExactSum,
    nan: u64,
    infinite: u64,
    min_max: Option<(f64, f64)>,
}

impl BrickValues {
    /// Measures a brick before anything is done to it; `range` is the finite range of all its
    /// samples, whose overlap are voxels of the volume too.
    pub(crate) fn of<T: Sample>(brick: &[T], core: &Core, range: Option<(T, T)>) -> Self {
        let mut values = sums(brick, core);
        values.min_max = range.map(|(min, max)| (min.to_f64(), max.to_f64()));
        values
    }

    /// Voxels that were measured.
    pub(crate) fn voxels(&self) -> u64 {
        self.finite + self.nan + self.infinite
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn sums<T: Sample>(brick: &[T], core: &Core) -> BrickValues {
    let mut values = BrickValues::default();
    if T::TYPE.is_integer() {
        // At most 2^21 values below 2^32 in magnitude: exact in i64 and in f64.
        let mut sum = 0_i64;
        if size_of::<T>() <= 2 {
            sum = sum_of_small(brick, core);
        } else {
            for row in core.rows() {
                for v in &brick[row] {
                    sum += v.to_f64() as i64;
                }
            }
        }
        values.finite = core.extent.iter().map(|&n| n as u64).product();
        values.sum.add(sum as f64);
    } else {
        let mut sum = CompensatedSum::default();
        for v in core.rows().flat_map(|row| &brick[row]) {
            values.nan += u64::from(v.is_nan());
            values.infinite += u64::from(!v.is_finite() && !v.is_nan());
            if v.is_finite() {
                values.finite += 1;
                sum.add(v.to_f64());
            }
        }
        values.sum = match sum.to_parts() {
            [sum, error] if sum.is_finite() && error.is_finite() => {
                [sum, error].into_iter().collect()
            }
            // Voxel by voxel where f64 cannot hold the sum.
            _ => {
                let voxels = core.rows().flat_map(|row| &brick[row]);
                voxels.map(|v| v.to_f64()).filter(|v| v.is_finite()).collect()
            }
        };
    }
    values
}

/// The sum of integers up to 16 bits: a slice at a time in as many sums as a vector has lanes.
#[inline(always)]
fn sum_of_small<T: Sample>(brick: &[T], core: &Core) -> i64 {
    let mut sum = 0;
    for z in 0..core.extent[2] {
        // At most 128 rows of 4 or fewer values each.
        let mut lanes = [0_i32; 32];
        for y in 0..core.extent[1] {
            let (rows, rest) = brick[core.row(y, z)].as_chunks::<32>();
            for row in rows {
                for (lane, v) in lanes.iter_mut().zip(row) {
                    *lane += v.to_i32();
                }
            }
            for (lane, v) in lanes.iter_mut().zip(rest) {
                *lane += v.to_i32();
            }
        }
        for lane in lanes {
            sum += i64::from(lane);
        }
    }
    sum
}

/// Values of a volume, brick by brick, in any order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct VolumeValues {
    finite: u64,
    sum: ExactSum,
    /// Voxels that are NaN.
    pub(crate) nan: u64,
    /// Voxels that are infinite.
    pub(crate) infinite: u64,
    /// Least and greatest finite voxel.
    pub(crate) min_max: Option<(f64, f64)>,
}

impl VolumeValues {
    /// Adds a brick.
    pub(crate) fn add(&mut self, brick: &BrickValues) {
        self.finite += brick.finite;
        self.sum.merge(&brick.sum);
        self.nan += brick.nan;
        self.infinite += brick.infinite;
        self.min_max = match (self.min_max, brick.min_max) {
            (Some((a, b)), Some((c, d))) => Some((a.min(c), b.max(d))),
            (one, other) => one.or(other),
        };
    }

    /// The mean of the finite voxels.
    pub(crate) fn mean(&self) -> Option<f64> {
        self.sum.mean(self.finite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use octree_store::encoding::finite_range;

    fn values<T: Sample>(brick: &[T]) -> VolumeValues {
        let core = Core { side: brick.len(), overlap: 0, extent: [brick.len(), 1, 1] };
        let mut volume = VolumeValues::default();
        volume.add(&BrickValues::of(brick, &core, finite_range(brick)));
        volume
    }

    #[test]
    fn ranges_and_means_follow_their_definitions() {
        let volume = values(&[i16::MIN, 0, i16::MAX]);
        assert_eq!(volume.min_max, Some((-32768.0, 32767.0)));
        assert_eq!(volume.mean(), Some(-1.0 / 3.0));
        assert_eq!(values(&[u32::MAX; 100]).mean(), Some(f64::from(u32::MAX)));
    }

    #[test]
    fn sums_of_small_integers_are_those_of_a_plain_loop() {
        fn check<T: Sample>(extent: [usize; 3]) {
            let core = Core { side: 74, overlap: 2, extent };
            let at = |i: u64| i.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(20).to_le_bytes();
            let brick: Vec<T> =
                (0..74 * 74 * 74).map(|i| T::from_le_slice(&at(i)[..size_of::<T>()])).collect();
            let plain: f64 = core.rows().flat_map(|row| &brick[row]).map(|v| v.to_f64()).sum();
            let values = BrickValues::of(&brick, &core, None);
            assert_eq!(
                (values.sum.value(), values.finite),
                (plain, core.rows().flatten().count() as u64)
            );
        }
        for extent in [[70, 70, 70], [32, 32, 32], [31, 1, 5], [1, 7, 1], [64, 3, 2]] {
            check::<u8>(extent);
            check::<i8>(extent);
            check::<u16>(extent);
            check::<i16>(extent);
            check::<u32>(extent);
        }
        let core = Core { side: 128, overlap: 0, extent: [128; 3] };
        let values = BrickValues::of(&vec![i16::MIN; 1 << 21], &core, None);
        assert_eq!(values.sum.value(), -32768.0 * f64::from(1 << 21));
    }

    #[test]
    fn a_brick_whose_sum_overflows_has_a_mean() {
        assert_eq!(values(&[f64::MAX; 100]).mean(), Some(f64::MAX));
        assert_eq!(values(&[f64::MAX, f64::MAX, f64::MIN, f64::MIN, 5.0]).mean(), Some(1.0));
    }

    #[test]
    fn the_order_of_bricks_does_not_matter() {
        let core = Core { side: 2, overlap: 0, extent: [2, 1, 1] };
        let bricks = [[0.1, 1e300], [-1e300, 7.0], [1e-300, f64::NAN]]
            .map(|brick| BrickValues::of(&brick, &core, finite_range(&brick)));
        let of = |order: [usize; 3]| {
            let mut volume = VolumeValues::default();
            for brick in order {
                volume.add(&bricks[brick]);
            }
            volume
        };
        assert_eq!(of([0, 1, 2]), of([2, 1, 0]));
        assert_eq!(of([0, 1, 2]), of([1, 2, 0]));
        assert_eq!(of([0, 1, 2]).mean(), Some(7.1 / 5.0));
    }

    #[test]
    fn what_is_no_number_is_counted_apart() {
        let volume = values(&[1.0, f32::NAN, 3.0, f32::INFINITY, f32::NEG_INFINITY]);
        assert_eq!((volume.nan, volume.infinite), (1, 2));
        assert_eq!((volume.min_max, volume.mean()), (Some((1.0, 3.0)), Some(2.0)));
        let nothing = values(&[f64::NAN; 3]);
        assert_eq!((nothing.min_max, nothing.mean()), (None, None));
    }
}
