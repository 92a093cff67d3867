//! Every encoding keeps its word in a whole store, whatever the effort and wherever the overlap is.

use crate::support::{converted, index, keys, pyramid, scan, small_bricks, voxels};
use octree_store::{
    BrickScratch, Damage, Effort, Encoding, ErrorSum, NodeKey, OverlapAtRest, Region, Sample,
    SampleBuffer, StoreError, UploadFormat, verify, with_sample_type,
};
use octree_store::{BrickState, SampleType, Store};
use preprocess::{
    ConvertOptions, NoProgress, OverlapReport, Source, SourceOptions, convert, verify_against,
};

const DIMS: [u64; 3] = [21, 18, 35];

fn bound(error: f64) -> Encoding {
    Encoding::max_error(error).unwrap()
}

fn how(encoding: Encoding, effort: Effort, overlap_at_rest: OverlapAtRest) -> ConvertOptions {
    ConvertOptions { effort, overlap_at_rest, ..small_bricks(encoding) }
}

/// What a reader gets of every brick, overlap included, against the pyramid of means: within `error` for
/// every sample, or without it within what the level says of cores and of overlap.
fn assert_within<T: Sample>(voxels: &[T], store: &Store, error: Option<f64>) {
    let geometry = store.geometry();
    let levels = pyramid(DIMS, voxels, geometry.top_level() + 1);
    let side = geometry.brick_side();
    let mut brick = vec![T::default(); geometry.brick_samples()];
    let mut scratch = BrickScratch::default();
    for key in keys(geometry) {
        let record = store.read_brick(key, &mut scratch, &mut brick).unwrap();
        let level = &store.metadata().levels[usize::from(key.level())];
        assert!(record.error.amax <= error.unwrap_or(level.amax), "{key}: {}", record.error.amax);
        let error = error.unwrap_or(level.amax.max(level.overlap_amax_bound));
        let dims = geometry.dims_at(key.level());
        let origin = geometry.sample_origin(key);
        for (i, read) in brick.iter().enumerate() {
            let at = [i % side, i / side % side, i / side / side];
            let voxel = [0, 1, 2].map(|axis| {
                (origin[axis] + at[axis] as i64).clamp(0, dims[axis] as i64 - 1) as u64
            });
            let v = levels[usize::from(key.level())][index(dims, voxel)];
            assert!(
                (read.to_f64() - v.to_f64()).abs() <= error,
                "{key} {at:?}: {v} reads as {read}"
            );
            let range = record.brick_min..=record.brick_max;
            assert!(range.contains(&read.to_f64()), "{key} {at:?}: {read} leaves its range");
        }
    }
}

fn assert_keeps_its_word<T: Sample>(options: &ConvertOptions, error: Option<f64>) {
    let made = converted(DIMS, scan::<T>(DIMS, 3), options);
    let report = verify::verify(&made.store, || true).unwrap().unwrap();
    assert!(report.is_ok(), "{report:?}");
    let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
    let against =
        verify_against(&made.store, source, &ConvertOptions::default(), &NoProgress).unwrap();
    assert_eq!(against.damaged, []);
    let level = &made.store.metadata().levels[0];
    assert_eq!((against.rms, against.amax), (level.rms, level.amax));
    let assembled = options.overlap_at_rest == OverlapAtRest::Assembled;
    assert_eq!(against.overlap.is_some(), assembled);
    assert!(assembled || level.overlap_extra_amax_bound == 0.0);
    if let Some(overlap) = against.overlap {
        let twin = assembled_overlap(&made.voxels, &made.store);
        assert_eq!([overlap.amax, overlap.extra_amax], [twin.amax, twin.extra_amax]);
        for (rms, twin) in [(overlap.rms, twin.rms), (overlap.extra_rms, twin.extra_rms)] {
            assert!((rms - twin).abs() <= 1e-12 * twin, "{rms} {twin}");
        }
        assert!(overlap.amax <= level.overlap_amax_bound, "{overlap:?} {level:?}");
        assert!(overlap.extra_amax <= level.overlap_extra_amax_bound, "{overlap:?} {level:?}");
    }
    assert_within(&made.voxels, &made.store, error);
    for threads in [1, 2, 7] {
        let options = ConvertOptions { threads, ..options.clone() };
        let other = made.folder.path().join(format!("{threads}.octavo"));
        let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
        let done = convert(&source, &other, &options, &NoProgress).unwrap();
        assert_eq!(done.metadata.digest, made.store.metadata().digest, "{threads} threads");
    }
    let region = Region { min: [5, 0, 7], max: [20, 17, 33] };
    let cut = made.store.read_region::<T>(0, region).unwrap();
    let whole = made.store.read_region::<T>(0, Region::whole(DIMS)).unwrap();
    let expected: Vec<T> = voxels(region.dims_xyz(), |at| {
        whole[index(DIMS, [0, 1, 2].map(|axis| at[axis] + region.min[axis]))]
    });
    assert_eq!(cut, expected);
}

