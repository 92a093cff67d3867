//! The ways to convert that are measured, as data: a new encoding is a row.

use crate::convert::ConvertOptions;
use octree_store::{Effort, Encoding, OverlapAtRest, SampleType};

/// One way to convert.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rung {
    /// How samples are stored.
    pub encoding: Encoding,
    /// How much work goes into small payloads.
    pub effort: Effort,
    /// Bricks whose every voxel is below this are dropped.
    pub empty_below: Option<f64>,
    /// Whether payloads hold the overlap.
    pub overlap_at_rest: OverlapAtRest,
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

/// Powers of two that the range is divided by for error bounds, where none are given.
const DIVISORS_LOG2: [i32; 5] = [12, 10, 8, 6, 4];

/// The error bounds to try, least first. Of integers whole ones: a fraction bounds no more.
fn max_errors(options: &LadderOptions) -> Vec<f64> {
    let mut bounds = options.max_errors.clone().unwrap_or_else(|| {
        let of_range = DIVISORS_LOG2.map(|log2| options.range / 2_f64.powi(log2));
        of_range.map(|bound| nice(bound, options.sample_type)).into()
    });
    bounds.sort_by(f64::total_cmp);
    bounds.dedup();
    bounds
}

/// A bound in few digits, not above the one that is asked for.
fn nice(bound: f64, sample_type: SampleType) -> f64 {
    if sample_type.is_integer() {
        return bound.floor();
    }
    // Cut off, not rounded: three digits of the mantissa.
    let text = format!("{bound:.17e}");
    let digits = text.split_once('e').map(|(mantissa, exponent)| {
        format!("{}e{exponent}", mantissa.get(..4).unwrap_or(mantissa))
    });
    digits.and_then(|digits| digits.parse().ok()).unwrap_or(bound)
}

/// All rungs.
pub fn ladder(options: &LadderOptions) -> Vec<Rung> {
    let overlap_at_rest = OverlapAtRest::Stored;
    let plain = |encoding, effort| Rung { encoding, effort, empty_below: None, overlap_at_rest };
    let exact_and_u8 = [Encoding::Lossless, Encoding::Quantised8];
    let bounded: Vec<_> = max_errors(options).into_iter().filter_map(Encoding::max_error).collect();
    let mut rungs = Vec::new();
    for encoding in exact_and_u8 {
        for effort in [Effort::Fast, Effort::Balanced, Effort::Small] {
            rungs.push(plain(encoding, effort));
        }
    }
    for &encoding in &bounded {
        for effort in [Effort::Balanced, Effort::Small] {
            rungs.push(plain(encoding, effort));
        }
    }
    // What else can be chosen is tried on each way to store samples once.
    let middle = bounded.get(bounded.len() / 2).copied();
    for encoding in exact_and_u8.into_iter().chain(middle) {
        let overlap_at_rest = OverlapAtRest::Assembled;
        rungs.push(Rung { overlap_at_rest, ..plain(encoding, Effort::Small) });
    }
    if options.empty_below.is_some() {
        for encoding in exact_and_u8.into_iter().chain(middle) {
            let empty_below = options.empty_below;
            rungs.push(Rung { empty_below, ..plain(encoding, Effort::Balanced) });
        }
    }
    rungs
}

impl Rung {
    /// A name that no other rung of a ladder has: `u8`, `u8 small`, `u8 without empty`.
    pub fn name(&self) -> String {
        let mut name = self.encoding.to_string();
        if self.effort != Effort::default() {
            name.push(' ');
            name.push_str(self.effort.name());
        }
        if self.overlap_at_rest == OverlapAtRest::Assembled {
            name.push_str(" assembled");
        }
        if self.empty_below.is_some() {
            name.push_str(" without empty");
        }
        name
    }

    /// What `octavo convert` must be told to go this way.
    pub fn arguments(&self) -> Vec<String> {
        let mut arguments = vec!["--encoding".to_owned(), self.encoding.to_string()];
        if self.effort != Effort::default() {
            arguments.extend(["--effort".to_owned(), self.effort.name().to_owned()]);
        }
        if self.overlap_at_rest == OverlapAtRest::Assembled {
            arguments.extend(["--overlap-at-rest".to_owned(), "assembled".to_owned()]);
        }
        if let Some(below) = self.empty_below {
            arguments.extend(["--empty-below".to_owned(), below.to_string()]);
        }
        arguments
    }

    /// The options of a conversion that goes this way.
    pub(super) fn options(&self, how: &ConvertOptions) -> ConvertOptions {
        let Self { encoding, effort, empty_below, overlap_at_rest } = *self;
        ConvertOptions { encoding, effort, overlap_at_rest, empty_below, ..how.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn options(sample_type: SampleType, range: f64) -> LadderOptions {
        LadderOptions { sample_type, range, max_errors: None, empty_below: Some(7.0) }
    }

    #[test]
    fn names_are_unique_and_every_encoding_that_reads_back_its_name_is_in() {
        for (sample_type, range) in
            [(SampleType::U16, 1300.0), (SampleType::F32, 0.37), (SampleType::U8, 0.0)]
        {
            let rungs = ladder(&options(sample_type, range));
            let names: BTreeSet<_> = rungs.iter().map(Rung::name).collect();
            assert_eq!(names.len(), rungs.len(), "{names:?}");
            for rung in &rungs {
                assert_eq!(rung.arguments()[1].parse(), Ok(rung.encoding));
            }
        }
    }

    #[test]
    fn bounds_are_fractions_of_the_range_and_whole_for_integers() {
        assert_eq!(max_errors(&options(SampleType::U16, 1300.0)), [0.0, 1.0, 5.0, 20.0, 81.0]);
        let float = max_errors(&options(SampleType::F32, 1.0));
        assert_eq!(float, [0.000_244, 0.000_976, 0.003_9, 0.015_6, 0.062_5]);
        let given = LadderOptions {
            max_errors: Some(vec![50.0, 0.5, 50.0]),
            ..options(SampleType::U16, 1300.0)
        };
        assert_eq!(max_errors(&given), [0.5, 50.0]);
    }

    #[test]
    fn bricks_are_dropped_only_where_there_is_a_threshold() {
        let drops = |options: &LadderOptions| {
            ladder(options).iter().filter(|rung| rung.empty_below.is_some()).count()
        };
        let with = options(SampleType::U16, 1300.0);
        assert_eq!(drops(&with), 3);
        assert_eq!(drops(&LadderOptions { empty_below: None, ..with }), 0);
    }
}
