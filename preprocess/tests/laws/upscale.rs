//! Enlarged volumes: the tricubic kernel against 64 taps in f64, and what must hold of any such kernel.

use crate::support::{bits, index, scan, small_bricks, voxels};
use flate2::Compression;
use flate2::write::GzEncoder;
use octree_store::{Encoding, Region, Sample, SampleType, Store, with_sample_type};
use preprocess::source::nifti_header::{NiftiDatatype, NiftiHeader, NiftiUnit};
use preprocess::{
    ConvertOptions, CubicKernel, Detail, NoProgress, PreprocessError, Source, SourceError,
    SourceOptions, Upscale, convert, verify_against,
};
use proptest::prelude::*;
use std::io::Write;
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
fn all<T: Sample>(source: &Source) -> Vec<T> {
    let [width, height, depth] = source.dims_xyz;
    let mut voxels = vec![T::default(); (width * height * depth) as usize];
    let mut slices = source.slices().unwrap();
    for slice in voxels.chunks_exact_mut((width * height) as usize) {
        slices.next(slice).unwrap();
    }
    voxels
}

/// The voxels enlarged, and how many were clamped.
fn enlarged_counting<T: Sample>(dims: [u64; 3], voxels: &[T], upscale: Upscale) -> (Vec<T>, u64) {
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

/// The voxels of level 0 of a store.
fn stored<T: Sample>(path: &Path) -> Vec<T> {
    let store = Store::open(path).unwrap();
    let dims = store.geometry().dims_xyz();
    store.read_region(0, Region::whole(dims)).unwrap()
}

#[test]
fn a_voxel_has_the_same_bits_in_every_brick_slice_thread_and_budget() {
    let dims = [23, 17, 30];
    let source_voxels = scan::<u16>(dims, 5);
    let detail = Some(Detail { amplitude: 0.5, seed: 11 });
    for upscale in [
        plain(4, CubicKernel::CatmullRom),
        Upscale::new(4, CubicKernel::CatmullRom, detail).unwrap(),
        Upscale::new(3, CubicKernel::Mitchell, detail).unwrap(),
        Upscale::new(8, CubicKernel::BSpline, detail).unwrap(),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let open = || raw(folder.path(), dims, &source_voxels).upscale(upscale).unwrap();
        let (expected, clamped) = enlarged_counting(dims, &source_voxels, upscale);
        let too_small = open().limit_slices(9, 1000);
        let Err(PreprocessError::MemoryTooSmall { needed, .. }) = too_small else {
            panic!("1000 bytes were enough");
        };
        for (threads, memory) in [(9, needed), (3, needed + 200_000), (2, 1 << 30)] {
            let mut source = open();
            source.limit_slices(threads, memory).unwrap();
            assert!(all::<u16>(&source) == expected, "{threads} threads in {memory} bytes");
            assert_eq!(source.clamped_voxels(), Some(clamped));
        }
        for (core, overlap, threads) in [(8, 0, 1), (32, 2, 3), (48, 4, 2), (128, 1, 2)] {
            let options = ConvertOptions {
                brick_core: core,
                brick_overlap: overlap,
                threads,
                encoding: Encoding::Lossless,
                ..ConvertOptions::default()
            };
            let path = folder.path().join(format!("{core}.octavo"));
            let done = convert(&open(), &path, &options, &NoProgress).unwrap();
            assert!(stored::<u16>(&path) == expected, "bricks of {core} + {overlap}");
            assert_eq!(done.clamped_voxels, Some(clamped), "each voxel counts once");
            assert_eq!(done.metadata.options["upscale"], upscale.factor());
        }
    }
}

#[test]
fn sources_that_must_be_decoded_give_the_same_store() {
    let dims = [20, 13, 41];
    let source_voxels = scan::<u16>(dims, 6);
    let folder = tempfile::tempdir().unwrap();
    let detail = Some(Detail { amplitude: 0.25, seed: 3 });
    let upscale = Upscale::new(2, CubicKernel::CatmullRom, detail).unwrap();
    let header =
        NiftiHeader::for_volume(dims, NiftiDatatype::U16, [1.0; 3], NiftiUnit::Millimetre, None);
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(&header.unwrap().to_bytes()).unwrap();
    gzip.write_all(&octree_store::to_le_bytes(&source_voxels)).unwrap();
    let packed = folder.path().join("a.nii.gz");
    std::fs::write(&packed, gzip.finish().unwrap()).unwrap();
    let open = |plain: bool| {
        let mut source = if plain {
            raw(folder.path(), dims, &source_voxels)
        } else {
            Source::open(&packed, &SourceOptions::default()).unwrap()
        };
        source.affine = None;
        source.upscale(upscale).unwrap()
    };
    let expected = enlarged(dims, &source_voxels, upscale);
    assert!(all::<u16>(&open(false)) == expected);
    let digests = [true, false].map(|plain| {
        let path = folder.path().join(format!("{plain}.octavo"));
        let options = small_bricks(Encoding::Quantised8);
        convert(&open(plain), &path, &options, &NoProgress).unwrap().metadata.digest
    });
    assert_eq!(digests[0], digests[1]);
}

#[test]
fn a_store_is_verified_against_the_source_that_it_was_enlarged_from() {
    let dims = [14, 9, 12];
    let folder = tempfile::tempdir().unwrap();
    let voxels = scan::<i16>(dims, 9);
    let detail = Some(Detail { amplitude: 0.3, seed: u64::MAX });
    let upscale = Upscale::new(3, CubicKernel::Mitchell, detail).unwrap();
    let region = Region { min: [2, 0, 1], max: [12, 9, 11] };
    let source = raw(folder.path(), dims, &voxels).crop(region).unwrap().upscale(upscale).unwrap();
    assert!(matches!(
        raw(folder.path(), dims, &voxels).upscale(upscale).unwrap().crop(region),
        Err(SourceError::EnlargedRegion { .. })
    ));
    let path = folder.path().join("a.octavo");
    let options = ConvertOptions { roi: Some(region), ..small_bricks(Encoding::Quantised8) };
    let done = convert(&source, &path, &options, &NoProgress).unwrap();
    let store = Store::open(&path).unwrap();
    let against = |voxels: &[i16]| {
        let source = raw(folder.path(), dims, voxels);
        verify_against(&store, source, &ConvertOptions::default(), &NoProgress).unwrap()
    };
    let report = against(&voxels);
    assert!(report.damaged.is_empty() && report.rms == done.metadata.levels[0].rms);
    let mut changed = voxels.clone();
    changed[index(dims, [6, 4, 5])] ^= 0x100;
    assert!(!against(&changed).damaged.is_empty());
}

#[test]
fn too_large_a_volume_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a_33554432x1x1_u8.raw");
    std::fs::File::create(&path).unwrap().set_len(1 << 25).unwrap();
    let open = || Source::open(&path, &SourceOptions::default()).unwrap();
    assert!(open().upscale(plain(2, CubicKernel::CatmullRom)).is_ok());
    let refused = open().upscale(plain(4, CubicKernel::CatmullRom));
    assert!(matches!(refused, Err(SourceError::Geometry { .. })));
}

