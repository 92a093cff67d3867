//! A sum of f64 that is exact: the order of its terms, and how they were grouped, do not matter.
//!
//! Every finite f64 is a whole multiple of 2^-1074 below 2^1024. So a sum of 2^64 of them is a whole
//! number of 2162 bits, which is kept as such, in two's complement, and rounded once when it is asked
//! for. Source: U. W. Kulisch, "Computer Arithmetic and Validity" (2008), the long accumulator.

use serde::{Deserialize, Serialize};

/// 64-bit limbs: 2098 bits of a term, 64 for carries, a sign, and some to spare.
const LIMBS: usize = 35;

/// A running sum of finite f64, exact up to 2^64 terms.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "Vec<u64>", try_from = "Vec<u64>")]
pub struct ExactSum {
    /// The sum in units of 2^-1074, least limb first, in two's complement.
    limbs: [u64; LIMBS],
}

impl Default for ExactSum {
    fn default() -> Self {
        Self { limbs: [0; LIMBS] }
    }
}

impl ExactSum {
    /// Adds one finite term. Infinities and NaN have no place in an exact sum and are passed over.
    pub fn add(&mut self, term: f64) {
        if !term.is_finite() {
            return;
        }
        let exponent = (term.to_bits() >> 52) as usize & 0x7ff;
        let fraction = term.to_bits() & ((1 << 52) - 1);
        // A subnormal has the unit of the least normal, and no hidden bit.
        let (mantissa, shift) =
            if exponent == 0 { (fraction, 0) } else { (fraction | 1 << 52, exponent - 1) };
        let wide = u128::from(mantissa) << (shift % 64);
        let (at, parts) = (shift / 64, [wide as u64, (wide >> 64) as u64]);
        if term.is_sign_negative() { self.subtract_at(at, parts) } else { self.add_at(at, parts) }
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &Self) {
        let mut carry = false;
        for (limb, add) in self.limbs.iter_mut().zip(other.limbs) {
            (*limb, carry) = limb.carrying_add(add, carry);
        }
    }

    fn add_at(&mut self, at: usize, parts: [u64; 2]) {
        let mut carry = false;
        let mut parts = parts.into_iter();
        for limb in &mut self.limbs[at..] {
            let part = parts.next();
            if part.is_none() && !carry {
                break;
            }
            (*limb, carry) = limb.carrying_add(part.unwrap_or(0), carry);
        }
    }

    fn subtract_at(&mut self, at: usize, parts: [u64; 2]) {
        let mut borrow = false;
        let mut parts = parts.into_iter();
        for limb in &mut self.limbs[at..] {
            let part = parts.next();
            if part.is_none() && !borrow {
                break;
            }
            (*limb, borrow) = limb.borrowing_sub(part.unwrap_or(0), borrow);
        }
    }

    /// The sum, rounded once to the nearest f64, ties to even; infinite where it is out of range.
    pub fn value(&self) -> f64 {
        self.rounded(0)
    }

    /// The sum divided by the number of its terms; finite for any terms.
    pub fn mean(&self, terms: u64) -> Option<f64> {
        if terms == 0 {
            return None;
        }
        let sum = self.value();
        if sum.is_finite() {
            return Some(sum / terms as f64);
        }
        // A sum that f64 cannot hold: a 2^64th of it can be held.
        let mean = self.rounded(64) / terms as f64 * 2_f64.powi(64);
        Some(mean.clamp(f64::MIN, f64::MAX))
    }

    /// The sum times 2^-down, rounded once; `down` is 0, or the sum is above 2^(down - 900).
    fn rounded(&self, down: u64) -> f64 {
        let negative = self.limbs[LIMBS - 1] >> 63 == 1;
        let magnitude = if negative {
            let mut magnitude = Self::default();
            for (at, &limb) in self.limbs.iter().enumerate() {
                magnitude.subtract_at(at, [limb, 0]);
            }
            magnitude.limbs
        } else {
            self.limbs
        };
        let Some(top) = magnitude.iter().rposition(|&limb| limb != 0) else { return 0.0 };
        let highest = 64 * top + magnitude[top].ilog2() as usize;
        // The bits at and above this one make the mantissa of 53 bits; below it they are rounded off.
        let lowest = highest.saturating_sub(52);
        let bits_from = |bit: usize| {
            let (limb, shift) = (bit / 64, bit % 64);
            let high = magnitude.get(limb + 1).copied().unwrap_or(0);
            ((u128::from(high) << 64 | u128::from(magnitude[limb])) >> shift) as u64
        };
        let mantissa = bits_from(lowest) & ((1 << 53) - 1);
        let round_up = lowest > 0 && {
            let half = bits_from(lowest - 1) & 1 == 1;
            let mask = (1_u64 << ((lowest - 1) % 64)) - 1;
            let below = (lowest - 1) / 64;
            let rest =
                magnitude[..below].iter().any(|&limb| limb != 0) || magnitude[below] & mask != 0;
            half && (rest || mantissa & 1 == 1)
        };
        // The hidden bit adds 1 to the exponent; so does a mantissa that rounds up to 2^53.
        let bits = ((lowest as u64 - down) << 52) + mantissa + u64::from(round_up);
        let value = f64::from_bits(bits.min(f64::INFINITY.to_bits()));
        if negative { -value } else { value }
    }
}

impl From<ExactSum> for Vec<u64> {
    fn from(sum: ExactSum) -> Self {
        sum.limbs.to_vec()
    }
}

impl TryFrom<Vec<u64>> for ExactSum {
    type Error = String;

    fn try_from(limbs: Vec<u64>) -> Result<Self, String> {
        let found = limbs.len();
        let limbs =
            limbs.try_into().map_err(|_| format!("{LIMBS} limbs expected, {found} found"))?;
        Ok(Self { limbs })
    }
}

