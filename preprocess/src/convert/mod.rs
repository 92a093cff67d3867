//! Conversion: a source becomes a store.
//!
//! Plan, then walk ([`crate::walk`]): read -> gather -> quantise and measure -> compress on the
//! pool's threads, and one writer thread that completes the records and owns the store.

mod brick;
mod output;
mod plan;
mod tree;

pub(crate) use brick::ValueRules;
pub(crate) use plan::folder_of;
pub use plan::{ConversionPlan, PlannedLevel};

use crate::error::PreprocessError;
use crate::memory::PeakMemory;
use crate::progress::Progress;
use crate::source::Source;
use crate::value_stats::VolumeValues;
use crate::walk::{Octet, walk};
use brick::{BrickEncoder, BrickOutput};
use octree_store::{
    DownsampleFilter, Effort, Encoding, Metadata, Region, Sample, SampleType, StoreWriter,
    with_sample_type,
};
use output::Output;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use tree::Tree;

/// How to convert.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvertOptions {
    /// Core voxels along a brick's side: even, 8 to 128.
    pub brick_core: u32,
    /// Overlap voxels on every side: 0 to 4.
    pub brick_overlap: u32,
    /// How bricks are encoded.
    pub encoding: Encoding,
    /// How much work goes into making payloads small.
    pub effort: Effort,
    /// How a level is made of the one below it.
    pub downsample: DownsampleFilter,
    /// Bricks whose every sample is below this are dropped.
    pub empty_below: Option<f64>,
    /// Takes the place of NaN in float sources.
    pub nan_value: Option<f64>,
    /// The region of the file that was cut out, for the record.
    pub roi: Option<Region>,
    /// The time that was chosen of a series, for the record.
    pub time: Option<u64>,
    /// The channel that was chosen, for the record.
    pub channel: Option<u64>,
    /// Threads that make bricks; fewer are used where memory is too small for so many.
    pub threads: usize,
    /// Own memory in bytes, mapped files apart.
    pub memory_bytes: u64,
    /// The folder of scratch files; beside the output where none is given.
    pub scratch: Option<PathBuf>,
    /// Whether an existing output is replaced.
    pub force: bool,
}

impl Default for ConvertOptions {
    fn default() -> Self {
        Self {
            brick_core: 32,
            brick_overlap: 2,
            encoding: Encoding::Quantised8,
            effort: Effort::default(),
            downsample: DownsampleFilter::default(),
            empty_below: None,
            nan_value: None,
            roi: None,
            time: None,
            channel: None,
            threads: thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: 512 << 20,
            scratch: None,
            force: false,
        }
    }
}

impl ConvertOptions {
    /// What the options do to values of a type.
    ///
    /// # Errors
    /// When the type cannot hold one of them.
    pub(crate) fn value_rules(
        &self,
        sample_type: SampleType,
    ) -> Result<ValueRules, PreprocessError> {
        let (least, greatest) = sample_type.limits();
        let bad = |option, value, why| Err(PreprocessError::BadValue { option, value, why });
        if let Some(value) = self.empty_below {
            if !value.is_finite() {
                return bad("--empty-below", value, "it must be a number");
            }
            if value <= least && value <= 0.0 {
                return bad("--empty-below", value, "no sample can be below it");
            }
        }
        if let Some(value) = self.nan_value.filter(|value| !(least..=greatest).contains(value)) {
            return bad("--nan-value", value, "the sample type cannot hold it");
        }
        let empty_value = self.empty_below.map_or(0.0, |below| empty_value(below, sample_type));
        Ok(ValueRules { nan_value: self.nan_value, empty_below: self.empty_below, empty_value })
    }

    /// The options that change a store's content, for its metadata.
    fn recorded(&self) -> BTreeMap<String, serde_json::Value> {
        let mut options = BTreeMap::new();
        if let Some(value) = self.nan_value {
            options.insert("nan_value".into(), value.into());
        }
        for (name, chosen) in [("time", self.time), ("channel", self.channel)] {
            if let Some(chosen) = chosen {
                options.insert(name.into(), chosen.into());
            }
        }
        if self.effort != Effort::default() {
            options.insert("effort".into(), self.effort.name().into());
        }
        if let Some(Region { min, max }) = self.roi {
            options.insert("roi".into(), serde_json::json!([min, max]));
        }
        options
    }
}

/// What a dropped brick decodes to: 0 where the threshold is above it, as one who drops air expects;
/// else the greatest value below the threshold.
fn empty_value(below: f64, sample_type: SampleType) -> f64 {
    if below > 0.0 {
        0.0
    } else if sample_type.is_integer() {
        below.ceil() - 1.0
    } else {
        with_sample_type!(sample_type, T => {
            let nearest = T::from_f64(below).to_f64();
            if nearest < below {
                nearest
            } else if T::TYPE == SampleType::F32 {
                f64::from((below as f32).next_down())
            } else {
                below.next_down()
            }
        })
    }
}

/// What a conversion did.
#[derive(Debug, Clone)]
pub struct Conversion {
    /// The store's metadata as written.
    pub metadata: Metadata,
    /// Bytes of the store's file.
    pub file_bytes: u64,
    /// The plan that was followed.
    pub plan: ConversionPlan,
    /// Seconds from plan to durable file.
    pub total_secs: f64,
    /// Of these, seconds until the last brick was made.
    pub bricks_secs: f64,
    /// Of these, seconds for compacting and closing the file, and making it durable.
    pub finish_secs: f64,
    /// Seconds during which the writer was busy.
    pub writer_busy_secs: f64,
    /// Own memory at its peak (see [`crate::memory`]), if the system tells it.
    pub peak_memory_bytes: Option<u64>,
}

