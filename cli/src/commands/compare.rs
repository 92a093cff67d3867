//! `octavo compare`: how far two volumes lie apart.

use super::{RawArgs, SeriesArgs, by, print_json};
use crate::exit::Answer;
use crate::numbers::exact;
use crate::parse;
use clap::Args;
use preprocess::compare::{Comparison, compare};
use preprocess::{Upscale, Volume};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Compare two volumes, stores or files
///
/// RMS, AMAX and PSNR of B against A, and where the worst voxel is. Exit code 1 if B is over a
/// limit that was given.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo compare tooth.nii.gz tooth.octavo\n  \
    octavo compare a.octavo b.octavo --max-amax 0 --json")]
pub(super) struct Compare {
    /// The volume to compare with
    a: PathBuf,
    /// The volume to judge
    b: PathBuf,
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
    /// Largest error allowed, in source units
    #[arg(long, value_name = "E", value_parser = parse::error_bound)]
    max_amax: Option<f64>,
    /// Least PSNR allowed, in dB
    #[arg(long, value_name = "D", value_parser = parse::error_bound)]
    min_psnr: Option<f64>,
    /// Print JSON (schema octavo.compare/1)
    #[arg(long)]
    json: bool,
}

impl Compare {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        // A raw file without flags or telling name is assumed to be as the other volume.
        let (a, b) = match (self.open(&self.a, None), self.open(&self.b, None)) {
            (Ok(a), Ok(b)) => (a, b),
            (Ok(a), Err(_)) => {
                let b = self.open(&self.b, Some(&a))?;
                (a, b)
            }
            (Err(_), Ok(b)) => (self.open(&self.a, Some(&b))?, b),
            (Err(error), Err(_)) => return Err(error),
        };
        let a = enlarged_like(a, &b)?;
        let b = enlarged_like(b, &a)?;
        let found = compare(&a, &b)?;
        if self.json {
            print_json(&found)?;
        } else {
            print(&found)?;
        }
        // Without a PSNR nothing differs, or there is no range to hold an error against.
        let no_psnr = if found.rms > 0.0 { f64::NEG_INFINITY } else { f64::INFINITY };
        let psnr = found.psnr_db.unwrap_or(no_psnr);
        let limited = self.max_amax.is_some() || self.min_psnr.is_some();
        let over = (limited && found.not_finite_different > 0)
            || self.max_amax.is_some_and(|most| found.amax > most)
            || self.min_psnr.is_some_and(|least| psnr < least);
        Ok(if over { Answer::No } else { Answer::Done })
    }

    fn open(&self, path: &Path, like: Option<&Volume>) -> anyhow::Result<Volume> {
        let is_raw = path.extension().is_some_and(|extension| extension == "raw");
        let mut options =
            if is_raw { self.raw.source_options(None) } else { self.series.source_options() };
        if let Some(other) = like.filter(|_| is_raw) {
            options.dims_xyz = options.dims_xyz.or(Some(other.dims_xyz()));
            options.sample_type = options.sample_type.or(Some(other.sample_type()));
        }
        let volume = Volume::open(path, &options)?;
        if let Volume::Source(source) = &volume {
            super::print_notes(source);
        }
        Ok(volume)
    }
}

/// A source that a store was enlarged from is compared as it was enlarged.
fn enlarged_like(volume: Volume, other: &Volume) -> anyhow::Result<Volume> {
    let (Volume::Source(source), Volume::Store { store, .. }) = (&volume, other) else {
        return Ok(volume);
    };
    let Some(upscale) = Upscale::recorded(&store.metadata().options)? else { return Ok(volume) };
    if source.dims_xyz.map(|n| n * u64::from(upscale.factor())) != other.dims_xyz() {
        return Ok(volume);
    }
    let Volume::Source(source) = volume else { return Ok(volume) };
    let path = &source.description.path;
    eprintln!("octavo: {path}: enlarged {} times, as the store was", upscale.factor());
    Ok(Volume::Source(Box::new(source.upscale(upscale)?)))
}

fn print(found: &Comparison) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{} voxels, {} of them differ", by(found.dims_xyz), found.different)?;
    if found.not_finite > 0 {
        writeln!(
            out,
            "{} voxels are no numbers in one of them; {} of these differ",
            found.not_finite, found.not_finite_different
        )?;
    }
    let psnr = found.psnr_db.map_or(String::new(), |psnr| format!(", PSNR {psnr:.2} dB"));
    writeln!(out, "RMS {}, AMAX {}{psnr}", exact(found.rms), exact(found.amax))?;
    if let (Some([x, y, z]), Some([a, b])) = (found.worst_xyz, found.worst_values) {
        writeln!(out, "worst voxel {x},{y},{z}: {} and {}", exact(a), exact(b))?;
    }
    Ok(())
}
