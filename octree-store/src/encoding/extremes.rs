//! Bricks at the ends of their types, each with the answer worked out first, in every encoding and effort,
//! with and without their overlap; and payloads and records that no encoder made.

use super::bounded::Anchor;
use super::decode::{DecodeScratch, Decoding};
use super::{BrickFormat, Coding, Compression, EncodeScratch, Filter, encode_brick, finite_range};
use crate::encoding::{Effort, Encoding};
use crate::key::NodeKey;
use crate::record::{BrickState, NodeRecord};
use crate::sample::{Sample, SampleType};
use crate::with_sample_type;
use proptest::prelude::*;

const SIDE: usize = 12;
const OVERLAP: usize = 2;

/// A brick whose samples repeat these.
fn brick<T: Sample>(values: &[T]) -> Vec<T> {
    (0..SIDE.pow(3)).map(|i| values[i % values.len()]).collect()
}

fn bound(error: f64) -> Encoding {
    Encoding::max_error(error).unwrap()
}

/// Encodes a brick in every effort, with and without overlap, and checks that all read alike. Returns the
/// record of the first and what a reader gets.
fn encoded<T: Sample>(samples: &[T], encoding: Encoding, anchor: Anchor) -> (NodeRecord, Vec<T>) {
    let mut first: Option<(NodeRecord, Vec<T>)> = None;
    for effort in [Effort::Fast, Effort::Balanced, Effort::Small] {
        let cut_overlap = (anchor == Anchor::Lattice).then_some(OVERLAP as u32);
        let format = BrickFormat { encoding, effort, cut_overlap };
        let (mut scratch, mut payload) = (EncodeScratch::default(), vec![7, 7]);
        let all = std::iter::once(0..samples.len());
        let key = NodeKey::new(0, [0; 3]);
        let range = finite_range(samples);
        let record = encode_brick(key, samples, format, range, all, &mut scratch, &mut payload);
        let payload = &payload[2..];
        assert_eq!(record.place.length as usize, payload.len());
        assert_eq!(record.state == BrickState::Stored && record.bits > 0, !payload.is_empty());
        let side = if cut_overlap.is_some() { SIDE - 2 * OVERLAP } else { SIDE };
        let mut decoded = vec![T::from_f64(record.brick_min); side.pow(3)];
        if record.state == BrickState::Stored {
            let decoding = Decoding { encoding, anchor };
            let mut scratch = DecodeScratch::default();
            decoding.decode(&record, payload, &mut scratch, &mut decoded).unwrap();
        }
        match &first {
            Some((of_first, read)) => {
                assert_eq!((record.error, record.bits), (of_first.error, of_first.bits));
                assert!(decoded.iter().zip(read).all(|(a, b)| a.same_bits(*b)));
            }
            None => first = Some((record, decoded)),
        }
    }
    first.unwrap()
}

/// The samples that a payload holds.
fn held<T: Sample>(samples: &[T], anchor: Anchor) -> Vec<T> {
    let rim = if anchor == Anchor::Lattice { OVERLAP..SIDE - OVERLAP } else { 0..SIDE };
    let mut held = Vec::new();
    for (z, y) in rim.clone().flat_map(|z| rim.clone().map(move |y| (z, y))) {
        held.extend(rim.clone().map(|x| samples[(z * SIDE + y) * SIDE + x]));
    }
    held
}

/// Every encoding keeps its word on a brick: lossless every bit, `max-error` its bound, `u8` its formula.
fn assert_every_encoding_keeps_its_word<T: Sample>(values: &[T]) {
    let samples = brick(values);
    for anchor in [Anchor::Brick, Anchor::Lattice] {
        let held = held(&samples, anchor);
        let (record, read) = encoded(&samples, Encoding::Lossless, anchor);
        assert!(read.iter().zip(&held).all(|(a, b)| a.same_bits(*b)), "{values:?}");
        assert_eq!(record.error.amax, 0.0);
        for error in [0.0, 1e-40, 0.3, 1.0, 1.5, 127.5, 1e6, 1e30, f64::MAX] {
            let (record, read) = encoded(&samples, bound(error), anchor);
            assert!(record.error.amax <= error, "{values:?}, bound {error}: {}", record.error.amax);
            for (read, v) in read.iter().zip(&held).filter(|(_, v)| v.is_finite()) {
                assert!((read.to_f64() - v.to_f64()).abs() <= error, "{v} became {read}, {error}");
            }
        }
        let (record, read) = encoded(&samples, Encoding::Quantised8, anchor);
        let step = record.brick_max / 255.0 - record.brick_min / 255.0;
        let magnitude = record.brick_max.abs().max(record.brick_min.abs());
        for (read, v) in read.iter().zip(&held).filter(|(_, v)| v.is_finite()) {
            let error = (read.to_f64() / 2.0 - v.to_f64() / 2.0).abs() * 2.0;
            assert!(error <= step / 2.0 + 0.5 + magnitude * 2.4e-7, "{v} became {read}");
        }
    }
}