/// Converts a source into a store at `output`.
///
/// # Errors
/// When the output exists or cannot be written, the source cannot be read, an option does not fit,
/// or `progress` asks to stop. Nothing is left under the output's name, nor beside it.
pub fn convert(
    source: &Source,
    output: &Path,
    options: &ConvertOptions,
    progress: &dyn Progress,
) -> Result<Conversion, PreprocessError> {
    let started = Instant::now();
    let memory = PeakMemory::watch()?;
    let rules = options.value_rules(source.sample_type())?;
    let plan = ConversionPlan::new(source, output, options)?;
    let input = Path::new(&source.description.path);
    let mut place = Output::prepare(output, input, options.force)?;
    let encoder =
        BrickEncoder { encoding: options.encoding, effort: options.effort, rules: &rules };
    let mut writer = StoreWriter::create(place.partial())?;
    place.made();
    let (values, writer_busy_secs) = with_sample_type!(source.sample_type(), T => {
        make_bricks::<T>(source, &plan, &encoder, &mut writer, progress)?
    });
    let bricks_secs = started.elapsed().as_secs_f64();
    let mut metadata = Metadata::new(&plan.geometry, source.sample_type(), options.encoding);
    metadata.spacing_xyz = source.spacing_xyz;
    metadata.unit = source.unit;
    metadata.affine = source.affine;
    metadata.downsample = options.downsample;
    metadata.empty_below = rules.empty_below;
    metadata.empty_value = rules.empty_value;
    metadata.value_min = values.min_max.map(|(min, _)| min);
    metadata.value_max = values.min_max.map(|(_, max)| max);
    metadata.value_mean = values.mean();
    metadata.nan_count = values.nan;
    metadata.inf_count = values.infinite;
    metadata.source = source.description.clone();
    metadata.created_by = concat!("octavo ", env!("CARGO_PKG_VERSION")).into();
    metadata.created_unix_secs =
        SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    metadata.options = options.recorded();
    let metadata = writer.finish(metadata)?;
    place.finish()?;
    let file_bytes = std::fs::metadata(output)
        .map_err(|source| PreprocessError::Output { path: output.to_owned(), source })?
        .len();
    let total_secs = started.elapsed().as_secs_f64();
    Ok(Conversion {
        metadata,
        file_bytes,
        plan,
        total_secs,
        bricks_secs,
        finish_secs: total_secs - bricks_secs,
        writer_busy_secs,
        peak_memory_bytes: memory.peak_bytes(),
    })
}

/// Walks the source and writes every brick; returns the source's values, and how many seconds the
/// writer was busy.
fn make_bricks<T: Sample>(
    source: &Source,
    plan: &ConversionPlan,
    encoder: &BrickEncoder<'_>,
    writer: &mut StoreWriter,
    progress: &dyn Progress,
) -> Result<(VolumeValues, f64), PreprocessError> {
    let pool = crate::pool(plan.threads)?;
    let tree = Tree::new(plan.geometry, encoder.rules.empty_value);
    // The store is written by this thread, which also finishes it: redb's cache is then taken and
    // given back in one arena of the allocator, and not held twice.
    thread::scope(|scope| {
        let (sender, receiver) = sync_channel::<Vec<Octet<BrickOutput>>>(1);
        let walking = thread::Builder::new()
            .name("walk".into())
            .spawn_scoped(scope, move || {
                let mut values = VolumeValues::default();
                let mut sink = |octets: Vec<Octet<BrickOutput>>| {
                    if progress.should_stop() {
                        return Err(PreprocessError::Cancelled);
                    }
                    for visited in octets.iter().flatten() {
                        if let Some(brick) = &visited.output.values {
                            values.add(brick);
                        }
                    }
                    // A writer that has stopped says why itself.
                    sender.send(octets).map_err(|_| PreprocessError::Cancelled)
                };
                walk::<T, _>(source, &plan.geometry, &pool, &plan.walk, encoder, &mut sink)?;
                Ok::<_, PreprocessError>(values)
            })
            .map_err(PreprocessError::Thread)?;
        let written = write_octets(writer, tree, receiver, progress);
        let walked = walking.join().map_err(|_| PreprocessError::Panic { thread: "walk" })?;
        let busy_secs = written?;
        Ok((walked?, busy_secs))
    })
}

/// Completes and writes octets until no more come; returns the seconds it was busy.
fn write_octets(
    writer: &mut StoreWriter,
    mut tree: Tree,
    octets: Receiver<Vec<Octet<BrickOutput>>>,
    progress: &dyn Progress,
) -> Result<f64, PreprocessError> {
    let mut busy_secs = 0.0;
    for batch in octets {
        let started = Instant::now();
        let mut bricks = 0;
        for octet in batch {
            bricks += octet.len() as u64;
            writer.append(&mut tree.complete(octet))?;
        }
        busy_secs += started.elapsed().as_secs_f64();
        progress.bricks_done(bricks);
    }
    Ok(busy_secs)
}