/// The errors of level 0's overlap, a sample at a time: from the voxel, and from what the brick's own range
/// makes of the voxel.
fn assembled_overlap<T: Sample>(voxels: &[T], store: &Store) -> OverlapReport {
    let geometry = store.geometry();
    let (mut error, mut extra) = (ErrorSum::default(), ErrorSum::default());
    for key in keys(geometry).into_iter().filter(|key| key.level() == 0) {
        let (record, read) = store.read_brick_samples(key).unwrap();
        if record.state == BrickState::Empty {
            continue;
        }
        let (region, side) = (geometry.core_region(key), geometry.brick_side());
        let origin = geometry.sample_origin(key);
        let mut samples = vec![T::default(); geometry.brick_samples()];
        let mut overlap = Vec::new();
        for (i, sample) in samples.iter_mut().enumerate() {
            let at = [i % side, i / side % side, i / side / side];
            let whole = [0, 1, 2].map(|axis| origin[axis] + at[axis] as i64);
            let voxel = [0, 1, 2].map(|axis| whole[axis].clamp(0, DIMS[axis] as i64 - 1) as u64);
            *sample = voxels[index(DIMS, voxel)];
            let in_core = (0..3).all(|a| (region.min[a]..region.max[a]).contains(&voxel[a]));
            if !in_core && voxel.map(|v| v as i64) == whole {
                overlap.push((i, *sample));
            }
        }
        let mut own = samples;
        store.recode(&record, &mut BrickScratch::default(), &mut own).unwrap();
        for (i, voxel) in overlap {
            error.add(read.get_f64(i) - voxel.to_f64());
            extra.add(read.get_f64(i) - own[i].to_f64());
        }
    }
    OverlapReport {
        rms: error.rms(),
        amax: error.amax,
        extra_rms: extra.rms(),
        extra_amax: extra.amax,
    }
}

#[test]
fn every_encoding_keeps_its_word_in_every_type_wherever_the_overlap_is() {
    for overlap in [OverlapAtRest::Stored, OverlapAtRest::Assembled] {
        for sample_type in [SampleType::U8, SampleType::I16, SampleType::U32, SampleType::F32] {
            with_sample_type!(sample_type, T => {
                for (encoding, error) in [
                    (Encoding::Lossless, Some(0.0)), (Encoding::Quantised8, None),
                    (bound(0.0), Some(0.0)), (bound(3.7), Some(3.7)), (bound(700.0), Some(700.0)),
                ] {
                    assert_keeps_its_word::<T>(&how(encoding, Effort::Balanced, overlap), error);
                }
            });
        }
        for effort in [Effort::Fast, Effort::Small] {
            for (encoding, error) in [
                (Encoding::Lossless, Some(0.0)),
                (Encoding::Quantised8, None),
                (bound(50.0), Some(50.0)),
            ] {
                assert_keeps_its_word::<u16>(&how(encoding, effort, overlap), error);
            }
        }
    }
}

#[test]
fn assembled_overlap_of_any_width_is_the_stored_one_where_nothing_is_lost() {
    // Volumes that end within bricks, and such as end with them.
    let (within, with) = ([17, 9, 26], [32, 32, 32]);
    for (core, overlap, dims) in [
        (8, 0, within),
        (8, 4, within),
        (10, 1, within),
        (16, 3, within),
        (8, 2, with),
        (16, 4, with),
    ] {
        let read = |overlap_at_rest| {
            let options = ConvertOptions {
                brick_core: core,
                brick_overlap: overlap,
                ..how(Encoding::Lossless, Effort::Balanced, overlap_at_rest)
            };
            let made = converted(dims, scan::<f32>(dims, 5), &options);
            let bricks: Vec<SampleBuffer> = keys(made.store.geometry())
                .into_iter()
                .map(|key| made.store.read_brick_samples(key).unwrap().1)
                .collect();
            (bricks, made.store.metadata().payload_bytes)
        };
        let (stored, assembled) = (read(OverlapAtRest::Stored), read(OverlapAtRest::Assembled));
        assert_eq!(stored.0, assembled.0, "core {core}, overlap {overlap}, {dims:?}");
        assert!(overlap == 0 || assembled.1 < stored.1 * 3 / 4);
    }
}

