//! Enlarged volumes: the tricubic kernel against 64 taps in f64, and what must hold of any such kernel.

use crate::support::{bits, index, scan, voxels};
use octree_store::{Sample, SampleType, with_sample_type};
use preprocess::{CubicKernel, Source, SourceOptions, Upscale};
use proptest::prelude::*;
use std::path::Path;

/// The enlargement without detail.
pub(crate) fn plain(factor: u32, kernel: CubicKernel) -> Upscale {
    Upscale::new(factor, kernel, None).unwrap()
}

/// Writes voxels into a raw file.
pub(crate) fn raw<T: Sample>(folder: &Path, dims: [u64; 3], voxels: &[T]) -> Source {
    let [x, y, z] = dims;
    let path = folder.join(format!("a_{x}x{y}x{z}_{}.raw", T::TYPE));
    std::fs::write(&path, octree_store::to_le_bytes(voxels)).unwrap();
    Source::open(path, &SourceOptions::default()).unwrap()
}

/// All voxels of a source, x fastest.
pub(crate) fn all<T: Sample>(source: &Source) -> Vec<T> {
    let [width, height, depth] = source.dims_xyz;
    let mut voxels = vec![T::default(); (width * height * depth) as usize];
    let mut slices = source.slices().unwrap();
    for slice in voxels.chunks_exact_mut((width * height) as usize) {
        slices.next(slice).unwrap();
    }
    voxels
}

/// The voxels enlarged, and how many were clamped.
pub(crate) fn enlarged_counting<T: Sample>(
    dims: [u64; 3],
    voxels: &[T],
    upscale: Upscale,
) -> (Vec<T>, u64) {
    let folder = tempfile::tempdir().unwrap();
    let source = raw(folder.path(), dims, voxels).upscale(upscale).unwrap();
    let new = all(&source);
    (new, source.clamped_voxels().unwrap())
}

/// The voxels enlarged.
pub(crate) fn enlarged<T: Sample>(dims: [u64; 3], voxels: &[T], upscale: Upscale) -> Vec<T> {
    enlarged_counting(dims, voxels, upscale).0
}

pub(crate) fn times(dims: [u64; 3], factor: u32) -> [u64; 3] {
    dims.map(|n| n * u64::from(factor))
}

/// The kernels as textbooks have them, each for itself.
fn textbook(kernel: CubicKernel, distance: f64) -> f64 {
    let x = distance.abs();
    match (kernel, x < 1.0, x < 2.0) {
        (_, _, false) => 0.0,
        (CubicKernel::CatmullRom, true, _) => 1.5 * x * x * x - 2.5 * x * x + 1.0,
        (CubicKernel::CatmullRom, ..) => -0.5 * x * x * x + 2.5 * x * x - 4.0 * x + 2.0,
        (CubicKernel::BSpline, true, _) => x * x * x / 2.0 - x * x + 2.0 / 3.0,
        (CubicKernel::BSpline, ..) => (2.0 - x) * (2.0 - x) * (2.0 - x) / 6.0,
        (CubicKernel::Mitchell, true, _) => (21.0 * x * x * x - 36.0 * x * x + 16.0) / 18.0,
        (CubicKernel::Mitchell, ..) => (-7.0 * x * x * x + 36.0 * x * x - 60.0 * x + 32.0) / 18.0,
    }
}

/// The slow twin: what the 64 source voxels around a new one weigh together, or those of them that the
/// kernel reaches, the greatest absolute value among them, and whether all are equal.
pub(crate) fn twin<T: Sample>(
    dims: [u64; 3],
    voxels: &[T],
    factor: u32,
    kernel: CubicKernel,
    at: [u64; 3],
) -> (f64, f64, bool) {
    let place = at.map(|o| (o as f64 + 0.5) / f64::from(factor) - 0.5);
    let (mut sum, mut greatest, mut same) = (0.0, 0.0_f64, true);
    let first = place.map(|v| v.floor() as i64 - 1);
    let value_at = |tap: [i64; 3]| {
        let inside = [0, 1, 2].map(|axis| tap[axis].clamp(0, dims[axis] as i64 - 1) as u64);
        voxels[index(dims, inside)].to_f64()
    };
    for tap in 0..64 {
        let tap = [first[0] + tap % 4, first[1] + tap / 4 % 4, first[2] + tap / 16];
        let distances = [0, 1, 2].map(|axis| place[axis] - tap[axis] as f64);
        if distances.iter().any(|distance| distance.abs() >= 2.0) {
            continue;
        }
        let weight: f64 = distances.iter().map(|distance| textbook(kernel, *distance)).product();
        let value = value_at(tap);
        sum += weight * value;
        greatest = greatest.max(value.abs());
        same &= value == value_at(first);
    }
    (sum, greatest, same)
}

