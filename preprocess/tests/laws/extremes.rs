//! Volumes at the ends of what numbers can be, from the file to what a reader gets at every level. The
//! expected answer stands first; `docs/ACCURACY.md` has them in a table.
//!
//! What one brick makes of such values is held against its laws in `octree-store/src/encoding/extremes.rs`.

use crate::ranges::assert_ranges_hold;
use crate::support::{Converted, converted, index, small_bricks, voxels};
use octree_store::{
    DownsampleFilter, Encoding, NodeKey, OverlapAtRest, Region, Sample, SampleType, Store,
    with_sample_type,
};
use preprocess::tradeoff::read_levels;
use preprocess::{ConvertOptions, NoProgress, Source, SourceOptions, convert, verify_against};
use std::os::unix::fs::FileExt;

/// Not a multiple of the brick, so that edges repeat and cells are partial.
const DIMS: [u64; 3] = [19, 17, 10];

fn max_error(error: f64) -> Encoding {
    Encoding::max_error(error).unwrap()
}

/// What a reader gets at level 0.
fn read<T: Sample>(made: &Converted<T>) -> Vec<T> {
    made.store.read_region::<T>(0, Region::whole(made.dims)).unwrap()
}

/// Converts a volume in every encoding and holds each against what it promises: `lossless` gives every bit
/// back, `max-error=E` no error above E, `u8` none above its formula; every level lies within its bound of
/// full resolution; no sample leaves the ranges above it; the report is what is measured anew.
fn assert_promises_hold<T: Sample>(dims: [u64; 3], volume: &[T], errors: &[f64]) {
    let encodings = [Encoding::Lossless, Encoding::Quantised8];
    for encoding in encodings.into_iter().chain(errors.iter().map(|e| max_error(*e))) {
        for overlap_at_rest in [OverlapAtRest::Stored, OverlapAtRest::Assembled] {
            let options = ConvertOptions { overlap_at_rest, ..small_bricks(encoding) };
            let made = converted(dims, volume.to_vec(), &options);
            let bound = match encoding {
                Encoding::Lossless => 0.0,
                Encoding::MaxError(error) => error.get(),
                Encoding::Quantised8 => u8_bound(&made.store),
            };
            for (got, source) in read(&made).iter().zip(volume) {
                if encoding == Encoding::Lossless {
                    assert!(got.same_bits(*source), "{source} became {got}");
                } else if source.is_finite() {
                    let error = distance(*got, *source);
                    assert!(error <= bound, "{encoding}: {source} became {got}, bound {bound}");
                }
            }
            assert!(made.store.metadata().levels[0].amax <= bound);
            assert_ranges_hold::<T>(&made.store);
            let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
            for level in read_levels(made.store.path(), &source, &NoProgress).unwrap() {
                assert!(level.deviation_rms <= level.rms_bound, "{encoding} {level:?}");
                assert!(level.deviation_amax <= level.amax_bound, "{encoding} {level:?}");
            }
            let how = ConvertOptions::default();
            assert_eq!(verify_against(&made.store, source, &how, &NoProgress).unwrap().damaged, []);
        }
    }
}

/// |got - source| without the overflow that the ends of f64 would make. Halves of the smallest would be
/// rounded.
fn distance<T: Sample>(got: T, source: T) -> f64 {
    let (got, source) = (got.to_f64(), source.to_f64());
    let plain = (got - source).abs();
    if plain.is_finite() { plain } else { 2.0 * (got / 2.0 - source / 2.0).abs() }
}

/// The largest that `u8`'s formula allows in any brick.
fn u8_bound(store: &Store) -> f64 {
    let sample_type = store.metadata().sample_type;
    let (epsilon, tiny, rounded) = with_sample_type!(sample_type, T => (
        if T::FITS_F32 { f64::from(f32::EPSILON) } else { f64::EPSILON },
        if T::FITS_F32 { f64::from(f32::from_bits(1)) } else { f64::from_bits(1) },
        if T::TYPE.is_integer() { 0.5 } else { 0.0 },
    ));
    let mut bound = 0.0_f64;
    store
        .visit_level(0, |record| {
            let half = record.brick_max / 2.0 - record.brick_min / 2.0;
            let scale = record.brick_max.abs().max(record.brick_min.abs()).max(2.0 * half);
            bound = bound.max(half / 255.0 + 2.0 * (scale * epsilon).max(tiny) + rounded);
            true
        })
        .unwrap();
    bound
}

/// Values that repeat along x in blocks of a brick, so that bricks of each alone and of several exist.
fn blocks<T: Sample>(values: &[T]) -> Vec<T> {
    voxels(DIMS, |[x, y, z]| {
        if z < 8 {
            values[((x / 8 + y / 8) as usize) % values.len()]
        } else {
            values[(x + 3 * y + 5 * z) as usize % values.len()]
        }
    })
}

