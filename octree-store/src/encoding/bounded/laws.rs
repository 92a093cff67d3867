//! What holds for every quantiser of the `max-error` encoding, against a twin in whole numbers.

use super::{Anchor, Quantiser};
use crate::encoding::MaxError;
use crate::encoding::finite_range;
use crate::error_sum::ErrorSum;
use crate::sample::{Sample, SampleType};
use crate::with_sample_type;
use proptest::prelude::*;

const ANCHORS: [Anchor; 2] = [Anchor::Brick, Anchor::Lattice];

fn quantiser<T: Sample>(min: T, max: T, error: f64, anchor: Anchor) -> Option<Quantiser<T>> {
    Quantiser::new(min, max, MaxError::new(error).unwrap(), anchor)
}

/// What the module says of integers, in i128.
fn integer_twin(v: i128, min: i128, max: i128, error: f64, anchor: Anchor) -> (i128, i128, i128) {
    let half = error.floor().min(1e12) as i128;
    let step = 2 * half + 1;
    let (first, count) = match anchor {
        Anchor::Brick => {
            let count = (max - min) / step + 1;
            let left = (max - min) - (count - 1) * step;
            (min + left / 2, count)
        }
        Anchor::Lattice => {
            let number = |v: i128| (v + half).div_euclid(step);
            (number(min) * step, number(max) - number(min) + 1)
        }
    };
    let code = (v - first + half).div_euclid(step);
    (code, (first + code * step).clamp(min, max), count)
}

/// Quantises in the narrowest words and decodes again; the laws hold for every anchor.
fn assert_laws<T: Sample>(samples: &[T], error: f64) {
    let Some((min, max)) = finite_range(samples) else { return };
    for anchor in ANCHORS {
        let Some(quantiser) = quantiser(min, max, error, anchor) else { continue };
        let mut codes = vec![0_u16; samples.len()];
        quantiser.quantise(samples, &mut codes);
        let mut decoded = vec![T::default(); samples.len()];
        quantiser.decode(&codes, &mut decoded);
        for (code, decoded) in codes.iter().zip(&decoded) {
            assert!(*code <= quantiser.last);
            assert!(
                decoded.same_bits(quantiser.value(*code)) || *decoded == quantiser.value(*code)
            );
            assert!((min..=max).contains(decoded), "{decoded} outside {min}..{max}");
        }
        if quantiser.bits() <= 8 {
            let mut narrow = vec![0_u8; samples.len()];
            quantiser.quantise(samples, &mut narrow);
            assert!(narrow.iter().zip(&codes).all(|(a, b)| u16::from(*a) == *b));
            let mut again = decoded.clone();
            quantiser.decode(&narrow, &mut again);
            assert_eq!(again, decoded);
        }
        if !quantiser.holds(samples, &codes) {
            assert!(!T::TYPE.is_integer(), "integers always hold: {error}, {min}..{max}");
            continue;
        }
        let finite = samples.iter().zip(&decoded).filter(|(v, _)| v.is_finite());
        for (v, d) in finite {
            assert!((v.to_f64() - d.to_f64()).abs() <= error, "{v} became {d}, bound {error}");
        }
        // Monotone, and what was read is read again.
        let mut order: Vec<_> = (0..samples.len()).filter(|&i| samples[i].is_finite()).collect();
        order.sort_by(|a, b| samples[*a].partial_cmp(&samples[*b]).unwrap());
        assert!(order.windows(2).all(|pair| codes[pair[0]] <= codes[pair[1]]));
        let mut requantised = codes.clone();
        quantiser.quantise(&decoded, &mut requantised);
        assert_eq!(requantised, codes, "{error} {anchor:?} {min}..{max}");
    }
}

