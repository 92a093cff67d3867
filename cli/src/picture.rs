//! Slices as grey pictures: which voxels, which window, which depth.

use anyhow::bail;
use clap::ValueEnum;
use octree_store::{Region, SampleBuffer, SampleType, Store};
use preprocess::histogram::Histogram;
use std::io::{self, Write};

/// The axis across a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

impl Axis {
    /// 0, 1 or 2.
    pub(crate) fn index(self) -> usize {
        self as usize
    }

    /// `x`, `y` or `z`.
    pub(crate) fn name(self) -> &'static str {
        ["x", "y", "z"][self.index()]
    }
}

/// Bits a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Depth {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

/// A slice's samples: the picture's rows from top to bottom.
#[derive(Debug)]
pub(crate) struct SlicePicture {
    /// Width and height in pixels.
    pub(crate) size: [u32; 2],
    samples: SampleBuffer,
}

/// Reads slice `index` across `axis` of a level.
pub(crate) fn read_slice(
    store: &Store,
    axis: Axis,
    index: u64,
    level: u8,
) -> anyhow::Result<SlicePicture> {
    let path = store.path().display();
    let top = store.geometry().top_level();
    if level > top {
        bail!("{path}: it has levels 0 to {top}, and level {level} was asked for");
    }
    let dims = store.geometry().dims_at(level);
    let count = dims[axis.index()];
    if index >= count {
        let name = axis.name();
        bail!(
            "{path}: level {level} has {count} slices across {name}, numbered from 0, and slice {index} was asked for"
        );
    }
    let mut region = Region::whole(dims);
    region.min[axis.index()] = index;
    region.max[axis.index()] = index + 1;
    let [width, height] = match axis {
        Axis::X => [dims[1], dims[2]],
        Axis::Y => [dims[0], dims[2]],
        Axis::Z => [dims[0], dims[1]],
    };
    let (Ok(width), Ok(height)) = (u32::try_from(width), u32::try_from(height)) else {
        bail!("{path}: a slice of {width} x {height} is too large for a picture");
    };
    Ok(SlicePicture { size: [width, height], samples: store.read_region_samples(level, region)? })
}

/// The values of black and white: what was asked for, else the source's range; u8 and u16 values
/// stand as they are in 16 bits.
pub(crate) fn window(store: &Store, asked: Option<[f64; 2]>, depth: Depth) -> [f64; 2] {
    let metadata = store.metadata();
    let as_is = matches!(metadata.sample_type, SampleType::U8 | SampleType::U16);
    match asked {
        Some(window) => window,
        None if depth == Depth::Sixteen && as_is => [0.0, 65535.0],
        None => [metadata.value_min.unwrap_or(0.0), metadata.value_max.unwrap_or(0.0)],
    }
}

/// A window that a few odd voxels do not spoil: from the 0.5th to the 99.5th percentile.
pub(crate) fn robust_window(histogram: &Histogram) -> [f64; 2] {
    [histogram.quantile(0.005), histogram.quantile(0.995)]
}

impl SlicePicture {
    /// Grey values of 8 bits.
    pub(crate) fn grey8(&self, window: [f64; 2]) -> Vec<u8> {
        self.grey(window, 255.0).map(|v| v as u8).collect()
    }

    /// Writes a PNG.
    pub(crate) fn write_png(
        &self,
        out: &mut dyn Write,
        window: [f64; 2],
        depth: Depth,
    ) -> io::Result<()> {
        let [width, height] = self.size;
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(png::ColorType::Grayscale);
        let (bits, pixels) = match depth {
            Depth::Eight => (png::BitDepth::Eight, self.grey8(window)),
            Depth::Sixteen => {
                let pixels = self.grey(window, 65535.0);
                (png::BitDepth::Sixteen, pixels.flat_map(|v| (v as u16).to_be_bytes()).collect())
            }
        };
        encoder.set_depth(bits);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&pixels)?;
        writer.finish()?;
        Ok(())
    }

    /// Values as 0..=white, rounded; NaN is black.
    fn grey(&self, [low, high]: [f64; 2], white: f64) -> impl Iterator<Item = f64> {
        // Halves keep the widest f64 range finite.
        let range = high / 2.0 - low / 2.0;
        (0..self.samples.len()).map(move |index| {
            let v = self.samples.get_f64(index) / 2.0 - low / 2.0;
            let share = if range > 0.0 { v / range } else { 0.0 };
            if share.is_nan() { 0.0 } else { (share.clamp(0.0, 1.0) * white).round() }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(samples: SampleBuffer, window: [f64; 2]) -> Vec<u8> {
        SlicePicture { size: [samples.len() as u32, 1], samples }.grey8(window)
    }

    #[test]
    fn the_window_maps_to_black_and_white() {
        assert_eq!(
            grey(SampleBuffer::U16(vec![0, 100, 150, 200, 900]), [100.0, 200.0]),
            [0, 0, 128, 255, 255]
        );
        let wide = SampleBuffer::F64(vec![f64::MIN, 0.0, f64::MAX, f64::NAN]);
        assert_eq!(grey(wide, [f64::MIN, f64::MAX]), [0, 128, 255, 0]);
        assert_eq!(grey(SampleBuffer::U8(vec![7]), [7.0, 7.0]), [0]);
    }
}
