//! Ranges and emptiness: no test on a node's range may lose what lies beneath it.

use crate::support::{converted, keys, scan, small_bricks, voxels};
use octree_store::{
    BrickScratch, BrickState, DownsampleFilter, Encoding, NodeKey, OverlapAtRest, Sample, Store,
};
use preprocess::ConvertOptions;

/// Every sample beneath every node lies in the node's subtree range, whatever is read.
pub(crate) fn assert_ranges_hold<T: Sample>(store: &Store) {
    let geometry = store.geometry();
    let mut brick = vec![T::default(); geometry.brick_samples()];
    for key in keys(geometry) {
        let record = store.read_brick(key, &mut BrickScratch::default(), &mut brick).unwrap();
        let mut above = key;
        loop {
            let ancestor = store.node(above).unwrap();
            let lossless = store.metadata().encoding == Encoding::Lossless;
            assert!(lossless || brick.iter().all(|sample| sample.is_finite()), "{key}");
            // Ranges are those of numbers: only `lossless` gives back what is none.
            for sample in brick.iter().filter(|sample| sample.is_finite()) {
                let v = sample.to_f64();
                assert!(
                    (ancestor.subtree_min..=ancestor.subtree_max).contains(&v),
                    "{key} in {above}"
                );
            }
            assert!(ancestor.subtree_min <= record.brick_min);
            assert!(ancestor.subtree_max >= record.brick_max);
            if above == geometry.root() {
                break;
            }
            above = above.parent();
        }
    }
}

#[test]
fn subtree_ranges_hold_every_sample_beneath() {
    let dims = [40, 33, 27];
    let coarse = Encoding::max_error(700.0).unwrap();
    for encoding in [Encoding::Quantised8, Encoding::Lossless, coarse] {
        let filters = DownsampleFilter::ALL.into_iter().map(|filter| (filter, Some(9000.0)));
        let mean = DownsampleFilter::Mean;
        for (downsample, empty_below) in filters.chain([(mean, None)]) {
            for overlap_at_rest in [OverlapAtRest::Stored, OverlapAtRest::Assembled] {
                let options = ConvertOptions {
                    empty_below,
                    downsample,
                    overlap_at_rest,
                    ..small_bricks(encoding)
                };
                let made = converted(dims, scan::<u16>(dims, 1), &options);
                assert_ranges_hold::<u16>(&made.store);
                let made = converted(dims, scan::<i16>(dims, 1), &options);
                assert_ranges_hold::<i16>(&made.store);
                let made = converted(dims, scan::<f32>(dims, 1), &options);
                assert_ranges_hold::<f32>(&made.store);
            }
        }
    }
}

#[test]
fn one_hot_voxel_shows_in_every_node_above_it() {
    let dims = [64, 64, 64];
    let hot = [13, 50, 31];
    let volume = voxels(dims, |at| if at == hot { 60_000_u16 } else { 100 });
    let made = converted(
        dims,
        volume,
        &ConvertOptions { empty_below: Some(200.0), ..small_bricks(Encoding::Quantised8) },
    );
    let geometry = made.store.geometry();
    let mut key = geometry.brick_of_voxel(0, hot);
    loop {
        assert_eq!(made.store.node(key).unwrap().subtree_max, 60_000.0, "{key}");
        if key == geometry.root() {
            break;
        }
        key = key.parent();
    }
    // Far from it all is empty, and near it the neighbours' overlaps keep it.
    assert_eq!(made.store.node(NodeKey::new(0, [7, 0, 0])).unwrap().state, BrickState::Empty);
    assert_eq!(made.store.node(NodeKey::new(0, [1, 6, 4])).unwrap().state, BrickState::Stored);
}

#[test]
fn a_constant_volume_has_no_payload() {
    for value in [0_u16, 77, 65535] {
        let made =
            converted([40, 20, 20], vec![value; 16_000], &small_bricks(Encoding::Quantised8));
        assert_eq!(made.store.metadata().payload_bytes, 0);
        assert!(made.store.metadata().levels.iter().all(|l| l.stored == 0 && l.uniform > 0));
        assert!(
            made.store
                .read_region::<u16>(0, octree_store::Region::whole([40, 20, 20]))
                .unwrap()
                .iter()
                .all(|&v| v == value)
        );
    }
}

#[test]
fn dropped_bricks_are_counted_apart_and_read_as_the_empty_value() {
    let dims = [32, 16, 16];
    // The left half is air of 100 to 199, the right half is material.
    let volume =
        voxels(
            dims,
            |[x, y, z]| if x < 20 { 100 + ((x + y + z) % 100) as u16 } else { 5000 + x as u16 },
        );
    let options = ConvertOptions { empty_below: Some(1000.0), ..small_bricks(Encoding::Lossless) };
    let made = converted(dims, volume.clone(), &options);
    let metadata = made.store.metadata();
    // Bricks 0 and 1 along x have cores 0..8 and 8..16, and samples up to 18: all air.
    let dropped: Vec<f64> = voxels(dims, |at| at)
        .into_iter()
        .zip(&volume)
        .filter(|([x, ..], _)| *x < 16)
        .map(|(_, &v)| f64::from(v))
        .collect();
    assert_eq!(metadata.dropped_voxels, dropped.len() as u64);
    let rms = (dropped.iter().map(|v| v * v).sum::<f64>() / dropped.len() as f64).sqrt();
    assert!((metadata.dropped_rms - rms).abs() < 1e-9 * rms);
    assert_eq!(metadata.dropped_amax, dropped.iter().copied().fold(0.0, f64::max));
    assert_eq!(metadata.dropped_energy, dropped.iter().map(|v| v * v).sum::<f64>());
    // Bricks of x < 16 have samples up to x = 17: from 100 at the origin to 100 + 17 + 15 + 15.
    assert_eq!((metadata.dropped_min, metadata.dropped_max), (Some(100.0), Some(147.0)));
    assert_eq!((metadata.levels[0].rms, metadata.levels[0].empty), (0.0, 8));
    let mut brick = vec![1_u16; made.store.geometry().brick_samples()];
    let key = NodeKey::new(0, [1, 0, 0]);
    made.store.read_brick(key, &mut BrickScratch::default(), &mut brick).unwrap();
    assert!(brick.iter().all(|&v| v == 0));
    // Nothing in the volume is 0, and what is read is.
    assert_ranges_hold::<u16>(&made.store);
    // "Below" is strict: a threshold at a brick's greatest sample keeps it, one at or below every voxel drops nothing.
    for (threshold, empty) in [(147.0, 7), (100.0, 0)] {
        let options = ConvertOptions { empty_below: Some(threshold), ..options.clone() };
        let made = converted(dims, volume.clone(), &options);
        assert_eq!(made.store.metadata().levels[0].empty, empty, "{threshold}");
    }
}

#[test]
fn a_threshold_below_zero_drops_to_a_value_below_it() {
    let dims = [16, 16, 16];
    let volume = voxels(dims, |[x, ..]| if x < 6 { -1000_i16 } else { 40 });
    let options = ConvertOptions {
        empty_below: Some(-500.0),
        brick_overlap: 0,
        ..small_bricks(Encoding::Quantised8)
    };
    let volume_far = voxels(dims, |[x, ..]| if x < 8 { -1000_i16 } else { 40 });
    assert_eq!(converted(dims, volume, &options).store.metadata().dropped_voxels, 0);
    let made = converted(dims, volume_far, &options);
    assert_eq!(made.store.metadata().dropped_voxels, 8 * 16 * 16);
    assert_eq!(made.store.metadata().empty_value, -501.0);
}
