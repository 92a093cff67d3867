//! The ways to convert that are measured, as data: a new encoding is a row.

use crate::convert::ConvertOptions;
use octree_store::{Effort, Encoding, SampleType};

/// One way to convert.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rung {
    /// How samples are stored.
    pub encoding: Encoding,
    /// How much work goes into small payloads.
    pub effort: Effort,
    /// Bricks whose every voxel is below this are dropped.
    pub empty_below: Option<f64>,
}

/// What the ladder depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct LadderOptions {
    /// The type of the samples.
    pub sample_type: SampleType,
    /// Greatest less least value.
    pub range: f64,
    /// The error bounds to try, in source units; else fractions of the range.
    pub max_errors: Option<Vec<f64>>,
    /// The threshold below which bricks are dropped in some of the rungs.
    pub empty_below: Option<f64>,
}

/// All rungs.
pub fn ladder(options: &LadderOptions) -> Vec<Rung> {
    let plain = |encoding, effort| Rung { encoding, effort, empty_below: None };
    let mut rungs = Vec::new();
    for encoding in [Encoding::Lossless, Encoding::Quantised8] {
        for effort in [Effort::Fast, Effort::Balanced, Effort::Small] {
            rungs.push(plain(encoding, effort));
        }
    }
    if options.empty_below.is_some() {
        for encoding in [Encoding::Lossless, Encoding::Quantised8] {
            let empty_below = options.empty_below;
            rungs.push(Rung { empty_below, ..plain(encoding, Effort::Balanced) });
        }
    }
    rungs
}

impl Rung {
    /// A name that no other rung of a ladder has: `u8`, `u8 small`, `u8 without empty`.
    pub fn name(&self) -> String {
        let mut name = self.encoding.name().to_owned();
        if self.effort != Effort::default() {
            name.push(' ');
            name.push_str(self.effort.name());
        }
        if self.empty_below.is_some() {
            name.push_str(" without empty");
        }
        name
    }

    /// What `octavo convert` must be told to go this way.
    pub fn arguments(&self) -> Vec<String> {
        let mut arguments = vec!["--encoding".to_owned(), self.encoding.name().to_owned()];
        if self.effort != Effort::default() {
            arguments.extend(["--effort".to_owned(), self.effort.name().to_owned()]);
        }
        if let Some(below) = self.empty_below {
            arguments.extend(["--empty-below".to_owned(), below.to_string()]);
        }
        arguments
    }

    /// The options of a conversion that goes this way.
    pub(super) fn options(&self, how: &ConvertOptions) -> ConvertOptions {
        let Self { encoding, effort, empty_below } = *self;
        ConvertOptions { encoding, effort, empty_below, ..how.clone() }
    }
}
