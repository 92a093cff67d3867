//! From a payload back to a brick's samples: the reverse of [`super::encode_brick`].

use super::bounded::{self, Anchor};
use super::payload::{Unpacker, unpack};
use super::quantised8;
use super::words::{Word, arranged_bytes, buffer, restore, with_word};
use super::{Coding, Encoding, Filter};
use crate::error::Damage;
use crate::metadata::Metadata;
use crate::record::NodeRecord;
use crate::sample::Sample;

/// Buffers that decoding keeps from brick to brick.
#[derive(Debug, Default)]
pub(crate) struct DecodeScratch {
    unpacker: Unpacker,
    codes: Vec<u64>,
}

/// What of a store's metadata its payloads depend on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Decoding {
    pub(crate) encoding: Encoding,
    pub(crate) anchor: Anchor,
}

impl DecodeScratch {
    /// A buffer for codes.
    pub(super) fn codes(&mut self) -> &mut Vec<u64> {
        &mut self.codes
    }
}

impl Decoding {
    /// What the metadata says.
    pub(crate) fn of(metadata: &Metadata) -> Self {
        let anchor = if metadata.stored_overlap { Anchor::Brick } else { Anchor::Lattice };
        Self { encoding: metadata.encoding, anchor }
    }

    /// Whether payloads hold the overlap: else the quantisers of all bricks share a lattice.
    pub(super) fn stored_overlap(&self) -> bool {
        self.anchor == Anchor::Brick
    }

    /// The quantiser of a `max-error` brick.
    ///
    /// # Errors
    /// When the record cannot have been made with this encoding.
    pub(crate) fn bounded<T: Sample>(
        &self,
        record: &NodeRecord,
    ) -> Result<bounded::Quantiser<T>, Damage> {
        let (min, max) = (T::from_f64(record.brick_min), T::from_f64(record.brick_max));
        let Encoding::MaxError(error) = self.encoding else {
            return Err(Damage::Tree { what: "its encoding is not the store's" });
        };
        bounded::Quantiser::new(min, max, error, self.anchor)
            .filter(|quantiser| quantiser.bits() == record.bits)
            .ok_or(Damage::Tree { what: "its bits do not follow from its range and the bound" })
    }

    /// Decodes a checked payload of a stored brick into samples.
    ///
    /// # Errors
    /// When the payload does not unpack to so many samples, or the record is none of this store's.
    pub(crate) fn decode<T: Sample>(
        &self,
        record: &NodeRecord,
        payload: &[u8],
        scratch: &mut DecodeScratch,
        samples: &mut [T],
    ) -> Result<(), Damage> {
        let (min, max) = (T::from_f64(record.brick_min), T::from_f64(record.brick_max));
        if !(min.is_finite() && max.is_finite() && min <= max) {
            return Err(Damage::Tree { what: "its range is none of its type" });
        }
        match record.coding {
            Coding::Quantised8 => {
                let codes = codes::<u8>(record, payload, samples.len(), scratch)?;
                quantised8::Quantiser::new(min, max).decode(codes, samples);
            }
            Coding::Lossless => with_word!(T, W => {
                let words: &mut [W] = bytemuck::cast_slice_mut(samples);
                restored(record, payload, &mut scratch.unpacker, words)?;
            }),
            Coding::Bounded => {
                let quantiser = self.bounded::<T>(record)?;
                match record.bits {
                    0 if payload.is_empty() => samples.fill(quantiser.value(0)),
                    0 => return Err(Damage::PayloadLength { expected: 0, found: payload.len() }),
                    1..=8 => {
                        quantiser
                            .decode(codes::<u8>(record, payload, samples.len(), scratch)?, samples);
                    }
                    _ => {
                        quantiser.decode(
                            codes::<u16>(record, payload, samples.len(), scratch)?,
                            samples,
                        );
                    }
                }
            }
        }
        Ok(())
    }
}

impl Decoding {
    /// Makes of samples what a reader would get if the payload of this stored brick held them.
    ///
    /// # Errors
    /// When the record is none of this store's.
    pub(crate) fn recode<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut DecodeScratch,
        samples: &mut [T],
    ) -> Result<(), Damage> {
        match record.coding {
            Coding::Quantised8 => {
                let (min, max) = (T::from_f64(record.brick_min), T::from_f64(record.brick_max));
                let quantiser = quantised8::Quantiser::new(min, max);
                let codes = buffer(&mut scratch.codes, samples.len());
                quantiser.quantise(samples, codes);
                quantiser.decode(codes, samples);
            }
            Coding::Bounded => {
                let quantiser = self.bounded::<T>(record)?;
                let codes = buffer::<u16>(&mut scratch.codes, samples.len());
                quantiser.quantise(samples, codes);
                quantiser.decode(codes, samples);
            }
            Coding::Lossless => {}
        }
        Ok(())
    }
}

/// A brick's codes, borrowed from the payload where they lie in it as they are.
///
/// # Errors
/// When the payload does not unpack to so many.
pub(crate) fn codes<'a, W: Word>(
    record: &NodeRecord,
    payload: &'a [u8],
    count: usize,
    scratch: &'a mut DecodeScratch,
) -> Result<&'a [W], Damage> {
    let DecodeScratch { unpacker, codes } = scratch;
    if W::BITS == 8 && record.filter == Filter::NONE {
        return Ok(bytemuck::cast_slice(unpack(record, payload, count, unpacker)?));
    }
    let codes = buffer(codes, count);
    restored(record, payload, unpacker, codes)?;
    Ok(codes)
}

/// Unpacks a payload and undoes its filter.
fn restored<W: Word>(
    record: &NodeRecord,
    payload: &[u8],
    unpacker: &mut Unpacker,
    words: &mut [W],
) -> Result<(), Damage> {
    let length = arranged_bytes::<W>(words.len(), record.bits, record.filter);
    restore(unpack(record, payload, length, unpacker)?, record.bits, record.filter, words)
}