#[test]
fn extremes_of_every_type_keep_their_word() {
    for sample_type in SampleType::ALL.into_iter().filter(|t| t.is_integer()) {
        with_sample_type!(sample_type, T => {
            let one = T::from_f64(1.0);
            assert_every_encoding_keeps_its_word(&[T::LEAST, T::default(), one, T::GREATEST]);
            assert_every_encoding_keeps_its_word(&[T::LEAST, T::GREATEST]);
            assert_every_encoding_keeps_its_word(&[T::GREATEST]);
        });
    }
    assert_every_encoding_keeps_its_word(&[0_u32, (1 << 24) + 1, (1 << 24) + 2, u32::MAX - 1]);
    assert_every_encoding_keeps_its_word(&[i32::MIN, -((1 << 24) + 1), i32::MAX]);
    assert_every_encoding_keeps_its_word(&[f32::MIN, -1.0, 0.0, -0.0, 1e-30, 1e30, f32::MAX]);
    assert_every_encoding_keeps_its_word(&[
        0.0,
        f32::from_bits(1),
        f32::from_bits(77),
        f32::MIN_POSITIVE,
    ]);
    assert_every_encoding_keeps_its_word(&[f64::MIN, 0.0, 1e300, f64::MAX, f64::from_bits(1)]);
    let (nan, infinite) = (f32::from_bits(0x7fc1_2345), f32::INFINITY);
    assert_every_encoding_keeps_its_word(&[nan, 1.0, -infinite, 2.5, infinite, -0.0]);
    assert_every_encoding_keeps_its_word(&[f64::NAN, 1e-300, f64::INFINITY, 3.0]);
    assert_every_encoding_keeps_its_word(&[nan]);
    assert_every_encoding_keeps_its_word(&[infinite, -infinite]);
}

/// What a renderer gets of a brick means what a reader gets, as near as the map says, and that is near: within a
/// few f32 digits of the greatest magnitude, half a unit of an integer, and what a lattice's ends reach beyond.
fn assert_uploads_mean_what_is_read<T: Sample>(values: &[T]) {
    let samples = brick(values);
    let (lowest, highest) = finite_range(&samples).unwrap_or_default();
    let magnitude = lowest.to_f64().abs().max(highest.to_f64().abs());
    let range = highest.to_f64() - lowest.to_f64();
    for error in [None, Some(0.0), Some(0.3), Some(127.5), Some(range / 3.0), Some(range / 900.0)] {
        let error = error.map(|error| error.min(f64::MAX));
        for encoding in
            error.map_or(vec![Encoding::Lossless, Encoding::Quantised8], |e| vec![bound(e)])
        {
            let all = std::iter::once(0..samples.len());
            let key = NodeKey::new(0, [0; 3]);
            let format = BrickFormat::stored(encoding, Effort::Small);
            let (mut scratch, mut payload) = (EncodeScratch::default(), Vec::new());
            let of = finite_range(&samples);
            let record = encode_brick(key, &samples, format, of, all, &mut scratch, &mut payload);
            if record.state != BrickState::Stored {
                continue;
            }
            let decoding = Decoding { encoding, anchor: Anchor::Brick };
            let (mut scratch, mut read) = (DecodeScratch::default(), samples.clone());
            let upload =
                decoding.upload_payload(&record, &payload, &mut scratch, &mut read).unwrap();
            decoding.decode(&record, &payload, &mut scratch, &mut read).unwrap();
            let map = upload.map;
            let magnitude = magnitude.max(error.unwrap_or(0.0));
            let near = magnitude * 2_f64.powi(-21)
                + match T::TYPE {
                    SampleType::F32 => 2.0 * f64::from(f32::from_bits(1)),
                    SampleType::F64 => 300.0 * f64::from_bits(1),
                    _ => 1.0,
                };
            assert!(map.max_difference <= near, "{values:?} as {encoding}: {map:?}");
            let texels = upload.bytes.chunks_exact(map.format.bytes());
            for (texel, read) in texels.zip(&read).filter(|(_, read)| read.is_finite()) {
                let texel = match *texel {
                    [byte] => f64::from(byte),
                    [a, b] => f64::from(u16::from_le_bytes([a, b])),
                    [a, b, c, d] => f64::from(f32::from_le_bytes([a, b, c, d])),
                    _ => unreachable!(),
                };
                let value = map.scale * texel + map.offset;
                let difference = (value - read.to_f64()).abs();
                assert!(difference <= map.max_difference, "{read} as {value}, {encoding}: {map:?}");
            }
        }
    }
}

