//! What is no number cannot be interpolated: pictures show NaN as the volume's least value, and infinities as its least
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

/// A brick without what is no number; the same one where there is none of it.
pub(crate) fn finite_brick(brick: &Arc<Brick>, range: [f64; 2]) -> Arc<Brick> {
    let texel = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes);
    let (texels, _) = brick.texels.as_chunks::<4>();
    if brick.format != BrickFormat::R32Float || texels.iter().all(|t| texel(t).is_finite()) {
        return Arc::clone(brick);
    }
    let [low, width] = [brick.texel_range[0], brick.texel_range[1] - brick.texel_range[0]];
    let as_texels = range.map(|v| if width > 0.0 { (v - low) / width } else { 0.0 });
    let replaced = texels
        .iter()
        .flat_map(|t| (finite(f64::from(texel(t)), as_texels) as f32).to_le_bytes())
        .collect();
    Arc::new(Brick { texels: replaced, ..(**brick).clone() })
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
        let found = finite_brick(&brick, range);
        let read: Vec<f64> = (0..5).map(|i| found.value(i)).collect();
        assert_eq!(read, [1.0, -2.5, 1.0, -2.5, -2.5]);
        let again = finite_brick(&found, range);
        assert!(Arc::ptr_eq(&found, &again));
        assert_eq!(range_of(&SampleBuffer::F32(vec![f32::NAN])), [0.0; 2]);
    }
}
