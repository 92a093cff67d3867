//! What values look like, and which ranges of values cannot be seen at all.
//!
//! The 2008 text (section 4) takes the difference of summed opacities at a brick's least and greatest
//! value: empty if nothing was added between. Sums of floats may cancel, and a range of one value adds
//! nothing even where it is opaque. A function of straight pieces between control points is
//! zero on a range exactly if it is at every point that the range touches, so prefix sums that *count* opaque
//! points decide it exactly. For an isovalue a brick is empty iff the value lies outside its range.

use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;
use thiserror::Error;

/// Why a transfer function cannot be used.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TransferError {
    /// No control point.
    #[error("a transfer function needs at least one point")]
    NoPoints,
    /// A number that is none, or infinite.
    #[error("point {point}: {what} must be a finite number, and is {found}")]
    NotFinite {
        /// Which point, from 0.
        point: usize,
        /// Which field.
        what: &'static str,
        /// The number.
        found: f64,
    },
    /// Values that go down.
    #[error(
        "point {point}: its value {found} is below the one before it, {before}: sort the points by value"
    )]
    Unsorted {
        /// Which point, from 0.
        point: usize,
        /// Its value.
        found: f64,
        /// The value of the point before it.
        before: f64,
    },
    /// A colour that no display has.
    #[error("point {point}: a colour has components from 0 to 1, and {found} was given")]
    Color {
        /// Which point, from 0.
        point: usize,
        /// The component.
        found: f64,
    },
    /// Extinction below 0.
    #[error("point {point}: extinction must be 0 or more, and is {found}")]
    Extinction {
        /// Which point, from 0.
        point: usize,
        /// The extinction per unit length.
        found: f64,
    },
}

/// One point of a transfer function; linear between points, constant outside. Two points of one value are a step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlPoint {
    /// The value, in source units.
    pub value: f64,
    /// Display colour: red, green, blue from 0 to 1.
    pub color: [f64; 3],
    /// Extinction per world unit.
    pub extinction: f64,
}

/// Value to colour and extinction. JSON as in
/// `{"points":[{"value":0,"color":[0,0,0],"extinction":0},{"value":900,"color":[1,0.9,0.8],"extinction":2.5}]}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "TransferJson", into = "TransferJson")]
pub struct TransferFunction {
    points: Vec<ControlPoint>,
    /// How many of the points before this one have extinction; one more than points.
    opaque_before: Vec<u32>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TransferJson {
    points: Vec<ControlPoint>,
}

impl TransferFunction {
    /// A transfer function of control points.
    ///
    /// # Errors
    /// When there is none, they are not sorted by value, or a number is out of its range.
    pub fn new(points: Vec<ControlPoint>) -> Result<Self, TransferError> {
        if points.is_empty() {
            return Err(TransferError::NoPoints);
        }
        let mut opaque_before = vec![0];
        for (index, point) in points.iter().enumerate() {
            let ControlPoint { value, color, extinction } = *point;
            let [r, g, b] = color;
            for (what, found) in [
                ("value", value),
                ("color", r),
                ("color", g),
                ("color", b),
                ("extinction", extinction),
            ] {
                if !found.is_finite() {
                    return Err(TransferError::NotFinite { point: index, what, found });
                }
            }
            if let Some(before) = index.checked_sub(1).map(|i| points[i].value)
                && value < before
            {
                return Err(TransferError::Unsorted { point: index, found: value, before });
            }
            if let Some(&found) = color.iter().find(|c| !(0.0..=1.0).contains(*c)) {
                return Err(TransferError::Color { point: index, found });
            }
            if extinction < 0.0 {
                return Err(TransferError::Extinction { point: index, found: extinction });
            }
            opaque_before.push(opaque_before[index] + u32::from(extinction > 0.0));
        }
        Ok(Self { points, opaque_before })
    }

    /// The points, in order.
    pub fn points(&self) -> &[ControlPoint] {
        &self.points
    }

    /// Colour and extinction of a value; at a step, those above it. NaN has none.
    pub fn at(&self, value: f64) -> ([f64; 3], f64) {
        if value.is_nan() {
            return ([0.0; 3], 0.0);
        }
        let above = self.points.partition_point(|point| point.value <= value);
        let low = &self.points[above.saturating_sub(1)];
        let high = &self.points[above.min(self.points.len() - 1)];
        let span = high.value - low.value;
        let t = if span > 0.0 { ((value - low.value) / span).clamp(0.0, 1.0) } else { 0.0 };
        let mix = |a: f64, b: f64| a + t * (b - a);
        let color = [0, 1, 2].map(|c| mix(low.color[c], high.color[c]));
        (color, mix(low.extinction, high.extinction))
    }

