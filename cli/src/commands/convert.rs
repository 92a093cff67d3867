//! `octavo convert`: a volume becomes a store.

use super::{RawArgs, SeriesArgs, by, human_bytes, print_json, write_whole};
use crate::exit::Answer;
use crate::info_json::{InfoJson, bits_per_voxel};
use crate::parse;
use crate::progress::Bar;
use clap::{Args, ValueEnum};
use octree_store::{DownsampleFilter, Effort, Encoding, LengthUnit, Region};
use preprocess::PreprocessError;
use preprocess::{Conversion, ConversionPlan, ConvertOptions, Source, convert};
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Convert a volume into a store
///
/// Reads NIfTI-1/2 and Analyze (.nii, .hdr + .img, each also .gz) and raw files. A raw file named
/// NAME_XxYxZ_TYPE.raw needs no flags.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo convert tooth.nii.gz\n  \
    octavo convert scan_1024x1024x1024_u16.raw -o scan.octavo --spacing 10,10,10 --unit um\n  \
    octavo convert scan.raw --dims 512,512,300 --dtype u16 --big-endian --empty-below 6400\n  \
    octavo convert scan.nii --plan")]
pub(super) struct Convert {
    /// The volume
    input: PathBuf,
    /// The store to make [default: the input's stem + .octavo]
    #[arg(short, long, value_name = "OUT.octavo")]
    output: Option<PathBuf>,
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
    /// Size of a voxel, in place of the source's own
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::spacing)]
    spacing: Option<[f64; 3]>,
    /// Unit of the spacing: m, mm, um or nm, in place of the source's own
    #[arg(long, value_parser = parse::unit)]
    unit: Option<LengthUnit>,
    /// Core voxels along a brick's side: even, 8 to 128
    #[arg(long, value_name = "N", default_value_t = 32)]
    brick: u32,
    /// Voxels of the neighbours on every side of the core: 0 to 4
    #[arg(long, value_name = "N", default_value_t = 2)]
    overlap: u32,
    /// How samples are stored: u8 takes 8 bits over each brick's range; lossless is bit exact
    #[arg(long, value_enum, default_value_t = EncodingName::U8)]
    encoding: EncodingName,
    /// How much work goes into a small store: fast stores bricks as they are, balanced tries LZ4,
    /// small uses Zstandard
    #[arg(long, value_enum, default_value_t = EffortName::Balanced)]
    effort: EffortName,
    /// How a level is made of the one below it: the mean, greatest, least or most frequent of
    /// 2x2x2 cells (mode keeps labels exact), or the one at the lowest corner (nearest)
    #[arg(long, value_enum, default_value_t = DownsampleName::Mean)]
    downsample: DownsampleName,
    /// Drop bricks whose every voxel is below this
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    empty_below: Option<f64>,
    /// Convert a part: half-open, in voxels
    #[arg(long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = parse::region)]
    roi: Option<Region>,
    /// Value that takes the place of NaN
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    nan_value: Option<f64>,
    /// Threads that make bricks [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Own memory to use at most, pages of mapped files apart
    #[arg(long, value_name = "SIZE", value_parser = parse::size, default_value = "512MiB")]
    memory: u64,
    /// Folder of scratch files [default: beside the output]
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
    /// Replace an existing store
    #[arg(long)]
    force: bool,
    /// Print what would happen and stop
    #[arg(long)]
    plan: bool,
    /// Write a report: what `info --json` gives, plus timings and memory
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum EncodingName {
    U8,
    Lossless,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum EffortName {
    Fast,
    Balanced,
    Small,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum DownsampleName {
    Mean,
    Max,
    Min,
    Mode,
    Nearest,
}

/// What `--report` holds.
#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    info: InfoJson<'a>,
    threads: usize,
    total_secs: f64,
    bricks_secs: f64,
    finish_secs: f64,
    writer_busy_secs: f64,
    voxels_per_sec: f64,
    peak_memory_bytes: Option<u64>,
    predicted_memory_bytes: u64,
    resumed_bricks: u64,
}

impl Convert {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let mut source = Source::open(&self.input, &self.raw.source_options(Some(&self.series)))?;
        if let Some(region) = self.roi {
            source = source.crop(region)?;
        }
        if let Some(spacing) = self.spacing {
            source.set_spacing(spacing);
        }
        source.unit = self.unit.unwrap_or(source.unit);
        let output = self.output.clone().unwrap_or_else(|| default_output(&self.input));
        let options = self.options();
        super::print_notes(&source);
        let plan = ConversionPlan::new(&source, &output, &options)?;
        if self.plan {
            if self.json {
                print_json(&plan)?;
            } else {
                print_plan(&plan, &output)?;
            }
            return Ok(Answer::Done);
        }
        if let Some(report) = self.report.as_ref().filter(|report| report.exists() && !self.force) {
            let path = report.to_owned();
            return Err(PreprocessError::Exists { path }.into());
        }
        // What would only be noticed at the end is looked at now.
        if let Some(report) = &self.report {
            let folder = report.parent().filter(|folder| !folder.as_os_str().is_empty());
            let clash = [&self.input, &output].into_iter().any(|other| other == report);
            if clash || folder.is_some_and(|folder| !folder.is_dir()) {
                let what =
                    if clash { "it is the input or the output" } else { "there is no such folder" };
                let source = io::Error::new(io::ErrorKind::InvalidInput, what);
                return Err(PreprocessError::Output { path: report.clone(), source }.into());
            }
        }
        let bar = Bar::new("converting", plan.bricks);
        let done = convert(&source, &output, &options, &bar);
        bar.finish();
        let done = done?;
        let report = report(&done);
        if let Some(path) = &self.report {
            write_whole(path, self.force, |file| {
                serde_json::to_writer_pretty(&mut *file, &report)?;
                writeln!(file)
            })?;
        }
        if self.json {
            print_json(&report)?;
        } else {
            print_summary(&done, &self.input, &output)?;
        }
        Ok(Answer::Done)
    }

    fn options(&self) -> ConvertOptions {
        let defaults = ConvertOptions::default();
        ConvertOptions {
            brick_core: self.brick,
            brick_overlap: self.overlap,
            encoding: match self.encoding {
                EncodingName::U8 => Encoding::Quantised8,
                EncodingName::Lossless => Encoding::Lossless,
            },
            effort: match self.effort {
                EffortName::Fast => Effort::Fast,
                EffortName::Balanced => Effort::Balanced,
                EffortName::Small => Effort::Small,
            },
            downsample: match self.downsample {
                DownsampleName::Mean => DownsampleFilter::Mean,
                DownsampleName::Max => DownsampleFilter::Max,
                DownsampleName::Min => DownsampleFilter::Min,
                DownsampleName::Mode => DownsampleFilter::Mode,
                DownsampleName::Nearest => DownsampleFilter::Nearest,
            },
            empty_below: self.empty_below,
            nan_value: self.nan_value,
            roi: self.roi,
            time: self.series.time,
            channel: self.series.channel,
            threads: self.threads.map_or(defaults.threads, usize::from),
            memory_bytes: self.memory,
            scratch: self.scratch.clone(),
            force: self.force,
        }
    }
}

