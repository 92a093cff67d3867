//! From a brick's samples to a payload and back.
//!
//! An encoding turns samples into codes ([`quantised8`], [`bounded`]) or takes their bits as they are, a
//! filter arranges these words ([`Filter`]), a compression packs them ([`payload`]). Each has an id in
//! FORMAT.md.

mod bit_planes;
pub mod bounded;
mod choice;
pub(crate) mod decode;
mod effort;
#[cfg(test)]
mod extremes;
mod filter;
mod integer_errors;
pub mod payload;
mod predict;
pub mod quantised8;
mod store_words;
mod upload;
pub(crate) mod words;

pub use choice::{Encoding, MaxError, OverlapAtRest};
pub use effort::Effort;
pub use filter::{Arrangement, Filter, Prediction};
pub use upload::{Upload, UploadFormat, ValueMap};

use crate::error_sum::ErrorSum;
use crate::key::NodeKey;
use crate::record::{BrickState, NodeRecord, PayloadPlace};
use crate::sample::Sample;
use bounded::Anchor;
use multiversion::multiversion;
use std::ops::Range;
use words::{Word, buffer, with_word};

/// What the words of a payload are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Coding {
    /// Codes of eight bits, linear over the brick's range.
    Quantised8 = 1,
    /// The samples' own bits.
    Lossless = 2,
    /// Codes of as many bits as the store's error bound needs.
    Bounded = 3,
}

impl Coding {
    /// The coding with this id in FORMAT.md.
    pub fn from_id(id: u8) -> Option<Self> {
        [Self::Quantised8, Self::Lossless, Self::Bounded]
            .into_iter()
            .find(|coding| *coding as u8 == id)
    }
}

/// How a payload's bytes are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Compression {
    /// Not at all: compression would have gained nothing.
    Raw = 0,
    /// One LZ4 block without a length prefix.
    Lz4 = 1,
    /// One Zstandard frame.
    Zstd = 2,
}

impl Compression {
    /// The compression with this id in FORMAT.md.
    pub fn from_id(id: u8) -> Option<Self> {
        [Self::Raw, Self::Lz4, Self::Zstd].into_iter().find(|compression| *compression as u8 == id)
    }
}

/// The finite range of samples, or `None` where there is no finite one.
pub fn finite_range<T: Sample>(samples: &[T]) -> Option<(T, T)> {
    let (min, max) = min_and_max(samples);
    let any = T::TYPE.is_integer() || min < max || samples.iter().any(|v| v.is_finite());
    (min <= max && any).then_some((min, max))
}

/// Without a branch a sample: what is not finite takes the place of an identity.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn min_and_max<T: Sample>(samples: &[T]) -> (T, T) {
    let (mut min, mut max) = (T::GREATEST, T::LEAST);
    // A loop and no `fold`: a closure would not inherit the function's instruction set.
    for &v in samples {
        let low = if v.is_finite() { v } else { T::GREATEST };
        let high = if v.is_finite() { v } else { T::LEAST };
        min = if low < min { low } else { min };
        max = if high > max { high } else { max };
    }
    (min, max)
}

/// How bricks are encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickFormat {
    /// What becomes of samples.
    pub encoding: Encoding,
    /// How much work goes into small payloads.
    pub effort: Effort,
    /// Samples on every side that are left out of the payload, because a reader assembles them from the
    /// neighbours; `None` where the payload holds all samples.
    pub cut_overlap: Option<u32>,
}

impl BrickFormat {
    /// Payloads that hold the overlap.
    pub fn stored(encoding: Encoding, effort: Effort) -> Self {
        Self { encoding, effort, cut_overlap: None }
    }
}

