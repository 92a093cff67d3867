//! The errors that a store reports are the errors that it has, and within their bounds.

use crate::support::{converted, index, keys, pyramid, pyramid_of, scan, small_bricks, voxels};
use octree_store::{
    BrickScratch, DownsampleFilter, Encoding, OverlapAtRest, Region, Sample, SampleType,
    with_sample_type,
};
use preprocess::export::{ExportFormat, export};
use preprocess::tradeoff::read_levels;
use preprocess::{ConvertOptions, NoProgress, Source, SourceOptions, Volume, verify_against};

/// Measures every brick of every level naively: bound, RMS and AMAX.
fn assert_errors<T: Sample>(dims: [u64; 3], options: &ConvertOptions) {
    let made = converted(dims, scan::<T>(dims, 7), options);
    let geometry = made.store.geometry();
    let levels = pyramid(dims, &made.voxels, geometry.top_level() + 1);
    let mut brick = vec![T::default(); geometry.brick_samples()];
    let side = geometry.brick_side();
    let epsilon = if T::FITS_F32 { f64::from(f32::EPSILON) } else { f64::EPSILON };
    let rounded = if T::TYPE.is_integer() { 0.5 } else { 0.0 };
    let mut per_level = vec![(0_u64, 0.0, 0.0_f64); levels.len()];
    for key in keys(geometry) {
        let record = made.store.read_brick(key, &mut BrickScratch::default(), &mut brick).unwrap();
        let level_dims = geometry.dims_at(key.level());
        let origin = geometry.sample_origin(key);
        let range = record.brick_max - record.brick_min;
        let scale = record.brick_min.abs().max(record.brick_max.abs()).max(range);
        let bound = match options.encoding {
            Encoding::Lossless => 0.0,
            Encoding::MaxError(error) => error.get(),
            Encoding::Quantised8 => range / 510.0 + 2.0 * epsilon * scale + rounded,
        };
        let (mut voxels, mut squares, mut amax) = (0, 0.0, 0.0_f64);
        let region = geometry.core_region(key);
        for z in region.min[2]..region.max[2] {
            for y in region.min[1]..region.max[1] {
                for x in region.min[0]..region.max[0] {
                    let at = [0, 1, 2].map(|axis| ([x, y, z][axis] as i64 - origin[axis]) as usize);
                    let got = brick[(at[2] * side + at[1]) * side + at[0]].to_f64();
                    let source = levels[usize::from(key.level())][index(level_dims, [x, y, z])];
                    let error = got - source.to_f64();
                    assert!(error.abs() <= bound, "{key}: {error} is over {bound}");
                    voxels += 1;
                    squares += error * error;
                    amax = amax.max(error.abs());
                }
            }
        }
        assert_eq!(record.error.voxels, voxels);
        assert_eq!(record.error.amax, amax);
        assert!((record.error.squares - squares).abs() <= 1e-12 * squares);
        let total = &mut per_level[usize::from(key.level())];
        *total = (total.0 + voxels, total.1 + squares, total.2.max(amax));
    }
    for (summary, (voxels, squares, amax)) in made.store.metadata().levels.iter().zip(per_level) {
        let rms = (squares / voxels as f64).sqrt();
        assert!((summary.rms - rms).abs() <= 1e-12 * rms);
        assert_eq!(summary.amax, amax);
    }
}

#[test]
fn every_voxel_of_every_type_lies_within_the_bound_and_the_report_is_true() {
    for sample_type in SampleType::ALL {
        for error in [None, Some(0.0), Some(0.4), Some(3.0), Some(250.0)] {
            let encoding = error.map_or(Some(Encoding::Quantised8), Encoding::max_error).unwrap();
            for overlap_at_rest in [OverlapAtRest::Stored, OverlapAtRest::Assembled] {
                let options = ConvertOptions { overlap_at_rest, ..small_bricks(encoding) };
                with_sample_type!(sample_type, T => assert_errors::<T>([21, 34, 13], &options));
            }
        }
    }
}

