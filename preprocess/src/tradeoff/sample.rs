//! What is measured of a volume: all of it, or a region in its middle with its proportions, decoded once
//! into a raw file of its own.

use super::threshold::otsu;
use crate::error::PreprocessError;
use crate::progress::Progress;
use crate::source::{Source, SourceOptions};
use octree_store::{Region, Sample, SampleType, to_le_bytes, with_sample_type};
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Bins of the histogram that a threshold is taken from.
const BINS: usize = 1024;

/// The part of a volume that has at most so many voxels: the whole, or a region in the middle with the
/// volume's proportions, as whole bricks where it has room for one.
pub fn sample_region(dims_xyz: [u64; 3], voxels: u64, core: u32) -> Region {
    let whole = Region::whole(dims_xyz);
    if dims_xyz.iter().map(|&n| u128::from(n)).product::<u128>() <= u128::from(voxels) {
        return whole;
    }
    // Axes that are thinner than a brick keep their length; the others share what is left.
    let core = u64::from(core);
    let mut size = dims_xyz;
    let scale_to = |size: [u64; 3], scaled: [bool; 3]| {
        let kept: f64 = (0..3).filter(|&a| !scaled[a]).map(|a| size[a] as f64).product();
        let long: f64 = (0..3).filter(|&a| scaled[a]).map(|a| dims_xyz[a] as f64).product();
        let axes = scaled.iter().filter(|&&s| s).count();
        (voxels as f64 / kept / long).powf(1.0 / axes.max(1) as f64)
    };
    let mut scaled = dims_xyz.map(|n| n > core);
    if scaled == [false; 3] {
        scaled = [true; 3];
    }
    for _ in 0..3 {
        let ratio = scale_to(size, scaled).min(1.0);
        for axis in 0..3 {
            if scaled[axis] {
                let length = (dims_xyz[axis] as f64 * ratio) as u64;
                size[axis] = if length >= core {
                    length / core * core
                } else {
                    length.max(core.min(dims_xyz[axis]))
                };
            }
        }
        // An axis at one brick cannot shrink: the others must.
        let again = [0, 1, 2].map(|axis| scaled[axis] && size[axis] > core);
        if size.iter().product::<u64>() <= voxels || again == scaled || again == [false; 3] {
            break;
        }
        scaled = again;
    }
    let min = [0, 1, 2].map(|axis| (dims_xyz[axis] - size[axis]) / 2);
    Region { min, max: [0, 1, 2].map(|axis| min[axis] + size[axis]) }
}

/// The values of a sample, in source units.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SampleValues {
    /// Least finite value; null without one.
    pub value_min: Option<f64>,
    /// Greatest finite value.
    pub value_max: Option<f64>,
    /// Voxels that are NaN.
    pub nan_count: u64,
    /// Voxels that are infinite.
    pub inf_count: u64,
}

impl SampleValues {
    /// Greatest less least value; 0 where there are none, the greatest f64 where it overflows.
    pub fn range(&self) -> f64 {
        let (Some(min), Some(max)) = (self.value_min, self.value_max) else { return 0.0 };
        (max - min).min(f64::MAX)
    }
}

/// A sample of a volume, ready to be converted again and again.
#[derive(Debug)]
pub struct Sampled {
    /// The raw file's voxels; spacing, unit and affine are those of the region.
    pub source: Source,
    /// The region of the volume.
    pub region: Region,
    /// The share of the volume's voxels that is in it.
    pub fraction: f64,
    /// Its values.
    pub values: SampleValues,
    /// Otsu's threshold of its values, where they differ.
    pub otsu: Option<f64>,
}

