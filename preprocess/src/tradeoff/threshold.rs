//! The threshold between air and material, where nobody gives one: N. Otsu, "A threshold selection method
//! from gray-level histograms", IEEE Trans. SMC 9 (1979): the cut that leaves most variance between the
//! two sides.

/// The first bin of the upper side; `None` where fewer than two bins are filled.
pub fn otsu(counts: &[u64]) -> Option<usize> {
    let all: f64 = counts.iter().map(|&count| count as f64).sum();
    let moment: f64 =
        counts.iter().enumerate().map(|(bin, &count)| bin as f64 * count as f64).sum();
    let (mut below, mut moment_below) = (0.0, 0.0);
    let mut best: Option<(f64, usize)> = None;
    for (bin, &count) in counts.iter().enumerate() {
        // The cut lies before this bin; cuts that differ by empty bins alone are one cut.
        let above = all - below;
        if count > 0 && below > 0.0 {
            let means = moment_below / below - (moment - moment_below) / above;
            let between = below * above * means * means;
            if best.is_none_or(|(most, _)| between > most) {
                best = Some((between, bin));
            }
        }
        below += count as f64;
        moment_below += bin as f64 * count as f64;
    }
    best.map(|(_, bin)| bin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// By its definition: the variance within both sides is least.
    fn twin(counts: &[u64]) -> Option<f64> {
        let within = |side: std::ops::Range<usize>| {
            let values = || side.clone().map(|bin| (bin as f64, counts[bin] as f64));
            let all: f64 = values().map(|(_, n)| n).sum();
            let mean = values().map(|(v, n)| v * n).sum::<f64>() / all;
            (all > 0.0).then(|| values().map(|(v, n)| n * (v - mean).powi(2)).sum::<f64>())
        };
        (1..counts.len())
            .filter_map(|cut| Some(within(0..cut)? + within(cut..counts.len())?))
            .min_by(f64::total_cmp)
    }

    proptest! {
        #[test]
        fn the_cut_leaves_the_least_variance_within(
            counts in proptest::collection::vec(prop_oneof![Just(0), 0_u64..1000], 1..40)
        ) {
            let of_cut = |cut: usize| {
                let mut low = counts.clone();
                low[cut..].fill(0);
                let mut high = counts.clone();
                high[..cut].fill(0);
                [low, high].map(|side| {
                    let all: u64 = side.iter().sum();
                    let mean = side.iter().enumerate().map(|(v, &n)| v as f64 * n as f64).sum::<f64>()
                        / all as f64;
                    side.iter().enumerate().map(|(v, &n)| n as f64 * (v as f64 - mean).powi(2)).sum::<f64>()
                }).iter().sum::<f64>()
            };
            match (otsu(&counts), twin(&counts)) {
                (Some(cut), Some(least)) => {
                    prop_assert!(of_cut(cut) <= least * (1.0 + 1e-9) + 1e-6);
                }
                (found, expected) => prop_assert_eq!(found.is_some(), expected.is_some()),
            }
        }
    }

    #[test]
    fn two_heaps_are_told_apart_and_one_value_is_not() {
        assert_eq!(otsu(&[90, 80, 0, 0, 0, 3, 7]), Some(5));
        assert_eq!(otsu(&[0, 9, 0]), None);
        assert_eq!(otsu(&[]), None);
    }
}