#[test]
fn overlap_beside_dropped_bricks_is_within_what_its_level_says() {
    for encoding in [Encoding::Lossless, Encoding::Quantised8, bound(300.0)] {
        for overlap in [OverlapAtRest::Stored, OverlapAtRest::Assembled] {
            let options = ConvertOptions {
                empty_below: Some(18_000.0),
                ..how(encoding, Effort::Balanced, overlap)
            };
            let made = converted(DIMS, scan::<u16>(DIMS, 3), &options);
            let level = &made.store.metadata().levels[0];
            assert!(level.empty > 0 && level.stored > 0, "{level:?}");
            let found = assembled_overlap(&made.voxels, &made.store);
            assert!(found.amax <= level.overlap_amax_bound, "{found:?} {level:?}");
            assert!(found.extra_amax <= level.overlap_extra_amax_bound, "{found:?} {level:?}");
            let seen = overlap == OverlapAtRest::Assembled;
            assert_eq!(found.extra_amax > 10_000.0, seen, "what was dropped shows: {found:?}");
            if seen {
                assert_dropped_neighbours_read_as_the_empty_value(&made.store);
            }
        }
    }
}

fn assert_dropped_neighbours_read_as_the_empty_value(store: &Store) {
    let (geometry, empty_value) = (store.geometry(), store.metadata().empty_value);
    let (side, core) = (geometry.brick_side(), i64::from(geometry.core()));
    let mut seen = 0;
    for key in keys(geometry).into_iter().filter(|key| key.level() == 0) {
        let (record, read) = store.read_brick_samples(key).unwrap();
        let origin = geometry.sample_origin(key);
        for i in 0..geometry.brick_samples() {
            let at = [i % side, i / side % side, i / side / side];
            let voxel = [0, 1, 2]
                .map(|axis| (origin[axis] + at[axis] as i64).clamp(0, DIMS[axis] as i64 - 1));
            let holder = store.node(NodeKey::new(0, voxel.map(|v| (v / core) as u64))).unwrap();
            if record.state == BrickState::Stored && holder.state == BrickState::Empty {
                let expected = empty_value.clamp(record.brick_min, record.brick_max);
                assert_eq!(read.get_f64(i), expected, "{key} {at:?}");
                seen += 1;
            }
        }
    }
    assert!(seen > 100, "{seen}");
}

#[test]
fn overlap_in_a_bricks_own_codes_is_the_overlap_that_is_stored() {
    for encoding in [Encoding::Lossless, Encoding::Quantised8, bound(300.0)] {
        let options = how(encoding, Effort::Balanced, OverlapAtRest::Stored);
        let made = converted(DIMS, scan::<i16>(DIMS, 3), &options);
        let found = assembled_overlap(&made.voxels, &made.store);
        assert_eq!((found.extra_rms, found.extra_amax), (0.0, 0.0), "{encoding}");
        assert_eq!(found.amax > 0.0, encoding != Encoding::Lossless);
    }
}

#[test]
fn not_a_number_in_a_neighbour_stays_where_it_is_kept() {
    let voxels =
        voxels(DIMS, |[x, y, z]| if (x + y + z) % 7 == 0 { f32::NAN } else { (x * y) as f32 });
    let read = |overlap| {
        let made =
            converted(DIMS, voxels.clone(), &how(Encoding::Lossless, Effort::Small, overlap));
        let (_, samples) = made.store.read_brick_samples(NodeKey::new(0, [1, 1, 1])).unwrap();
        samples.to_le_bytes()
    };
    assert_eq!(read(OverlapAtRest::Stored), read(OverlapAtRest::Assembled));
}