#[test]
fn constant_volumes_are_uniform_at_every_level_and_come_back_exactly() {
    for sample_type in SampleType::ALL {
        with_sample_type!(sample_type, T => {
            for value in [T::LEAST, T::default(), T::GREATEST] {
                for encoding in [Encoding::Lossless, Encoding::Quantised8, max_error(3.0)] {
                    let count = DIMS.iter().product::<u64>() as usize;
                    let made = converted(DIMS, vec![value; count], &small_bricks(encoding));
                    let metadata = made.store.metadata();
                    assert_eq!(metadata.payload_bytes, 0, "{value} as {encoding}");
                    assert!(read(&made).iter().all(|v| v.same_bits(value)), "{value} as {encoding}");
                    for level in &metadata.levels {
                        let none = [level.rms, level.amax, level.lod_rms_bound, level.lod_amax_bound];
                        assert_eq!((level.stored, none), (0, [0.0; 4]), "{value} as {encoding}");
                    }
                }
            }
        });
    }
}

#[test]
fn volumes_of_nan_or_infinity_alone_read_as_0_unless_lossless() {
    let count = DIMS.iter().product::<u64>();
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::from_bits(0xffc1_2345)] {
        for encoding in [Encoding::Quantised8, max_error(1.0)] {
            let made = converted(DIMS, vec![value; count as usize], &small_bricks(encoding));
            let metadata = made.store.metadata();
            assert!(read(&made).iter().all(|v| *v == 0.0), "{value} as {encoding}");
            assert_eq!(metadata.payload_bytes, 0);
            let counted = (metadata.nan_count, metadata.inf_count);
            assert_eq!(counted, if value.is_nan() { (count, 0) } else { (0, count) });
            assert_eq!((metadata.value_min, metadata.psnr_db()), (None, None));
        }
        let exact = converted(DIMS, vec![value; count as usize], &small_bricks(Encoding::Lossless));
        assert!(read(&exact).iter().all(|v| v.same_bits(value)), "{value}");
    }
}

#[test]
fn ranges_of_1_2_255_256_and_65535_have_the_error_worked_out() {
    // u8 has 255 steps: exact up to a range of 255; of 256 the middle is off by 1 at most; of 65535 a step is 257, so
    // 128 at most.
    for (range, amax) in [(1_u16, 0.0), (2, 0.0), (255, 0.0), (256, 1.0), (65_535, 128.0)] {
        let dims = [64, 64, 32];
        let volume = voxels(dims, |[x, y, z]| {
            let place = (z * 64 + y) * 64 + x;
            (place % (u64::from(range) + 1)) as u16
        });
        let whole = ConvertOptions { brick_core: 64, ..small_bricks(Encoding::Quantised8) };
        let made = converted(dims, volume.clone(), &whole);
        let found = made.store.metadata().levels[0].amax;
        assert!(found <= amax && (amax == 0.0 || found >= amax.min(127.0)), "{range}: {found}");
        let exact = ConvertOptions { encoding: max_error(0.0), ..whole };
        let made = converted(dims, volume.clone(), &exact);
        assert_eq!(read(&made), volume, "max-error=0 is exact for integers");
        assert_promises_hold(DIMS, &blocks(&[0, range / 2, range]), &[0.0, 1.0, 127.0]);
    }
}

#[test]
fn integers_at_the_ends_of_their_types_keep_every_promise() {
    assert_promises_hold(DIMS, &blocks(&[i16::MIN, -1, 0, i16::MAX]), &[0.0, 50.0]);
    assert_promises_hold(DIMS, &blocks(&[i8::MIN, -1, 0, i8::MAX]), &[0.0, 3.0]);
    // Above 2^24 f32 has no place for every integer.
    let above = (1_u32 << 24) + 1;
    assert_promises_hold(
        DIMS,
        &blocks(&[0, above, above + 1, u32::MAX - 1, u32::MAX]),
        &[0.0, 1e4],
    );
    assert_promises_hold(DIMS, &blocks(&[above, above + 1, above + 2, above + 3]), &[0.0, 1.0]);
    assert_promises_hold(DIMS, &blocks(&[i32::MIN, -16_777_217, 0, i32::MAX]), &[0.0, 1e5]);
}

