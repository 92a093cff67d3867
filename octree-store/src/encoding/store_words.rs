//! From words to a payload: which filter serves a brick, and what compression gains on it.
//!
//! - `fast`: as few bits as the words use, as they are.
//! - `balanced`: LZ4, where a trial on an eighth of the brick says which filter gains most, if any.
//! - `small`: Zstandard, whose Huffman coder gains on noise too, after the prediction whose differences
//!   have the least entropy: none where there is noise alone, Lorenzo's where there is structure alone, the mean
//!   of neighbours where there are both.

use super::effort::Effort;
use super::filter::{Arrangement, Filter, Prediction};
use super::payload::{self, Packer, gains};
use super::predict;
use super::words::{Word, arrange, arranged_bytes, buffer};
use crate::encoding::{Coding, Compression};
use crate::record::NodeRecord;

/// Buffers that are kept from brick to brick.
#[derive(Debug, Default)]
pub(super) struct StoreScratch {
    residuals: Vec<u64>,
    tried: Vec<u64>,
    pub(super) arranged: Vec<u8>,
    pub(super) packer: Packer,
}

/// Pieces of a brick that filters are tried on, and the share of it that each has.
const PIECES: usize = 8;
const PIECE_SHARE: usize = 64;

/// Adds a brick's words to `payloads`; writes filter, compression, length and checksum into the record,
/// whose `bits` are known.
pub(super) fn store<W: Word>(
    words: &[W],
    effort: Effort,
    record: &mut NodeRecord,
    scratch: &mut StoreScratch,
    payloads: &mut Vec<u8>,
) {
    let bits = record.bits;
    let plain = plain::<W>(bits);
    let plain_bytes = arranged_bytes::<W>(words.len(), bits, plain);
    let chosen = match effort {
        Effort::Fast => None,
        Effort::Balanced if record.coding == Coding::Quantised8 => {
            // Eight bits that noise fills: the trial that costs least.
            let bytes = bytemuck::cast_slice(words);
            payload::worth_trying(bytes, &mut scratch.packer).then_some(Filter::NONE)
        }
        Effort::Balanced => tried(words, bits, scratch),
        Effort::Small => Some(predicted(words, scratch)),
    };
    let StoreScratch { residuals, arranged, packer, .. } = scratch;
    if let Some(filter) = chosen {
        let bytes = arranged_in(words, bits, filter, residuals, arranged);
        if let Some((compression, packed)) = packer.pack(bytes, plain_bytes, effort) {
            record.filter = filter;
            record.compression = compression;
            return payload::add(packed, record, payloads);
        }
    }
    record.filter = plain;
    record.compression = Compression::Raw;
    payload::add(arranged_in(words, bits, plain, residuals, arranged), record, payloads);
}

/// The arranged words: in `arranged`, or where they are if that is the same.
fn arranged_in<'a, W: Word>(
    words: &'a [W],
    bits: u8,
    filter: Filter,
    residuals: &mut Vec<u64>,
    arranged: &'a mut Vec<u8>,
) -> &'a [u8] {
    if W::BITS == 8 && filter == Filter::NONE {
        return bytemuck::cast_slice(words);
    }
    arrange(words, bits, filter, residuals, arranged);
    arranged
}

/// The filter of words that are not compressed: no more bits than they use.
fn plain<W: Word>(bits: u8) -> Filter {
    let arrangement = if bits == W::BITS { Arrangement::InOrder } else { Arrangement::BitPlanes };
    Filter { prediction: Prediction::None, arrangement }
}

/// The filter with which LZ4 gains most on an eighth of the words, spread evenly; none where it is not
/// worth the time of unpacking.
fn tried<W: Word>(words: &[W], bits: u8, scratch: &mut StoreScratch) -> Option<Filter> {
    let as_they_are = match plain::<W>(bits) {
        Filter { arrangement: Arrangement::InOrder, .. } if W::BITS > 8 => {
            Filter { arrangement: Arrangement::BytePlanes, ..Filter::NONE }
        }
        plain => plain,
    };
    let differences =
        Filter { prediction: Prediction::Previous, arrangement: Arrangement::BitPlanes };
    let piece = words.len() / PIECE_SHARE;
    if piece < 64 {
        return Some(as_they_are);
    }
    let StoreScratch { residuals, tried, arranged, packer } = scratch;
    let tried = buffer::<W>(tried, PIECES * piece);
    for (i, tried) in tried.chunks_exact_mut(piece).enumerate() {
        tried.copy_from_slice(&words[words.len() / PIECES * i..][..piece]);
    }
    let plain_bytes = arranged_bytes::<W>(tried.len(), bits, plain::<W>(bits));
    let mut packed_bytes = |filter: &Filter| {
        arrange(tried, bits, *filter, residuals, arranged);
        packer.lz4(arranged).map_or(usize::MAX, <[u8]>::len)
    };
    let best = [as_they_are, differences].map(|filter| (packed_bytes(&filter), filter));
    let (bytes, filter) = if best[0].0 <= best[1].0 { best[0] } else { best[1] };
    gains(bytes, plain_bytes).then_some(filter)
}

/// What predicting must gain, in bits a word: undoing it takes time.
const PREDICTION_GAIN_BITS: f64 = 0.05;

/// What may be predicted from.
const PREDICTIONS: [Prediction; 4] =
    [Prediction::None, Prediction::Previous, Prediction::Lorenzo, Prediction::Mean];