/// A progress that stops the work after so many bricks.
struct StopsAt(std::sync::atomic::AtomicU64);

impl preprocess::Progress for StopsAt {
    fn bricks_done(&self, bricks: u64) {
        let left = self.0.load(std::sync::atomic::Ordering::Relaxed);
        self.0.store(left.saturating_sub(bricks), std::sync::atomic::Ordering::Relaxed);
    }
    fn should_stop(&self) -> bool {
        self.0.load(std::sync::atomic::Ordering::Relaxed) == 0
    }
}

#[test]
fn stopped_work_is_gone_on_with_to_the_same_store_and_count() {
    let dims = [15, 14, 24];
    let folder = tempfile::tempdir().unwrap();
    let ends = voxels(dims, |at| if bits(7, at) >> 63 == 0 { 0 } else { 255_u8 });
    let detail = Some(Detail { amplitude: 0.5, seed: 2 });
    let upscale = Upscale::new(4, CubicKernel::CatmullRom, detail).unwrap();
    let file = raw(folder.path(), dims, &ends).files[0].clone();
    let open =
        |upscale| Source::open(&file, &SourceOptions::default()).unwrap().upscale(upscale).unwrap();
    let options =
        ConvertOptions { commit_source_bytes: 10_000, ..small_bricks(Encoding::Quantised8) };
    let whole = convert(&open(upscale), &folder.path().join("w.octavo"), &options, &NoProgress);
    let whole = whole.unwrap();
    assert!(whole.clamped_voxels > Some(1000));
    for stop in [40, 300, 700] {
        let path = folder.path().join(format!("{stop}.octavo"));
        let stopped = convert(&open(upscale), &path, &options, &StopsAt(stop.into()));
        assert!(matches!(stopped, Err(PreprocessError::Kept { .. })), "{stopped:?}");
        let resume = ConvertOptions { start: preprocess::Start::Resume, ..options.clone() };
        let other = Detail { amplitude: 0.5, seed: 3 };
        let other = Upscale::new(4, CubicKernel::CatmullRom, Some(other)).unwrap();
        let refused = convert(&open(other), &path, &resume, &NoProgress);
        assert!(matches!(refused, Err(PreprocessError::CannotResume { .. })), "another seed");
        let done = convert(&open(upscale), &path, &resume, &NoProgress).unwrap();
        assert!(done.resumed_bricks > 0);
        assert_eq!(done.metadata.digest, whole.metadata.digest);
        assert_eq!(done.clamped_voxels, whole.clamped_voxels);
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