impl Sampled {
    /// Decodes a region of a source into a raw file in `folder`, once, so that neither the format's own
    /// decoding nor the disk is in what is measured later.
    ///
    /// # Errors
    /// When the source cannot be read, the file not be written, or `progress` asks to stop.
    pub fn take(
        source: Source,
        region: Region,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Self, PreprocessError> {
        let all: f64 = source.dims_xyz.iter().map(|&n| n as f64).product();
        let cut = source.crop(region)?;
        let sample_type = cut.sample_type();
        let path = folder.join("sample.raw");
        let values = with_sample_type!(sample_type, T => copy::<T>(&cut, &path, progress))?;
        let how = SourceOptions {
            dims_xyz: Some(cut.dims_xyz),
            sample_type: Some(sample_type),
            ..SourceOptions::default()
        };
        let mut source = Source::open(&path, &how)?;
        (source.spacing_xyz, source.unit, source.affine) = (cut.spacing_xyz, cut.unit, cut.affine);
        let otsu = with_sample_type!(sample_type, T => threshold::<T>(&source, &values))?;
        let fraction = region.voxels() as f64 / all;
        Ok(Self { source, region, fraction, values, otsu })
    }

    /// The type of its voxels.
    pub fn sample_type(&self) -> SampleType {
        self.source.sample_type()
    }
}

/// Writes a source's voxels, little-endian, and looks at their values.
fn copy<T: Sample>(
    source: &Source,
    path: &Path,
    progress: &dyn Progress,
) -> Result<SampleValues, PreprocessError> {
    let failed = |source| PreprocessError::ScratchFile { path: path.to_owned(), source };
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path).map_err(failed)?);
    let mut values = SampleValues { value_min: None, value_max: None, nan_count: 0, inf_count: 0 };
    each_slice::<T>(source, |slice| {
        if progress.should_stop() {
            return Err(PreprocessError::Cancelled);
        }
        for v in slice.iter().filter(|v| !v.is_finite()) {
            let count = if v.is_nan() { &mut values.nan_count } else { &mut values.inf_count };
            *count += 1;
        }
        if let Some((min, max)) = octree_store::encoding::finite_range(slice) {
            let (min, max) = (min.to_f64(), max.to_f64());
            values.value_min = Some(values.value_min.map_or(min, |least| least.min(min)));
            values.value_max = Some(values.value_max.map_or(max, |most| most.max(max)));
        }
        if cfg!(target_endian = "little") {
            file.write_all(bytemuck::cast_slice(slice)).map_err(failed)
        } else {
            file.write_all(&to_le_bytes(slice)).map_err(failed)
        }
    })?;
    file.flush().map_err(failed)?;
    Ok(values)
}

/// Otsu's threshold: the value from which on voxels are material.
fn threshold<T: Sample>(
    source: &Source,
    values: &SampleValues,
) -> Result<Option<f64>, PreprocessError> {
    let (Some(min), Some(max)) = (values.value_min, values.value_max) else { return Ok(None) };
    let whole_steps = T::TYPE.is_integer() && max - min < BINS as f64;
    // Halves, because the range of f64 extremes overflows.
    let half_width = if whole_steps { 0.5 } else { (max / 2.0 - min / 2.0) / BINS as f64 };
    if half_width <= 0.0 {
        return Ok(None);
    }
    let mut counts = vec![0_u64; BINS];
    each_slice::<T>(source, |slice| {
        for v in slice.iter().filter(|v| v.is_finite()) {
            let bin = ((v.to_f64() / 2.0 - min / 2.0) / half_width) as usize;
            counts[bin.min(BINS - 1)] += 1;
        }
        Ok(())
    })?;
    let Some(bin) = otsu(&counts) else { return Ok(None) };
    let edge = min + half_width * bin as f64 + half_width * bin as f64;
    Ok(Some(if T::TYPE.is_integer() { edge.ceil() } else { edge }))
}

