//! `octavo upscale`: an enlarged volume as a file.

use super::enlarge::{EnlargeArgs, factors};
use super::{RawArgs, SeriesArgs, by, human_bytes, print_json};
use crate::exit::Answer;
use crate::parse;
use crate::progress::Bar;
use anyhow::bail;
use clap::Args;
use octree_store::{LengthUnit, Region};
use preprocess::export::{ExportFormat, export};
use preprocess::{Source, Volume};
use serde::Serialize;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Instant;

/// Enlarge a volume by tricubic interpolation, with procedural detail if wanted
///
/// Written slice by slice in the source's type; spacing and affine follow, so that world positions
/// stay. To make a store of an enlarged volume, convert --upscale needs no file of it.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo upscale tooth.nii.gz -o tooth4.nii\n  \
    octavo upscale tooth.nii.gz -o tooth2.nii --factor 2 --kernel mitchell\n  \
    octavo upscale scan.raw --dims 512,512,300 --dtype u16 -o big.raw --detail 0.5 --seed 7")]
pub(super) struct Upscale {
    /// The volume: a file, a folder of slices, a quoted glob
    input: PathBuf,
    /// The file: .raw, .nii, .nii.gz, .nrrd or .tif (BigTIFF above 4 GiB)
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// How many times, along every axis
    #[arg(long, value_name = "F", default_value = "4", value_parser = factors())]
    factor: u32,
    #[command(flatten)]
    enlarge: EnlargeArgs,
    /// Size of a voxel of the input, in place of its own
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::spacing)]
    spacing: Option<[f64; 3]>,
    /// Unit of the spacing: m, mm, um or nm, in place of the input's own
    #[arg(long, value_parser = parse::unit)]
    unit: Option<LengthUnit>,
    /// Enlarge a part: half-open, in voxels of the input
    #[arg(long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = parse::region)]
    roi: Option<Region>,
    /// Threads [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Own memory to use at most, pages of mapped files apart
    #[arg(long, value_name = "SIZE", value_parser = parse::size, default_value = "512MiB")]
    memory: u64,
    /// Replace an existing file
    #[arg(long)]
    force: bool,
    /// Print JSON (schema octavo.upscale/1)
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
}

#[derive(Serialize)]
struct UpscaleJson {
    schema: &'static str,
    dims_xyz: [u64; 3],
    sample_type: octree_store::SampleType,
    spacing_xyz: [f64; 3],
    factor: u32,
    kernel: &'static str,
    detail: Option<f64>,
    seed: Option<u64>,
    clamped_voxels: u64,
    total_secs: f64,
    voxels_per_sec: f64,
}

impl Upscale {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let Some(format) = ExportFormat::of_name(&self.output) else {
            bail!(
                "{}: its name must end in .raw, .nii, .nii.gz, .nrrd, .tif or .tiff",
                self.output.display()
            );
        };
        let upscale = self.enlarge.upscale(self.factor)?;
        let mut source = Source::open(&self.input, &self.raw.source_options(Some(&self.series)))?;
        super::print_notes(&source);
        if let Some(region) = self.roi {
            source = source.crop(region)?;
        }
        if let Some(spacing) = self.spacing {
            source.set_spacing(spacing);
        }
        source.unit = self.unit.unwrap_or(source.unit);
        let mut source = source.upscale(upscale)?;
        let default = std::thread::available_parallelism().map_or(1, usize::from);
        source.limit_slices(self.threads.map_or(default, usize::from), self.memory)?;
        let volume = Volume::Source(Box::new(source));
        let started = Instant::now();
        let bar = Bar::of("enlarging", volume.dims_xyz()[2], "slices");
        let done = export(&volume, &self.output, format, self.force, &bar);
        bar.finish();
        done?;
        let total_secs = started.elapsed().as_secs_f64();
        let clamped_voxels = match &volume {
            Volume::Source(source) => source.clamped_voxels().unwrap_or(0),
            Volume::Store { .. } => 0,
        };
        let dims_xyz = volume.dims_xyz();
        let voxels: u64 = dims_xyz.iter().product();
        let report = UpscaleJson {
            schema: "octavo.upscale/1",
            dims_xyz,
            sample_type: volume.sample_type(),
            spacing_xyz: volume.spacing_xyz(),
            factor: upscale.factor(),
            kernel: upscale.kernel().name(),
            detail: upscale.detail().map(|detail| detail.amplitude),
            seed: upscale.detail().map(|detail| detail.seed),
            clamped_voxels,
            total_secs,
            voxels_per_sec: voxels as f64 / total_secs,
        };
        if self.json {
            print_json(&report)?;
        } else {
            self.print(&report)?;
        }
        Ok(Answer::Done)
    }

    fn print(&self, report: &UpscaleJson) -> io::Result<()> {
        let mut out = io::stdout().lock();
        writeln!(out, "{} -> {}", self.input.display(), self.output.display())?;
        writeln!(
            out,
            "  {} {} voxels in {:.2} s: {:.1} million voxels a second",
            by(report.dims_xyz),
            report.sample_type,
            report.total_secs,
            report.voxels_per_sec / 1e6
        )?;
        let detail = match (report.detail, report.seed) {
            (Some(amplitude), Some(seed)) => {
                format!(", detail of {amplitude} times the local contrast, seed {seed}")
            }
            _ => String::new(),
        };
        writeln!(out, "  {} times, {}{detail}", report.factor, report.kernel)?;
        writeln!(out, "  {} voxels clamped to the type's range", report.clamped_voxels)?;
        let bytes = std::fs::metadata(&self.output)?.len();
        writeln!(out, "  {} in the file", human_bytes(bytes))
    }
}
