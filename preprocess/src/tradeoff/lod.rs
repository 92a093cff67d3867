//! How far what a reader gets at each level lies from full resolution: the true deviation, over every
//! level-0 voxel, beside the bounds that the store states.
//!
//! A level-0 voxel v lies in cell c of level k, and a reader gets r for c. So |v - r| <= |v - c| + |c - r|:
//! the level's LOD bound and the error of its bricks (of coding them, or of dropping them). The same holds for root
//! mean squares (Minkowski), once the errors of cells are weighted by level-0 voxels: none holds more
//! than 8^k.

use crate::error::PreprocessError;
use crate::progress::Progress;
use crate::source::Source;
use crate::volume::{Volume, VolumeSlices};
use octree_store::{ErrorSum, ErrorTotal, Sample, Store, with_sample_type};
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Sums of bounds are raised by this against rounding.
const ROUNDING: f64 = 1.0 + 1e-12;

/// What a reader gets at one level, in source units. Root mean squares over levels count every level-0
/// voxel once, one that is no number with 0.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LevelReading {
    /// The level; 0 is full resolution.
    pub level: u8,
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// Bytes of the level's payloads.
    pub payload_bytes: u64,
    /// RMS of (what a reader gets - the level's cell) over the level's finite voxels, dropped ones included.
    pub read_rms: f64,
    /// Largest such error.
    pub read_amax: f64,
    /// The stored bound on the RMS of (level-0 voxel - the level's cell), before coding.
    pub lod_rms_bound: f64,
    /// The stored bound on the largest such deviation.
    pub lod_amax_bound: f64,
    /// Bound on `deviation_rms` that follows from the above.
    pub rms_bound: f64,
    /// Bound on `deviation_amax` that follows from the above.
    pub amax_bound: f64,
    /// Measured RMS of (level-0 voxel of the source - what a reader gets for its cell).
    pub deviation_rms: f64,
    /// Measured largest such deviation.
    pub deviation_amax: f64,
    /// `deviation_rms` over `rms_bound`: 1 is tight; null where the bound is 0.
    pub rms_tightness: Option<f64>,
    /// `deviation_amax` over `amax_bound`.
    pub amax_tightness: Option<f64>,
}

/// Reads every level of a store beside its source, slice by slice.
///
/// # Errors
/// When one of them cannot be read, they differ in size or type, or `progress` asks to stop.
pub fn read_levels(
    path: &Path,
    source: &Source,
    progress: &dyn Progress,
) -> Result<Vec<LevelReading>, PreprocessError> {
    let store = Store::open(path)?;
    let (a, b) = (store.metadata().dims_xyz, source.dims_xyz);
    if a != b {
        return Err(PreprocessError::DifferentDims { a, b });
    }
    store
        .geometry()
        .levels()
        .zip(with_sample_type!(source.sample_type(), T => deviations::<T>(&store, source, progress))?)
        .map(|(level, deviation)| reading(&store, level, &deviation))
        .collect()
}

fn reading(
    store: &Store,
    level: u8,
    deviation: &ErrorSum,
) -> Result<LevelReading, PreprocessError> {
    let mut errors = ErrorTotal::default();
    store.visit_level(level, |record| {
        errors.add(&record.error);
        true
    })?;
    let read = errors.total();
    let summary = &store.metadata().levels[usize::from(level)];
    let voxels: f64 = store.metadata().dims_xyz.iter().map(|&n| n as f64).product();
    let most_weight = 8_f64.powi(i32::from(level)) * read.voxels as f64 / voxels;
    let sum = |lod: f64, read: f64| ((lod + read) * ROUNDING).min(f64::MAX);
    let rms_bound = sum(summary.lod_rms_bound, most_weight.sqrt() * read.rms());
    let amax_bound = sum(summary.lod_amax_bound, read.amax);
    let deviation_rms = deviation.rms() * (deviation.voxels as f64 / voxels).sqrt();
    let tightness = |measured: f64, bound: f64| (bound > 0.0).then(|| measured / bound);
    Ok(LevelReading {
        level,
        dims_xyz: summary.dims_xyz,
        payload_bytes: summary.payload_bytes,
        read_rms: read.rms(),
        read_amax: read.amax,
        lod_rms_bound: summary.lod_rms_bound,
        lod_amax_bound: summary.lod_amax_bound,
        rms_bound,
        amax_bound,
        deviation_rms,
        deviation_amax: deviation.amax,
        rms_tightness: tightness(deviation_rms, rms_bound),
        amax_tightness: tightness(deviation.amax, amax_bound),
    })
}

/// (what a reader gets - level-0 voxel) of every level.
fn deviations<T: Sample>(
    store: &Store,
    source: &Source,
    progress: &dyn Progress,
) -> Result<Vec<ErrorSum>, PreprocessError> {
    // A store of its own a level: each has a slab of decoded bricks, and they are read side by side.
    let volumes = store
        .geometry()
        .levels()
        .map(|level| {
            let store = Store::open(store.path())?;
            Volume::of_store(store, level, None)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut levels = volumes.iter().map(Level::<T>::new).collect::<Result<Vec<_>, _>>()?;
    let [width, height, depth] = source.dims_xyz.map(|n| n as usize);
    let mut slice = vec![T::default(); width * height];
    let mut slices = source.slices()?;
    for z in 0..depth {
        if progress.should_stop() {
            return Err(PreprocessError::Cancelled);
        }
        slices.next(&mut slice)?;
        for (k, level) in levels.iter_mut().enumerate() {
            if z % (1 << k) == 0 {
                level.slices.next(&mut level.slice)?;
            }
            level.add(&slice, width, k);
        }
    }
    Ok(levels.iter().map(|level| level.total.total()).collect())
}

/// A level that is being read.
struct Level<'a, T> {
    slices: VolumeSlices<'a, T>,
    slice: Vec<T>,
    width: usize,
    total: ErrorTotal,
}

impl<'a, T: Sample> Level<'a, T> {
    fn new(volume: &'a Volume) -> Result<Self, PreprocessError> {
        let [width, height, _] = volume.dims_xyz().map(|n| n as usize);
        let slice = vec![T::default(); width * height];
        Ok(Self { slices: volume.slices()?, slice, width, total: ErrorTotal::default() })
    }

    /// Adds a slice of level-0 voxels; level k's slice is the one that holds it.
    fn add(&mut self, voxels: &[T], width: usize, k: usize) {
        let (cells, cells_width) = (&self.slice, self.width);
        let add_row = |(mut total, mut row): (ErrorTotal, Vec<T>), (y, voxels): (usize, &[T])| {
            let cells = &cells[(y >> k) * cells_width..][..cells_width];
            let mut error = ErrorSum::default();
            if k == 0 {
                error.add_all(voxels, cells);
            } else {
                row.clear();
                for cell in cells {
                    row.extend(std::iter::repeat_n(*cell, 1 << k));
                }
                error.add_all(voxels, &row[..width]);
            }
            total.add(&error);
            (total, row)
        };
        let sum = |mut a: ErrorTotal, b: ErrorTotal| {
            a.merge(&b);
            a
        };
        // Exact sums: neither threads nor grouping shows.
        let added = voxels
            .par_chunks(width)
            .enumerate()
            .with_min_len(64)
            .fold(|| (ErrorTotal::default(), Vec::new()), add_row)
            .map(|(total, _)| total)
            .reduce(ErrorTotal::default, sum);
        self.total.merge(&added);
    }
}