proptest! {
    #[test]
    fn integers_are_those_of_the_twin_in_whole_numbers(
        bits in proptest::collection::vec(any::<u64>(), 2..60), narrow in 0_u32..32,
        error in prop_oneof![0.0..4.0, 0.0..1e3, 0.0..1e7, Just(1e18)],
    ) {
        for sample_type in SampleType::ALL.into_iter().filter(|t| t.is_integer()) {
            with_sample_type!(sample_type, T => {
                let width = 8 * size_of::<T>() as u32;
                let samples: Vec<T> = bits
                    .iter()
                    .map(|b| T::from_le_slice(&((b << (64 - width)) as i64 >> (64 - width) >> (narrow % width)).to_le_bytes()[..size_of::<T>()]))
                    .collect();
                assert_laws(&samples, error);
                let (min, max) = finite_range(&samples).unwrap();
                for anchor in ANCHORS {
                    let whole = |v: T| v.to_f64() as i128;
                    let twin = |v| integer_twin(whole(v), whole(min), whole(max), error, anchor);
                    let (_, _, count) = twin(min);
                    let Some(quantiser) = quantiser(min, max, error, anchor) else {
                        prop_assert!(count > 65_536);
                        continue;
                    };
                    // The fewest bits that hold the codes.
                    prop_assert!(1_i128 << quantiser.bits() >= count);
                    prop_assert!(quantiser.bits() == 0 || 1_i128 << (quantiser.bits() - 1) < count);
                    let mut codes = vec![0_u16; samples.len()];
                    quantiser.quantise(&samples, &mut codes);
                    for (v, code) in samples.iter().zip(codes) {
                        let (expected, read, _) = twin(*v);
                        prop_assert_eq!(i128::from(code), expected);
                        prop_assert_eq!(whole(quantiser.value(code)), read);
                    }
                }
            });
        }
    }

    #[test]
    fn floats_of_any_bits_are_within_the_bound(
        bits in proptest::collection::vec(any::<u64>(), 2..60), error in any::<u64>(),
    ) {
        let error = f64::from_bits(error).abs();
        if MaxError::new(error).is_some() {
            assert_laws(&bits.iter().map(|&b| f64::from_bits(b)).collect::<Vec<_>>(), error);
            assert_laws(&bits.iter().map(|&b| f32::from_bits(b as u32)).collect::<Vec<_>>(), error);
        }
    }

    #[test]
    fn ordinary_floats_are_within_the_bound_and_not_stored_lossless(
        base in -1.0_f32..1.0, range in 1.0_f32..1e6, share in -4.7_f64..0.3,
        at in proptest::collection::vec(0.0_f32..1.0, 2..4000),
    ) {
        let share = 10_f64.powf(share);
        let narrow: Vec<f32> = at.iter().map(|t| (base + t) * range).collect();
        let wide: Vec<f64> = narrow.iter().map(|v| f64::from(*v) + 1e-9).collect();
        let error = share * f64::from(range);
        assert_laws(&narrow, error);
        assert_laws(&wide, error);
        let (min, max) = finite_range(&narrow).unwrap();
        for anchor in ANCHORS {
            if let Some(quantiser) = quantiser(min, max, error, anchor) {
                let mut codes = vec![0_u16; narrow.len()];
                quantiser.quantise(&narrow, &mut codes);
                prop_assert!(quantiser.holds(&narrow, &codes));
            } else {
                prop_assert!(share < 1e-5);
            }
        }
    }
}

#[test]
fn division_of_small_integers_is_exact_at_every_edge_of_every_step() {
    for half in 0..=32_767_u32 {
        let quantiser = quantiser(0_u16, u16::MAX, f64::from(half), Anchor::Brick).unwrap();
        let step = 2 * half + 1;
        let first = u32::from(u16::MAX) % step / 2;
        let edges: Vec<u16> = (0..=u32::MAX)
            .map(|q| i64::from(first) - i64::from(half) + i64::from(q) * i64::from(step))
            .take_while(|edge| *edge <= 65_535)
            .flat_map(|edge| [edge - 1, edge])
            .filter_map(|v| u16::try_from(v).ok())
            .collect();
        let mut codes = vec![0_u16; edges.len()];
        quantiser.quantise(&edges, &mut codes);
        for (v, code) in edges.iter().zip(codes) {
            let expected = (u32::from(*v) + half - first) / step;
            assert_eq!(u32::from(code), expected, "{v} with step {step}");
        }
    }
}

#[test]
fn bits_are_the_fewest() {
    // Codes: floor(range / (2 E + 1)) + 1.
    for (range, error, bits) in [
        (1_u16, 0.0, 1),
        (2, 0.0, 2),
        (255, 0.0, 8),
        (256, 0.0, 9),
        (65_535, 0.0, 16),
        (1, 0.5, 1),
        (1, 1.0, 0),
        (2, 1.0, 0),
        (3, 1.0, 1),
        (65_535, 127.0, 9),
        (65_535, 128.0, 8),
        (65_535, 32_767.0, 1),
        (65_535, 32_768.0, 0),
        (65_535, 1e300, 0),
        (100, 50.9, 0),
        (100, 49.9, 1),
    ] {
        let quantiser = quantiser(
            7_000 % (u16::MAX - range + 1),
            7_000 % (u16::MAX - range + 1) + range,
            error,
            Anchor::Brick,
        );
        assert_eq!(quantiser.unwrap().bits(), bits, "range {range}, bound {error}");
    }
    assert!(quantiser(0_u32, 65_535, 0.0, Anchor::Brick).is_some());
    assert!(quantiser(0_u32, 65_536, 0.0, Anchor::Brick).is_none(), "more than 16 bits");
    assert!(quantiser(0.0_f32, 1.0, 0.0, Anchor::Brick).is_none(), "floats without error");
}

