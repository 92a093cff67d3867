//! A sum of f64 that does not drift: Neumaier's compensated summation.
//!
//! The error of n additions is one rounding of the result plus n^2 * 2^-106 of the terms' sum, so
//! 2^36 terms lose nothing that f64 can show. Source: A. Neumaier, "Rundungsfehleranalyse einiger
//! Verfahren zur Summation endlicher Summen", ZAMM 54 (1974).

/// A running sum with the rounding errors carried beside it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CompensatedSum {
    sum: f64,
    error: f64,
}

impl CompensatedSum {
    /// Adds one finite term.
    pub fn add(&mut self, term: f64) {
        let total = self.sum + term;
        self.error += if self.sum.abs() >= term.abs() {
            (self.sum - total) + term
        } else {
            (term - total) + self.sum
        };
        self.sum = total;
    }

    /// The sum, rounded once.
    pub fn value(&self) -> f64 {
        self.sum + self.error
    }

    /// The two numbers that the sum is made of, to be kept and taken up again.
    pub fn to_parts(self) -> [f64; 2] {
        [self.sum, self.error]
    }

    /// The sum of these parts.
    pub fn from_parts([sum, error]: [f64; 2]) -> Self {
        Self { sum, error }
    }
}

impl FromIterator<f64> for CompensatedSum {
    fn from_iter<I: IntoIterator<Item = f64>>(terms: I) -> Self {
        let mut sum = Self::default();
        terms.into_iter().for_each(|term| sum.add(term));
        sum
    }
}

/// The root mean square of weighted values, kept as a scale and a sum of ratios so that no square
/// overflows (as LAPACK's `dlassq` does).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WeightedRms {
    scale: f64,
    squares: CompensatedSum,
    weight: f64,
}

impl WeightedRms {
    /// The numbers that it is made of, to be kept and taken up again.
    pub fn to_parts(self) -> [f64; 4] {
        let [sum, error] = self.squares.to_parts();
        [self.scale, sum, error, self.weight]
    }

    /// The root mean square of these parts.
    pub fn from_parts([scale, sum, error, weight]: [f64; 4]) -> Self {
        Self { scale, squares: CompensatedSum::from_parts([sum, error]), weight }
    }

    /// Adds a finite value that is not negative, with its weight.
    pub fn add(&mut self, weight: f64, value: f64) {
        if value > self.scale {
            let ratio = self.scale / value;
            let rescaled = self.squares.value() * ratio * ratio;
            self.squares = CompensatedSum { sum: rescaled, error: 0.0 };
            self.scale = value;
        }
        if self.scale > 0.0 {
            let ratio = value / self.scale;
            self.squares.add(weight * ratio * ratio);
        }
        self.weight += weight;
    }

    /// The root mean square; 0 of nothing.
    pub fn value(&self) -> f64 {
        if self.weight > 0.0 {
            self.scale * (self.squares.value() / self.weight).sqrt()
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_plain_addition_loses_is_kept() {
        let terms = [1.0, 1e100, 1.0, -1e100];
        assert_eq!(
            terms.iter().sum::<f64>(),
            0.0,
            "the plain sum must fail for this test to say much"
        );
        assert_eq!(terms.into_iter().collect::<CompensatedSum>().value(), 2.0);
    }

    #[test]
    fn a_weighted_rms_follows_its_definition_without_overflow() {
        for unit in [1.0, 1e250, 1e-250] {
            let mut rms = WeightedRms::default();
            rms.add(2.0, 3.0 * unit);
            rms.add(1.0, 4.0 * unit);
            rms.add(1.0, 0.0);
            let expected = (34.0_f64 / 4.0).sqrt() * unit; // (2 x 9 + 16) / 4
            assert!((rms.value() / expected - 1.0).abs() < 1e-14, "{unit}");
        }
        assert_eq!(WeightedRms::default().value(), 0.0);
    }

    #[test]
    fn many_small_terms_beside_a_large_one_are_exact() {
        let terms = std::iter::once(2_f64.powi(60)).chain((0..1000).map(|_| 1.0));
        let exact = (1_u128 << 60) + 1000;
        assert_eq!(terms.collect::<CompensatedSum>().value(), exact as f64);
    }
}
