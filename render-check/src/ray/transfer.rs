//! Tables of the transfer function, the rule of the 2010 text's equation 2, and exp(-x).
//!
//! Twin of `transfer.wgsl`.

use glam::{Vec4, vec4};

/// The table at a value.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// In entries.
    x: f32,
    /// Extinction-weighted colour, and extinction.
    optics: Vec4,
    /// Their integral: at the entry below, what was rounded off there, and from there on.
    whole: Vec4,
    rest: Vec4,
    part: Vec4,
}

/// Entries nearer than this count as one (equation 2's epsilon).
const EPSILON: f32 = 1.0 / 64.0;

fn row(table: &[[[f32; 4]; 3]], entry: i32, row: usize) -> Vec4 {
    Vec4::from_array(table[entry as usize][row])
}

pub(super) fn entry_at(table: &[[[f32; 4]; 3]], value: f32) -> Entry {
    let last = (table.len() - 1) as f32;
    let x = (value * last).clamp(-1e6, 1e6);
    let below = x.floor().clamp(0.0, last);
    let above = (x.floor() + 1.0).clamp(0.0, last);
    let t = x - below;
    let f = row(table, below as i32, 0);
    let rise = row(table, above as i32, 0) - f;
    // Beyond the ends the function is constant.
    Entry {
        x,
        optics: f + rise * t.clamp(0.0, 1.0),
        whole: row(table, below as i32, 1),
        rest: row(table, below as i32, 2),
        part: t * f + (0.5 * t * t) * rise,
    }
}

/// The mean of the function between two values: equation 2.
pub(super) fn mean(a: &Entry, b: &Entry) -> Vec4 {
    let width = b.x - a.x;
    if width.abs() > EPSILON {
        let integral = (b.whole - a.whole) + ((b.rest - a.rest) + (b.part - a.part));
        return (integral / width).max(vec4(0.0, 0.0, 0.0, 0.0));
    }
    0.5 * (a.optics + b.optics)
}

/// exp(-x) and (1 - exp(-x)) / x.
pub(super) fn decay(x: f32) -> [f32; 2] {
    if x < 0.5 {
        // Products: divisions are dear, and the terms are the same to a unit or two of the last place.
        let [c, d, e] = [1.0 / 3.0, 1.0 / 6.0, 1.0 / 7.0];
        let inner = 1.0 - x * 0.2 * (1.0 - x * d * (1.0 - x * e));
        let share = 1.0 - x * 0.5 * (1.0 - x * c * (1.0 - x * 0.25 * inner));
        return [1.0 - x * share, share];
    }
    let left = (-x).exp();
    [left, (1.0 - left) / x]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::{ExactIntegrals, TransferTable};
    use octree_store::loader::{ControlPoint, TransferFunction};

    fn function() -> TransferFunction {
        let point = |value, color, extinction| ControlPoint { value, color, extinction };
        TransferFunction::new(vec![
            point(0.0, [0.1, 0.2, 0.3], 0.0),
            point(0.21, [0.9, 0.2, 0.4], 5.0),
            point(0.7, [0.3, 1.0, 0.0], 0.25),
            point(1.0, [1.0, 1.0, 1.0], 3.0),
        ])
        .unwrap()
    }

    /// Pairs of values from far apart to next to nothing, and beyond the ends.
    fn pairs() -> impl Iterator<Item = [f64; 2]> {
        (0..4000).map(|i| {
            let a = f64::from(i * 7919 % 4001) / 4001.0 * 1.2 - 0.1;
            let width = 10_f64.powf(-f64::from(i % 9));
            [a, if i % 2 == 0 { a + width } else { a - width }]
        })
    }

    /// The largest error of a mean, as a share of the greatest extinction.
    fn error(entries: usize) -> f64 {
        let exact = ExactIntegrals::new(&function());
        let table = TransferTable::new(&function(), [0.0, 1.0], entries);
        let mut worst = 0.0_f64;
        for [a, b] in pairs() {
            let (x, y) = (entry_at(&table.rows, a as f32), entry_at(&table.rows, b as f32));
            let found = mean(&x, &y).to_array();
            // What f32 makes of the values is no error of the table.
            let expected = exact.mean(f64::from(a as f32), f64::from(b as f32));
            for c in 0..4 {
                worst = worst.max((f64::from(found[c]) - expected[c]).abs() / 5.0);
            }
        }
        worst
    }

    #[test]
    fn tables_are_right_to_a_few_units_of_f32_whatever_their_length() {
        for (entries, bound) in [(65_536, 2e-5), (4096, 4e-4)] {
            let found = error(entries);
            println!("{entries} entries: {found:e} of the greatest extinction");
            assert!(found < bound, "{entries}: {found}");
        }
    }

    #[test]
    fn a_step_is_one_entry_wide_and_keeps_its_mass() {
        let point = |value, extinction| ControlPoint { value, color: [1.0; 3], extinction };
        let step = TransferFunction::new(vec![
            point(0.0, 0.0),
            point(0.5, 0.0),
            point(0.5, 2.0),
            point(1.0, 2.0),
        ])
        .unwrap();
        let table = TransferTable::new(&step, [0.0, 1.0], 1000);
        let between = |a: f32, b: f32| mean(&entry_at(&table.rows, a), &entry_at(&table.rows, b)).w;
        assert!((between(0.0, 1.0) - 1.0).abs() < 1e-5);
        assert_eq!(between(0.0, 0.498), 0.0);
        assert!((between(0.502, 1.0) - 2.0).abs() < 1e-5);
        assert!((between(0.4, 0.6) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn a_peak_between_two_entries_is_not_lost() {
        let point = |value, extinction| ControlPoint { value, color: [1.0; 3], extinction };
        let peak = TransferFunction::new(vec![
            point(0.0, 0.0),
            point(0.5001, 0.0),
            point(0.5002, 100.0),
            point(0.5003, 0.0),
            point(1.0, 0.0),
        ])
        .unwrap();
        let table = TransferTable::new(&peak, [0.0, 1.0], 101);
        let found = mean(&entry_at(&table.rows, 0.0), &entry_at(&table.rows, 1.0)).w;
        assert!((found - 0.01).abs() < 1e-6, "{found}");
    }

    #[test]
    fn what_is_left_of_light_is_right_for_every_depth() {
        for i in -90..=40 {
            let x = 10_f64.powf(f64::from(i) / 10.0);
            let [left, share] = decay(x as f32).map(f64::from);
            let x = f64::from(x as f32);
            assert!((left - (-x).exp()).abs() < 1e-6, "{x}");
            let expected = -(-x).exp_m1() / x;
            assert!((share - expected).abs() < 1e-6 * expected, "{x}: {share} {expected}");
        }
        assert_eq!(decay(0.0), [1.0, 1.0]);
    }
}
