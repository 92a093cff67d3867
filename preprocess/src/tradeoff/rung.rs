//! One rung: the conversion, timed; the store, read in several ways, timed; and what it keeps.
//!
//! Everything is warm: the sample lies in the page cache, and so does the store when it is read. Times are
//! medians of as many repetitions as fit a third of a second, and of one where it takes longer.

use super::ladder::Rung;
use super::lod::{LevelReading, read_levels};
use super::sample::Sampled;
use crate::convert::{Conversion, ConvertOptions, Start, convert};
use crate::error::PreprocessError;
use crate::progress::Progress;
use octree_store::{BrickScratch, NodeRecord, OverlapAtRest, Sample, Store, with_sample_type};
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Repetitions end when this long was measured.
const ENOUGH_SECS: f64 = 0.33;
/// Repetitions at most.
const MOST_RUNS: usize = 15;
/// Random reads at most.
const RANDOM_READS: usize = 4096;

/// What was measured of one rung. Errors are in source units, sizes without a unit in bytes; a MB is 10^6
/// bytes of voxels in the source's type.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(Default))]
pub struct RungReading {
    /// Its name, which no other rung of the report has.
    pub name: String,
    /// How samples are stored.
    pub encoding: String,
    /// How much work goes into small payloads.
    pub effort: &'static str,
    /// Bricks whose every voxel is below this are dropped; null where none are.
    pub empty_below: Option<f64>,
    /// Whether payloads hold the overlap; else it is assembled on reading.
    pub stored_overlap: bool,
    /// What `octavo convert` must be told to go this way.
    pub arguments: Vec<String>,
    /// Bits of level 0's payloads for each of its voxels.
    pub payload_bits_per_voxel: f64,
    /// Bits of the whole file, pyramid and index included, for each level-0 voxel.
    pub file_bits_per_voxel: f64,
    /// Bytes of the store.
    pub file_bytes: u64,
    /// RMS at level 0 over all finite voxels, those in dropped bricks included.
    pub rms: f64,
    /// AMAX over the same.
    pub amax: f64,
    /// PSNR over the same, its peak the range of the sample's values; null without error or range.
    pub psnr_db: Option<f64>,
    /// RMS at level 0 over the voxels of bricks that were kept: what `info` calls `rms`.
    pub kept_rms: f64,
    /// AMAX over the same.
    pub kept_amax: f64,
    /// Level-0 voxels in dropped bricks.
    pub dropped_voxels: u64,
    /// Seconds of the conversion, the store durable: the median.
    pub encode_secs: f64,
    /// Conversions that were timed.
    pub encode_runs: usize,
    /// The sample's bytes over `encode_secs`.
    pub encode_mb_per_sec: f64,
    /// Decoding the core of every brick of level 0 on one thread.
    pub decode_mb_per_sec_one_thread: f64,
    /// The same on all threads that the report names.
    pub decode_mb_per_sec: f64,
    /// Passes over level 0 that were timed, of each of the two.
    pub decode_runs: [usize; 2],
    /// Microseconds to find, read, check and decode one brick at a random place, overlap included: the median.
    pub random_read_micros: f64,
    /// Random reads that were timed.
    pub random_reads: usize,
    /// The store's digest.
    pub digest: String,
    /// What a reader gets, level by level.
    pub levels: Vec<LevelReading>,
}

