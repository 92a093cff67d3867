//! A transfer function for a volume of which nothing is known but its values: what is most common is air,
//! what Otsu's threshold sets apart from it is the thing.

use octree_store::loader::{ControlPoint, TransferFunction};

const BINS: usize = 256;

/// A transfer function for a volume with such values (a coarse level's will do), `world_diagonal` long.
///
/// Below the threshold nothing is seen; above it extinction rises until an eighth of the volume would be
/// opaque. Where the common values are the high ones it is the other way round, and where there is but one value all
/// of it is seen.
pub fn guess(values: impl Iterator<Item = f64>, world_diagonal: f64) -> TransferFunction {
    let values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let most = 24.0 / if world_diagonal > 0.0 { world_diagonal } else { 1.0 };
    let most = if most.is_finite() { most } else { 1.0 };
    let point = |value, t: f64, extinction| ControlPoint {
        value,
        color: [0.35 + 0.65 * t, 0.2 + 0.75 * t, 0.15 + 0.7 * t],
        extinction,
    };
    let width = high - low;
    let points = if width > 0.0 && width.is_finite() {
        let mut bins = [0_u64; BINS];
        for value in &values {
            bins[(((value - low) / width * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        let cut = otsu(&bins);
        let at = |bin: f64| low + width * bin / BINS as f64;
        let threshold = at(cut as f64);
        let common = (0..BINS).max_by_key(|&bin| bins[bin]).unwrap_or(0);
        if common < cut {
            let full = threshold + 0.3 * (high - threshold);
            vec![point(threshold, 0.0, 0.0), point(full, 0.6, most), point(high, 1.0, most)]
        } else {
            let full = threshold - 0.3 * (threshold - low);
            vec![point(low, 1.0, most), point(full, 0.6, most), point(threshold, 0.0, 0.0)]
        }
    } else {
        vec![point(if low.is_finite() { low } else { 0.0 }, 0.5, most / 8.0)]
    };
    // All numbers are finite and sorted; if rounding has made them not so, a plain one is still a picture.
    TransferFunction::new(points).unwrap_or_else(|_| {
        TransferFunction::new(vec![ControlPoint { value: 0.0, color: [1.0; 3], extinction: 1.0 }])
            .expect("one finite point is a transfer function")
    })
}

/// The bin that parts a histogram into two classes of the greatest variance between them: the first of the upper class.
fn otsu(bins: &[u64; BINS]) -> usize {
    let count: f64 = bins.iter().map(|&n| n as f64).sum();
    let moment: f64 = bins.iter().enumerate().map(|(i, &n)| i as f64 * n as f64).sum();
    let (mut below, mut below_moment) = (0.0, 0.0);
    let (mut best, mut cut) = (-1.0, 1);
    for (bin, &n) in bins.iter().enumerate().take(BINS - 1) {
        below += n as f64;
        below_moment += bin as f64 * n as f64;
        let above = count - below;
        if below > 0.0 && above > 0.0 {
            let apart = below_moment / below - (moment - below_moment) / above;
            let between = below * above * apart * apart;
            if between > best {
                (best, cut) = (between, bin + 1);
            }
        }
    }
    cut
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_is_not_seen_and_the_thing_is_whichever_is_brighter() {
        let values = |air: f64, thing: f64| {
            (0..1000).map(move |i| (if i % 5 == 0 { thing } else { air }) + f64::from(i % 7))
        };
        for (air, thing) in [(100.0, 900.0), (900.0, 100.0)] {
            let function = guess(values(air, thing), 50.0);
            assert_eq!(function.at(air + 3.0).1, 0.0);
            assert!(function.at(thing + 3.0).1 > 0.3);
        }
    }

    #[test]
    fn every_set_of_values_has_a_function() {
        for values in
            [vec![], vec![7.0], vec![f64::NAN], vec![f64::MAX, f64::MIN], vec![0.0, 5e-324]]
        {
            let function = guess(values.into_iter(), 0.0);
            assert!(!function.points().is_empty());
        }
    }
}