/// The filter whose bytes have the least entropy, each byte of the words for itself; estimated on a
/// sixth of a brick's rows.
fn predicted<W: Word>(words: &[W], scratch: &mut StoreScratch) -> Filter {
    let side = predict::side_of(words.len());
    // What is no cube is taken as rows of 32.
    let width = side.unwrap_or(32).min(words.len());
    let rows = words.len() / width.max(1);
    let sampled = (0..rows).filter(|row| match side {
        Some(side) => row % side % 3 == 1 && row / side % 2 == 1,
        None => row % 6 == 1,
    });
    let residuals = buffer::<W>(&mut scratch.residuals, width);
    let mut histograms = vec![[[0_u32; 256]; PREDICTIONS.len()]; size_of::<W>()];
    let mut count = 0;
    for row in sampled {
        count += width;
        let row_words = &words[row * width..][..width];
        add_row(&mut histograms, 0, row_words);
        predict::residuals(row_words, Prediction::Previous, residuals);
        add_row(&mut histograms, 1, residuals);
        if let Some(side) = side {
            predict::lorenzo_row(words, side, row, residuals);
            add_row(&mut histograms, 2, residuals);
            predict::mean_row(words, side, row, residuals);
            add_row(&mut histograms, 3, residuals);
        }
    }
    let mut best = (f64::INFINITY, Prediction::None);
    for (place, prediction) in PREDICTIONS.into_iter().enumerate() {
        if side.is_none() && prediction.is_for_cubes() {
            continue;
        }
        let bits: f64 = histograms.iter().map(|of| entropy_bits(&of[place], count)).sum();
        let cost = if prediction == Prediction::None { 0.0 } else { PREDICTION_GAIN_BITS };
        if bits + cost < best.0 {
            best = (bits + cost, prediction);
        }
    }
    let arrangement = if W::BITS > 8 { Arrangement::BytePlanes } else { Arrangement::InOrder };
    Filter { prediction: best.1, arrangement }
}

/// The histograms of a byte of the words, one for each of [`PREDICTIONS`].
type Histograms = [[u32; 256]; PREDICTIONS.len()];

fn add_row<W: Word>(histograms: &mut [Histograms], prediction: usize, words: &[W]) {
    for (index, of) in histograms.iter_mut().enumerate() {
        for word in words {
            of[prediction][usize::from(word.byte(index))] += 1;
        }
    }
}

/// Shannon's entropy, in bits a byte.
fn entropy_bits(histogram: &[u32; 256], count: usize) -> f64 {
    let all = count as f64;
    let bits = |n: u32| f64::from(n) * (all / f64::from(n)).log2();
    histogram.iter().filter(|n| **n > 0).map(|n| bits(*n)).sum::<f64>() / all.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::{Encoding, encode_samples};
    use crate::key::NodeKey;

    /// A brick of x, y, z and noise: a number up to 31 that differs from sample to sample.
    fn brick(at: impl Fn([u16; 3], u16) -> u16) -> Vec<u16> {
        let noise = |i: u64| {
            let v = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
            ((v ^ (v >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 59) as u16
        };
        (0..36 * 36 * 36_u64)
            .map(|i| at([i % 36, i / 36 % 36, i / 36 / 36].map(|v| v as u16), noise(i)))
            .collect()
    }

    fn stored(words: &[u16], effort: Effort) -> (NodeRecord, usize) {
        let (mut record, _) = encode_samples(NodeKey::new(0, [0; 3]), words, Encoding::Lossless);
        let mut payloads = Vec::new();
        store(words, effort, &mut record, &mut StoreScratch::default(), &mut payloads);
        (record, payloads.len())
    }

    fn packed(words: &[u16], effort: Effort, filter: Filter) -> usize {
        let (mut residuals, mut bytes) = (Vec::new(), Vec::new());
        arrange(words, 16, filter, &mut residuals, &mut bytes);
        Packer::default().pack(&bytes, usize::MAX, effort).unwrap().1.len()
    }

    #[test]
    fn small_predicts_what_costs_least() {
        for (words, prediction) in [
            (brick(|_, noise| 300 * noise), Prediction::None),
            (brick(|[x, y, z], _| 40 * x * y + 7 * z * z), Prediction::Lorenzo),
            (brick(|[x, y, z], noise| 9 * (x + y + z) + noise), Prediction::Mean),
        ] {
            let (record, bytes) = stored(&words, Effort::Small);
            assert_eq!(record.filter.prediction, prediction);
            for prediction in PREDICTIONS {
                let filter = Filter { prediction, arrangement: Arrangement::BytePlanes };
                let other = packed(&words, Effort::Small, filter);
                assert!(bytes <= other * 103 / 100, "{bytes} {prediction:?} {other}");
            }
        }
    }

    #[test]
    fn balanced_takes_the_filter_that_gains_most() {
        let mixed = |v: u16| {
            let v = v.wrapping_add(1).wrapping_mul(40_503);
            (v ^ (v >> 7)).wrapping_mul(40_503)
        };
        let by_byte = Filter { arrangement: Arrangement::BytePlanes, ..Filter::NONE };
        let differences =
            Filter { prediction: Prediction::Previous, arrangement: Arrangement::BitPlanes };
        for (words, best) in [
            (brick(|[x, y, z], _| 40 * x * y + 7 * z * z), differences),
            // Rows of one text, each from another place on: their bytes repeat, their bits do not.
            (brick(|[x, y, z], _| mixed(x + mixed(36 * z + y) % 61)), by_byte),
        ] {
            let (record, bytes) = stored(&words, Effort::Balanced);
            assert_eq!(record.filter, best);
            for filter in [by_byte, differences] {
                let other = packed(&words, Effort::Balanced, filter);
                assert!(bytes <= other, "{bytes} {filter:?} {other}");
            }
        }
    }
}