    /// Whether no value of `min..=max` has any extinction.
    pub fn is_empty(&self, min: f64, max: f64) -> bool {
        let touched = self.touched(min, max);
        self.opaque_before[touched.end() + 1] == self.opaque_before[*touched.start()]
    }

    /// The points that decide what the function is on a range: those in it, and where it begins or ends
    /// between two points, these.
    fn touched(&self, min: f64, max: f64) -> RangeInclusive<usize> {
        let last = self.points.len() - 1;
        let first = self.points.partition_point(|point| point.value < min);
        let first = match self.points.get(first) {
            Some(point) if point.value == min => first,
            _ => first.saturating_sub(1),
        };
        let end = self.points.partition_point(|point| point.value <= max);
        let end = match end.checked_sub(1).map(|i| self.points[i].value) {
            Some(value) if value == max => end - 1,
            _ => end.min(last),
        };
        first..=end.max(first)
    }

    /// A bound on how fast extinction and extinction-weighted colour change with the value in
    /// `min..=max`: per unit length and unit of value. Infinite where a step lies in the range.
    pub fn steepness(&self, min: f64, max: f64) -> f64 {
        self.points[self.touched(min, max)].windows(2).fold(0.0, |steepest, pair| {
            let [a, b] = [pair[0], pair[1]];
            let color = (0..3).fold(0.0_f64, |d, c| d.max((a.color[c] - b.color[c]).abs()));
            let rise = (a.extinction - b.extinction).abs() + a.extinction.max(b.extinction) * color;
            let span = b.value - a.value;
            f64::max(steepest, if rise == 0.0 { 0.0 } else { rise / span })
        })
    }
}

impl TryFrom<TransferJson> for TransferFunction {
    type Error = TransferError;

