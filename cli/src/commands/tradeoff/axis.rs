//! Axes of the plots: where a value lies, and where the marks are.
//!
//! A logarithmic axis has no place for zero, nor a decibel axis for no error at all: such values get a
//! column of their own at the edge, with a mark of its own.

use super::report::short;

/// How an axis is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// Evenly, from zero on.
    FromZero,
    /// Evenly over the values.
    Linear,
    /// By powers.
    Log,
}

/// An axis over values of which some have no place on it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    scale: Scale,
    /// First and last place.
    pub(super) low: f64,
    pub(super) high: f64,
    /// Places of the marks, with their words.
    pub(super) marks: Vec<(f64, String)>,
    /// Where the column of those without a place begins and ends, and its middle.
    pub(super) edge: Option<[f64; 3]>,
}

impl Axis {
    /// An axis that holds these values; `None` among them are those without a place, which are called
    /// `edge` and stand below the others, or above them where the axis is linear.
    pub(super) fn new(values: &[Option<f64>], scale: Scale, edge: &str) -> Self {
        let places: Vec<f64> = values.iter().flatten().map(|&v| place(scale, v)).collect();
        let without = places.len() < values.len();
        let mut low = places.iter().copied().fold(f64::INFINITY, f64::min);
        let mut high = places.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if scale == Scale::FromZero {
            low = 0.0;
        }
        if high - low < 1e-9 * high.abs().max(1e-300) {
            let half = if scale == Scale::Log { 0.5 } else { (high.abs() / 2.0).max(0.5) };
            (low, high) = (low - half, high + half);
        }
        let margin = 0.08 * (high - low);
        let (first, last) = if scale == Scale::FromZero { (0.0, low) } else { (margin, low) };
        (low, high) = (last - first, high + margin);
        let mut marks = match scale {
            Scale::Log => log_marks(low, high),
            Scale::FromZero | Scale::Linear => even_marks(low, high),
        };
        let mut column = None;
        if without {
            let width = 0.1 * (high - low);
            let at = if scale == Scale::Log { [low - width, low] } else { [high, high + width] };
            let middle = f64::midpoint(at[0], at[1]);
            marks.push((middle, edge.to_owned()));
            column = Some([at[0], at[1], middle]);
            (low, high) = (low.min(at[0]), high.max(at[1]));
        }
        Self { scale, low, high, marks, edge: column }
    }

    /// An axis of the whole numbers from 0 to `last`.
    pub(super) fn counting(last: usize) -> Self {
        let marks = (0..=last).map(|n| (n as f64, n.to_string())).collect();
        Self { scale: Scale::Linear, low: -0.25, high: last as f64 + 0.25, marks, edge: None }
    }

    /// The place of a value.
    pub(super) fn at(&self, value: Option<f64>) -> f64 {
        match (value, self.edge) {
            (Some(value), _) => place(self.scale, value),
            (None, Some([.., middle])) => middle,
            (None, None) => self.low,
        }
    }
}

fn place(scale: Scale, value: f64) -> f64 {
    if scale == Scale::Log { value.log10() } else { value }
}

/// Marks at 1, 2 and 5 times the powers of ten, or at these alone where there would be too many.
fn log_marks(low: f64, high: f64) -> Vec<(f64, String)> {
    let decades = low.floor() as i32..=high.ceil() as i32;
    let every = ((high - low) / 7.0).ceil().max(1.0) as i32;
    let steps: &[f64] = if high - low > 3.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    decades
        .filter(|decade| decade.rem_euclid(every) == 0)
        .flat_map(|decade| steps.iter().map(move |step| step * 10_f64.powi(decade)))
        .map(|value| (value.log10(), short(value)))
        .filter(|(at, _)| (low..=high).contains(at))
        .collect()
}

/// About six marks at round numbers.
fn even_marks(low: f64, high: f64) -> Vec<(f64, String)> {
    let rough = (high - low) / 6.0;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|step| step * power)
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(10.0 * power);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|n| n as f64 * step).map(|value| (value, short(value))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_has_a_column_of_its_own_beside_a_logarithmic_axis() {
        let axis = Axis::new(&[Some(1.0), Some(100.0), None], Scale::Log, "0");
        let [begin, end, middle] = axis.edge.unwrap();
        assert!(begin < middle && middle < end && end < axis.at(Some(1.0)));
        assert_eq!((axis.at(Some(100.0)), axis.at(None)), (2.0, middle));
        assert!(axis.marks.contains(&(middle, "0".into())), "{:?}", axis.marks);
        assert!(axis.marks.contains(&(1.0, "10".into())));
        assert_eq!(axis.low, begin);
    }

    #[test]
    fn no_error_stands_beyond_the_highest_psnr() {
        let axis = Axis::new(&[Some(40.0), None, Some(70.0)], Scale::Linear, "exact");
        let [begin, end, _] = axis.edge.unwrap();
        assert!(axis.at(Some(70.0)) < begin && end == axis.high);
        assert!(Axis::new(&[Some(40.0)], Scale::Linear, "exact").edge.is_none());
    }

    #[test]
    fn axes_of_one_value_or_none_have_a_width() {
        for values in [&[][..], &[Some(0.0)], &[Some(7.0)], &[None], &[Some(1e-300)]] {
            for scale in [Scale::FromZero, Scale::Linear] {
                let axis = Axis::new(values, scale, "none");
                assert!(axis.high > axis.low && axis.marks.len() < 12, "{values:?} {axis:?}");
            }
        }
        let wide = Axis::new(&[Some(1e-30), Some(1e30)], Scale::Log, "0");
        assert!((4..12).contains(&wide.marks.len()), "{:?}", wide.marks);
    }
}
