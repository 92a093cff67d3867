//! Bricks of floats as they are drawn: in units of the volume's range, so that no digits are lost where values lie far from 0, and without
//! what is no number, which cannot be interpolated. Pictures show NaN as the volume's least value, and infinities as its least
//! and greatest, in the store and in the source alike.

use octree_store::SampleBuffer;
use octree_store::loader::{Brick, BrickFormat};
use std::sync::Arc;

/// A value that is finite.
pub(crate) fn finite(value: f64, [least, greatest]: [f64; 2]) -> f64 {
    if value.is_finite() {
        value
    } else if value > 0.0 {
        greatest
    } else {
        least
    }
}

/// Least and greatest finite value; 0 and 0 where there is none.
pub(crate) fn range_of(samples: &SampleBuffer) -> [f64; 2] {
    let values = (0..samples.len()).map(|i| samples.get_f64(i)).filter(|v| v.is_finite());
    let found = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    if found[0] <= found[1] { found } else { [0.0; 2] }
}

/// The values that texels 0 and 1 of floats are drawn as: a volume's least and greatest, or around its one value.
pub(crate) fn float_range([least, greatest]: [f64; 2]) -> [f64; 2] {
    if least < greatest { [least, greatest] } else { [least, least + least.abs().max(1.0)] }
}

/// A brick of floats with texels in units of a [`float_range`]; other bricks are as they were.
pub(crate) fn unit_brick(brick: &Arc<Brick>, range: [f64; 2]) -> Arc<Brick> {
    if brick.format != BrickFormat::R32Float {
        return Arc::clone(brick);
    }
    // Halves, since the difference of two finite numbers may be none.
    let [low, high] = range.map(|v| v / 2.0);
    let [first, second] = brick.texel_range;
    let unit = |bytes: &[u8; 4]| {
        let texel = f64::from(f32::from_le_bytes(*bytes));
        let value = finite(first + texel * (second - first), range);
        ((value / 2.0 - low) / (high - low)) as f32
    };
    let texels = brick.texels.as_chunks().0.iter().flat_map(|t| unit(t).to_le_bytes()).collect();
    Arc::new(Brick { format: BrickFormat::R32Float, texels, texel_range: range })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_becomes_the_least_or_the_greatest_value() {
        let values = [1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -2.5];
        let brick = Arc::new(Brick {
            format: BrickFormat::R32Float,
            texels: values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            texel_range: [0.0, 1.0],
        });
        let range = range_of(&SampleBuffer::F32(values.to_vec()));
        assert_eq!(range, [-2.5, 1.0]);
        let found = unit_brick(&brick, float_range(range));
        let read: Vec<f64> = (0..5).map(|i| found.value(i)).collect();
        for (read, expected) in read.iter().zip([1.0, -2.5, 1.0, -2.5, -2.5]) {
            assert!((read - expected).abs() < 1e-6, "{read} {expected}");
        }
        assert_eq!(range_of(&SampleBuffer::F32(vec![f32::NAN])), [0.0; 2]);
    }
    #[test]
    fn values_far_from_0_and_at_the_ends_of_floats_keep_their_digits() {
        for range in
            [[1e5, 1e5 + 1000.0], [-3.4e38, 3.4e38], [1e33, 1.1e33], [0.0, 1e-40], [7.0, 7.0]]
        {
            let texels = [0.0, 0.25, 1.0].map(|t| range[0] + t * (range[1] - range[0]));
            let brick = Arc::new(Brick {
                format: BrickFormat::R32Float,
                texels: texels.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect(),
                texel_range: [0.0, 1.0],
            });
            let found = unit_brick(&brick, float_range(range));
            let units = found.texels.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
            let expected = if range[0] < range[1] { [0.0, 0.25, 1.0] } else { [0.0; 3] };
            for (unit, expected) in units.zip(expected) {
                assert!((unit - expected).abs() < 2e-5, "{range:?}: {unit} {expected}");
            }
        }
    }
}