impl FromIterator<f64> for ExactSum {
    fn from_iter<I: IntoIterator<Item = f64>>(terms: I) -> Self {
        let mut sum = Self::default();
        terms.into_iter().for_each(|term| sum.add(term));
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sum(terms: &[f64]) -> ExactSum {
        terms.iter().copied().collect()
    }

    /// Any finite f64, of which many are near each other and many are not.
    fn finite() -> impl Strategy<Value = f64> {
        prop_oneof![
            any::<u64>().prop_map(f64::from_bits).prop_filter("finite", |v| v.is_finite()),
            -1e6..1e6,
            (-9_007_199_254_740_992_i64..9_007_199_254_740_992).prop_map(|v| v as f64),
        ]
    }

    proptest! {
        #[test]
        fn one_term_comes_back_to_the_bit(v in finite()) {
            // The sum of nothing but -0.0 is 0.0.
            prop_assert_eq!(sum(&[v]).value().to_bits(), (v + 0.0).to_bits());
        }

        #[test]
        fn two_terms_are_what_one_rounding_of_them_gives(a in finite(), b in finite()) {
            prop_assert_eq!(sum(&[a, b]).value(), a + b);
        }

        #[test]
        fn neither_order_nor_grouping_matters(
            terms in proptest::collection::vec(finite(), 0..40), cut in 0_usize..40, seed in any::<u64>(),
        ) {
            let whole = sum(&terms);
            let (left, right) = terms.split_at(cut.min(terms.len()));
            let mut merged = sum(right);
            merged.merge(&sum(left));
            prop_assert_eq!(&merged, &whole);
            let mut shuffled = terms.clone();
            shuffled.sort_by_key(|v| (v.to_bits() ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            prop_assert_eq!(sum(&shuffled), whole);
        }

        #[test]
        fn what_is_added_and_taken_away_leaves_nothing(terms in proptest::collection::vec(finite(), 0..40)) {
            let mut whole = sum(&terms);
            for v in terms.iter().rev() {
                whole.add(-v);
            }
            prop_assert_eq!(whole, ExactSum::default());
        }

        #[test]
        fn integers_are_summed_as_integers(terms in proptest::collection::vec(any::<i64>(), 0..60)) {
            // Halves of 32 bits are exact in f64; their sum of up to 71 bits is rounded once, as a cast does.
            let halves = terms.iter().flat_map(|v| [(v >> 32) as f64 * 4_294_967_296.0, (v & 0xffff_ffff) as f64]);
            let exact: i128 = terms.iter().map(|v| i128::from(*v)).sum();
            prop_assert_eq!(halves.collect::<ExactSum>().value(), exact as f64);
        }

        #[test]
        fn it_can_be_kept_as_json(terms in proptest::collection::vec(finite(), 0..5)) {
            let whole = sum(&terms);
            let json = serde_json::to_string(&whole).unwrap();
            prop_assert_eq!(serde_json::from_str::<ExactSum>(&json).unwrap(), whole);
        }
    }

    #[test]
    fn what_plain_and_compensated_addition_lose_is_kept() {
        let terms = [1e308, 1.0, 1e-300, -1e308, -1.0];
        assert_eq!(terms.iter().sum::<f64>(), -1.0, "a plain sum must fail for this to say much");
        assert_eq!(sum(&terms).value(), 1e-300);
    }

    #[test]
    fn as_many_terms_as_a_volume_of_2_to_36_voxels_has_lose_nothing() {
        // Doubling 36 times stands for 2^36 equal terms.
        let mut whole = sum(&[0.1]);
        for _ in 0..36 {
            let same = whole.clone();
            whole.merge(&same);
        }
        assert_eq!(whole.value(), 0.1 * 2_f64.powi(36));
        whole.add(f64::from_bits(1));
        whole.add(-0.1 * 2_f64.powi(36));
        assert_eq!(whole.value(), f64::from_bits(1));
    }

    #[test]
    fn sums_out_of_range_are_infinite_and_come_back() {
        let mut whole = sum(&[f64::MAX, f64::MAX]);
        assert_eq!(whole.value(), f64::INFINITY);
        for _ in 0..3 {
            whole.add(f64::MIN);
        }
        assert_eq!(whole.value(), f64::MIN);
        // Half a unit above the greatest f64 rounds away from it, anything less does not.
        let half_unit = 2_f64.powi(970);
        assert_eq!(sum(&[f64::MAX, half_unit]).value(), f64::INFINITY);
        assert_eq!(sum(&[f64::MAX, half_unit.next_down()]).value(), f64::MAX);
    }

    #[test]
    fn ties_go_to_the_even_side() {
        let two_53 = 2_f64.powi(53);
        assert_eq!(sum(&[two_53, 1.0]).value(), two_53);
        assert_eq!(sum(&[two_53, 1.0, f64::from_bits(1)]).value(), two_53 + 2.0);
        assert_eq!(sum(&[two_53, 3.0]).value(), two_53 + 4.0);
        assert_eq!(sum(&[-two_53, -1.0]).value(), -two_53);
    }

    #[test]
    fn means_of_any_terms_are_finite() {
        assert_eq!(ExactSum::default().mean(0), None);
        assert_eq!(sum(&[1.0, 2.0]).mean(2), Some(1.5));
        for v in [f64::MAX, f64::MIN, 1.5e308] {
            assert_eq!(sum(&[v; 4]).mean(4), Some(v));
        }
        let third = sum(&[f64::MAX, f64::MAX, 0.0]).mean(3).unwrap();
        assert!((third / (f64::MAX / 3.0 * 2.0) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn damaged_json_is_refused() {
        assert!(serde_json::from_str::<ExactSum>("[1,2,3]").is_err());
    }
}