fn each_slice<T: Sample>(
    source: &Source,
    mut take: impl FnMut(&[T]) -> Result<(), PreprocessError>,
) -> Result<(), PreprocessError> {
    let [width, height, depth] = source.dims_xyz;
    let mut slice = vec![T::default(); (width * height) as usize];
    let mut slices = source.slices()?;
    for _ in 0..depth {
        slices.next(&mut slice)?;
        take(&slice)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;
    use proptest::prelude::*;

    #[test]
    fn a_volume_that_fits_is_taken_whole() {
        let dims = [103, 94, 161];
        assert_eq!(sample_region(dims, dims.iter().product(), 32), Region::whole(dims));
    }

    #[test]
    fn a_sample_is_in_the_middle_in_whole_bricks_and_the_volumes_proportions() {
        let region = sample_region([4096, 2048, 1024], 1 << 27, 32);
        assert_eq!(region.dims_xyz(), [1024, 512, 256]);
        assert_eq!(region.min, [1536, 768, 384]);
        // A slab thinner than a brick keeps its thickness.
        assert_eq!(sample_region([6400, 3200, 8], 64 * 100_000, 32).dims_xyz()[2], 8);
    }

    proptest! {
        #[test]
        fn a_sample_lies_within_and_is_no_larger_than_asked_or_a_brick(
            dims in [1_u64..5000, 1_u64..5000, 1_u64..5000], voxels in 1_u64..1 << 33,
            core in prop_oneof![Just(8_u32), Just(32), Just(128)],
        ) {
            let region = sample_region(dims, voxels, core);
            prop_assert!(region.lies_within(dims), "{region:?} {dims:?}");
            let brick: u64 = dims.iter().map(|&n| n.min(u64::from(core))).product();
            prop_assert!(region.voxels() <= voxels.max(brick), "{region:?}");
        }
    }

    fn threshold_of<T: Sample>(low: T, high: T) -> Option<f64> {
        let folder = tempfile::tempdir().unwrap();
        let raw = folder.path().join(format!("a_8x8x8_{}.raw", T::TYPE));
        let voxels: Vec<T> = (0..512).map(|i| if i % 3 == 0 { high } else { low }).collect();
        std::fs::write(&raw, to_le_bytes(&voxels)).unwrap();
        let source = Source::open(&raw, &SourceOptions::default()).unwrap();
        let region = Region::whole([8; 3]);
        Sampled::take(source, region, folder.path(), &NoProgress).unwrap().otsu
    }

    #[test]
    fn a_threshold_parts_two_values_of_any_type() {
        assert_eq!(threshold_of(10_u16, 20), Some(20.0));
        assert_eq!(threshold_of(-20_i16, -10), Some(-10.0));
        let between = |threshold: Option<f64>, low: f64, high: f64| {
            let threshold = threshold.unwrap();
            // In the last of the bins, that of the upper value.
            assert!(threshold > high - (high / 512.0 - low / 512.0), "{low} {threshold} {high}");
            assert!(low < threshold && threshold <= high, "{low} {threshold} {high}");
        };
        between(threshold_of(i32::MIN, i32::MAX), f64::from(i32::MIN), f64::from(i32::MAX));
        between(threshold_of(0.0, 3e-5), 0.0, 3e-5);
        between(threshold_of(-1.7e308, 1.7e308), -1.7e308, 1.7e308);
        assert_eq!(threshold_of(7.0, 7.0), None);
    }

    #[test]
    fn a_sample_is_the_regions_voxels_and_their_values() {
        let folder = tempfile::tempdir().unwrap();
        let raw = folder.path().join("a_9x7x5_f32.raw");
        let voxels: Vec<f32> =
            (0..9 * 7 * 5).map(|i| if i == 200 { f32::NAN } else { i as f32 }).collect();
        std::fs::write(&raw, to_le_bytes(&voxels)).unwrap();
        let source = Source::open(&raw, &SourceOptions::default()).unwrap();
        let region = Region { min: [1, 2, 3], max: [8, 6, 5] };
        let sampled = Sampled::take(source, region, folder.path(), &NoProgress).unwrap();
        assert_eq!(sampled.source.dims_xyz, [7, 4, 2]);
        let mut read = Vec::new();
        each_slice::<f32>(&sampled.source, |slice| {
            read.extend_from_slice(slice);
            Ok(())
        })
        .unwrap();
        let at = |x: u64, y: u64, z: u64| ((z * 7 + y) * 9 + x) as usize;
        let mut expected = Vec::new();
        for (z, y) in (3..5).flat_map(|z| (2..6).map(move |y| (z, y))) {
            expected.extend((1..8).map(|x| voxels[at(x, y, z)]));
        }
        assert!(read.iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits()));
        assert_eq!(read.len(), expected.len());
        let nan = expected.iter().filter(|v| v.is_nan()).count() as u64;
        let finite = || expected.iter().filter(|v| v.is_finite()).map(|&v| f64::from(v));
        assert_eq!(sampled.values.nan_count, nan);
        assert_eq!(sampled.values.value_min, finite().reduce(f64::min));
        assert_eq!(sampled.values.value_max, finite().reduce(f64::max));
        assert!((sampled.fraction - 56.0 / 315.0).abs() < 1e-12);
        let middle = sampled.otsu.unwrap();
        assert!(middle > 212.0 && middle < 300.0, "{middle}");
    }
}
