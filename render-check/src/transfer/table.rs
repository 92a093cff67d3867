//! A transfer function as the table that shaders take: N entries over the window, made in f64.
//!
//! An entry is the mean of the function weighted by the hat around it. So where the function is linear the table
//! is the function, its integral is kept whatever lies between entries, and a step is one entry wide. The first and the last are
//! the function's own values, which go on beyond.
//! Between entries the table is linear, and its integral known exactly. The integral of N entries grows to N times the
//! function, and equation 2 of the 2010 text takes small differences of it; so it is stored as two floats, the
//! second being what the first rounds away.

use super::exact::ExactIntegrals;
use crate::view::Look;
use octree_store::loader::TransferFunction;

/// The abscissae of Gauss's rule of two points in 0..1, exact for cubic pieces: a quadratic times a hat.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];

/// The table of a transfer function: three rows, interleaved.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferTable {
    /// For each entry: extinction-weighted colour and extinction; their integral, in entries; and what it was rounded by.
    pub(crate) rows: Vec<[[f32; 4]; 3]>,
}

impl TransferTable {
    /// The table of a look.
    pub fn of(look: &Look) -> Self {
        Self::new(&look.transfer, look.window, look.table_entries as usize)
    }

    /// The table of `entries` (2 at least) values, the first and last at the window's ends.
    pub fn new(transfer: &TransferFunction, window: [f64; 2], entries: usize) -> Self {
        let exact = ExactIntegrals::new(transfer);
        let entries = entries.max(2);
        let [low, width] = [window[0], window[1] - window[0]];
        let value = |x: f64| low + width * x / (entries - 1) as f64;
        let mut knots: Vec<f64> =
            exact.knots().map(|v| (v - low) / width * (entries - 1) as f64).collect();
        knots.push(f64::INFINITY);
        let mut values = vec![[0.0; 4]; entries];
        let mut knot = 0;
        for i in 0..entries - 1 {
            // The interval between two entries, in pieces without a knot inside.
            let (mut from, end) = (i as f64, (i + 1) as f64);
            while from < end {
                while knots[knot] <= from {
                    knot += 1;
                }
                let to = knots[knot].min(end);
                for at in GAUSS.map(|g| from + g * (to - from)) {
                    let (f, t) = (exact.at(value(at)), at - i as f64);
                    let weight = (to - from) / 2.0;
                    for c in 0..4 {
                        values[i][c] += weight * (1.0 - t) * f[c];
                        values[i + 1][c] += weight * t * f[c];
                    }
                }
                from = to;
            }
        }
        // Beyond its ends the table goes on as the function does there.
        values[0] = exact.at(low.next_down());
        values[entries - 1] = exact.at(window[1].next_up());
        let mut integral = [0.0_f64; 4];
        let mut before: Option<[f32; 4]> = None;
        let rows = values
            .into_iter()
            .map(|value| {
                // Summed of the rounded entries, so that rows belong to one another.
                let value = value.map(|v| v as f32);
                if let Some(before) = before {
                    integral = [0, 1, 2, 3].map(|c| {
                        integral[c] + f64::midpoint(f64::from(before[c]), f64::from(value[c]))
                    });
                }
                before = Some(value);
                let high = integral.map(|v| v as f32);
                let rest = [0, 1, 2, 3].map(|c| (integral[c] - f64::from(high[c])) as f32);
                [value, high, rest]
            })
            .collect();
        Self { rows }
    }
}