fn assert_twin<T: Sample>(dims: [u64; 3], upscale: Upscale, source: &[T]) {
    let (factor, kernel) = (upscale.factor(), upscale.kernel());
    let (new, clamped) = enlarged_counting(dims, source, upscale);
    let new_dims = times(dims, factor);
    let (least, greatest) = T::TYPE.limits();
    let (mut beyond, mut exact) = (0, 0_usize);
    for (i, at) in voxels(new_dims, |at| at).into_iter().enumerate() {
        let (expected, most, _) = twin(dims, source, factor, kernel, at);
        let found = new[i].to_f64();
        if T::TYPE.is_integer() {
            let whole = expected.round_ties_even();
            beyond += u64::from(whole < least || whole > greatest);
            let inside = whole.clamp(least, greatest);
            exact += usize::from(found == inside);
            assert!((found - inside).abs() <= 1.0, "{factor} {kernel} {at:?}: {found}, {expected}");
        } else {
            let error = (found - expected).abs();
            assert!(error <= 1e-5 * most, "{factor} {kernel} {at:?}: {found}, {expected}");
        }
    }
    if T::TYPE.is_integer() {
        // f32 rounds a few of those that lie half way between two integers otherwise.
        assert!(exact * 100 >= new.len() * 99, "{exact} of {} are exact", new.len());
        assert_eq!(clamped, beyond, "{factor} {kernel} {}", T::TYPE);
    }
}

#[test]
fn every_type_factor_and_kernel_is_the_naive_twin() {
    for sample_type in SampleType::ALL {
        with_sample_type!(sample_type, T => {
            for factor in Upscale::FACTORS {
                for kernel in CubicKernel::ALL {
                    let dims = [7, 5, 6];
                    assert_twin::<T>(dims, plain(factor, kernel), &scan(dims, 3));
                }
            }
        });
    }
}

#[test]
fn overshoots_are_clamped_and_counted_at_the_ends_of_the_range() {
    let dims = [9, 8, 7];
    for sample_type in SampleType::ALL.into_iter().filter(|t| t.is_integer()) {
        with_sample_type!(sample_type, T => {
            // Only the two ends: every edge overshoots.
            let ends = voxels(dims, |at| if bits(7, at) >> 63 == 0 { T::LEAST } else { T::GREATEST });
            for factor in Upscale::FACTORS {
                assert_twin::<T>(dims, plain(factor, CubicKernel::CatmullRom), &ends);
            }
            let (_, clamped) = enlarged_counting(dims, &ends, plain(4, CubicKernel::CatmullRom));
            assert!(clamped > 1000, "{sample_type}: {clamped}");
            let (_, clamped) = enlarged_counting(dims, &ends, plain(4, CubicKernel::BSpline));
            assert_eq!(clamped, 0, "a B-spline does not overshoot");
        });
    }
}

#[test]
fn volumes_of_one_voxel_row_or_slice_are_the_twin_too() {
    for dims in [[1, 1, 1], [9, 1, 1], [1, 9, 1], [1, 1, 9], [5, 4, 1], [2, 2, 2]] {
        for factor in [3, 4] {
            assert_twin::<i16>(dims, plain(factor, CubicKernel::CatmullRom), &scan(dims, 1));
            assert_twin::<f64>(dims, plain(factor, CubicKernel::Mitchell), &scan(dims, 1));
        }
    }
}

#[test]
fn a_constant_stays_that_constant_to_the_bit() {
    // One voxel differs, so that the rest is not taken by the way of uniform boxes.
    fn check<T: Sample>(value: T, other: T) {
        let dims = [20, 3, 2];
        for factor in Upscale::FACTORS {
            for kernel in CubicKernel::ALL {
                for odd_one in [value, other] {
                    let source =
                        voxels(dims, |[x, y, z]| if x + y + z == 0 { odd_one } else { value });
                    let new = enlarged(dims, &source, plain(factor, kernel));
                    for (i, at) in voxels(times(dims, factor), |at| at).into_iter().enumerate() {
                        let far = at[0] >= u64::from(factor) * 3;
                        assert!(!far || new[i].same_bits(value), "{} is not {value}", new[i]);
                    }
                }
            }
        }
    }
    check::<u16>(65_535, 0);
    check::<i8>(-128, 127);
    check::<u32>(u32::MAX, 5);
    check::<f32>(0.1, 1e9);
    check::<f32>(-1000.3, 0.0);
    check::<f64>(1e300 / 3.0, 0.0);
}

