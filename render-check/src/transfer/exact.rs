//! Integrals of a transfer function over the value, exactly: pieces of extinction are linear, pieces of
//! extinction-weighted colour quadratic, so their integrals are polynomials (2010 text, section 3: F(s)).

use octree_store::loader::{ControlPoint, TransferFunction};

/// Extinction-weighted colour and extinction, or their integrals.
pub(crate) type Optics = [f64; 4];

/// A transfer function with its integral from its first point on.
#[derive(Debug, Clone)]
pub(crate) struct ExactIntegrals {
    points: Vec<ControlPoint>,
    /// The integral up to each point.
    up_to: Vec<Optics>,
}

impl ExactIntegrals {
    pub(crate) fn new(transfer: &TransferFunction) -> Self {
        let points = transfer.points().to_vec();
        let mut up_to = vec![[0.0; 4]];
        for pair in points.windows(2) {
            let piece = piece(&pair[0], &pair[1], 1.0);
            let before = up_to[up_to.len() - 1];
            up_to.push([0, 1, 2, 3].map(|i| before[i] + piece[i]));
        }
        Self { points, up_to }
    }

    /// Extinction-weighted colour, and extinction.
    pub(crate) fn at(&self, value: f64) -> Optics {
        let above = self.points.partition_point(|point| point.value <= value);
        let low = &self.points[above.saturating_sub(1)];
        let high = &self.points[above.min(self.points.len() - 1)];
        weighted(low, high, share(low, high, value))
    }

    /// The integral from the first point to `value`.
    fn integral(&self, value: f64) -> Optics {
        let last = self.points.len() - 1;
        let above = self.points.partition_point(|point| point.value <= value);
        if above == 0 || above > last {
            let end = if above == 0 { 0 } else { last };
            let rest = value - self.points[end].value;
            let constant = weighted(&self.points[end], &self.points[end], 0.0);
            return [0, 1, 2, 3].map(|i| self.up_to[end][i] + rest * constant[i]);
        }
        let (low, high) = (&self.points[above - 1], &self.points[above]);
        let piece = piece(low, high, share(low, high, value));
        [0, 1, 2, 3].map(|i| self.up_to[above - 1][i] + piece[i])
    }

    /// The mean between two values (2010 text, equation 2). Values so near that the difference of integrals would
    /// be rounding are taken by Simpson's rule, which is exact within a piece.
    pub(crate) fn mean(&self, a: f64, b: f64) -> Optics {
        let width = b - a;
        let scale = self.points.iter().map(|p| p.value.abs()).fold(a.abs().max(b.abs()), f64::max);
        if width.abs() > 1e-7 * scale && width.is_finite() {
            let (from, to) = (self.integral(a), self.integral(b));
            return [0, 1, 2, 3].map(|i| ((to[i] - from[i]) / width).max(0.0));
        }
        let (from, middle, to) = (self.at(a), self.at(f64::midpoint(a, b)), self.at(b));
        [0, 1, 2, 3].map(|i| (from[i] + 4.0 * middle[i] + to[i]) / 6.0)
    }

    /// The values at which pieces meet.
    pub(crate) fn knots(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|point| point.value)
    }
}

fn share(low: &ControlPoint, high: &ControlPoint, value: f64) -> f64 {
    let span = high.value - low.value;
    if span > 0.0 { ((value - low.value) / span).clamp(0.0, 1.0) } else { 0.0 }
}

/// Colour times extinction, and extinction, a share of the way between two points.
fn weighted(low: &ControlPoint, high: &ControlPoint, t: f64) -> Optics {
    let mix = |a: f64, b: f64| a + t * (b - a);
    let extinction = mix(low.extinction, high.extinction);
    let [r, g, b] = [0, 1, 2].map(|c| mix(low.color[c], high.color[c]) * extinction);
    [r, g, b, extinction]
}

/// The integral of a share `t` of a piece.
fn piece(low: &ControlPoint, high: &ControlPoint, t: f64) -> Optics {
    let width = high.value - low.value;
    let rise = high.extinction - low.extinction;
    let [r, g, b] = [0, 1, 2].map(|c| {
        let (base, slope) = (low.color[c], high.color[c] - low.color[c]);
        // (base + slope u) (extinction + rise u), integrated over u.
        let linear = base * rise + slope * low.extinction;
        width * t * (base * low.extinction + t * (linear / 2.0 + t * slope * rise / 3.0))
    });
    [r, g, b, width * t * (low.extinction + t * rise / 2.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> TransferFunction {
        let point = |value, color, extinction| ControlPoint { value, color, extinction };
        TransferFunction::new(vec![
            point(-2.0, [0.2, 0.0, 1.0], 0.5),
            point(1.0, [1.0, 0.5, 0.0], 3.0),
            point(1.0, [0.0, 0.5, 0.3], 0.0),
            point(4.0, [0.3, 0.9, 0.1], 2.0),
        ])
        .unwrap()
    }

    #[test]
    fn means_are_those_of_a_sum_over_many_values() {
        let exact = ExactIntegrals::new(&example());
        for (a, b) in
            [(-5.0, 7.0), (0.9, 1.1), (-1.0, 0.5), (3.0, -3.0), (4.5, 6.0), (2.0, 2.0 + 1e-9)]
        {
            let n = 200_000;
            let mut sums = [0.0; 4];
            for i in 0..n {
                let at = exact.at(a + (b - a) * (f64::from(i) + 0.5) / f64::from(n));
                sums = [0, 1, 2, 3].map(|c| sums[c] + at[c]);
            }
            let mean = exact.mean(a, b);
            for c in 0..4 {
                assert!(
                    (mean[c] - sums[c] / f64::from(n)).abs() < 2e-5,
                    "{a} {b}: {mean:?} {sums:?}"
                );
            }
        }
    }

    #[test]
    fn colour_and_extinction_are_the_transfer_functions_own() {
        let (transfer, exact) = (example(), ExactIntegrals::new(&example()));
        for i in -60..60 {
            let value = f64::from(i) / 10.0;
            let (color, extinction) = transfer.at(value);
            let found = exact.at(value);
            assert!((found[3] - extinction).abs() < 1e-12);
            assert!((0..3).all(|c| (found[c] - color[c] * extinction).abs() < 1e-12), "{value}");
        }
    }
}