#[test]
fn damage_in_a_neighbour_fails_the_overlap_with_its_key_and_no_core_but_its_own() {
    let options = how(Encoding::Lossless, Effort::Balanced, OverlapAtRest::Assembled);
    let made = converted(DIMS, scan::<u16>(DIMS, 8), &options);
    let (bad, good, far) =
        (NodeKey::new(0, [1, 1, 1]), NodeKey::new(0, [0, 0, 0]), NodeKey::new(0, [0, 0, 4]));
    let place = made.store.node(bad).unwrap().place;
    let mut bytes = std::fs::read(made.store.path()).unwrap();
    bytes[4096 + place.offset as usize + 9] ^= 4;
    let path = made.folder.path().join("damaged.octavo");
    std::fs::write(&path, bytes).unwrap();
    let store = Store::open(&path).unwrap();
    let mut brick = vec![0_u16; store.geometry().brick_samples()];
    let mut scratch = BrickScratch::default();
    let failed = store.read_brick(good, &mut scratch, &mut brick).unwrap_err();
    let damage = Damage::PayloadChecksum;
    assert!(
        matches!(failed, StoreError::Damaged { key, damage: d, .. } if key == bad && d == damage)
    );
    store.read_brick_core(good, &mut scratch, &mut brick).unwrap();
    store.read_brick(far, &mut scratch, &mut brick).unwrap();
    let damaged: Vec<_> = verify::verify(&store, || true).unwrap().unwrap().damaged;
    assert_eq!(damaged.iter().map(|node| node.key).collect::<Vec<_>>(), [bad]);
}

#[test]
fn uploads_mean_what_decoding_gives_and_eight_bits_stay_eight() {
    for overlap in [OverlapAtRest::Stored, OverlapAtRest::Assembled] {
        for sample_type in SampleType::ALL {
            with_sample_type!(sample_type, T => {
                for encoding in [Encoding::Quantised8, Encoding::Lossless, bound(0.0), bound(2.5), bound(300.0)] {
                    let made = converted(DIMS, scan::<T>(DIMS, 4), &how(encoding, Effort::Small, overlap));
                    assert_uploads::<T>(&made.store);
                }
            });
        }
    }
}

fn assert_uploads<T: Sample>(store: &Store) {
    let mut samples = vec![T::default(); store.geometry().brick_samples()];
    let mut scratch = BrickScratch::default();
    for key in keys(store.geometry()) {
        let record = store.read_brick(key, &mut scratch, &mut samples).unwrap();
        let upload = store.read_upload(&record, &mut scratch).unwrap();
        let map = upload.map;
        assert_eq!(upload.bytes.len(), samples.len() * map.format.bytes());
        let expected = match (store.metadata().encoding, T::TYPE) {
            _ if record.state != BrickState::Stored || record.bits == 0 => UploadFormat::R8,
            (Encoding::Lossless, _) if size_of::<T>() == 1 => UploadFormat::R8,
            (Encoding::Lossless, SampleType::U16 | SampleType::I16) => UploadFormat::R16,
            (Encoding::Lossless, _) => UploadFormat::R32Float,
            _ if record.bits <= 8 => UploadFormat::R8,
            _ if record.bits <= 16 => UploadFormat::R16,
            _ => UploadFormat::R32Float,
        };
        assert_eq!(map.format, expected, "{record:?}");
        for (texel, sample) in upload.bytes.chunks_exact(map.format.bytes()).zip(&samples) {
            let texel = match *texel {
                [byte] => f64::from(byte),
                [a, b] => f64::from(u16::from_le_bytes([a, b])),
                [a, b, c, d] => f64::from(f32::from_le_bytes([a, b, c, d])),
                _ => unreachable!(),
            };
            let value = map.scale * texel + map.offset;
            let difference = (value - sample.to_f64()).abs();
            assert!(difference <= map.max_difference, "{sample} as {value}: {map:?} {record:?}");
        }
    }
}

#[test]
fn a_store_says_how_many_bits_its_bricks_have() {
    let made = converted(DIMS, scan::<u16>(DIMS, 3), &small_bricks(bound(300.0)));
    let metadata = made.store.metadata();
    assert_eq!(metadata.encoding.to_string(), "max-error=300");
    for level in &metadata.levels {
        let mut counted = std::collections::BTreeMap::new();
        made.store
            .visit_level(level.level, |record| {
                if record.state == BrickState::Stored {
                    *counted.entry(record.bits).or_insert(0) += 1;
                }
                true
            })
            .unwrap();
        assert_eq!(level.bits, counted);
        assert_eq!(level.bits.values().sum::<u64>(), level.stored);
    }
    assert!(metadata.levels[0].bits.len() > 1, "bricks differ: {:?}", metadata.levels[0].bits);
}