    fn try_from(json: TransferJson) -> Result<Self, TransferError> {
        Self::new(json.points)
    }
}

impl From<TransferFunction> for TransferJson {
    fn from(function: TransferFunction) -> Self {
        Self { points: function.points }
    }
}

/// What is shown of a volume.
#[derive(Debug, Clone, PartialEq)]
pub enum Appearance {
    /// A transfer function, for direct volume rendering.
    Transfer(TransferFunction),
    /// The surface of one value.
    Isovalue(f64),
    /// Every value, as in a maximum intensity projection: nothing is empty.
    Everything,
}

impl Appearance {
    /// Whether it is the same to the bit: equality, but for a surface of no number.
    pub(super) fn is(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Isovalue(a), Self::Isovalue(b)) => a.to_bits() == b.to_bits(),
            (a, b) => a == b,
        }
    }

    /// Whether nothing of the range `min..=max` can be seen.
    pub fn is_empty(&self, min: f64, max: f64) -> bool {
        match self {
            Self::Transfer(function) => function.is_empty(min, max),
            Self::Isovalue(value) => !(min..=max).contains(value),
            Self::Everything => false,
        }
    }

    /// A bound on the error in opacity (0 to 1) of a ray through a brick `length` long, whose values in
    /// `range` deviate by `deviation`. Of a surface nothing is known but that no deviation is no error;
    /// where everything is shown, it is the share of the volume's own range, `volume_range`.
    pub(super) fn error(
        &self,
        range: [f64; 2],
        deviation: f64,
        length: f64,
        volume_range: [f64; 2],
    ) -> f64 {
        if deviation == 0.0 {
            return 0.0;
        }
        match self {
            Self::Transfer(function) => {
                // Levels are means, so a brick's values and the finer ones lie in its subtree's range.
                let steepness = function.steepness(range[0], range[1]);
                if steepness == 0.0 { 0.0 } else { -(-steepness * deviation * length).exp_m1() }
            }
            // A surface moves by the deviation over the gradient, which may be as small as it likes.
            Self::Isovalue(_) => {
                if deviation == 0.0 {
                    0.0
                } else {
                    f64::INFINITY
                }
            }
            Self::Everything => deviation / (volume_range[1] - volume_range[0]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn function(points: &[(f64, f64)]) -> TransferFunction {
        let point = |&(value, extinction): &(f64, f64)| ControlPoint {
            value,
            color: [extinction.min(1.0), 0.5, 0.0],
            extinction,
        };
        TransferFunction::new(points.iter().map(point).collect()).unwrap()
    }

    #[test]
    fn json_is_read_and_written_and_mistakes_are_named() {
        let json = r#"{"points":[{"value":0.0,"color":[0.0,0.0,0.0],"extinction":0.0},{"value":900.0,"color":[1.0,0.9,0.8],"extinction":2.5}]}"#;
        let parse = |json: &str| {
            serde_json::from_str::<TransferFunction>(json).map_err(|error| error.to_string())
        };
        assert_eq!(serde_json::to_string(&parse(json).unwrap()).unwrap(), json);
        let fails = |from: &str, to: &str| parse(&json.replace(from, to)).unwrap_err();
        assert!(fails("900.0", "-1").contains("sort the points"));
        assert!(fails("2.5", "-2.5").contains("0 or more"));
        assert!(fails("0.9", "1.9").contains("from 0 to 1"));
        assert!(fails("2.5", "null").contains("invalid type"));
        assert!(fails("2.5", "1e999").contains("out of range"));
        assert!(fails("\"value\":900.0", "\"value\":900.0,\"alpha\":1").contains("alpha"));
        assert!(parse(r#"{"points":[]}"#).unwrap_err().contains("at least one"));
        let nan = ControlPoint { value: f64::NAN, color: [0.0; 3], extinction: 0.0 };
        assert!(TransferFunction::new(vec![nan]).unwrap_err().to_string().contains("finite"));
    }

    #[test]
    fn a_step_is_seen_from_its_own_value_on() {
        let step = function(&[(100.0, 0.0), (100.0, 3.0), (101.0, 3.0), (101.0, 0.0)]);
        assert!(step.is_empty(0.0, 99.999));
        assert!(!step.is_empty(0.0, 100.0), "the step's own value counts");
        assert!(!step.is_empty(100.5, 100.5), "a range of one opaque value is not empty");
        assert!(step.is_empty(101.001, 1e9));
        assert_eq!(step.at(100.5).1, 3.0);
        assert_eq!(step.at(99.0).1, 0.0);
        assert_eq!(step.steepness(0.0, 200.0), f64::INFINITY);
        assert_eq!(step.steepness(100.2, 100.8), 0.0);
    }

    #[test]
    fn tiny_opacities_beside_huge_ones_are_not_lost() {
        let f = function(&[(0.0, 1e30), (1.0, 0.0), (2.0, 0.0), (3.0, 1e-30), (4.0, 0.0)]);
        assert!(!f.is_empty(2.5, 3.0));
        assert!(f.is_empty(1.0, 2.0));
        assert!(!f.is_empty(2.0, 2.0 + 1e-9), "a rise begins at once");
    }

    #[test]
    fn an_isovalue_is_in_the_range_or_not() {
        assert!(Appearance::Isovalue(5.0).is_empty(6.0, 7.0));
        assert!(!Appearance::Isovalue(5.0).is_empty(5.0, 7.0));
        assert!(!Appearance::Everything.is_empty(0.0, 0.0));
        let error =
            |deviation| Appearance::Isovalue(5.0).error([4.0, 6.0], deviation, 1.0, [0.0, 9.0]);
        assert_eq!([error(0.0), error(1e-9)], [0.0, f64::INFINITY], "nothing bounds the gradient");
    }

    proptest! {
        #[test]
        fn emptiness_is_that_of_every_value_in_the_range(
            points in proptest::collection::vec((0_u8..40, 0_u8..3), 1..8), a in 0_u8..44, b in 0_u8..44,
        ) {
            let mut points: Vec<(f64, f64)> =
                points.into_iter().map(|(v, e)| (f64::from(v), f64::from(e))).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let f = function(&points);
            let (min, max) = (f64::from(a.min(b)) - 2.0, f64::from(a.max(b)) - 2.0);
            // Straight pieces between whole values: quarters meet each of them inside.
            let steps = ((max - min) * 4.0) as u32;
            let sampled = (0..=steps).all(|i| f.at(min + f64::from(i) / 4.0).1 == 0.0);
            let step_below = points.iter().any(|p| (min..=max).contains(&p.0) && p.1 > 0.0);
            prop_assert_eq!(f.is_empty(min, max), sampled && !step_below);
        }

        #[test]
        fn steepness_bounds_what_differs(
            points in proptest::collection::vec((0_u8..40, 0_u8..4), 2..8), a in 0.0..40.0, b in 0.0..40.0,
        ) {
            let mut points: Vec<(f64, f64)> =
                points.into_iter().map(|(v, e)| (f64::from(v), f64::from(e))).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let f = function(&points);
            let (low, high) = (f64::min(a, b), f64::max(a, b));
            let bound = f.steepness(low, high) * (high - low);
            let ((ca, ea), (cb, eb)) = (f.at(low), f.at(high));
            prop_assert!((ea - eb).abs() <= bound * (1.0 + 1e-9) + 1e-9);
            for c in 0..3 {
                prop_assert!((ea * ca[c] - eb * cb[c]).abs() <= bound * (1.0 + 1e-9) + 1e-9);
            }
        }
    }
}