#[test]
fn uploads_of_extremes_mean_what_is_read() {
    for sample_type in SampleType::ALL.into_iter().filter(|t| t.is_integer()) {
        with_sample_type!(sample_type, T => {
            assert_uploads_mean_what_is_read(&[T::LEAST, T::default(), T::from_f64(1.0), T::GREATEST]);
            assert_uploads_mean_what_is_read(&[T::LEAST, T::GREATEST]);
        });
    }
    assert_uploads_mean_what_is_read(&[u32::MAX, u32::MAX - 1, u32::MAX - 70_000]);
    assert_uploads_mean_what_is_read(&[f32::MIN, -1.0, 0.0, 1e-30, 1e30, f32::MAX]);
    assert_uploads_mean_what_is_read(&[0.0, f32::from_bits(1), f32::from_bits(1000)]);
    assert_uploads_mean_what_is_read(&[f32::NAN, 1.0, f32::INFINITY, 2.5, f32::NEG_INFINITY]);
    assert_uploads_mean_what_is_read(&[0.0, 1.0, 1e300, -1e300]);
    assert_uploads_mean_what_is_read(&[0.0, f64::from_bits(1), f64::from_bits(1000)]);
    assert_uploads_mean_what_is_read(&[0.0, f64::from_bits(100), f64::from_bits(37)]);
    assert_uploads_mean_what_is_read(&[1e-310, 3e-309, 7e-310]);
    assert_uploads_mean_what_is_read(&[0.0, 1e-305, 7e-306, f64::NAN]);
    assert_uploads_mean_what_is_read(&[1.0, 1.0 + f64::EPSILON]);
}

/// What is expected of a u16 brick of these values: state, coding, bits and AMAX.
fn assert_answer(values: &[u16], encoding: Encoding, state: BrickState, bits: u8, amax: f64) {
    let (record, _) = encoded(&brick(values), encoding, Anchor::Brick);
    let found = (record.state, record.bits, record.error.amax);
    assert_eq!(found, (state, bits, amax), "{values:?} as {encoding}");
}

#[test]
fn constant_bricks_are_uniform_and_exact() {
    for value in [0, 1, 32_768, u16::MAX] {
        for encoding in [Encoding::Quantised8, Encoding::Lossless, bound(0.0), bound(9.0)] {
            assert_answer(&[value], encoding, BrickState::Uniform, 0, 0.0);
        }
    }
    // Of all-NaN bricks every encoding with a quantiser makes 0; lossless keeps the payload.
    let nan = brick(&[f32::NAN]);
    assert_eq!(encoded(&nan, Encoding::Quantised8, Anchor::Brick).0.state, BrickState::Uniform);
    assert_eq!(encoded(&nan, bound(1.0), Anchor::Brick).0.state, BrickState::Uniform);
    let (record, read) = encoded(&nan, Encoding::Lossless, Anchor::Brick);
    assert_eq!((record.state, record.error.voxels), (BrickState::Stored, 0));
    assert!(read.iter().all(|v| v.is_nan()));
    let infinite = encoded(&brick(&[f32::INFINITY]), Encoding::Lossless, Anchor::Brick);
    assert!(infinite.1.iter().all(|v| *v == f32::INFINITY));
}

#[test]
fn ranges_have_the_bits_and_the_errors_that_were_worked_out() {
    use BrickState::Stored;
    // E = 0: as many bits as numbers of the range need.
    for (range, bits) in [(1, 1), (2, 2), (255, 8), (256, 9), (65_535, 16)] {
        assert_answer(&[0, range / 3, range], bound(0.0), Stored, bits, 0.0);
    }
    // One code, read as the middle: 100 is off by 100 and 200 by 100.
    assert_answer(&[100, 300], bound(100.0), Stored, 0, 100.0);
    assert_answer(&[0, u16::MAX], bound(1e9), Stored, 0, 32_768.0);
    // 256 steps of 257 are 65792: 8 bits; the ends lie (65535 - 255 * 257) / 2 = 0 from the first and last.
    assert_answer(&[0, 65_535], bound(128.0), Stored, 8, 0.0);
    // 129 is 128 from the value at 257 and from the one at 1: ties do not exist, as the step is odd.
    assert_answer(&[0, 128, 129, 65_535], bound(128.0), Stored, 8, 128.0);
    // A bound that is no whole number is its floor.
    assert_answer(&[0, 128, 129, 65_535], bound(128.9), Stored, 8, 128.0);
    // u8 on ranges up to 255 is exact; on 65535 the step is 257, and 128 reads as 0 or 257.
    for range in [1, 2, 255] {
        assert_answer(&[0, range / 2, range], Encoding::Quantised8, Stored, 8, 0.0);
    }
    assert_answer(&[0, 128, 65_535], Encoding::Quantised8, Stored, 8, 128.0);
    // A checkerboard of the ends.
    assert_answer(&[0, 65_535], Encoding::Quantised8, Stored, 8, 0.0);
}