#[test]
fn floats_at_the_ends_of_their_types_keep_every_promise() {
    // The range overflows f32; f64's overflows f64.
    assert_promises_hold(DIMS, &blocks(&[-3.4e38_f32, -1.0, 0.0, 3.4e38]), &[1e30, 1e35, 1e39]);
    assert_promises_hold(DIMS, &blocks(&[f32::MIN, f32::MAX]), &[1e35]);
    assert_promises_hold(DIMS, &blocks(&[-1e300_f64, 1e39, -1e39, 1e300]), &[1e290, 1e299]);
    // Denormals, and numbers of all sizes side by side.
    let least = f32::from_bits(1);
    assert_promises_hold(
        DIMS,
        &blocks(&[0.0, least, 77.0 * least, f32::MIN_POSITIVE]),
        &[1e-45, 1e-40],
    );
    assert_promises_hold(
        DIMS,
        &blocks(&[0.0, f64::from_bits(1), f64::from_bits(99)]),
        &[5e-324, 1e-322],
    );
    assert_promises_hold(DIMS, &blocks(&[1e-30_f32, 1e30, -1e-30, -1e30]), &[1e-31, 1e20, 1e28]);
}

#[test]
fn minus_zero_keeps_its_sign_in_lossless_stores_and_is_zero_in_others() {
    let volume = blocks(&[0.0_f32, -0.0, 1.0]);
    assert_promises_hold(DIMS, &volume, &[0.0, 0.25]);
    let signs = vec![-0.0_f32; DIMS.iter().product::<u64>() as usize];
    let made = converted(DIMS, signs.clone(), &small_bricks(Encoding::Lossless));
    assert!(read(&made).iter().all(|v| v.to_bits() == signs[0].to_bits()));
    // 0 and -0 alone: the range is 0, and still no sign is lost.
    let made = converted(DIMS, blocks(&[0.0_f32, -0.0]), &small_bricks(Encoding::Lossless));
    assert!(read(&made).iter().zip(&made.voxels).all(|(a, b)| a.to_bits() == b.to_bits()));
}

#[test]
fn islands_of_nan_change_no_number_beside_them() {
    let island = |nan: f32| {
        voxels(DIMS, |[x, y, z]| {
            if x < 8 && y < 9 || (x + y + z) % 11 == 0 { nan } else { (100 + x + y) as f32 }
        })
    };
    assert_promises_hold(DIMS, &island(f32::NAN), &[0.1, 4.0]);
    assert_promises_hold(DIMS, &island(f32::INFINITY), &[0.1, 4.0]);
    for encoding in [Encoding::Quantised8, max_error(4.0)] {
        let made = converted(DIMS, island(f32::NAN), &small_bricks(encoding));
        assert!(read(&made).iter().all(|v| v.is_finite() && *v <= 135.0), "{encoding}");
    }
}

#[test]
fn a_checkerboard_is_as_far_from_its_mean_as_the_bound_says() {
    // 0 and 65535 in turn: every mean is 32767.5, and half to even is 32768; so |v - mean| is at most 32768, and the
    // RMS sqrt((32768^2 + 32767^2) / 2). Above level 1 all is 32768: no step adds to the bound.
    let dims = [32, 32, 32];
    let board = voxels(dims, |[x, y, z]| if (x + y + z) % 2 == 0 { 0 } else { u16::MAX });
    let made = converted(dims, board.clone(), &small_bricks(Encoding::Lossless));
    let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
    let rms = f64::midpoint(32_768.0_f64.powi(2), 32_767.0_f64.powi(2)).sqrt();
    for level in read_levels(made.store.path(), &source, &NoProgress).unwrap().iter().skip(1) {
        assert_eq!(level.deviation_amax, 32_768.0);
        assert!((level.deviation_rms - rms).abs() < 1e-6);
        assert!(level.rms_tightness.unwrap() > 1.0 - 1e-9, "{level:?}");
        assert!(level.amax_tightness.unwrap() > 1.0 - 1e-9, "{level:?}");
    }
    assert!(
        made.store
            .read_region::<u16>(2, Region::whole([8; 3]))
            .unwrap()
            .iter()
            .all(|&v| v == 32_768)
    );
    assert_promises_hold(
        DIMS,
        &voxels(DIMS, |[x, y, z]| if (x + y + z) % 2 == 0 { 0 } else { u16::MAX }),
        &[0.0, 100.0, 40_000.0],
    );
}

