//! Bricks as a renderer's textures take them: eight bits stay eight bits, and an affine map says what
//! they mean.

use super::decode::{DecodeScratch, Decoding, codes};
use super::words::{Word, buffer};
use super::{Coding, quantised8};
use crate::error::Damage;
use crate::record::NodeRecord;
use crate::sample::{Sample, SampleType};

/// What a texel of an uploaded brick is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum UploadFormat {
    /// An unsigned byte: `u8` codes, `max-error` codes of up to 8 bits, lossless 8-bit integers.
    R8,
    /// An unsigned 16-bit integer, little-endian: `max-error` codes of 9 to 16 bits, lossless 16-bit integers.
    R16,
    /// An f32, little-endian: everything else.
    R32Float,
}

impl UploadFormat {
    /// Bytes of a texel.
    pub fn bytes(self) -> usize {
        match self {
            Self::R8 => 1,
            Self::R16 => 2,
            Self::R32Float => 4,
        }
    }
}

/// What texels mean: `value = scale * texel + offset` in source units, the texel taken as the whole number
/// (R8, R16; not normalised to 1) or the f32 that it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueMap {
    /// Of the texels.
    pub format: UploadFormat,
    /// Source units a texel's unit.
    pub scale: f64,
    /// The value of texel 0.
    pub offset: f64,
    /// `value`, computed in f64, is at most this far from what decoding gives, which rounds to the sample
    /// type and clamps to the brick's range. Of finite samples: NaN is NaN in R32Float, where it is kept.
    pub max_difference: f64,
}

/// A brick ready for a texture.
#[derive(Debug, Clone, PartialEq)]
pub struct Upload {
    /// Its texels, x fastest, overlap included.
    pub bytes: Vec<u8>,
    /// What they mean.
    pub map: ValueMap,
}

/// What rounding to a type adds at most, for values up to `magnitude`.
fn rounding<T: Sample>(magnitude: f64) -> f64 {
    let arithmetic = magnitude * 2_f64.powi(-50);
    match T::TYPE {
        SampleType::F32 => magnitude * 2_f64.powi(-24) + f64::from(f32::from_bits(1)) + arithmetic,
        SampleType::F64 => arithmetic + f64::from_bits(1),
        _ => 0.5 + arithmetic,
    }
}

/// What a code's number multiplies where f64 rounds the step itself: of denormal ranges the last bit.
fn rounded_step<T: Sample>() -> f64 {
    if T::TYPE == SampleType::F64 { 256.0 * f64::from_bits(1) } else { 0.0 }
}

impl Decoding {
    /// What the texels of a stored brick mean.
    ///
    /// # Errors
    /// When the record is none of this store's.
    pub(crate) fn value_map<T: Sample>(&self, record: &NodeRecord) -> Result<ValueMap, Damage> {
        let (min, max) = (record.brick_min, record.brick_max);
        let magnitude = min.abs().max(max.abs());
        let map = |format, scale, offset, max_difference| ValueMap {
            format,
            scale,
            offset,
            max_difference,
        };
        Ok(match record.coding {
            Coding::Quantised8 => {
                let step = max / 255.0 - min / 255.0;
                // Decoding rounds where these do not, and halo that was assembled is coded again.
                let again = if self.stored_overlap() { 0.0 } else { step / 2.0 };
                let rounded = rounding::<T>(2.0 * magnitude) + rounded_step::<T>();
                map(UploadFormat::R8, step, min, rounded + again)
            }
            Coding::Bounded => {
                let quantiser = self.bounded::<T>(record)?;
                let format = if record.bits <= 8 { UploadFormat::R8 } else { UploadFormat::R16 };
                let (scale, offset) = quantiser.value_map();
                let rounded =
                    if T::TYPE.is_integer() { 0.0 } else { rounding::<T>(magnitude + scale) };
                // On the lattice the ends reach up to half a step beyond the range, and halo is coded again.
                let again = if self.stored_overlap() { 0.0 } else { scale / 2.0 };
                map(format, scale, offset, again + rounded)
            }
            Coding::Lossless => match T::TYPE {
                SampleType::U8 => map(UploadFormat::R8, 1.0, 0.0, 0.0),
                SampleType::I8 => map(UploadFormat::R8, 1.0, -128.0, 0.0),
                SampleType::U16 => map(UploadFormat::R16, 1.0, 0.0, 0.0),
                SampleType::I16 => map(UploadFormat::R16, 1.0, -32_768.0, 0.0),
                SampleType::F32 => map(UploadFormat::R32Float, 1.0, 0.0, 0.0),
                SampleType::U32 | SampleType::I32 | SampleType::F64 => {
                    // Counted from the minimum in a unit of about the range, so that 24 bits are spent on
                    // what differs. Halves, because the widest range overflows.
                    let half_range = max / 2.0 - min / 2.0;
                    let scale = if half_range > 0.0 {
                        let log2 = half_range.log2().ceil() + 1.0;
                        2_f64.powi(log2.clamp(-1000.0, 1000.0) as i32)
                    } else {
                        1.0
                    };
                    let least = 2_f64.powi(-149) * scale;
                    let texel = half_range * 2_f64.powi(-22) + least;
                    map(UploadFormat::R32Float, scale, min, texel + magnitude * 2_f64.powi(-50))
                }
            },
        })
    }