#[test]
fn bounds_of_levels_hold_for_what_a_reader_gets_and_are_not_much_too_wide() {
    let dims = [50, 41, 70];
    for downsample in DownsampleFilter::ALL {
        let encodings = [Encoding::Lossless, Encoding::Quantised8];
        for encoding in encodings.into_iter().chain(Encoding::max_error(900.0)) {
            for empty_below in [None, Some(12_000.0)] {
                let options = ConvertOptions { downsample, empty_below, ..small_bricks(encoding) };
                let made = converted(dims, scan::<u16>(dims, 6), &options);
                let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
                let levels = read_levels(made.store.path(), &source, &NoProgress).unwrap();
                assert_eq!(levels.len(), 5);
                for level in &levels {
                    let k = u32::from(level.level);
                    // By definition: every level-0 voxel against the cell that holds it.
                    let cells = made
                        .store
                        .read_region::<u16>(level.level, Region::whole(level.dims_xyz))
                        .unwrap();
                    let (mut squares, mut amax) = (0.0, 0.0_f64);
                    for (v, at) in made.voxels.iter().zip(voxels(dims, |at| at)) {
                        let cell = cells[index(level.dims_xyz, at.map(|v| v >> k))];
                        let deviation = f64::from(*v) - f64::from(cell);
                        squares += deviation * deviation;
                        amax = amax.max(deviation.abs());
                    }
                    let rms = (squares / made.voxels.len() as f64).sqrt();
                    assert!((level.deviation_rms - rms).abs() <= 1e-12 * rms, "{level:?} {rms}");
                    assert_eq!(level.deviation_amax, amax);
                    assert!(rms <= level.rms_bound && amax <= level.amax_bound, "{level:?}");
                    // No bound is of use that is far too wide. Levels above those of the structure are the
                    // worst: each step adds to the bound what it takes from the means.
                    if encoding == Encoding::Lossless && empty_below.is_none() && k > 0 {
                        let tight = level.rms_tightness.unwrap();
                        assert!(tight > 0.35, "{downsample:?} {level:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn verifying_against_the_source_gives_the_report_again() {
    for (empty_below, nan_value) in [(None, None), (Some(2000.0), None)] {
        let options =
            ConvertOptions { empty_below, nan_value, ..small_bricks(Encoding::Quantised8) };
        let made = converted([40, 33, 20], scan::<u16>([40, 33, 20], 9), &options);
        let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
        let report =
            verify_against(&made.store, source, &ConvertOptions::default(), &NoProgress).unwrap();
        assert_eq!(report.damaged, []);
        let metadata = made.store.metadata();
        assert_eq!((report.rms, report.amax), (metadata.levels[0].rms, metadata.levels[0].amax));
        assert_eq!(report.dropped_rms, metadata.dropped_rms);
        assert_eq!(report.dropped_amax, metadata.dropped_amax);
    }
}

#[test]
fn a_source_that_differs_by_one_voxel_is_noticed() {
    let mut made =
        converted([40, 33, 20], scan::<u16>([40, 33, 20], 9), &small_bricks(Encoding::Quantised8));
    let at = [17, 20, 3];
    made.voxels[index(made.dims, at)] ^= 0x400;
    std::fs::write(&made.raw, octree_store::to_le_bytes(&made.voxels)).unwrap();
    let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
    let report =
        verify_against(&made.store, source, &ConvertOptions::default(), &NoProgress).unwrap();
    let home = made.store.geometry().brick_of_voxel(0, at);
    assert!(report.damaged.iter().any(|node| node.key == home), "{:?}", report.damaged);
}

#[test]
fn what_is_extracted_stays_within_amax() {
    let made =
        converted([40, 33, 20], scan::<i16>([40, 33, 20], 4), &small_bricks(Encoding::Quantised8));
    let amax = made.store.metadata().levels[0].amax;
    assert!(amax > 0.0, "something must have been lost for this test to say much");
    let out = made.folder.path().join("out.nii.gz");
    let store = octree_store::Store::open(made.store.path()).unwrap();
    export(
        &Volume::of_store(store, 0, None).unwrap(),
        &out,
        ExportFormat::NiftiGz,
        false,
        &NoProgress,
    )
    .unwrap();
    let a = Volume::open(&made.raw, &SourceOptions::default()).unwrap();
    let b = Volume::open(&out, &SourceOptions::default()).unwrap();
    assert_eq!(preprocess::compare::compare(&a, &b).unwrap().amax, amax);
}

#[test]
fn every_level_lies_within_its_bound_of_full_resolution() {
    let dims = [37, 50, 21];
    for filter in DownsampleFilter::ALL {
        assert_within_bound(dims, filter);
    }
}

fn assert_within_bound(dims: [u64; 3], filter: DownsampleFilter) {
    let options = ConvertOptions { downsample: filter, ..small_bricks(Encoding::Lossless) };
    let made = converted(dims, scan::<u16>(dims, 3), &options);
    let geometry = made.store.geometry();
    let levels = pyramid_of(filter, dims, &made.voxels, geometry.top_level() + 1);
    for key in keys(geometry) {
        let record = made.store.node(key).unwrap();
        let (level, level_dims) = (key.level(), geometry.dims_at(key.level()));
        let region = geometry.core_region(key);
        let (mut squares, mut amax, mut voxels) = (0.0, 0.0_f64, 0);
        for (i, voxel) in made.voxels.iter().enumerate() {
            let i = i as u64;
            let cell =
                [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]].map(|v| v >> level);
            if (0..3).all(|axis| (region.min[axis]..region.max[axis]).contains(&cell[axis])) {
                let coarse = levels[usize::from(level)][index(level_dims, cell)];
                let deviation = f64::from(*voxel) - f64::from(coarse);
                squares += deviation * deviation;
                amax = amax.max(deviation.abs());
                voxels += 1;
            }
        }
        let rms = (squares / f64::from(voxels)).sqrt();
        assert!(rms <= record.lod_rms_bound + 1e-9, "{key}: {rms} > {}", record.lod_rms_bound);
        assert!(amax <= record.lod_amax_bound, "{key}: {amax} > {}", record.lod_amax_bound);
        if level == 1 {
            // One step is measured, not bounded: equal but for rounding.
            assert!((rms - record.lod_rms_bound).abs() <= 1e-9 * rms, "{key}");
            assert!((amax - record.lod_amax_bound).abs() <= 1e-9 * amax, "{key}");
        }
    }
}
