//! Conversion: a source becomes a store.
//!
//! Plan, then walk ([`crate::walk`]): read -> gather -> quantise and measure -> compress on the
//! pool's threads, and one writer thread that completes the records and owns the store. Every
//! [`plan::COMMIT_SOURCE_BYTES`] of the source what was written is made durable, and with it how far
//! the work is ([`resume`]).

mod brick;
mod output;
mod plan;
mod resume;
mod tree;
mod write;

pub(crate) use brick::{BrickEncoder, BrickOutput, ValueRules};
pub use output::Start;
pub(crate) use output::{Output, check_place};
pub(crate) use plan::folder_of;
pub use plan::{ConversionPlan, PlannedLevel};
pub(crate) use tree::Tree;

use crate::error::PreprocessError;
use crate::memory::PeakMemory;
use crate::progress::Progress;
use crate::source::Source;
use crate::value_stats::VolumeValues;
use crate::walk::Earlier;
use octree_store::encoding::BrickFormat;
use octree_store::{
    Disk, DiskFile, DownsampleFilter, Effort, Encoding, Metadata, OverlapAtRest, Region, Sample,
    SampleType, StoreError, StoreWriter, with_sample_type,
};
use resume::{Kept, State};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use write::{Work, Written, make_bricks};

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
    /// Whether payloads hold the overlap.
    pub overlap_at_rest: OverlapAtRest,
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
    /// The DICOM series that was chosen, for the record.
    pub series: Option<String>,
    /// Threads that make bricks; fewer are used where memory is too small for so many.
    pub threads: usize,
    /// Own memory in bytes, mapped files apart.
    pub memory_bytes: u64,
    /// The folder of scratch files; beside the output where none is given.
    pub scratch: Option<PathBuf>,
    /// Bytes of the source after which what was done is made durable.
    pub commit_source_bytes: u64,
    /// What is done with an existing output, or with unfinished work.
    pub start: Start,
    /// Where the output lies: the file system, unless a test watches it.
    pub disk: Disk,
}