#[test]
fn values_on_rounding_ties_go_to_the_even_side_in_means_and_keep_the_bound() {
    // 2 x 2 x 2 cells whose sums are odd multiples of 4: means end in .5.
    let dims = [16, 16, 16];
    let volume = voxels(dims, |[x, y, z]| (10 * (x / 2 + y / 2 + z / 2) + x % 2) as i16 - 60);
    let made = converted(dims, volume, &small_bricks(Encoding::Lossless));
    let means = made.store.read_region::<i16>(1, Region::whole([8; 3])).unwrap();
    for (i, at) in voxels([8; 3], |at| at).into_iter().enumerate() {
        let low = 10 * (at[0] + at[1] + at[2]) as i16 - 60;
        // low + 0.5, and low is even.
        assert_eq!(means[i], low, "{at:?}");
    }
    // Steps of 2 E + 1 with values half way between two codes, and floats on the middle of a step.
    assert_promises_hold(DIMS, &blocks(&[0_u16, 50, 51, 101, 151, 152]), &[50.0, 50.5]);
    assert_promises_hold(DIMS, &blocks(&[0.0_f32, 0.5, 1.0, 1.5, 2.5, 3.0]), &[0.5, 0.25]);
    assert_promises_hold(DIMS, &blocks(&[0_u8, 127, 128, 255]), &[0.5, 63.5]);
}

#[test]
fn an_error_of_0_is_exact_and_one_above_the_range_leaves_one_value_a_brick() {
    let scan = crate::support::scan::<u16>(DIMS, 3);
    let made = converted(DIMS, scan.clone(), &small_bricks(max_error(0.0)));
    assert_eq!(read(&made), scan);
    let floats = crate::support::scan::<f32>(DIMS, 3);
    let made = converted(DIMS, floats.clone(), &small_bricks(max_error(0.0)));
    assert!(read(&made).iter().zip(&floats).all(|(a, b)| a.to_bits() == b.to_bits()));
    for error in [65_536.0, 1e300, f64::MAX] {
        let made = converted(DIMS, scan.clone(), &small_bricks(max_error(error)));
        assert_eq!(made.store.metadata().payload_bytes, 0, "{error}");
        assert!(made.store.metadata().levels[0].amax <= 32_768.0);
    }
    for refused in [-1.0, -f64::MIN_POSITIVE, f64::NAN, f64::INFINITY] {
        assert_eq!(Encoding::max_error(refused), None, "{refused}");
    }
}

#[test]
fn one_hot_voxel_in_512_cubed_shows_at_every_level_and_in_every_range_above_it() {
    let (dims, hot, value) = ([512_u64; 3], [301, 77, 450], 60_000_u16);
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("hot_512x512x512_u16.raw");
    // A file of holes with two bytes in it.
    let file = std::fs::File::create(&raw).unwrap();
    file.set_len(2 * 512_u64.pow(3)).unwrap();
    file.write_all_at(&value.to_le_bytes(), 2 * index(dims, hot) as u64).unwrap();
    for downsample in [DownsampleFilter::Mean, DownsampleFilter::Max] {
        let options = ConvertOptions {
            downsample,
            encoding: max_error(10.0),
            empty_below: Some(30_000.0),
            ..ConvertOptions::default()
        };
        let source = Source::open(&raw, &SourceOptions::default()).unwrap();
        let path = folder.path().join("hot.octavo");
        convert(&source, &path, &options, &NoProgress).unwrap();
        let store = Store::open(&path).unwrap();
        assert_eq!(store.geometry().top_level(), 4);
        // Means of eight, each rounded half to even: 60000, 7500, 937.5, 117.25, 14.6.
        let cells = match downsample {
            DownsampleFilter::Mean => [60_000.0, 7500.0, 938.0, 117.0, 15.0],
            _ => [60_000.0; 5],
        };
        for (level, cell) in (0_u8..).zip(cells) {
            let at = hot.map(|v| v >> level);
            let home = store.geometry().brick_of_voxel(level, at);
            let record = store.node(home).unwrap();
            assert_eq!((record.subtree_min, record.subtree_max), (0.0, 60_000.0), "{home}");
            assert_eq!(record.brick_max, cell, "{home}");
            // The voxel itself, or all the zeros beside it, are as far from the cell as can be.
            let far = if level == 0 { 0.0 } else { cell.max(60_000.0 - cell) };
            assert!(record.lod_amax_bound >= far, "{home}: {}", record.lod_amax_bound);
            let cube = 8_f64.powi(i32::from(level));
            let rms = (((60_000.0 - cell).powi(2) + (cube - 1.0) * cell * cell)
                / store.geometry().voxels_beneath(home) as f64)
                .sqrt();
            assert!(
                record.lod_rms_bound >= rms * (1.0 - 1e-12),
                "{home}: {} {rms}",
                record.lod_rms_bound
            );
            let read = store.read_region::<u16>(level, Region { min: at, max: at.map(|v| v + 1) });
            let kept = if level == 0 || downsample == DownsampleFilter::Max { 60_000 } else { 0 };
            assert!(read.unwrap()[0].abs_diff(kept) <= 10, "{home}");
        }
        // Far from it all is empty.
        let far = store.node(NodeKey::new(0, [0; 3])).unwrap();
        assert_eq!(far.state, octree_store::BrickState::Empty);
        std::fs::remove_file(&path).unwrap();
    }
}