/// The input's stem and `.octavo`, in the folder where we are.
fn default_output(input: &Path) -> PathBuf {
    let name = input.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    PathBuf::from(format!("{stem}.octavo"))
}

fn report(done: &Conversion) -> Report<'_> {
    let voxels: u64 = done.metadata.dims_xyz.iter().product();
    Report {
        info: InfoJson::new(&done.metadata, done.file_bytes),
        threads: done.plan.threads,
        total_secs: done.total_secs,
        bricks_secs: done.bricks_secs,
        finish_secs: done.finish_secs,
        writer_busy_secs: done.writer_busy_secs,
        voxels_per_sec: voxels as f64 / done.total_secs,
        peak_memory_bytes: done.peak_memory_bytes,
        predicted_memory_bytes: done.plan.predicted_memory_bytes,
        resumed_bricks: 0,
    }
}

fn print_plan(plan: &ConversionPlan, output: &Path) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "would make   {}", output.display())?;
    writeln!(
        out,
        "volume       {} {} voxels, {}",
        by(plan.dims_xyz),
        plan.sample_type,
        human_bytes(plan.source_bytes)
    )?;
    writeln!(
        out,
        "bricks       {} of {}^3 + {} overlap, {}",
        plan.bricks,
        plan.brick_core,
        plan.brick_overlap,
        plan.encoding.name()
    )?;
    for level in &plan.levels {
        writeln!(
            out,
            "level {:2}     {} voxels, {} bricks",
            level.level,
            by(level.dims_xyz),
            level.bricks
        )?;
    }
    writeln!(
        out,
        "memory       {} of the {} allowed, on {} threads",
        human_bytes(plan.predicted_memory_bytes),
        human_bytes(plan.memory_budget_bytes),
        plan.threads
    )?;
    writeln!(out, "scratch      {} at most", human_bytes(plan.scratch_bytes))?;
    writeln!(out, "store        {} at most", human_bytes(plan.output_bytes_max))
}

fn print_summary(done: &Conversion, input: &Path, output: &Path) -> io::Result<()> {
    let metadata = &done.metadata;
    let mut out = io::stdout().lock();
    let voxels: u64 = metadata.dims_xyz.iter().product();
    writeln!(out, "{} -> {}", input.display(), output.display())?;
    writeln!(
        out,
        "  {} {} voxels in {:.2} s: {:.1} million voxels a second",
        by(metadata.dims_xyz),
        metadata.sample_type,
        done.total_secs,
        voxels as f64 / done.total_secs / 1e6
    )?;
    let count =
        |f: fn(&octree_store::LevelSummary) -> u64| metadata.levels.iter().map(f).sum::<u64>();
    writeln!(
        out,
        "  {} levels, {} bricks stored, {} uniform, {} empty",
        metadata.levels.len(),
        count(|level| level.stored),
        count(|level| level.uniform),
        count(|level| level.empty)
    )?;
    writeln!(
        out,
        "  {} in the file, {:.2} bits a voxel, pyramid included",
        human_bytes(done.file_bytes),
        bits_per_voxel(metadata, done.file_bytes)
    )?;
    writeln!(out, "  {}", super::info::error_line(metadata))?;
    if metadata.dropped_voxels > 0 {
        writeln!(out, "  {}", super::info::dropped_line(metadata))?;
    }
    if let Some(peak) = done.peak_memory_bytes {
        writeln!(
            out,
            "  own memory {} at its peak, {} predicted",
            human_bytes(peak),
            human_bytes(done.plan.predicted_memory_bytes)
        )?;
    }
    Ok(())
}