impl Default for ConvertOptions {
    fn default() -> Self {
        Self {
            brick_core: 32,
            brick_overlap: 2,
            encoding: Encoding::Quantised8,
            effort: Effort::default(),
            overlap_at_rest: OverlapAtRest::default(),
            downsample: DownsampleFilter::default(),
            empty_below: None,
            nan_value: None,
            roi: None,
            time: None,
            channel: None,
            series: None,
            threads: thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: 512 << 20,
            scratch: None,
            commit_source_bytes: plan::COMMIT_SOURCE_BYTES,
            start: Start::Fresh,
            disk: Disk::default(),
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

    /// Whether the options fit a type of samples.
    ///
    /// # Errors
    /// When the type cannot hold one of their values.
    pub fn check(&self, sample_type: SampleType) -> Result<(), PreprocessError> {
        self.value_rules(sample_type).map(drop)
    }

    pub(crate) fn brick_format(&self) -> BrickFormat {
        let cut_overlap =
            (self.overlap_at_rest == OverlapAtRest::Assembled).then_some(self.brick_overlap);
        BrickFormat { encoding: self.encoding, effort: self.effort, cut_overlap }
    }

    /// Everything that shapes the store's content, for one who resumes.
    fn content(&self, source: &Source, plan: &ConversionPlan) -> String {
        let content = serde_json::json!({
            "dims_xyz": source.dims_xyz,
            "spacing_xyz": source.spacing_xyz.map(f64::to_bits),
            "unit": source.unit,
            "affine": source.affine.map(|rows| rows.map(|row| row.map(f64::to_bits))),
            "sample_type": source.sample_type(),
            "encoding": self.encoding,
            "stored_overlap": self.overlap_at_rest == OverlapAtRest::Stored,
            "downsample": self.downsample,
            "brick": [self.brick_core, self.brick_overlap],
            "empty_below": self.empty_below.map(f64::to_bits),
            "options": self.recorded(source),
            "slots_bytes": plan.slots_bytes,
        });
        content.to_string()
    }

    /// The options that change a store's content, for its metadata.
    fn recorded(&self, source: &Source) -> BTreeMap<String, serde_json::Value> {
        let mut options = BTreeMap::new();
        if let Some(value) = self.nan_value {
            options.insert("nan_value".into(), value.into());
        }
        for (name, chosen) in [("time", self.time), ("channel", self.channel)] {
            if let Some(chosen) = chosen {
                options.insert(name.into(), chosen.into());
            }
        }
        if let Some(series) = &self.series {
            options.insert("series".into(), series.as_str().into());
        }
        if self.effort != Effort::default() {
            options.insert("effort".into(), self.effort.name().into());
        }
        if let Some(Region { min, max }) = self.roi {
            options.insert("roi".into(), serde_json::json!([min, max]));
        }
        if let Some(upscale) = source.upscaling() {
            upscale.record(&mut options);
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
    /// Of these, seconds for writing the index and making the file durable.
    pub finish_secs: f64,
    /// Seconds during which the writer was busy.
    pub writer_busy_secs: f64,
    /// Own memory at its peak (see [`crate::memory`]), if the system tells it.
    pub peak_memory_bytes: Option<u64>,
    /// Bricks that an earlier run had made.
    pub resumed_bricks: u64,
    /// Of an enlarged source, the voxels whose values were clamped to the sample type's range, each once.
    pub clamped_voxels: Option<u64>,
}

/// Converts a source into a store at `output`.
///
/// # Errors
/// When the output exists or cannot be written, the source cannot be read, an option does not fit,
/// or `progress` asks to stop. Nothing is left under the output's name. What was made durable stays
/// beside it for [`Start::Resume`] where the work was stopped or the system failed; else nothing does.
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
    let folder = options.scratch.as_deref();
    let mut place = Output::prepare(&options.disk, output, &source.files, folder, options.start)?;
    let begun = Begun::open(source, &plan, options, &mut place)?;
    let Begun { mut writer, state, kept, scratch } = begun;
    let resumed_bricks = state.bricks;
    progress.bricks_done(resumed_bricks);
    let format = options.brick_format();
    let encoder = BrickEncoder { format, rules: &rules };
    let work = Work { source, plan: &plan, state, pending: kept.pending(&plan.geometry) };
    let earlier = Earlier { octets: work.state.octets, scratch: Arc::new(scratch) };
    let made = with_sample_type!(source.sample_type(), T => {
        make_bricks::<T>(work, &encoder, &mut writer, earlier, progress)
    });
    let Written { values, clamped, writer_busy_secs } = match made {
        Ok(made) => made,
        Err(error) => {
            // What was on its way counts too, if it arrived.
            let _ = writer.wait();
            let durable = writer.last_durable_mark() > 0 || resumed_bricks > 0;
            return Err(kept_or_not(error, durable, &mut place));
        }
    };
    let bricks_secs = started.elapsed().as_secs_f64();
    let mut metadata = Metadata::new(&plan.geometry, source.sample_type(), options.encoding);
    metadata.spacing_xyz = source.spacing_xyz;
    metadata.unit = source.unit;
    metadata.affine = source.affine;
    metadata.stored_overlap = options.overlap_at_rest == OverlapAtRest::Stored;
    metadata.downsample = options.downsample;
    metadata.empty_below = rules.empty_below;
    metadata.empty_value = rules.empty_value;
    describe_values(&mut metadata, &values);
    metadata.source = source.description.clone();
    metadata.created_by = concat!("octavo ", env!("CARGO_PKG_VERSION")).into();
    metadata.created_unix_secs =
        SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    metadata.options = options.recorded(source);
    let metadata = match writer.finish(metadata) {
        Ok(metadata) => metadata,
        Err(error) => return Err(kept_or_not(error.into(), true, &mut place)),
    };
    place.finish().map_err(|error| keep(error, &mut place))?;
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
        resumed_bricks,
        clamped_voxels: source.upscaling().map(|_| clamped),
    })
}

fn describe_values(metadata: &mut Metadata, values: &VolumeValues) {
    metadata.value_min = values.min_max.map(|(min, _)| min);
    metadata.value_max = values.min_max.map(|(_, max)| max);
    metadata.value_mean = values.mean();
    metadata.nan_count = values.nan;
    metadata.inf_count = values.infinite;
}

/// Keeps what is durable where it is of use to one who resumes: the error says so then.
fn kept_or_not(error: PreprocessError, durable: bool, place: &mut Output) -> PreprocessError {
    if durable && error.is_environment() { keep(error, place) } else { error }
}

fn keep(error: PreprocessError, place: &mut Output) -> PreprocessError {
    place.keep();
    PreprocessError::Kept { path: place.partial.clone(), source: Box::new(error) }
}

/// Of damage in what earlier work has left, what to do.
fn cannot_resume(error: StoreError) -> PreprocessError {
    let (path, what) = match error {
        StoreError::MetadataDamaged { path, .. } => (path, "this file is damaged or cut short"),
        StoreError::Database { path, .. } => (path, "this file is damaged"),
        other => return other.into(),
    };
    PreprocessError::CannotResume { path, what }
}

/// A conversion that can go on: from its beginning, or from where an earlier one was ended.
struct Begun {
    writer: StoreWriter,
    state: State,
    kept: Kept,
    scratch: DiskFile,
}

impl Begun {
    fn open(
        source: &Source,
        plan: &ConversionPlan,
        options: &ConvertOptions,
        place: &mut Output,
    ) -> Result<Self, PreprocessError> {
        let state = State::new(source, plan, options).map_err(|error| {
            let path = source.description.path.clone().into();
            PreprocessError::Source(crate::SourceError::Io { path, source: error })
        })?;
        if place.resumes {
            if let Some(resumed) = Self::resume(&state, source, plan, place)? {
                return Ok(resumed);
            }
            place.start_over()?;
        }
        let scratch = place.open_scratch(plan.slots_bytes)?;
        let synced = scratch.try_clone().map_err(PreprocessError::Scratch)?;
        let writer =
            StoreWriter::create_in(place.file()?, &place.partial, &place.index, vec![synced])?;
        // What will be committed is worth nothing without its name.
        place.keep_names()?;
        Ok(Self { writer, state, kept: Kept::default(), scratch })
    }

