//! A brick in the form in which a renderer uploads it, in the one format of its pool.
//!
//! Codes stay codes: the 2010 text (section 5) lets the texture unit interpolate them and maps the result to
//! the brick's own range. Where bricks of a store differ in bits (`max-error`), all take the widest format
//! among them, with the same codes.

use crate::encoding::decode::Decoding;
use crate::encoding::{Coding, Upload, UploadFormat, ValueMap};
use crate::error::{Damage, StoreError};
use crate::metadata::Metadata;
use crate::record::{BrickState, NodeRecord};
use crate::store::{BrickScratch, Store};
use crate::with_sample_type;

/// How a brick's texels are to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BrickFormat {
    /// One byte: texel = byte / 255.
    R8,
    /// Two bytes, little-endian: texel = value / 65535.
    R16,
    /// A 32-bit float, little-endian.
    R32Float,
}

impl BrickFormat {
    /// Bytes of a texel.
    pub fn bytes(self) -> usize {
        match self {
            Self::R8 => 1,
            Self::R16 => 2,
            Self::R32Float => 4,
        }
    }

    /// The format that all bricks of a store fit.
    pub fn of(metadata: &Metadata) -> Self {
        let bits = metadata.levels.iter().flat_map(|level| level.bits.keys()).max();
        match bits {
            Some(0..=8) | None => Self::R8,
            Some(9..=16) => Self::R16,
            Some(_) => Self::R32Float,
        }
    }

    /// The whole number, or the float, that a texel of 1 is.
    fn unit(self) -> f64 {
        match self {
            Self::R8 => 255.0,
            Self::R16 => 65535.0,
            Self::R32Float => 1.0,
        }
    }
}

/// A decoded brick: samples x fastest, overlap included, as the renderer's texture takes them.
#[derive(Debug, Clone, PartialEq)]
pub struct Brick {
    /// How to read `texels`.
    pub format: BrickFormat,
    /// [`crate::Geometry::brick_samples`] texels.
    pub texels: Vec<u8>,
    /// The values of texels 0 and 1: a texel t stands for `[0] + t ([1] - [0])`.
    pub texel_range: [f64; 2],
}

impl Brick {
    /// A brick as it comes from the store, in the format of all of them.
    fn new(upload: Upload, format: BrickFormat, texel_range: [f64; 2]) -> Self {
        let Upload { bytes, map } = upload;
        let texels = match (map.format, format) {
            (UploadFormat::R8, BrickFormat::R16) => {
                bytes.iter().flat_map(|&code| u16::from(code).to_le_bytes()).collect()
            }
            (UploadFormat::R8, BrickFormat::R32Float) => {
                bytes.iter().flat_map(|&code| f32::from(code).to_le_bytes()).collect()
            }
            (UploadFormat::R16, BrickFormat::R32Float) => bytes
                .as_chunks()
                .0
                .iter()
                .flat_map(|&code| f32::from(u16::from_le_bytes(code)).to_le_bytes())
                .collect(),
            _ => bytes,
        };
        Self { format, texels, texel_range }
    }

    /// Sample `index` as a value in source units.
    pub fn value(&self, index: usize) -> f64 {
        let [low, high] = self.texel_range;
        let texel = match self.format {
            BrickFormat::R8 => f64::from(self.texels[index]),
            BrickFormat::R16 => f64::from(u16::from_le_bytes(self.texels.as_chunks().0[index])),
            BrickFormat::R32Float => {
                f64::from(f32::from_le_bytes(self.texels.as_chunks().0[index]))
            }
        };
        low + texel * (high - low) / self.format.unit()
    }
}

/// The values of texels 0 and 1 of a stored brick; of a record that is none of this store's, the brick's
/// range.
pub(super) fn texel_range(record: &NodeRecord, metadata: &Metadata) -> [f64; 2] {
    let range = [record.brick_min, record.brick_max];
    let format = BrickFormat::of(metadata);
    // The greatest code is the brick's maximum to the bit.
    if record.coding == Coding::Quantised8 && format == BrickFormat::R8 {
        return range;
    }
    let map = with_sample_type!(metadata.sample_type, T => {
        Decoding::of(metadata).value_map::<T>(record)
    });
    map.map_or(range, |ValueMap { scale, offset, .. }| [offset, offset + scale * format.unit()])
}

impl Store {
    /// The brick of a stored record, in the form in which a renderer uploads it.
    ///
    /// # Errors
    /// When the record has no payload, or the payload is damaged.
    pub fn upload_brick(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
    ) -> Result<Brick, StoreError> {
        if !matches!(record.state, BrickState::Stored | BrickState::Lost) {
            let what = "a payload was asked for where it has none";
            return Err(self.damaged(record.key, Damage::Tree { what }));
        }
        let upload = self.read_upload(record, scratch)?;
        let metadata = self.metadata();
        Ok(Brick::new(upload, BrickFormat::of(metadata), texel_range(record, metadata)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes 0, 7 and 200 of a brick whose code q means 0.5 q + 3, in every format that holds them.
    #[test]
    fn a_wider_format_has_the_same_codes_and_values() {
        let codes = [0_u16, 7, 200];
        let upload = |format| Upload {
            bytes: match format {
                UploadFormat::R8 => codes.iter().map(|code| *code as u8).collect(),
                _ => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
            },
            map: ValueMap { format, scale: 0.5, offset: 3.0, max_difference: 0.0 },
        };
        let range = |format: BrickFormat| [3.0, 3.0 + 0.5 * format.unit()];
        for (from, to) in [
            (UploadFormat::R8, BrickFormat::R8),
            (UploadFormat::R8, BrickFormat::R16),
            (UploadFormat::R8, BrickFormat::R32Float),
            (UploadFormat::R16, BrickFormat::R16),
            (UploadFormat::R16, BrickFormat::R32Float),
        ] {
            let brick = Brick::new(upload(from), to, range(to));
            assert_eq!(brick.texels.len(), codes.len() * to.bytes());
            for (i, code) in codes.into_iter().enumerate() {
                let expected = 0.5 * f64::from(code) + 3.0;
                assert!((brick.value(i) - expected).abs() < 1e-12, "{from:?} as {to:?}");
            }
        }
    }
}
