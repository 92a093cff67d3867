//! `octavo convert`: a volume becomes a store, or several volumes become as many.

mod batch;
mod report;
mod show;

use super::enlarge::{EnlargeArgs, factors};
use super::{RawArgs, SeriesArgs, human_bytes, print_json, write_whole};
use crate::exit::Answer;
use crate::parse;
use crate::progress::Bar;
use clap::{Args, ValueEnum};
use octree_store::{DownsampleFilter, Effort, Encoding, LengthUnit, OverlapAtRest, Region};
use preprocess::PreprocessError;
use preprocess::{ConversionPlan, ConvertOptions, Source, Start, convert};
use report::Report;
use show::{PlanJson, print_plan, print_summary};
use std::io;
use std::path::{Path, PathBuf};

/// Convert a volume into a store
///
/// Reads NIfTI-1/2 and Analyze (.nii, .hdr + .img, each also .gz), TIFF and BigTIFF, folders and quoted
/// patterns of TIFF or PNG slices, NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), DICOM (a folder, .dcm)
/// and raw files. A raw file named NAME_XxYxZ_TYPE.raw needs no flags.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo convert tooth.nii.gz\n  \
    octavo convert scan_1024x1024x1024_u16.raw -o scan.octavo --spacing 10,10,10 --unit um\n  \
    octavo convert scan.raw --dims 512,512,300 --dtype u16 --big-endian --empty-below 6400\n  \
    octavo convert scan.nii --resume\n  \
    octavo convert scans/*.nii.gz -o stores --jobs 2 --json\n  \
    octavo convert scan.nii --upscale 4 --detail 0.5 --seed 7 --empty-below 6400\n  \
    octavo convert scan.nii --plan")]
#[allow(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub(super) struct Convert {
    /// The volume, or several: files, folders of slices, quoted globs
    #[arg(required_unless_present = "list", value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The store to make, or with several inputs the folder for them [default: the input's stem + .octavo]
    #[arg(short, long, value_name = "OUT.octavo")]
    output: Option<PathBuf>,
    /// A file that names more inputs, one a line; - reads them from stdin
    #[arg(long, value_name = "FILE")]
    list: Option<PathBuf>,
    /// With several inputs, how many are converted at a time; they share threads and memory
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    jobs: u16,
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
    /// How samples are stored: u8 takes 8 bits over each brick's range; lossless is bit exact; with
    /// max-error=E each brick takes the fewest bits that keep every voxel within E of the source
    #[arg(long, value_name = "u8|lossless|max-error=E", default_value_t = Encoding::Quantised8)]
    encoding: Encoding,
    /// How much work goes into a small store: fast stores bricks as they are, balanced tries LZ4,
    /// small uses Zstandard
    #[arg(long, value_enum, default_value_t = EffortName::Balanced)]
    effort: EffortName,
    /// Where overlap is while the store rests: stored in every brick, so that a brick is one read, or
    /// assembled on reading from the neighbours, which saves its bytes
    #[arg(long, value_enum, default_value_t = OverlapName::Stored)]
    overlap_at_rest: OverlapName,
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
    /// Convert the volume enlarged so many times along every axis, without ever storing it; a region is
    /// cut out first
    #[arg(long, value_name = "F", value_parser = factors())]
    upscale: Option<u32>,
    #[command(flatten)]
    enlarge: EnlargeArgs,
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
    /// Replace an existing store, or begin unfinished work anew
    #[arg(long)]
    force: bool,
    /// Go on with an unfinished conversion, or begin one where there is none
    #[arg(long, conflicts_with = "force")]
    resume: bool,
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

/// One input and what it becomes.
#[derive(Debug, Clone)]
struct Job {
    input: PathBuf,
    output: PathBuf,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum EffortName {
    Fast,
    Balanced,
    Small,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OverlapName {
    Stored,
    Assembled,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum DownsampleName {
    Mean,
    Max,
    Min,
    Mode,
    Nearest,
}

impl Convert {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        if self.upscale.is_none() && self.enlarge.any() {
            anyhow::bail!("--kernel, --detail and --seed say how to enlarge: give --upscale too");
        }
        let jobs = self.jobs()?;
        match jobs.as_slice() {
            [job] if self.list.is_none() => self.one(job),
            jobs => batch::run(&self, jobs),
        }
    }

    /// Every input with its output.
    fn jobs(&self) -> anyhow::Result<Vec<Job>> {
        let mut inputs = self.inputs.clone();
        if let Some(list) = &self.list {
            inputs.extend(batch::read_list(list)?);
        }
        let several = inputs.len() > 1 || self.list.is_some();
        let folder = self.output.clone().filter(|output| several || output.is_dir());
        if let Some(folder) = folder.as_ref().filter(|folder| !folder.is_dir()) {
            let what = "with several inputs, -o names a folder, and there is no such folder";
            let source = io::Error::new(io::ErrorKind::NotFound, what);
            return Err(PreprocessError::Output { path: folder.clone(), source }.into());
        }
        let jobs: Vec<_> = inputs
            .into_iter()
            .map(|input| {
                let output = match (&folder, &self.output) {
                    (Some(folder), _) => folder.join(default_output(&input)),
                    (None, Some(output)) => output.clone(),
                    (None, None) => default_output(&input),
                };
                Job { input, output }
            })
            .collect();
        for (index, job) in jobs.iter().enumerate() {
            if let Some(other) = jobs[..index].iter().find(|other| other.output == job.output) {
                anyhow::bail!(
                    "{} and {} would both become {}: convert them apart, with -o",
                    other.input.display(),
                    job.input.display(),
                    job.output.display()
                );
            }
        }
        Ok(jobs)
    }

    /// Opens a job's source as the flags say.
    fn open(&self, job: &Job) -> Result<Source, PreprocessError> {
        let how = self.raw.source_options(Some(&self.series));
        let mut source = Source::open(&job.input, &how)?;
        if let Some(region) = self.roi {
            source = source.crop(region)?;
        }
        if let Some(spacing) = self.spacing {
            source.set_spacing(spacing);
        }
        source.unit = self.unit.unwrap_or(source.unit);
        match self.upscale {
            Some(factor) => Ok(source.upscale(self.enlarge.upscale(factor)?)?),
            None => Ok(source),
        }
    }

    /// Converts the only input.
    fn one(&self, job: &Job) -> anyhow::Result<Answer> {
        let source = self.open(job)?;
        let options = self.options();
        super::print_notes(&source);
        let plan = ConversionPlan::new(&source, &job.output, &options)?;
        if self.plan {
            if self.json {
                print_json(&PlanJson::new(&plan, &job.output, &options))?;
            } else {
                print_plan(&plan, &job.output)?;
            }
            warn_of_space(&plan, job, &options);
            return Ok(Answer::Done);
        }
        self.check_report(std::slice::from_ref(job))?;
        warn_of_space(&plan, job, &options);
        let bar = Bar::new("converting", plan.bricks);
        let done = convert(&source, &job.output, &options, &bar);
        bar.finish();
        let done = done?;
        let report = Report::of(&done);
        if let Some(path) = &self.report {
            write_whole(path, self.force || self.resume, |file| {
                serde_json::to_writer_pretty(&mut *file, &report)?;
                writeln!(file)
            })?;
        }
        if self.json {
            print_json(&report)?;
        } else {
            print_summary(&done, &job.input, &job.output)?;
        }
        Ok(Answer::Done)
    }

    /// Looks now at what would only be noticed at the end: whether the report can be written.
    fn check_report(&self, jobs: &[Job]) -> anyhow::Result<()> {
        let Some(report) = &self.report else { return Ok(()) };
        if report.exists() && !self.force && !self.resume {
            let path = report.to_owned();
            return Err(PreprocessError::Exists { path }.into());
        }
        let folder = report.parent().filter(|folder| !folder.as_os_str().is_empty());
        let clash = jobs.iter().any(|job| [&job.input, &job.output].contains(&report));
        if clash || folder.is_some_and(|folder| !folder.is_dir()) {
            let what =
                if clash { "it is an input or an output" } else { "there is no such folder" };
            let source = io::Error::new(io::ErrorKind::InvalidInput, what);
            return Err(PreprocessError::Output { path: report.clone(), source }.into());
        }
        Ok(())
    }

    fn options(&self) -> ConvertOptions {
        let defaults = ConvertOptions::default();
        ConvertOptions {
            brick_core: self.brick,
            brick_overlap: self.overlap,
            encoding: self.encoding,
            effort: match self.effort {
                EffortName::Fast => Effort::Fast,
                EffortName::Balanced => Effort::Balanced,
                EffortName::Small => Effort::Small,
            },
            overlap_at_rest: match self.overlap_at_rest {
                OverlapName::Stored => OverlapAtRest::Stored,
                OverlapName::Assembled => OverlapAtRest::Assembled,
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
            series: self.series.series.clone(),
            threads: self.threads.map_or(defaults.threads, usize::from),
            memory_bytes: self.memory,
            scratch: self.scratch.clone(),
            commit_source_bytes: defaults.commit_source_bytes,
            start: match (self.force, self.resume) {
                (true, _) => Start::Replace,
                (_, true) => Start::Resume,
                _ => Start::Fresh,
            },
            disk: defaults.disk,
        }
    }
}

/// Says so where the disk may turn out too small: not all that is reserved need be used.
fn warn_of_space(plan: &ConversionPlan, job: &Job, options: &ConvertOptions) {
    if let Some((needed, free)) = plan.disk_space(&job.output, options).short {
        eprintln!(
            "octavo: {}: the disk has {} free, and up to {} may be needed",
            job.output.display(),
            human_bytes(free),
            human_bytes(needed)
        );
    }
}

/// The input's stem and `.octavo`, in the folder where we are: of a folder its whole name, of a pattern
/// what comes before its first wildcard, or the name of its folder.
fn default_output(input: &Path) -> PathBuf {
    let name_of = |path: &Path| {
        path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    };
    let name = name_of(input);
    if input.is_dir() {
        // `scan/` and `.` have the name of the folder that they stand for.
        let whole = input.canonicalize().map(|path| name_of(&path)).unwrap_or_default();
        return PathBuf::from(format!("{}.octavo", if name.is_empty() { whole } else { name }));
    }
    if let Some(wild) = name.find(['*', '?', '[']).filter(|_| !input.exists()) {
        let before = name[..wild].trim_end_matches(['_', '-', '.', ' ']).to_owned();
        let folder = input.parent().map(name_of).unwrap_or_default();
        let stem = [before, folder].into_iter().find(|stem| !stem.is_empty());
        return PathBuf::from(format!("{}.octavo", stem.unwrap_or_else(|| "slices".into())));
    }
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    PathBuf::from(format!("{stem}.octavo"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_named_after_their_inputs() {
        let folder = tempfile::tempdir().unwrap();
        let scan = folder.path().join("scan.2026");
        std::fs::create_dir(&scan).unwrap();
        for (input, output) in [
            (Path::new("a/tooth.nii.gz"), "tooth.octavo"),
            (Path::new("scan_4x4x4_u8.raw"), "scan_4x4x4_u8.octavo"),
            (&scan, "scan.2026.octavo"),
            (Path::new("scan/slice_*.tif"), "slice.octavo"),
            (Path::new("scan/*.tif"), "scan.octavo"),
            (Path::new("*.png"), "slices.octavo"),
        ] {
            assert_eq!(default_output(input), Path::new(output), "{}", input.display());
        }
    }
}
