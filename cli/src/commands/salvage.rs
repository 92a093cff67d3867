//! `octavo salvage`: what is whole of a damaged store, in a new one.

use super::print_json;
use super::verify::DamagedJson;
use crate::exit::Answer;
use crate::progress::Bar;
use clap::Args;
use octree_store::{Salvaged, Store};
use preprocess::{Start, salvage};
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Copy what is whole of a damaged store into a new one, and list what is not
///
/// The new store knows which bricks are lost: to read one is an error, and pictures show the coarser level in its
/// place. 'octavo repair' can make them anew where the source is found. Exit code 1 if anything is lost, or
/// if what was saved does not give the digest that the store had.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    octavo salvage damaged.octavo -o saved.octavo --json")]
pub(super) struct Salvage {
    /// The damaged store
    store: PathBuf,
    /// The new store
    #[arg(short, long, value_name = "OUT.octavo")]
    output: PathBuf,
    /// Replace an existing output
    #[arg(long)]
    force: bool,
    /// Print JSON (schema octavo.salvage/1)
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct SalvageJson<'a> {
    schema: &'static str,
    /// Whether nothing is lost.
    ok: bool,
    bricks: u64,
    lost: Vec<DamagedJson>,
    digest: &'a str,
}

impl Salvage {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open_remains(&self.store)?;
        let bricks = store.geometry().bricks();
        let start = if self.force { Start::Replace } else { Start::Fresh };
        let bar = Bar::new("copying", bricks);
        let done = salvage(&store, &self.output, start, &bar);
        bar.finish();
        let Salvaged { metadata, lost } = done?;
        let lost: Vec<_> = lost.iter().map(DamagedJson::from).collect();
        // All records are there then, but not those that were written together.
        let strangers = lost.is_empty() && metadata.digest != store.metadata().digest;
        let ok = lost.is_empty() && !strangers;
        if self.json {
            let schema = "octavo.salvage/1";
            print_json(&SalvageJson { schema, ok, bricks, lost, digest: &metadata.digest })?;
        } else {
            print(&self.output, bricks, &lost)?;
        }
        if strangers {
            eprintln!(
                "octavo: what was saved does not give the digest that {} had: some of it is not what was written there; hold it against the source (octavo verify --against)",
                self.store.display()
            );
        }
        Ok(if ok { Answer::Done } else { Answer::No })
    }
}

fn print(path: &Path, bricks: u64, lost: &[DamagedJson]) -> io::Result<()> {
    let mut out = io::stdout().lock();
    for DamagedJson { level, x, y, z, what } in lost {
        writeln!(out, "level {level} brick {x},{y},{z} is lost: {what}")?;
    }
    let saved = bricks - lost.len() as u64;
    writeln!(out, "{}: {saved} of {bricks} bricks saved, {} lost", path.display(), lost.len())
}
