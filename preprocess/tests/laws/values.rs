//! What is said of the source's values, and what becomes of those that are no numbers.

use crate::support::{converted, index, scan, small_bricks, voxels};
use octree_store::{Encoding, Region};
use preprocess::compare::compare;
use preprocess::{ConvertOptions, NoProgress, Source, SourceOptions, Volume, verify_against};
use std::path::Path;

#[test]
fn range_and_mean_are_those_of_the_voxels() {
    let dims = [33, 20, 41];
    let made = converted(dims, scan::<u32>(dims, 8), &small_bricks(Encoding::Quantised8));
    let metadata = made.store.metadata();
    let values: Vec<u64> = made.voxels.iter().map(|&v| u64::from(v)).collect();
    assert_eq!(metadata.value_min, values.iter().min().map(|&v| v as f64));
    assert_eq!(metadata.value_max, values.iter().max().map(|&v| v as f64));
    let mean = values.iter().sum::<u64>() as f64 / values.len() as f64;
    assert_eq!(metadata.value_mean, Some(mean));
}

/// A float volume with islands of NaN and both infinities.
fn islands(dims: [u64; 3]) -> Vec<f32> {
    voxels(dims, |[x, y, z]| match (x, y, z) {
        (0..12, 0..12, 0..12) => f32::NAN,
        (20, 5, 5) => f32::INFINITY,
        (21, 5, 5) => f32::NEG_INFINITY,
        _ => 10.0 + x as f32 + 0.25 * y as f32,
    })
}

#[test]
fn nan_and_infinities_are_counted_and_stored_as_said() {
    let dims = [24, 24, 24];
    let made = converted(dims, islands(dims), &small_bricks(Encoding::Quantised8));
    let metadata = made.store.metadata();
    assert_eq!((metadata.nan_count, metadata.inf_count), (12 * 12 * 12, 2));
    assert_eq!((metadata.value_min, metadata.value_max), (Some(10.0), Some(38.75)));
    let read = made.store.read_region::<f32>(0, Region::whole(dims)).unwrap();
    assert!(read.iter().all(|v| v.is_finite()), "a quantised store holds numbers alone");
    // The infinities clamp to the range of their brick, which is x 14..26 (22, 23 repeat) and y 0..10.
    assert_eq!(read[index(dims, [20, 5, 5])], 10.0 + 23.0 + 0.25 * 9.0);
    assert_eq!(read[index(dims, [21, 5, 5])], 10.0 + 14.0);
    // A brick of NaN alone has no range: 0 stands for it.
    assert_eq!(read[index(dims, [3, 3, 3])], 0.0);
    let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
    assert_eq!(
        verify_against(&made.store, source, &ConvertOptions::default(), &NoProgress)
            .unwrap()
            .damaged,
        []
    );
}

#[test]
fn lossless_keeps_every_bit_of_what_is_no_number() {
    let dims = [24, 24, 24];
    let mut volume = islands(dims);
    volume[5] = f32::from_bits(0x7fc0_1234);
    volume[6] = -0.0;
    let made = converted(dims, volume, &small_bricks(Encoding::Lossless));
    let read = made.store.read_region::<f32>(0, Region::whole(dims)).unwrap();
    assert!(read.iter().zip(&made.voxels).all(|(a, b)| a.to_bits() == b.to_bits()));
}

#[test]
fn a_nan_value_takes_the_place_of_nan_alone() {
    let dims = [24, 24, 24];
    let options = ConvertOptions { nan_value: Some(-5.0), ..small_bricks(Encoding::Lossless) };
    let made = converted(dims, islands(dims), &options);
    assert_eq!(made.store.metadata().nan_count, 12 * 12 * 12);
    let read = made.store.read_region::<f32>(0, Region::whole(dims)).unwrap();
    for (read, source) in read.iter().zip(&made.voxels) {
        let expected = if source.is_nan() { -5.0 } else { *source };
        assert_eq!(read.to_bits(), expected.to_bits());
    }
    let coarse = made.store.read_region::<f32>(1, Region { min: [0; 3], max: [1; 3] }).unwrap();
    assert_eq!(coarse, [-5.0], "the levels above are made of the value too");
}

#[test]
fn a_volume_without_a_number_is_a_store_all_the_same() {
    let made = converted([9, 9, 9], vec![f64::NAN; 729], &small_bricks(Encoding::Quantised8));
    let metadata = made.store.metadata();
    assert_eq!((metadata.value_min, metadata.value_mean, metadata.nan_count), (None, None, 729));
}

#[test]
fn the_widest_f64_values_make_a_store_that_tells_its_errors() {
    let dims = [20, 20, 20];
    for (unit, tolerance) in [(1e200, 1e-9), (1.7e307, 1e-9), (8e-300, 1e-9)] {
        let volume = voxels(dims, |[x, y, z]| {
            let sign = if (x + y + z) % 2 == 0 { 1.0 } else { -1.0 };
            sign * unit * (1.0 + (x * y) as f64 / 400.0)
        });
        for encoding in [Encoding::Quantised8, Encoding::Lossless] {
            let made = converted(dims, volume.clone(), &small_bricks(encoding));
            let level = &made.store.metadata().levels[0];
            let read = made.store.read_region::<f64>(0, Region::whole(dims)).unwrap();
            let errors = || read.iter().zip(&volume).map(|(a, b)| (a / unit - b / unit).abs());
            let rms = (errors().map(|e| e * e).sum::<f64>() / 8000.0).sqrt();
            let amax = errors().fold(0.0, f64::max);
            assert!((level.rms / unit - rms).abs() <= tolerance * rms, "{unit}");
            assert!((level.amax / unit - amax).abs() <= tolerance * amax.max(1e-300), "{unit}");
            assert!(made.store.metadata().levels[1].lod_rms_bound / unit > 0.5);
            let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
            let how = ConvertOptions::default();
            assert_eq!(verify_against(&made.store, source, &how, &NoProgress).unwrap().damaged, []);
            let open = |path: &Path| Volume::open(path, &SourceOptions::default()).unwrap();
            let found = compare(&open(&made.raw), &open(made.store.path())).unwrap();
            assert!((found.rms - level.rms).abs() <= tolerance * level.rms, "{unit} {found:?}");
            assert_eq!((found.amax, found.not_finite), (level.amax, 0), "{unit}");
            let metadata = made.store.metadata();
            assert_eq!(found.psnr_db.is_some(), level.amax > 0.0, "{unit} {found:?}");
            for (found, stored) in found.psnr_db.into_iter().zip(metadata.psnr_db()) {
                assert!(
                    found.is_finite() && (found - stored).abs() < 1e-6,
                    "{unit}: {found} {stored}"
                );
            }
        }
    }
}