#[test]
fn one_code_reads_as_the_middle() {
    let one = quantiser(100_u16, 200, 1e9, Anchor::Brick).unwrap();
    assert_eq!((one.bits(), one.value(0), one.value(9)), (0, 150, 150));
    let one = quantiser(1.0_f32, 2.0, 1e9, Anchor::Brick).unwrap();
    assert_eq!((one.bits(), one.value(0)), (0, 1.5));
}

#[test]
fn every_code_reads_as_a_value_within_the_range() {
    let codes: Vec<u16> = (0..=u16::MAX).collect();
    for anchor in ANCHORS {
        let mut read = vec![0_i16; codes.len()];
        let quantiser = quantiser(-300_i16, 4_000, 3.0, anchor).unwrap();
        quantiser.decode(&codes, &mut read);
        assert!(read.is_sorted() && read.iter().all(|v| (-300..=4_000).contains(v)));
        assert_eq!(read[usize::from(quantiser.last)..].iter().min(), read.last());
    }
}

#[test]
fn extremes_hold() {
    for error in [0.0, 5e-324, 1e-40, 1e-30, 0.4, 1.0, 50.0, 1e9, 1e30, 1e38, 1e300, f64::MAX] {
        assert_laws(&[f32::MIN, -1.0, 0.0, 1.0, f32::MAX], error);
        assert_laws(&[f64::MIN, 0.0, 1e300, f64::MAX], error);
        assert_laws(&[0.0, f32::from_bits(1), f32::from_bits(100)], error);
        assert_laws(&[0.0, f64::from_bits(1), f64::from_bits(1000)], error);
        assert_laws(&[1e30_f32, 1e-30, 0.0, -0.0], error);
        assert_laws(&[1.0_f32, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2.0], error);
        assert_laws(&[i16::MIN, -1, 0, i16::MAX], error);
        assert_laws(&[0, 1, u32::MAX - 1, u32::MAX], error);
        assert_laws(&[i32::MIN, 0, (1 << 24) + 1, i32::MAX], error);
    }
    // f32's whole range in 16 bits, where it overflows f32.
    let wide = quantiser(f32::MIN, f32::MAX, 1e34, Anchor::Brick).unwrap();
    assert_eq!(wide.bits(), 16);
    // f64's does not fit f64.
    assert!(quantiser(f64::MIN, f64::MAX, 1e307, Anchor::Brick).is_none());
}

#[test]
fn not_a_number_reads_as_the_minimum_does_and_infinities_clamp() {
    let samples = [2.0_f32, f32::NAN, 4.0, f32::INFINITY, f32::NEG_INFINITY];
    let quantiser = quantiser(2.0, 4.0, 0.1, Anchor::Brick).unwrap();
    let mut codes = [0_u8; 5];
    quantiser.quantise(&samples, &mut codes);
    assert_eq!([codes[1], codes[3], codes[4]], [codes[0], codes[2], codes[0]]);
}

#[test]
fn bricks_that_share_a_lattice_read_a_shared_value_alike() {
    // The range of one brick lies within the other's; neither clamps in the middle.
    let (a, b) = (
        quantiser(0_u16, 40_000, 50.0, Anchor::Lattice),
        quantiser(10_133, 30_777, 50.0, Anchor::Lattice),
    );
    for v in (10_300..30_600).step_by(7) {
        let read = |quantiser: &Quantiser<u16>| {
            let mut code = [0_u16];
            quantiser.quantise(&[v], &mut code);
            quantiser.value(code[0])
        };
        assert_eq!(read(&a.unwrap()), read(&b.unwrap()));
    }
}

#[test]
fn errors_over_spans_are_those_of_the_decoded_samples() {
    let samples: Vec<u16> = (0..900_u32).map(|i| (i * 7919 % 50_021) as u16).collect();
    let quantiser = quantiser(0, 50_020, 50.0, Anchor::Brick).unwrap();
    let mut codes = vec![0_u16; samples.len()];
    quantiser.quantise(&samples, &mut codes);
    let decoded: Vec<u16> = codes.iter().map(|code| quantiser.value(*code)).collect();
    let mut expected = ErrorSum::default();
    expected.add_all(&samples[5..300], &decoded[5..300]);
    expected.add_all(&samples[310..311], &decoded[310..311]);
    let errors = quantiser.errors(&samples, &codes, [5..300, 310..311].into_iter());
    assert_eq!(
        (errors.voxels, errors.squares, errors.amax),
        (expected.voxels, expected.squares, expected.amax)
    );
}
