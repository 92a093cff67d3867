//! What a reader gets: lossless bricks hold the naive pyramid, and overlaps their neighbours' cores.

use crate::support::{AWKWARD_DIMS, converted, index, keys, pyramid, scan, small_bricks};
use octree_store::{BrickScratch, Encoding, Region, Sample, SampleType, with_sample_type};
use preprocess::ConvertOptions;
use proptest::prelude::*;

/// Every sample of every brick of every level, overlap included, by its definition.
fn assert_bricks_are_the_pyramid<T: Sample>(dims: [u64; 3], options: &ConvertOptions, seed: u64) {
    let made = converted(dims, scan::<T>(dims, seed), options);
    let geometry = made.store.geometry();
    let levels = pyramid(dims, &made.voxels, geometry.top_level() + 1);
    let mut brick = vec![T::default(); geometry.brick_samples()];
    let side = geometry.brick_side();
    for key in keys(geometry) {
        made.store.read_brick(key, &mut BrickScratch::default(), &mut brick).unwrap();
        let level_dims = geometry.dims_at(key.level());
        let origin = geometry.sample_origin(key);
        for (i, sample) in brick.iter().enumerate() {
            let local = [i % side, i / side % side, i / side / side];
            let nearest = [0, 1, 2].map(|axis| {
                (origin[axis] + local[axis] as i64).clamp(0, level_dims[axis] as i64 - 1) as u64
            });
            let expected = levels[usize::from(key.level())][index(level_dims, nearest)];
            assert!(
                sample.same_bits(expected),
                "{key} sample {local:?} of {dims:?}: {sample} is not {expected}"
            );
        }
    }
}

#[test]
fn lossless_bricks_hold_the_naive_pyramid_at_awkward_sizes() {
    for dims in AWKWARD_DIMS {
        assert_bricks_are_the_pyramid::<u16>(dims, &small_bricks(Encoding::Lossless), 1);
    }
}

#[test]
fn lossless_bricks_hold_the_naive_pyramid_for_every_sample_type() {
    for sample_type in SampleType::ALL {
        with_sample_type!(sample_type, T => {
            assert_bricks_are_the_pyramid::<T>([19, 35, 27], &small_bricks(Encoding::Lossless), 2);
        });
    }
}

#[test]
fn sizes_beside_a_multiple_of_the_usual_brick_hold_too() {
    let options = ConvertOptions { encoding: Encoding::Lossless, ..ConvertOptions::default() };
    for dims in [[31, 32, 33], [63, 64, 65], [33, 1, 97]] {
        assert_bricks_are_the_pyramid::<u16>(dims, &options, 3);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn lossless_bricks_hold_the_naive_pyramid_for_any_bricks(
        dims in [1_u64..50, 1_u64..50, 1_u64..50],
        half_core in 4_u32..17, overlap in 0_u32..5, threads in 1_usize..5, seed in any::<u64>(),
    ) {
        let options = ConvertOptions {
            brick_core: 2 * half_core, brick_overlap: overlap, threads, encoding: Encoding::Lossless,
            ..ConvertOptions::default()
        };
        assert_bricks_are_the_pyramid::<i16>(dims, &options, seed);
    }

    #[test]
    fn a_region_is_what_its_bricks_hold(
        dims in [1_u64..50, 1_u64..50, 1_u64..50], level in 0_u8..4,
        low in [0.0..1.0, 0.0..1.0, 0.0..1.0], high in [0.0..1.0, 0.0..1.0, 0.0..1.0],
    ) {
        let made = converted(dims, scan::<u16>(dims, 5), &small_bricks(Encoding::Lossless));
        let level = level.min(made.store.geometry().top_level());
        let level_dims = made.store.geometry().dims_at(level);
        let min = [0, 1, 2].map(|axis| (low[axis] * level_dims[axis] as f64) as u64);
        let max = [0, 1, 2].map(|axis| {
            min[axis] + 1 + (high[axis] * (level_dims[axis] - min[axis]) as f64) as u64
        });
        let max = [0, 1, 2].map(|axis| max[axis].min(level_dims[axis]));
        let region = Region { min, max };
        let read = made.store.read_region::<u16>(level, region).unwrap();
        let levels = pyramid(dims, &made.voxels, level + 1);
        let size = region.dims_xyz();
        prop_assert_eq!(read.len() as u64, region.voxels());
        for (i, v) in read.into_iter().enumerate() {
            let i = i as u64;
            let local = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
            let at = [0, 1, 2].map(|axis| region.min[axis] + local[axis]);
            prop_assert_eq!(v, levels[usize::from(level)][index(level_dims, at)]);
        }
    }
}