impl Sampled {
    /// Goes one way: converts the sample to a store in `folder`, reads it, and removes it. Of `how`, what the
    /// rung does not say itself is used.
    ///
    /// # Errors
    /// When it cannot be converted or read, or `progress` asks to stop.
    pub fn measure(
        &self,
        rung: &Rung,
        how: &ConvertOptions,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<RungReading, PreprocessError> {
        let output = folder.join("rung.octavo");
        let options = ConvertOptions { start: Start::Replace, ..rung.options(how) };
        let mut done: Option<Conversion> = None;
        let encode = repeat(|| {
            let started = Instant::now();
            let made =
                convert(&self.source, &output, &options, &Quiet(progress)).map_err(unkept)?;
            done = Some(made);
            Ok(started.elapsed().as_secs_f64())
        })?;
        let Some(Conversion { metadata, file_bytes, plan, .. }) = done else {
            return Err(PreprocessError::Cancelled);
        };
        progress.bricks_done(plan.bricks);
        let store = Store::open(&output)?;
        let decode = with_sample_type!(metadata.sample_type, T => {
            read_store::<T>(&store, how.threads.max(1), progress)
        })?;
        drop(store);
        let levels = read_levels(&output, &self.source, progress)?;
        std::fs::remove_file(&output)
            .map_err(|source| PreprocessError::Output { path: output, source })?;
        let voxels = self.region.voxels() as f64;
        let mb = voxels * metadata.sample_type.bytes() as f64 / 1e6;
        let (level, first) = (&metadata.levels[0], &levels[0]);
        let range = self.values.range();
        let psnr = |rms: f64| (rms > 0.0 && range > 0.0).then(|| 20.0 * (range / rms).log10());
        progress.bricks_done(plan.bricks);
        Ok(RungReading {
            name: rung.name(),
            encoding: rung.encoding.to_string(),
            effort: rung.effort.name(),
            empty_below: rung.empty_below,
            stored_overlap: rung.overlap_at_rest == OverlapAtRest::Stored,
            arguments: rung.arguments(),
            payload_bits_per_voxel: 8.0 * level.payload_bytes as f64 / voxels,
            file_bits_per_voxel: 8.0 * file_bytes as f64 / voxels,
            file_bytes,
            rms: first.read_rms,
            amax: first.read_amax,
            psnr_db: psnr(first.read_rms),
            kept_rms: level.rms,
            kept_amax: level.amax,
            dropped_voxels: metadata.dropped_voxels,
            encode_secs: encode.median_secs,
            encode_runs: encode.runs,
            encode_mb_per_sec: mb / encode.median_secs,
            decode_mb_per_sec_one_thread: mb / decode.one.median_secs,
            decode_mb_per_sec: mb / decode.all.median_secs,
            decode_runs: [decode.one.runs, decode.all.runs],
            random_read_micros: decode.random_micros,
            random_reads: decode.random_reads,
            digest: metadata.digest,
            levels,
        })
    }
}

/// Nothing is kept for later: the folder goes with the work.
fn unkept(error: PreprocessError) -> PreprocessError {
    match error {
        PreprocessError::Kept { source, .. } => *source,
        other => other,
    }
}

/// Counts no bricks, but stops.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn bricks_done(&self, _: u64) {}

    fn should_stop(&self) -> bool {
        self.0.should_stop()
    }
}

/// Times of repetitions.
struct Times {
    median_secs: f64,
    runs: usize,
}

/// Repeats what says how long it took.
fn repeat(mut run: impl FnMut() -> Result<f64, PreprocessError>) -> Result<Times, PreprocessError> {
    let mut secs = Vec::new();
    while secs.len() < MOST_RUNS && secs.iter().sum::<f64>() < ENOUGH_SECS {
        secs.push(run()?);
    }
    Ok(Times { median_secs: median(&mut secs), runs: secs.len() })
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2].max(f64::MIN_POSITIVE)
}

/// How fast a store is read.
struct Decode {
    one: Times,
    all: Times,
    random_micros: f64,
    random_reads: usize,
}

fn read_store<T: Sample>(
    store: &Store,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Decode, PreprocessError> {
    let mut records: Vec<NodeRecord> = Vec::new();
    store.visit_level(0, |record| {
        records.push(*record);
        true
    })?;
    let begin = || (vec![T::default(); store.geometry().brick_samples()], BrickScratch::default());
    let decode = |(mut brick, mut scratch): (Vec<T>, BrickScratch), record: &NodeRecord| {
        store.decode_brick_core(record, &mut scratch, &mut brick)?;
        Ok::<_, PreprocessError>((brick, scratch))
    };
    let stop = || if progress.should_stop() { Err(PreprocessError::Cancelled) } else { Ok(()) };
    let pass = |threads: usize| {
        let pool = crate::pool(threads)?;
        let once = || {
            stop()?;
            let started = Instant::now();
            pool.install(|| {
                records.par_iter().try_fold(begin, decode).try_for_each(|r| r.map(drop))
            })?;
            Ok(started.elapsed().as_secs_f64())
        };
        once()?;
        repeat(once)
    };
    let (one, all) = (pass(1)?, pass(threads)?);
    shuffle(&mut records);
    records.truncate(RANDOM_READS);
    let (mut brick, mut scratch) = begin();
    let mut micros = Vec::new();
    while micros.len() < RANDOM_READS.min(64.max(records.len())) {
        stop()?;
        for record in &records {
            let started = Instant::now();
            store.read_brick(record.key, &mut scratch, &mut brick)?;
            micros.push(started.elapsed().as_secs_f64() * 1e6);
        }
    }
    let random_reads = micros.len();
    Ok(Decode { one, all, random_micros: median(&mut micros), random_reads })
}

/// Fisher and Yates with xorshift numbers: the same order every time.
fn shuffle<V>(values: &mut [V]) {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    for last in (1..values.len()).rev() {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        values.swap(last, (state % (last as u64 + 1)) as usize);
    }
}
