//! `octavo tradeoff`: a volume, or a sample of it, converted in every way that is worth a look; what each
//! costs and gives is written as JSON and as a page with plots.

mod axis;
mod drawing;
mod html;
mod labels;
mod plots;
mod report;
mod show;
mod view;

use super::render::Drawer;
use super::{RawArgs, SeriesArgs, print_json, write_whole};
use crate::exit::Answer;
use crate::parse;
use crate::progress::Bar;
use clap::Args;
use octree_store::{Region, SampleType};
use preprocess::tradeoff::{LadderOptions, Rung, Sampled, ladder, sample_region};
use preprocess::{ConvertOptions, PreprocessError, Progress, Source};
use report::{Limit, Report, Threshold};
use std::io;
use std::path::{Path, PathBuf};

/// Measure what each way to convert a volume costs and gives
///
/// Converts the volume, or a sample from its middle, with every encoding and effort; reads each store back;
/// and writes DIR/report.json (schema octavo.tradeoff/1) and DIR/report.html: size, error, speed, how far
/// each level lies from full resolution, and the best choice for three wishes with the command for it.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo tradeoff tooth.nii.gz -o tooth-tradeoff\n  \
    octavo tradeoff scan_2048x2048x2048_u16.raw -o trade --sample 16000000 --max-error 10,50,250\n  \
    octavo tradeoff scan.nii -o trade --wish-error 20 --wish-bits 4 --json --force")]
pub(super) struct Tradeoff {
    /// The volume: a file, a folder of slices, or a quoted glob
    input: PathBuf,
    /// The folder for report.json and report.html; made if it is not there. Scratch files go there too
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
    /// Voxels to measure at most: a larger volume is measured by a region in its middle with its proportions
    #[arg(long, value_name = "VOXELS", default_value_t = 1 << 26, value_parser = clap::value_parser!(u64).range(1..))]
    sample: u64,
    /// Error bounds to try [default: the range of the values over 16, 64, 256, 1024 and 4096]
    #[arg(long, value_name = "E1,E2,...", value_delimiter = ',', value_parser = parse::error_bound)]
    max_error: Vec<f64>,
    /// The threshold of the rungs that drop bricks [default: Otsu's, from the histogram]
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    empty_below: Option<f64>,
    /// Largest error of the wishes for the smallest store and the fastest reading [default: the range of the
    /// values over 256]
    #[arg(long, value_name = "E", value_parser = parse::error_bound)]
    wish_error: Option<f64>,
    /// Most bits a voxel of the wish for the most accurate store [default: half of the source's]
    #[arg(long, value_name = "B", value_parser = parse::error_bound)]
    wish_bits: Option<f64>,
    /// Measure a part: half-open, in voxels
    #[arg(long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = parse::region)]
    roi: Option<Region>,
    /// Core voxels along a brick's side: even, 8 to 128
    #[arg(long, value_name = "N", default_value_t = 32)]
    brick: u32,
    /// Voxels of the neighbours on every side of the core: 0 to 4
    #[arg(long, value_name = "N", default_value_t = 2)]
    overlap: u32,
    /// Threads that make and read bricks [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Own memory of a conversion at most, pages of mapped files apart
    #[arg(long, value_name = "SIZE", value_parser = parse::size, default_value = "512MiB")]
    memory: u64,
    /// Who draws the pictures that show what a view costs
    #[arg(long, value_enum, default_value_t)]
    renderer: Drawer,
    /// Replace reports that are there
    #[arg(long)]
    force: bool,
    /// Print the report as JSON too
    #[arg(long)]
    json: bool,
}

impl Tradeoff {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let mut source = Source::open(&self.input, &self.raw.source_options(Some(&self.series)))?;
        super::print_notes(&source);
        let description = source.description.clone();
        let file_dims_xyz = source.dims_xyz;
        if let Some(region) = self.roi {
            source = source.crop(region)?;
        }
        let how = self.convert_options();
        let region = sample_region(source.dims_xyz, self.sample, self.brick);
        source.geometry(self.brick, self.overlap)?;
        self.check_limits(source.sample_type())?;
        let folder = Folder::open(&self.output, self.force)?;

