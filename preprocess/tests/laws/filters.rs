//! Every filter between levels, from end to end.

use crate::support::{converted, index, pyramid_of, scan, small_bricks, voxels};
use octree_store::{DownsampleFilter, Encoding, Region, Sample, SampleType, with_sample_type};
use preprocess::{ConvertOptions, NoProgress, Source, SourceOptions, verify_against};

fn assert_levels<T: Sample>(filter: DownsampleFilter, dims: [u64; 3], volume: Vec<T>) {
    let options = ConvertOptions { downsample: filter, ..small_bricks(Encoding::Lossless) };
    let made = converted(dims, volume, &options);
    assert_eq!(made.store.metadata().downsample, filter);
    let geometry = made.store.geometry();
    let levels = pyramid_of(filter, dims, &made.voxels, geometry.top_level() + 1);
    for (level, expected) in geometry.levels().zip(&levels) {
        let whole = Region::whole(geometry.dims_at(level));
        let read = made.store.read_region::<T>(level, whole).unwrap();
        let same = |(a, b): (&T, &T)| a == b || a.is_nan() && b.is_nan();
        assert!(read.iter().zip(expected).all(same), "{filter:?} of {}, level {level}", T::TYPE);
    }
    let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
    let how = ConvertOptions::default();
    let report = verify_against(&made.store, source, &how, &NoProgress).unwrap();
    assert_eq!(report.damaged, [], "{filter:?}");
}

#[test]
fn every_level_is_what_its_filter_makes_of_the_level_below() {
    let dims = [37, 18, 29];
    for filter in DownsampleFilter::ALL {
        for sample_type in SampleType::ALL {
            with_sample_type!(sample_type, T => assert_levels(filter, dims, scan::<T>(dims, 4)));
        }
    }
}

#[test]
fn cells_that_are_no_numbers_are_left_out_by_all_filters_but_nearest() {
    let dims = [21, 17, 9];
    for filter in DownsampleFilter::ALL {
        let mut volume = scan::<f32>(dims, 5);
        for (i, v) in volume.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0 || i / 21 < 40) {
            *v = if i / 21 < 40 || i % 2 == 0 { f32::NAN } else { *v };
        }
        assert_levels(filter, dims, volume);
    }
}

#[test]
fn the_mode_of_labels_has_only_labels_of_the_block_it_stands_for() {
    let dims = [40, 33, 26];
    let volume = voxels(dims, |[x, y, z]| 1000 * ((x / 7 + y / 5 + z / 3) % 6) as u16 + 17);
    let options =
        ConvertOptions { downsample: DownsampleFilter::Mode, ..small_bricks(Encoding::Lossless) };
    let made = converted(dims, volume, &options);
    let geometry = made.store.geometry();
    let mut below = made.voxels.clone();
    for level in geometry.levels().skip(1) {
        let (fine, coarse) = (geometry.dims_at(level - 1), geometry.dims_at(level));
        let cells = made.store.read_region::<u16>(level, Region::whole(coarse)).unwrap();
        for (i, at) in voxels(coarse, |at| at).into_iter().enumerate() {
            let mut block = voxels([2; 3], |d| [0, 1, 2].map(|axis| 2 * at[axis] + d[axis]));
            block.retain(|cell| (0..3).all(|axis| cell[axis] < fine[axis]));
            assert!(block.iter().any(|cell| below[index(fine, *cell)] == cells[i]));
        }
        below = cells;
    }
}