    /// What an earlier run has left; `None` where none of it was durable.
    fn resume(
        state: &State,
        source: &Source,
        plan: &ConversionPlan,
        place: &Output,
    ) -> Result<Option<Self>, PreprocessError> {
        let resume = |synced| {
            StoreWriter::resume_in(place.file()?, &place.partial, &place.index, synced)
                .map_err(cannot_resume)
        };
        let scratch = match place.open_scratch(plan.slots_bytes) {
            Ok(scratch) => scratch,
            // Where nothing was committed, what is wrong with it does not matter.
            Err(error) => return resume(vec![])?.map_or(Ok(None), |_| Err(error)),
        };
        let synced = scratch.try_clone().map_err(PreprocessError::Scratch)?;
        let Some((writer, committed)) = resume(vec![synced])? else { return Ok(None) };
        let state = state.found(&committed.state, &place.index)?;
        let kept = Kept::read(&committed.progress).ok_or_else(|| {
            let what = "what it kept of the levels is cut short";
            PreprocessError::CannotResume { path: place.index.clone(), what }
        })?;
        with_sample_type!(source.sample_type(), T => {
            kept.check_slots::<T>(plan, &scratch, &place.scratch)?;
        });
        Ok(Some(Self { writer, state, kept, scratch }))
    }
}