        let bar = Bar::new("sampling", 0);
        let sampled = Sampled::take(source, region, folder.scratch(), &bar);
        bar.finish();
        let sampled = sampled?;
        let threshold = self.threshold(&sampled);
        let rungs = ladder(&LadderOptions {
            sample_type: sampled.sample_type(),
            range: sampled.values.range(),
            max_errors: (!self.max_error.is_empty()).then(|| self.max_error.clone()),
            empty_below: threshold.map(|threshold| threshold.value),
        });
        let bricks = sampled.source.geometry(self.brick, self.overlap)?.bricks();
        // Each is made once and read once, as far as the bar is concerned.
        let bar = Bar::new("measuring", 2 * bricks * rungs.len() as u64);
        let readings = measure(&sampled, &rungs, &how, folder.scratch(), &bar);
        bar.finish();
        let rungs = readings?;
        let bar = Bar::new("drawing", 2 * bricks);
        let view = view::measure(&sampled, &how, self.renderer, folder.scratch(), &bar);
        bar.finish();
        let report = Report::new(report::Measured {
            description: &description,
            file_dims_xyz,
            sampled: &sampled,
            threshold,
            how: &how,
            rungs,
            view: view?,
            wish_error: self.wish_error.map(Limit::given),
            wish_bits: self.wish_bits.map(Limit::given),
            convert: self.convert_command(),
        });
        let page = html::page(&report)?;
        let json = serde_json::to_vec_pretty(&report)?;
        folder.write("report.html", page.as_bytes())?;
        folder.write("report.json", &json)?;
        folder.keep();
        if self.json {
            print_json(&report)?;
        } else {
            show::print(&report, &self.output)?;
        }
        Ok(Answer::Done)
    }

    fn convert_options(&self) -> ConvertOptions {
        let defaults = ConvertOptions::default();
        ConvertOptions {
            brick_core: self.brick,
            brick_overlap: self.overlap,
            threads: self.threads.map_or(defaults.threads, usize::from),
            memory_bytes: self.memory,
            ..defaults
        }
    }

    /// What a conversion would refuse at its beginning is refused before the sample is taken.
    fn check_limits(&self, sample_type: SampleType) -> Result<(), PreprocessError> {
        let Some(value) = self.empty_below else { return Ok(()) };
        ConvertOptions { empty_below: Some(value), ..ConvertOptions::default() }.check(sample_type)
    }

    fn threshold(&self, sampled: &Sampled) -> Option<Threshold> {
        let given = self.empty_below.map(|value| Threshold { value, how: "given" });
        given.or_else(|| sampled.otsu.map(|value| Threshold { value, how: "otsu" }))
    }

    /// The beginning of the command that converts the input, up to what a rung adds.
    fn convert_command(&self) -> String {
        let mut words = vec!["octavo".to_owned(), "convert".to_owned()];
        words.push(quoted(&self.input.display().to_string()));
        let mut add = |flag: &str, value: Option<String>| {
            if let Some(value) = value {
                words.extend([flag.to_owned(), value]);
            }
        };
        let commas = |triple: [u64; 3]| triple.map(|n| n.to_string()).join(",");
        add("--dims", self.raw.dims.map(commas));
        add("--dtype", self.raw.dtype.map(|dtype| dtype.to_string()));
        add("--skip", self.raw.skip.map(|skip| skip.to_string()));
        add("--channel", self.series.channel.map(|channel| channel.to_string()));
        add("--time", self.series.time.map(|time| time.to_string()));
        add("--series", self.series.series.as_deref().map(quoted));
        add(
            "--roi",
            self.roi.map(|Region { min, max }| {
                [0, 1, 2].map(|axis| format!("{}:{}", min[axis], max[axis])).join(",")
            }),
        );
        add("--brick", (self.brick != 32).then(|| self.brick.to_string()));
        add("--overlap", (self.overlap != 2).then(|| self.overlap.to_string()));
        for (flag, given) in
            [("--big-endian", self.raw.big_endian), ("--allow-gaps", self.series.allow_gaps)]
        {
            if given {
                words.push(flag.to_owned());
            }
        }
        words.join(" ")
    }
}

