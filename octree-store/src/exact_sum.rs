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
}

impl FromIterator<f64> for CompensatedSum {
    fn from_iter<I: IntoIterator<Item = f64>>(terms: I) -> Self {
        let mut sum = Self::default();
        terms.into_iter().for_each(|term| sum.add(term));
        sum
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
    fn many_small_terms_beside_a_large_one_are_exact() {
        let terms = std::iter::once(2_f64.powi(60)).chain((0..1000).map(|_| 1.0));
        let exact = (1_u128 << 60) + 1000;
        assert_eq!(terms.collect::<CompensatedSum>().value(), exact as f64);
    }
}
