//! A store's bricks as a renderer's textures take them, and samples as a brick's codes would keep them.

use super::reader::{BrickScratch, Store};
use crate::encoding::{Upload, UploadFormat, ValueMap};
use crate::error::{Damage, StoreError};
use crate::record::{BrickState, NodeRecord};
use crate::sample::Sample;
use crate::with_sample_type;

impl Store {
    /// Reads a brick as a renderer's texture takes it, overlap included: eight bits stay eight bits.
    /// Uniform and empty bricks, and stored ones of one code, are R8 texels of 0.
    ///
    /// # Errors
    /// As [`Store::decode_brick`], but for the type.
    pub fn read_upload(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
    ) -> Result<Upload, StoreError> {
        with_sample_type!(self.metadata().sample_type, T => {
            self.read_texels::<T>(record, scratch, Self::decode_brick::<T>)
        })
    }

    /// As [`Store::read_upload`], for one who needs no overlap: where it is not in the payload the texels around
    /// the core mean nothing, and no neighbour is read.
    ///
    /// # Errors
    /// As [`Store::decode_brick_core`], but for the type.
    pub fn read_upload_core(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
    ) -> Result<Upload, StoreError> {
        with_sample_type!(self.metadata().sample_type, T => {
            self.read_texels::<T>(record, scratch, Self::decode_brick_core::<T>)
        })
    }

    /// The map of a brick's texels, as [`Store::read_upload`] gives it with them. Nothing is read.
    ///
    /// # Errors
    /// When the record is none of this store's.
    pub fn value_map(&self, record: &NodeRecord) -> Result<ValueMap, StoreError> {
        let constant =
            |offset| ValueMap { format: UploadFormat::R8, scale: 1.0, offset, max_difference: 0.0 };
        match record.state {
            BrickState::Uniform => return Ok(constant(record.brick_min)),
            BrickState::Empty => return Ok(constant(self.metadata().empty_value)),
            BrickState::Lost => return Err(self.damaged(record.key, Damage::Lost)),
            BrickState::Stored => {}
        }
        with_sample_type!(self.metadata().sample_type, T => self.decoding().value_map::<T>(record))
            .map_err(|damage| self.damaged(record.key, damage))
    }

    /// Texels of a brick, whose samples `decode` reads where its payload does not hold them all.
    fn read_texels<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        decode: impl FnOnce(&Self, &NodeRecord, &mut BrickScratch, &mut [T]) -> Result<(), StoreError>,
    ) -> Result<Upload, StoreError> {
        if record.state != BrickState::Stored {
            let bytes = vec![0; self.geometry().brick_samples()];
            return Ok(Upload { bytes, map: self.value_map(record)? });
        }
        let mut samples = vec![T::default(); self.geometry().brick_samples()];
        let decoding = self.decoding();
        let upload = if self.metadata().stored_overlap {
            let BrickScratch { payload, decode, .. } = scratch;
            self.fetch_payload(record, payload)?;
            decoding.upload_payload(record, payload, decode, &mut samples)
        } else {
            decode(self, record, scratch, &mut samples)?;
            decoding.upload_samples(record, &mut scratch.decode, &samples)
        };
        upload.map_err(|damage| self.damaged(record.key, damage))
    }

    /// Makes of the samples of a whole brick what a reader would get if they were stored in the brick's own
    /// codes: so one can see what assembling overlap from neighbours changes.
    ///
    /// # Errors
    /// When the record is none of this store's.
    pub fn recode<T: Sample>(
        &self,
        record: &NodeRecord,
        scratch: &mut BrickScratch,
        samples: &mut [T],
    ) -> Result<(), StoreError> {
        match record.state {
            BrickState::Uniform => samples.fill(T::from_f64(record.brick_min)),
            BrickState::Empty => samples.fill(T::from_f64(self.metadata().empty_value)),
            BrickState::Lost => return Err(self.damaged(record.key, Damage::Lost)),
            BrickState::Stored => self
                .decoding()
                .recode(record, &mut scratch.decode, samples)
                .map_err(|damage| self.damaged(record.key, damage))?,
        }
        Ok(())
    }
}
