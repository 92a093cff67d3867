//! A transfer function that is shifted, widened and strengthened by hand.

use octree_store::loader::{ControlPoint, TransferFunction};
use render_check::transfer::ColorMap;

/// How a transfer function differs from the one that was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TransferEdit {
    /// Its values are moved by so much of the data's range.
    pub(super) shift: f64,
    /// Its points lie so many times as far from their middle.
    pub(super) width: f64,
    /// Its extinction is so many times as great.
    pub(super) gain: f64,
    /// The colour map that replaces its colours, if one does, by its place among all.
    pub(super) map: Option<usize>,
}

impl Default for TransferEdit {
    fn default() -> Self {
        Self { shift: 0.0, width: 1.0, gain: 1.0, map: None }
    }
}

impl TransferEdit {
    /// Where a value of the given function goes; `range` is the data's least and greatest value.
    pub(super) fn moved(&self, value: f64, ends: [f64; 2], range: [f64; 2]) -> f64 {
        let middle = f64::midpoint(ends[0], ends[1]);
        middle + (value - middle) * self.width + self.shift * (range[1] - range[0])
    }

    /// The changed function; the given one where the change is none that numbers can hold.
    pub(super) fn of(&self, given: &TransferFunction, range: [f64; 2]) -> TransferFunction {
        if *self == Self::default() {
            return given.clone();
        }
        let points = given.points();
        let ends = [points[0].value, points[points.len() - 1].value];
        let color = |value: f64| match self.map.and_then(|at| ColorMap::all().nth(at)) {
            None => given.at(value).0,
            Some(map) if ends[0] < ends[1] => map.at((value - ends[0]) / (ends[1] - ends[0])),
            Some(map) => map.at(0.5),
        };
        let changed = |p: &ControlPoint| ControlPoint {
            value: self.moved(p.value, ends, range),
            color: if self.map.is_some() { color(p.value) } else { p.color },
            extinction: p.extinction * self.gain,
        };
        let mut all: Vec<ControlPoint> = points.iter().map(changed).collect();
        if self.map.is_some() && ends[0] < ends[1] {
            // A map's colours bend between the points too.
            let steps = 16;
            for step in 1..steps {
                let value = ends[0] + (ends[1] - ends[0]) * f64::from(step) / f64::from(steps);
                if points.iter().all(|p| p.value != value) {
                    let extinction = given.at(value).1;
                    all.push(changed(&ControlPoint { value, color: [0.0; 3], extinction }));
                }
            }
            all.sort_by(|a, b| a.value.total_cmp(&b.value));
        }
        TransferFunction::new(all).unwrap_or_else(|_| given.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given() -> TransferFunction {
        let point = |value, c, extinction| ControlPoint { value, color: [c; 3], extinction };
        // With a step at 300.
        TransferFunction::new(vec![
            point(100.0, 0.0, 0.0),
            point(300.0, 0.5, 0.0),
            point(300.0, 0.5, 2.0),
            point(500.0, 1.0, 4.0),
        ])
        .unwrap()
    }

    #[test]
    fn shifting_widening_and_strengthening_do_what_they_say() {
        let edit = TransferEdit { shift: 0.1, width: 2.0, gain: 3.0, map: None };
        let function = edit.of(&given(), [0.0, 1000.0]);
        let found: Vec<_> = function.points().iter().map(|p| (p.value, p.extinction)).collect();
        assert_eq!(found, [(0.0, 0.0), (400.0, 0.0), (400.0, 6.0), (800.0, 12.0)]);
        assert_eq!(function.points()[3].color, [1.0; 3]);
        assert_eq!(TransferEdit::default().of(&given(), [0.0, 1.0]), given());
    }

    #[test]
    fn a_map_colours_what_lies_between_the_points_and_leaves_extinction() {
        let at = ColorMap::all().position(|map| map == ColorMap::find("viridis").unwrap());
        let edit = TransferEdit { map: at, ..TransferEdit::default() };
        let function = edit.of(&given(), [0.0, 1000.0]);
        for value in [100.0, 150.0, 250.0, 299.0, 301.0, 400.0, 475.0, 500.0, 600.0] {
            let (color, extinction) = function.at(value);
            assert!((extinction - given().at(value).1).abs() < 1e-12, "{value}");
            let expected = ColorMap::find("viridis").unwrap().at((value - 100.0) / 400.0);
            assert!((0..3).all(|c| (color[c] - expected[c]).abs() < 1e-9), "{value} {color:?}");
        }
    }

    #[test]
    fn what_numbers_cannot_hold_changes_nothing() {
        let edit = TransferEdit { gain: f64::INFINITY, ..TransferEdit::default() };
        assert_eq!(edit.of(&given(), [0.0, 1.0]), given());
    }
}
