//! How far overlap samples may be off: bounds that follow from a level's records, so that they cost nothing
//! and a verification can work them out anew.
//!
//! Errors are measured over cores, because there each voxel counts once. An overlap sample that is stored has
//! its brick's own codes. One that is assembled is a core sample of another brick, clamped to the range of
//! the brick that asks; the voxel lies in that range, so clamping only brings it nearer. `verify --against`
//! measures what is bounded here.

use crate::encoding::{Coding, Encoding, quantised8};
use crate::metadata::Metadata;
use crate::record::{BrickState, NodeRecord};
use crate::sample::{Sample, SampleType};
use crate::with_sample_type;

/// What the records of a level say of their overlap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OverlapBounds {
    sample_type: SampleType,
    encoding: Encoding,
    stored_overlap: bool,
    overlap: u32,
    /// Most that coding takes from a sample of any brick.
    coded: f64,
    /// Most that it takes from one of a brick that one code says all of: no overlap is assembled for it.
    one_code: f64,
    /// Largest errors of cores, kept and dropped.
    kept: f64,
    dropped: f64,
}

impl OverlapBounds {
    pub(crate) fn new(metadata: &Metadata) -> Self {
        Self {
            sample_type: metadata.sample_type,
            encoding: metadata.encoding,
            stored_overlap: metadata.stored_overlap,
            overlap: metadata.brick_overlap,
            coded: 0.0,
            one_code: 0.0,
            kept: 0.0,
            dropped: 0.0,
        }
    }

    pub(crate) fn add(&mut self, record: &NodeRecord) {
        if record.state == BrickState::Lost {
            return;
        }
        let amax =
            if record.state == BrickState::Empty { &mut self.dropped } else { &mut self.kept };
        *amax = amax.max(record.error.amax);
        if record.state != BrickState::Stored {
            return;
        }
        let own = match (record.coding, self.encoding) {
            (Coding::Quantised8, _) => with_sample_type!(self.sample_type, T => {
                let [min, max] = [record.brick_min, record.brick_max].map(T::from_f64);
                quantised8::Quantiser::new(min, max).error_bound()
            }),
            (Coding::Bounded, Encoding::MaxError(error)) => {
                error.get().min(record.brick_max - record.brick_min)
            }
            _ => 0.0,
        };
        self.coded = self.coded.max(own);
        if record.bits == 0 {
            self.one_code = self.one_code.max(own);
        }
    }

    /// Most that a finite overlap sample of a kept brick, within the volume, is off from the source.
    pub(crate) fn amax(&self) -> f64 {
        match (self.overlap, self.stored_overlap) {
            (0, _) => 0.0,
            (_, true) => self.coded,
            (_, false) => self.kept.max(self.dropped).max(self.one_code),
        }
    }

    /// Most that such a sample is off from what would be read if it were stored in the brick's own codes; 0
    /// where it is.
    pub(crate) fn extra_amax(&self) -> f64 {
        if self.overlap == 0 || self.stored_overlap {
            return 0.0;
        }
        let neighbours = match self.encoding {
            // Bricks share the lattice: they differ where one clamps or is lossless, and then one of the
            // two values lies between the voxel and the other.
            Encoding::MaxError(_) => self.dropped,
            Encoding::Quantised8 | Encoding::Lossless => self.kept.max(self.dropped),
        };
        (self.coded + neighbours).min(f64::MAX)
    }
}