    /// The texels of a stored brick whose payload has the overlap.
    ///
    /// # Errors
    /// As [`Decoding::decode`].
    pub(crate) fn upload_payload<T: Sample>(
        &self,
        record: &NodeRecord,
        payload: &[u8],
        scratch: &mut DecodeScratch,
        samples: &mut [T],
    ) -> Result<Upload, Damage> {
        let map = self.value_map::<T>(record)?;
        let bytes = match (record.coding, map.format) {
            (Coding::Bounded, _) if record.bits == 0 => vec![0; samples.len()],
            (Coding::Quantised8 | Coding::Bounded, UploadFormat::R8) => {
                codes::<u8>(record, payload, samples.len(), scratch)?.to_vec()
            }
            (Coding::Bounded, _) => {
                le_bytes(codes::<u16>(record, payload, samples.len(), scratch)?)
            }
            _ => {
                self.decode(record, payload, scratch, samples)?;
                return self.upload_samples(record, scratch, samples);
            }
        };
        Ok(Upload { bytes, map })
    }

    /// The texels of decoded samples: codes of samples that have been decoded are the codes that they were
    /// decoded from.
    ///
    /// # Errors
    /// When the record is none of this store's.
    pub(crate) fn upload_samples<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut DecodeScratch,
        samples: &[T],
    ) -> Result<Upload, Damage> {
        let map = self.value_map::<T>(record)?;
        let bytes = match (record.coding, map.format) {
            (Coding::Quantised8, _) => {
                let (min, max) = (T::from_f64(record.brick_min), T::from_f64(record.brick_max));
                let mut codes = vec![0; samples.len()];
                quantised8::Quantiser::new(min, max).quantise(samples, &mut codes);
                codes
            }
            (Coding::Bounded, UploadFormat::R8) => {
                let mut codes = vec![0_u8; samples.len()];
                self.bounded::<T>(record)?.quantise(samples, &mut codes);
                codes
            }
            (Coding::Bounded, _) => {
                let codes = buffer::<u16>(scratch.codes(), samples.len());
                self.bounded::<T>(record)?.quantise(samples, codes);
                le_bytes(codes)
            }
            (Coding::Lossless, UploadFormat::R32Float) => {
                let ValueMap { scale, offset, .. } = map;
                let texel = |v: &T| match T::TYPE {
                    SampleType::F32 => v.to_f32(),
                    _ => (v.to_f64() / scale - offset / scale) as f32,
                };
                samples.iter().flat_map(|v| texel(v).to_le_bytes()).collect()
            }
            (Coding::Lossless, _) => {
                let least = T::LEAST.to_i32();
                let texels = samples.iter().map(|v| (v.to_i32() - least) as u16);
                if map.format == UploadFormat::R8 {
                    texels.map(|texel| texel as u8).collect()
                } else {
                    texels.flat_map(u16::to_le_bytes).collect()
                }
            }
        };
        Ok(Upload { bytes, map })
    }
}

fn le_bytes<W: Word>(codes: &[W]) -> Vec<u8> {
    codes.iter().flat_map(|code| code.to_u16().to_le_bytes()).collect()
}