fn measure(
    sampled: &Sampled,
    rungs: &[Rung],
    how: &ConvertOptions,
    scratch: &Path,
    progress: &dyn Progress,
) -> Result<Vec<preprocess::tradeoff::RungReading>, PreprocessError> {
    rungs.iter().map(|rung| sampled.measure(rung, how, scratch, progress)).collect()
}

/// A word as a POSIX shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,@%+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// The folder of the reports, with scratch space that goes when the work ends.
struct Folder {
    path: PathBuf,
    scratch: Option<tempfile::TempDir>,
    force: bool,
    /// Whether the folder is ours to remove if nothing comes of the work.
    made: bool,
}

impl Folder {
    fn open(path: &Path, force: bool) -> Result<Self, PreprocessError> {
        let failed = |source| PreprocessError::Output { path: path.to_owned(), source };
        for name in ["report.json", "report.html"] {
            let report = path.join(name);
            if report.exists() && !(force && report.is_file()) {
                return Err(PreprocessError::Exists { path: report });
            }
        }
        let made = match std::fs::create_dir(path) {
            Ok(()) => true,
            Err(_) if path.is_dir() => false,
            Err(error) => {
                let (kind, why) = match error.kind() {
                    io::ErrorKind::AlreadyExists => {
                        (io::ErrorKind::NotADirectory, "it is no folder: give -o the name of one")
                    }
                    kind @ io::ErrorKind::NotFound => {
                        (kind, "there is no such folder to make it in")
                    }
                    _ => return Err(failed(error)),
                };
                return Err(failed(io::Error::new(kind, why)));
            }
        };
        let mut folder = Self { path: path.to_owned(), scratch: None, force, made };
        let scratch = tempfile::Builder::new().prefix(".octavo-tradeoff-").tempdir_in(path);
        folder.scratch = Some(scratch.map_err(failed)?);
        Ok(folder)
    }

    fn scratch(&self) -> &Path {
        self.scratch.as_ref().map_or(&self.path, |scratch| scratch.path())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        write_whole(&self.path.join(name), self.force, |file| file.write_all(bytes))
    }

    /// The reports are written: the folder stays.
    fn keep(mut self) {
        self.made = false;
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        self.scratch = None;
        if self.made {
            // Only if it is empty, which is what remove_dir asks for.
            let _ = std::fs::remove_dir(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Typed {
        #[command(flatten)]
        tradeoff: Tradeoff,
    }

    #[test]
    fn the_command_has_all_that_chooses_the_volume() {
        let chosen = "--dims 4,5,6 --dtype u16 --skip 7 --channel 1 --time 2 --series 1.2.3 --roi 0:1,0:2,0:3 \
                      --brick 16 --overlap 1 --big-endian --allow-gaps";
        let typed: Vec<_> =
            ["octavo", "in.raw", "-o", "t"].into_iter().chain(chosen.split_whitespace()).collect();
        let Typed { tradeoff } = Typed::try_parse_from(typed).unwrap();
        let words: Vec<_> = chosen.split_whitespace().collect();
        assert_eq!(
            tradeoff.convert_command(),
            format!("octavo convert in.raw {}", words.join(" "))
        );
    }

    #[test]
    fn words_are_quoted_where_a_shell_would_split_or_expand_them() {
        assert_eq!(quoted("a/b-c_1.nii.gz"), "a/b-c_1.nii.gz");
        assert_eq!(quoted("my scan.nii"), "'my scan.nii'");
        assert_eq!(quoted("it's *.tif"), r"'it'\''s *.tif'");
        assert_eq!(quoted(""), "''");
    }
}