#[test]
fn linear_ramps_are_reproduced_away_from_edges() {
    let dims = [11, 10, 9];
    for factor in Upscale::FACTORS {
        for kernel in CubicKernel::ALL {
            let f = u64::from(factor);
            // Steps that give whole numbers at every new voxel.
            let ramp = voxels(dims, |[x, y, z]| (1000 + 2 * f * (3 * x + 5 * y + 7 * z)) as u16);
            let new = enlarged(dims, &ramp, plain(factor, kernel));
            let floats =
                voxels(dims, |[x, y, z]| 0.3 * x as f32 - 0.7 * y as f32 + 0.11 * z as f32);
            let new_floats = enlarged(dims, &floats, plain(factor, kernel));
            for (i, at) in voxels(times(dims, factor), |at| at).into_iter().enumerate() {
                if (0..3).any(|axis| at[axis] < 2 * f || at[axis] >= (dims[axis] - 2) * f) {
                    continue;
                }
                // 2 f ((o + 0.5) / f - 0.5) = 2 o + 1 - f.
                let [x, y, z] = at.map(|o| 2 * o + 1 - f);
                assert_eq!(u64::from(new[i]), 1000 + 3 * x + 5 * y + 7 * z, "{factor} {kernel}");
                let [x, y, z] = at.map(|o| (o as f64 + 0.5) / f as f64 - 0.5);
                let expected = 0.3 * x - 0.7 * y + 0.11 * z;
                assert!((f64::from(new_floats[i]) - expected).abs() < 4e-6, "{factor} {kernel}");
            }
        }
    }
}

#[test]
fn samples_come_back_where_a_new_voxel_lies_on_an_old_one() {
    for sample_type in SampleType::ALL {
        with_sample_type!(sample_type, T => {
            let dims = [6, 7, 5];
            let source = scan::<T>(dims, 8);
            let new = enlarged(dims, &source, plain(3, CubicKernel::CatmullRom));
            for (i, at) in voxels(dims, |at| at).into_iter().enumerate() {
                let same = new[index(times(dims, 3), at.map(|v| 3 * v + 1))];
                assert!(same.same_bits(source[i]), "{at:?}: {same} is not {}", source[i]);
            }
        });
    }
}

fn assert_mirrors<T: Sample>(dims: [u64; 3], factor: u32, kernel: CubicKernel, seed: u64) {
    let source = scan::<T>(dims, seed);
    let new = enlarged(dims, &source, plain(factor, kernel));
    for axis in 0..3 {
        let mirror = |dims: [u64; 3], mut at: [u64; 3]| {
            at[axis] = dims[axis] - 1 - at[axis];
            at
        };
        let mirrored = voxels(dims, |at| source[index(dims, mirror(dims, at))]);
        let new_mirrored = enlarged(dims, &mirrored, plain(factor, kernel));
        let new_dims = times(dims, factor);
        for (i, at) in voxels(new_dims, |at| at).into_iter().enumerate() {
            let expected = new[index(new_dims, mirror(new_dims, at))];
            assert!(new_mirrored[i].same_bits(expected), "{factor} {kernel} axis {axis} {at:?}");
        }
    }
}

#[test]
fn mirrored_input_gives_mirrored_output_bit_for_bit() {
    for factor in Upscale::FACTORS {
        for kernel in CubicKernel::ALL {
            assert_mirrors::<f32>([9, 6, 7], factor, kernel, 2);
            assert_mirrors::<f64>([4, 6, 3], factor, kernel, 2);
            assert_mirrors::<u16>([5, 8, 6], factor, kernel, 2);
        }
    }
}

#[test]
fn what_is_no_number_stays_where_it_is_and_its_surroundings_are_the_nearest() {
    let dims = [9, 8, 10];
    let mut source = scan::<f32>(dims, 4);
    source[index(dims, [4, 4, 5])] = f32::NAN;
    source[index(dims, [1, 2, 1])] = f32::NEG_INFINITY;
    for factor in Upscale::FACTORS {
        let kernel = CubicKernel::CatmullRom;
        let new = enlarged(dims, &source, plain(factor, kernel));
        let mut nearest = 0;
        for (i, at) in voxels(times(dims, factor), |at| at).into_iter().enumerate() {
            let own = source[index(dims, at.map(|o| o / u64::from(factor)))];
            let (expected, most, _) = twin(dims, &source, factor, kernel, at);
            if expected.is_finite() {
                assert!((f64::from(new[i]) - expected).abs() <= 1e-5 * most, "{at:?}");
            } else {
                assert!(new[i].same_bits(own), "{at:?}: {} is not {own}", new[i]);
                nearest += 1;
            }
        }
        assert!(nearest > 100);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn any_volume_is_the_twin(
        dims in [1_u64..12, 1_u64..12, 1_u64..12], seed in any::<u64>(),
        factor in 0_usize..4, kernel in 0_usize..3,
    ) {
        let upscale = plain(Upscale::FACTORS[factor], CubicKernel::ALL[kernel]);
        assert_twin::<u8>(dims, upscale, &scan(dims, seed));
        assert_twin::<f32>(dims, upscale, &scan(dims, seed));
    }
}
