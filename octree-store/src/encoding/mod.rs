//! From a brick's samples to a payload and back.
//!
//! An encoding turns samples into bytes ([`quantised8`], [`lossless`]), a filter arranges them, a
//! compression packs them ([`payload`]). Each has an id in FORMAT.md.

mod effort;
mod integer_errors;
pub mod lossless;
pub mod payload;
pub mod quantised8;

pub use effort::Effort;

use crate::error_sum::ErrorSum;
use crate::key::NodeKey;
use crate::record::{BrickState, NodeRecord, PayloadPlace};
use crate::sample::Sample;
use multiversion::multiversion;
use serde::{Deserialize, Serialize};

/// How samples become the payload's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Encoding {
    /// Eight bits a sample, linear over the brick's range.
    #[serde(rename = "u8")]
    Quantised8 = 1,
    /// The source's own type, bit exact.
    #[serde(rename = "lossless")]
    Lossless = 2,
}

impl Encoding {
    /// The encoding with this id in FORMAT.md.
    pub fn from_id(id: u8) -> Option<Self> {
        [Self::Quantised8, Self::Lossless].into_iter().find(|encoding| *encoding as u8 == id)
    }

    /// The name used on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quantised8 => "u8",
            Self::Lossless => "lossless",
        }
    }

    /// Bits a sample of type `T` has in the payload before compression.
    pub fn bits<T: Sample>(self) -> u8 {
        match self {
            Self::Quantised8 => 8,
            Self::Lossless => 8 * size_of::<T>() as u8,
        }
    }
}

/// How a payload's bytes are arranged before compression.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Filter {
    /// In order.
    None = 0,
    /// All first bytes of the samples, then all second bytes, and so on.
    ByteShuffle = 1,
}

impl Filter {
    /// The filter with this id in FORMAT.md.
    pub fn from_id(id: u8) -> Option<Self> {
        [Self::None, Self::ByteShuffle].into_iter().find(|filter| *filter as u8 == id)
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

/// A brick's record and payload, with the error counted over `measured` samples of it.
///
/// The payload is added to `payloads`, and its length stands in the record.
///
/// `samples` is the whole brick and `range` its [`finite_range`]; `measured` yields the indices of its in-volume core voxels. The
/// record's ranges are the brick's own; its place, child mask and LOD bounds are left at zero.
pub fn encode_brick<T: Sample>(
    key: NodeKey,
    samples: &[T],
    (encoding, effort): (Encoding, Effort),
    range: Option<(T, T)>,
    measured: impl Iterator<Item = std::ops::Range<usize>> + Clone,
    scratch: &mut EncodeScratch,
    payloads: &mut Vec<u8>,
) -> NodeRecord {
    // A brick without a finite sample has no range; 0 stands for it.
    let (min, max) = range.unwrap_or_default();
    let mut record = NodeRecord {
        key,
        state: BrickState::Stored,
        encoding,
        bits: encoding.bits::<T>(),
        filter: Filter::None,
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
    let uniform = match encoding {
        Encoding::Quantised8 => min == max,
        Encoding::Lossless => {
            range.is_some() && samples.iter().all(|sample| sample.same_bits(samples[0]))
        }
    };
    match encoding {
        _ if uniform => {
            record.state = BrickState::Uniform;
            record.bits = 0;
            count_finite(samples, measured, &mut record.error);
        }
        Encoding::Quantised8 => {
            let quantiser = quantised8::Quantiser::new(min, max);
            scratch.bytes.resize(samples.len(), 0);
            quantiser.quantise(samples, &mut scratch.bytes);
            record.error = quantiser.errors(samples, &scratch.bytes, measured);
            payload::compress(&scratch.bytes, effort, &mut record, &mut scratch.packer, payloads);
        }
        Encoding::Lossless => {
            count_finite(samples, measured, &mut record.error);
            lossless::shuffle(samples, &mut scratch.bytes);
            record.filter = if size_of::<T>() > 1 { Filter::ByteShuffle } else { Filter::None };
            payload::compress(&scratch.bytes, effort, &mut record, &mut scratch.packer, payloads);
        }
    }
    record
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
    let how = (encoding, Effort::default());
    let (mut scratch, mut payload) = (EncodeScratch::default(), Vec::new());
    let range = finite_range(samples);
    let record = encode_brick(key, samples, how, range, all, &mut scratch, &mut payload);
    (record, payload)
}

/// Buffers that [`encode_brick`] keeps from brick to brick.
#[derive(Debug, Default)]
pub struct EncodeScratch {
    bytes: Vec<u8>,
    packer: payload::Packer,
}
