//! The commands, one file each: arguments, and what is done with them.

mod against;
mod brick;
mod compare;
mod completions;
mod convert;
mod enlarge;
mod extract;
mod histogram;
mod info;
mod man;
mod preview;
mod render;
mod render_check;
mod repair;
mod salvage;
mod serve;
mod slice;
mod tradeoff;
mod upscale;
mod verify;
mod view;

use crate::exit::Answer;
use crate::parse;
use clap::{Args, Parser, Subcommand};
use octree_store::SampleType;
use preprocess::{PreprocessError, SourceOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Volumes as octrees of small compressed bricks: convert, inspect, verify, extract.
///
/// Axis order is x,y,z everywhere, x fastest. Exit codes: 0 done; 1 the command worked and the
/// answer is no; 2 wrong usage or unusable input; 3 the environment failed.
#[derive(Debug, Parser)]
#[command(name = "octavo", version, about, long_about, arg_required_else_help = true)]
pub(crate) struct Octavo {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Convert(convert::Convert),
    Info(info::Info),
    Verify(verify::Verify),
    Repair(repair::Repair),
    Salvage(salvage::Salvage),
    Histogram(histogram::Histogram),
    Slice(slice::Slice),
    Preview(preview::Preview),
    Extract(extract::Extract),
    Brick(brick::Brick),
    Compare(compare::Compare),
    Render(render::Render),
    RenderCheck(render_check::RenderCheck),
    View(view::View),
    Tradeoff(tradeoff::Tradeoff),
    Upscale(upscale::Upscale),
    Serve(serve::Serve),
    Completions(completions::Completions),
    Man(man::Man),
}

impl Octavo {
    /// Does what the arguments say.
    pub(crate) fn run(self) -> anyhow::Result<Answer> {
        match self.command {
            Command::Convert(command) => command.run(),
            Command::Info(command) => command.run(),
            Command::Verify(command) => command.run(),
            Command::Repair(command) => command.run(),
            Command::Salvage(command) => command.run(),
            Command::Histogram(command) => command.run(),
            Command::Slice(command) => command.run(),
            Command::Preview(command) => command.run(),
            Command::Extract(command) => command.run(),
            Command::Brick(command) => command.run(),
            Command::Compare(command) => command.run(),
            Command::Render(command) => command.run(),
            Command::RenderCheck(command) => command.run(),
            Command::View(command) => command.run(),
            Command::Tradeoff(command) => command.run(),
            Command::Upscale(command) => command.run(),
            Command::Serve(command) => command.run(),
            Command::Completions(command) => command.run(),
            Command::Man(command) => command.run(),
        }
    }
}

/// What a raw file does not say itself.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Raw files")]
struct RawArgs {
    /// Voxels along x, y and z
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::triple)]
    dims: Option<[u64; 3]>,
    /// Type of the samples: u8, i8, u16, i16, u32, i32, f32 or f64
    #[arg(long, value_name = "TYPE")]
    dtype: Option<SampleType>,
    /// The most significant byte comes first
    #[arg(long)]
    big_endian: bool,
    /// Bytes before the first voxel
    #[arg(long, value_name = "BYTES")]
    skip: Option<u64>,
}

/// Which 3-D volume of a series.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Series of volumes")]
struct SeriesArgs {
    /// Channel, from 0
    #[arg(long, value_name = "N")]
    channel: Option<u64>,
    /// Time, from 0
    #[arg(long, value_name = "N")]
    time: Option<u64>,
    /// Series of a DICOM folder, by its UID
    #[arg(long, value_name = "UID")]
    series: Option<String>,
    /// Take slices as they are where numbers or positions are missing or uneven
    #[arg(long)]
    allow_gaps: bool,
}

impl SeriesArgs {
    fn source_options(&self) -> SourceOptions {
        SourceOptions {
            time: self.time,
            channel: self.channel,
            series: self.series.clone(),
            allow_gaps: self.allow_gaps,
            ..SourceOptions::default()
        }
    }
}

/// Says what the user should know of a source.
fn print_notes(source: &preprocess::Source) {
    for note in &source.notes {
        eprintln!("octavo: {}: {note}", source.description.path);
    }
}

impl RawArgs {
    fn source_options(&self, series: Option<&SeriesArgs>) -> SourceOptions {
        SourceOptions {
            dims_xyz: self.dims,
            sample_type: self.dtype,
            big_endian: self.big_endian,
            skip: self.skip,
            time: series.and_then(|series| series.time),
            channel: series.and_then(|series| series.channel),
            series: series.and_then(|series| series.series.clone()),
            allow_gaps: series.is_some_and(|series| series.allow_gaps),
        }
    }
}

/// Prints JSON on one line.
fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    serde_json::to_writer(&mut out, value).map_err(io::Error::from)?;
    writeln!(out)?;
    Ok(())
}

/// Writes a file that appears when it is whole.
fn write_whole(
    path: &Path,
    force: bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> anyhow::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    if path.exists() && !(path.is_file() && force) {
        let path = path.to_owned();
        return Err(PreprocessError::Exists { path }.into());
    }
    let save = || {
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        let file = tempfile::Builder::new()
            .prefix(".octavo-")
            .permissions(std::fs::Permissions::from_mode(0o666))
            .tempfile_in(folder)?;
        let mut buffered = io::BufWriter::new(file);
        write(&mut buffered)?;
        let file = buffered.into_inner().map_err(io::IntoInnerError::into_error)?;
        preprocess::export::persist(file, path)
    };
    save().map_err(|source| PreprocessError::Output { path: path.to_owned(), source }.into())
}

/// Bytes as people read them.
fn human_bytes(bytes: u64) -> String {
    indicatif::HumanBytes(bytes).to_string()
}

/// `103 x 94 x 161`.
fn by(dims_xyz: [u64; 3]) -> String {
    dims_xyz.map(|n| n.to_string()).join(" x ")
}