/// A brick's record and payload, with the error counted over `measured` samples of it.
///
/// The payload is added to `payloads`, and its length stands in the record.
///
/// `samples` is the whole brick and `range` its [`finite_range`]; `measured` yields the indices of its in-volume core voxels. The
/// record's ranges are the brick's own; its place, child mask and LOD bounds are left at zero.
pub fn encode_brick<T: Sample>(
    key: NodeKey,
    samples: &[T],
    format: BrickFormat,
    range: Option<(T, T)>,
    measured: impl Iterator<Item = Range<usize>> + Clone,
    scratch: &mut EncodeScratch,
    payloads: &mut Vec<u8>,
) -> NodeRecord {
    // A brick without a finite sample has no range; 0 stands for it.
    let (min, max) = range.unwrap_or_default();
    let mut record = NodeRecord {
        key,
        state: BrickState::Stored,
        coding: Coding::Lossless,
        bits: 8 * size_of::<T>() as u8,
        filter: Filter::NONE,
        compression: Compression::Raw,
        child_mask: 0,
        place: PayloadPlace::default(),
        payload_checksum: 0,
        brick_min: min.to_f64(),
        brick_max: max.to_f64(),
        subtree_min: min.to_f64(),
        subtree_max: max.to_f64(),
        error: ErrorSum::default(),
        lod_rms_bound: 0.0,
        lod_amax_bound: 0.0,
    };
    let exact = match format.encoding {
        Encoding::Lossless => true,
        // Integers have codes of fewer bits that are exact.
        Encoding::MaxError(error) => error.get() == 0.0 && !T::TYPE.is_integer(),
        Encoding::Quantised8 => false,
    };
    let uniform = if exact {
        range.is_some() && samples.iter().all(|sample| sample.same_bits(samples[0]))
    } else {
        min == max
    };
    if uniform {
        record.state = BrickState::Uniform;
        record.bits = 0;
        count_finite(samples, measured, &mut record.error);
        return record;
    }
    match format.encoding {
        Encoding::Quantised8 => {
            record.coding = Coding::Quantised8;
            record.bits = 8;
            let quantiser = quantised8::Quantiser::new(min, max);
            let EncodeScratch { codes, core, store } = scratch;
            let codes = buffer(codes, samples.len());
            quantiser.quantise(samples, codes);
            record.error = quantiser.errors(samples, codes, measured);
            let core = cut(codes, format.cut_overlap, core);
            store_words::store(core, format.effort, &mut record, store, payloads);
            return record;
        }
        Encoding::MaxError(error) if !exact => {
            let anchor = if format.cut_overlap.is_some() { Anchor::Lattice } else { Anchor::Brick };
            let stored =
                bounded::Quantiser::new(min, max, error, anchor).is_some_and(|quantiser| {
                    let store = if quantiser.bits() <= 8 {
                        store_bounded::<T, u8, _>
                    } else {
                        store_bounded::<T, u16, _>
                    };
                    let measured = measured.clone();
                    store(&quantiser, samples, format, measured, &mut record, scratch, payloads)
                });
            if stored {
                return record;
            }
        }
        Encoding::MaxError(_) | Encoding::Lossless => {}
    }
    count_finite(samples, measured, &mut record.error);
    with_word!(T, W => {
        let words: &[W] = bytemuck::cast_slice(samples);
        let words = cut(words, format.cut_overlap, &mut scratch.core);
        store_words::store(words, format.effort, &mut record, &mut scratch.store, payloads);
    });
    record
}

/// Encodes a brick with a quantiser's codes; false, and nothing done, where a sample would be off by more
/// than the bound.
fn store_bounded<T: Sample, W: Word, I: Iterator<Item = Range<usize>>>(
    quantiser: &bounded::Quantiser<T>,
    samples: &[T],
    format: BrickFormat,
    measured: I,
    record: &mut NodeRecord,
    scratch: &mut EncodeScratch,
    payloads: &mut Vec<u8>,
) -> bool {
    let EncodeScratch { codes, core, store } = scratch;
    let codes = buffer::<W>(codes, samples.len());
    quantiser.quantise(samples, codes);
    if !quantiser.holds(samples, codes) {
        return false;
    }
    record.coding = Coding::Bounded;
    record.bits = quantiser.bits();
    record.error = quantiser.errors(samples, codes, measured);
    if record.bits > 0 {
        let core = cut(codes, format.cut_overlap, core);
        store_words::store(core, format.effort, record, store, payloads);
    }
    true
}

/// The words without `overlap` of them on every side of their cube.
///
/// # Panics
/// When they are no cube, or not larger than that.
fn cut<'a, W: Word>(words: &'a [W], overlap: Option<u32>, core: &'a mut Vec<u64>) -> &'a [W] {
    let Some(overlap) = overlap.filter(|overlap| *overlap > 0) else { return words };
    let side = predict::side_of(words.len()).expect("bricks are cubes");
    let overlap = overlap as usize;
    let inner = side - 2 * overlap;
    let core = buffer(core, inner.pow(3));
    for (row, to) in core.chunks_exact_mut(inner).enumerate() {
        let (y, z) = (row % inner + overlap, row / inner + overlap);
        to.copy_from_slice(&words[(z * side + y) * side + overlap..][..inner]);
    }
    core
}

/// Counts finite samples, all of which come back exactly.
fn count_finite<T: Sample>(
    samples: &[T],
    measured: impl Iterator<Item = std::ops::Range<usize>>,
    error: &mut ErrorSum,
) {
    for span in measured {
        error.voxels += samples[span].iter().filter(|v| v.is_finite()).count() as u64;
    }
}

/// A brick's record and payload, with the error counted over every sample.
///
/// For bricks made by hand; a conversion counts in-volume core voxels alone
/// ([`encode_brick`]).
pub fn encode_samples<T: Sample>(
    key: NodeKey,
    samples: &[T],
    encoding: Encoding,
) -> (NodeRecord, Vec<u8>) {
    let all = std::iter::once(0..samples.len());
    let how = BrickFormat::stored(encoding, Effort::default());
    let (mut scratch, mut payload) = (EncodeScratch::default(), Vec::new());
    let range = finite_range(samples);
    let record = encode_brick(key, samples, how, range, all, &mut scratch, &mut payload);
    (record, payload)
}

/// Buffers that [`encode_brick`] keeps from brick to brick.
#[derive(Debug, Default)]
pub struct EncodeScratch {
    codes: Vec<u64>,
    core: Vec<u64>,
    store: store_words::StoreScratch,
}
