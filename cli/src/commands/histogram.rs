//! `octavo histogram`: how often each value occurs.

use super::{print_json, write_whole};
use crate::chart;
use crate::exit::Answer;
use anyhow::bail;
use clap::Args;
use octree_store::Store;
use std::io::{self, Write};
use std::path::PathBuf;

/// Count how often values occur, at full resolution or a coarser level
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo histogram tooth.octavo\n  \
    octavo histogram tooth.octavo --bins 64 --csv > tooth.csv\n  \
    octavo histogram tooth.octavo -o tooth.svg")]
pub(super) struct Histogram {
    /// The store
    store: PathBuf,
    /// Number of bins
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65536))]
    bins: u32,
    /// Level to count
    #[arg(long, value_name = "L", default_value_t = 0)]
    level: u8,
    /// Print JSON (schema octavo.histogram/1)
    #[arg(long, group = "form")]
    json: bool,
    /// Print CSV: from, to, count
    #[arg(long, group = "form")]
    csv: bool,
    /// Draw it: .png or .svg
    #[arg(short, long, value_name = "FILE", group = "form")]
    output: Option<PathBuf>,
    /// Replace an existing file
    #[arg(long)]
    force: bool,
}

impl Histogram {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open(&self.store)?;
        if self.level > store.geometry().top_level() {
            bail!(
                "{}: it has levels 0 to {}, and level {} was asked for",
                self.store.display(),
                store.geometry().top_level(),
                self.level
            );
        }
        let kind = self.output.as_deref().map(chart::Kind::of_name).transpose()?;
        let histogram = preprocess::histogram::histogram(&store, self.level, self.bins as usize)?;
        let mut out = io::stdout().lock();
        if self.json {
            drop(out);
            print_json(&histogram)?;
        } else if self.csv {
            writeln!(out, "from,to,count")?;
            for (edges, count) in histogram.edges.windows(2).zip(&histogram.counts) {
                writeln!(out, "{},{},{count}", edges[0], edges[1])?;
            }
        } else if let (Some(path), Some(kind)) = (&self.output, kind) {
            let title = self.store.file_name().unwrap_or_default().to_string_lossy();
            let picture = chart::histogram(&histogram, &title, kind)?;
            write_whole(path, self.force, |file| file.write_all(&picture))?;
        } else {
            write!(out, "{}", chart::in_terminal(&histogram))?;
        }
        Ok(Answer::Done)
    }
}
