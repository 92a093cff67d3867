//! A brick in the form in which a renderer uploads it.
//!
//! Codes of 8 bits stay codes: the 2010 text (section 5) lets the texture unit interpolate them and maps the
//! result to the brick's own range. Integers of 8 and 16 bits that are stored bit for bit become R8 and R16
//! texels, signed ones shifted by their least value; everything else becomes 32-bit floats.

use crate::encoding::{Encoding, lossless, payload};
use crate::error::{Damage, StoreError};
use crate::record::{BrickState, NodeRecord};
use crate::sample::{Sample, SampleType};
use crate::store::{BrickScratch, Store};
use crate::with_sample_type;

/// How a brick's texels are to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BrickFormat {
    /// One byte: texel = byte / 255.
    R8,
    /// Two bytes, little-endian: texel = value / 65535.
    R16,
    /// A 32-bit float, little-endian: the sample itself, in source units.
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

    /// The format of the bricks of an encoding and sample type.
    pub fn of(encoding: Encoding, sample_type: SampleType) -> Self {
        match (encoding, sample_type) {
            (Encoding::Quantised8, _) | (Encoding::Lossless, SampleType::U8 | SampleType::I8) => {
                Self::R8
            }
            (Encoding::Lossless, SampleType::U16 | SampleType::I16) => Self::R16,
            (Encoding::Lossless, _) => Self::R32Float,
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
    /// The values of texels 0 and 1: a texel t of `R8` or `R16` stands for `[0] + t ([1] - [0])`. Of `R32Float`, whose
    /// texels are values already, the brick's least and greatest value.
    pub texel_range: [f64; 2],
}

impl Brick {
    /// Sample `index` as a value in source units.
    pub fn value(&self, index: usize) -> f64 {
        let [low, high] = self.texel_range;
        match self.format {
            BrickFormat::R8 => low + f64::from(self.texels[index]) * (high - low) / 255.0,
            BrickFormat::R16 => {
                let at = [self.texels[2 * index], self.texels[2 * index + 1]];
                low + f64::from(u16::from_le_bytes(at)) * (high - low) / 65535.0
            }
            BrickFormat::R32Float => {
                let mut bytes = [0; 4];
                bytes.copy_from_slice(&self.texels[4 * index..4 * index + 4]);
                f64::from(f32::from_le_bytes(bytes))
            }
        }
    }
}

/// The values of texels 0 and 1 of a stored brick.
pub(super) fn texel_range(record: &NodeRecord, sample_type: SampleType) -> [f64; 2] {
    match (record.encoding, BrickFormat::of(record.encoding, sample_type)) {
        (Encoding::Lossless, BrickFormat::R8 | BrickFormat::R16) => {
            let (low, high) = sample_type.limits();
            [low, high]
        }
        _ => [record.brick_min, record.brick_max],
    }
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
        let sample_type = self.metadata().sample_type;
        if record.state != BrickState::Stored {
            let what = "a payload was asked for where it has none";
            return Err(self.damaged(record.key, Damage::Tree { what }));
        }
        let samples = self.geometry().brick_samples();
        let (payload, unpacker) = self.payload_and_unpacker(record, scratch)?;
        let texels = with_sample_type!(sample_type, T => {
            texels::<T>(record, payload, unpacker, samples)
        })
        .map_err(|damage| self.damaged(record.key, damage))?;
        let format = BrickFormat::of(record.encoding, sample_type);
        Ok(Brick { format, texels, texel_range: texel_range(record, sample_type) })
    }
}

/// A payload's texels.
fn texels<T: Sample>(
    record: &NodeRecord,
    payload: &[u8],
    unpacker: &mut payload::Unpacker,
    samples: usize,
) -> Result<Vec<u8>, Damage> {
    match record.encoding {
        Encoding::Quantised8 => Ok(payload::unpack(record, payload, samples, unpacker)?.to_vec()),
        Encoding::Lossless => {
            let bytes = payload::unpack(record, payload, samples * size_of::<T>(), unpacker)?;
            let mut values = vec![T::default(); samples];
            lossless::unshuffle(bytes, &mut values);
            Ok(match BrickFormat::of(record.encoding, T::TYPE) {
                BrickFormat::R8 => {
                    let least = T::LEAST.to_i32();
                    values.iter().map(|v| (v.to_i32() - least) as u8).collect()
                }
                BrickFormat::R16 => {
                    let least = T::LEAST.to_i32();
                    values
                        .iter()
                        .flat_map(|v| ((v.to_i32() - least) as u16).to_le_bytes())
                        .collect()
                }
                BrickFormat::R32Float => {
                    values.iter().flat_map(|v| (v.to_f64() as f32).to_le_bytes()).collect()
                }
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::encode_samples;
    use crate::geometry::Geometry;
    use crate::key::NodeKey;
    use crate::metadata::Metadata;
    use crate::store::StoreWriter;

    #[test]
    fn every_type_comes_in_the_smallest_form_that_keeps_it() {
        for sample_type in SampleType::ALL {
            for encoding in [Encoding::Lossless, Encoding::Quantised8] {
                let geometry = Geometry::new([8, 8, 8], 8, 1).unwrap();
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join("one.octavo");
                let (low, high) = sample_type.limits();
                let (record, payload) = with_sample_type!(sample_type, T => {
                    // Halves first: the widest range overflows.
                    let at = |i: usize| (low / 2.0 + (high / 2.0 - low / 2.0) * i as f64 / 999.0) * 2.0;
                    let samples: Vec<T> = (0..1000).map(|i| T::from_f64(at(i).min(high))).collect();
                    encode_samples(NodeKey::new(0, [0; 3]), &samples, encoding)
                });
                let work = folder.path().join("work");
                let mut writer = StoreWriter::create(&path, &work, Vec::new()).unwrap();
                writer.append(&mut [record], &payload, Vec::new()).unwrap();
                writer.finish(Metadata::new(&geometry, sample_type, encoding)).unwrap();
                let store = Store::open(&path).unwrap();
                let (record, samples) = store.read_brick_samples(geometry.root()).unwrap();
                let brick = store.upload_brick(&record, &mut BrickScratch::default()).unwrap();
                let exact = encoding == Encoding::Lossless;
                let format = match (exact, sample_type.is_integer(), sample_type.bytes()) {
                    (false, ..) | (true, true, 1) => BrickFormat::R8,
                    (true, true, 2) => BrickFormat::R16,
                    _ => BrickFormat::R32Float,
                };
                assert_eq!((brick.format, brick.texels.len()), (format, 1000 * format.bytes()));
                if sample_type == SampleType::F64 {
                    continue; // Its ends do not fit a 32-bit float.
                }
                let unit = if format == BrickFormat::R32Float { (high - low) / 1e7 } else { 1e-3 };
                for i in 0..1000 {
                    let error = (brick.value(i) - samples.get_f64(i)).abs();
                    // The store rounds what it reads to whole numbers, and f32 to its own.
                    let rounded = if exact { 0.0 } else { 0.5 + (high - low) * 1e-7 };
                    assert!(error <= unit + rounded, "{sample_type} {encoding:?} {i}: {error}");
                }
            }
        }
    }
}
