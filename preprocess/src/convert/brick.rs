//! One brick on its way into the store: measured, perhaps dropped, encoded.

use crate::downsample::Core;
use crate::error::PreprocessError;
use crate::value_stats::BrickValues;
use crate::walk::Visitor;
use octree_store::encoding::{BrickFormat, EncodeScratch, Filter, encode_brick, finite_range};
use octree_store::{BrickState, ErrorSum, NodeKey, NodeRecord, Sample};

/// Encodes bricks, from many threads at once.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BrickEncoder<'a> {
    pub(crate) format: BrickFormat,
    pub(crate) rules: &'a ValueRules,
}

/// What a conversion does to values before they are encoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ValueRules {
    /// Takes the place of NaN.
    pub(crate) nan_value: Option<f64>,
    /// Bricks whose every sample is below this are dropped.
    pub(crate) empty_below: Option<f64>,
    /// What a dropped brick decodes to.
    pub(crate) empty_value: f64,
}

impl ValueRules {
    /// Replaces NaN in the samples of level 0, of which the levels above are made; tells whether
    /// it may have.
    pub(crate) fn apply<T: Sample>(&self, samples: &mut [T]) -> bool {
        let Some(value) = self.nan_value.filter(|_| !T::TYPE.is_integer()) else { return false };
        let value = T::from_f64(value);
        for sample in samples.iter_mut().filter(|sample| sample.is_nan()) {
            *sample = value;
        }
        true
    }

    /// Whether a brick is dropped: no sample of it, overlap included, reaches the threshold.
    pub(crate) fn drops<T: Sample>(&self, samples: &[T]) -> bool {
        self.empty_below
            .is_some_and(|below| samples.iter().all(|v| v.to_f64() < below || v.is_nan()))
    }
}

/// A brick that is ready to be written, but for what its descendants say.
#[derive(Debug)]
pub(crate) struct BrickOutput {
    pub(crate) record: NodeRecord,
    /// The source's values, at level 0.
    pub(crate) values: Option<BrickValues>,
}

impl<T: Sample> Visitor<T> for BrickEncoder<'_> {
    type Output = BrickOutput;
    type Scratch = EncodeScratch;

    fn visit(
        &self,
        key: NodeKey,
        core: &Core,
        samples: &mut [T],
        scratch: &mut EncodeScratch,
        payloads: &mut Vec<u8>,
    ) -> Result<BrickOutput, PreprocessError> {
        let mut range = finite_range(samples);
        let values = (key.level() == 0).then(|| BrickValues::of(samples, core, range));
        if key.level() == 0 && self.rules.apply(samples) {
            range = finite_range(samples);
        }
        let before = payloads.len();
        let mut record =
            encode_brick(key, samples, self.format, range, core.rows(), scratch, payloads);
        if self.rules.drops(samples) {
            payloads.truncate(before);
            record.state = BrickState::Empty;
            record.bits = 0;
            record.filter = Filter::NONE;
            record.payload_checksum = 0;
            record.place.length = 0;
            record.error = ErrorSum::default();
            let empty = [T::from_f64(self.rules.empty_value); 128];
            for row in core.rows() {
                record.error.add_all(&samples[row], &empty);
            }
        }
        Ok(BrickOutput { record, values })
    }
}