#[test]
fn a_bound_that_sixteen_bits_cannot_hold_is_lossless_in_that_brick() {
    let wide = brick(&[0_u32, 1, 70_000, u32::MAX]);
    let (record, _) = encoded(&wide, bound(0.0), Anchor::Brick);
    assert_eq!((record.coding, record.bits, record.error.amax), (Coding::Lossless, 32, 0.0));
    let (record, _) = encoded(&wide, bound(32_768.0), Anchor::Brick);
    assert_eq!((record.coding, record.bits), (Coding::Bounded, 16));
    let floats = brick(&[0.0_f32, -0.0, 1e-30, 1e30]);
    let (record, read) = encoded(&floats, bound(1e-31), Anchor::Brick);
    assert_eq!((record.coding, record.bits), (Coding::Lossless, 32));
    assert!(read[1].is_sign_negative(), "-0 stays");
    // Above 2^24 an f32 has steps of 2. With a bound of 1.5 the values lie 2.98 apart, and rounding takes
    // the one that is 1.4 away to a sample that is 2 away.
    let coarse: Vec<f32> = (0..21_u8).map(|i| 16_777_216.0 + 2.0 * f32::from(i)).collect();
    assert_every_encoding_keeps_its_word(&coarse);
    let (record, read) = encoded(&brick(&coarse), bound(1.5), Anchor::Brick);
    assert_eq!((record.coding, record.error.amax), (Coding::Lossless, 0.0));
    assert_eq!(read, brick(&coarse));
}

#[test]
fn small_differences_take_the_bits_of_the_differences() {
    // Noise of 10 bits on 40,000, in 16-bit samples.
    let noise: Vec<u16> = (0..SIDE.pow(3) as u64)
        .map(|i| 40_000 + (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 54) as u16)
        .collect();
    let (record, read) = encoded(&noise, bound(0.0), Anchor::Brick);
    assert_eq!((record.bits, record.place.length as usize), (10, 10 * noise.len() / 8));
    assert_eq!(read, noise);
}

#[test]
fn bits_that_do_not_follow_from_range_and_bound_are_damage() {
    let samples = brick(&[0_u16, 1000]);
    let (record, _) = encoded(&samples, bound(3.0), Anchor::Brick);
    let decoding = Decoding { encoding: bound(3.0), anchor: Anchor::Brick };
    for bits in [0, record.bits - 1, record.bits + 1, 16, 17, 255] {
        let wrong = NodeRecord { bits, filter: Filter::NONE, ..record };
        let payload = vec![0; 2 * samples.len()];
        for length in [0, samples.len(), payload.len()] {
            let mut read = samples.clone();
            let mut scratch = DecodeScratch::default();
            assert!(decoding.decode(&wrong, &payload[..length], &mut scratch, &mut read).is_err());
        }
    }
}

proptest! {
    #[test]
    fn records_and_payloads_that_nobody_made_are_errors_or_values_within_the_range(
        payload in proptest::collection::vec(any::<u8>(), 0..9000), ids in any::<[u8; 4]>(),
        ranges in any::<[u64; 2]>(), error in any::<u64>(), as_codes in any::<bool>(),
    ) {
        let [coding, bits, filter, compression] = ids;
        let filters: Vec<_> = Filter::all().collect();
        let samples = brick(&[0_u16, 1000]);
        let (mut record, _) = encoded(&samples, bound(1.0), Anchor::Brick);
        record.coding = Coding::from_id(coding % 3 + 1).unwrap();
        record.filter = filters[usize::from(filter) % filters.len()];
        record.compression = Compression::from_id(compression % 3).unwrap();
        if !as_codes {
            record.bits = bits;
            record.brick_min = f64::from_bits(ranges[0]);
            record.brick_max = f64::from_bits(ranges[1]);
        }
        let error = Encoding::max_error(f64::from_bits(error)).unwrap_or(bound(1.0));
        for encoding in [error, bound(1.0), Encoding::Quantised8] {
            for sample_type in SampleType::ALL {
                with_sample_type!(sample_type, T => {
                    let mut read = vec![T::default(); SIDE.pow(3)];
                    let decoding = Decoding { encoding, anchor: Anchor::Brick };
                    let mut scratch = DecodeScratch::default();
                    for length in [payload.len(), read.len() * usize::from(bits % 17) / 8, read.len(), 0] {
                        let payload = &payload[..length.min(payload.len())];
                        let decoded = decoding.decode(&record, payload, &mut scratch, &mut read);
                        if decoded.is_ok() && record.coding != Coding::Lossless {
                            let (min, max) = (T::from_f64(record.brick_min), T::from_f64(record.brick_max));
                            prop_assert!(read.iter().all(|v| (min..=max).contains(v)));
                        }
                    }
                });
            }
        }
    }
}
