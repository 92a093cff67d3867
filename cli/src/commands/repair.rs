//! `octavo repair`: damaged bricks made anew from the source.

use super::against::AgainstArgs;
use super::print_json;
use super::verify::DamagedJson;
use crate::exit::Answer;
use crate::progress::Bar;
use clap::Args;
use octree_store::Store;
use preprocess::{Repair as Done, Start, repair};
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Make the damaged bricks of a store anew, from the source it was made from
///
/// Damaged payloads are put right in place. Where records or the index are damaged too, the store is written anew
/// beside itself, which takes its space once more, and replaces it at the end; other names of the old file
/// (hard links) keep the old one. Where it was not made from this
/// source, nothing is changed (exit code 2).
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    octavo repair tooth.octavo --against tooth.nii.gz --json")]
pub(super) struct Repair {
    /// The store
    store: PathBuf,
    /// The source it was made from; a raw one without flags or telling name has the store's
    /// dimensions and type
    #[arg(long, value_name = "INPUT")]
    against: PathBuf,
    /// Replace what unfinished work has left beside the store
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    how: AgainstArgs,
    /// Print JSON (schema octavo.repair/1)
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct RepairJson<'a> {
    schema: &'static str,
    /// What was made anew, and what had been wrong with it.
    repaired: Vec<DamagedJson>,
    /// What had been wrong with the first page, the index or the metadata.
    store: Option<&'a str>,
    in_place: bool,
    bricks_compared: u64,
    digest_before: &'a str,
    digest: &'a str,
}

impl Repair {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open_remains(&self.store)?;
        let source = self.how.open(&self.against, &store)?;
        let mut how = self.how.options();
        how.start = if self.force { Start::Replace } else { Start::Mend };
        let bar = Bar::new("repairing", store.geometry().bricks());
        let done = repair(&store, source, &how, &bar);
        bar.finish();
        let done = done?;
        if self.json {
            print_json(&RepairJson {
                schema: "octavo.repair/1",
                repaired: done.repaired.iter().map(DamagedJson::from).collect(),
                store: done.around.as_deref(),
                in_place: done.in_place,
                bricks_compared: done.bricks_compared,
                digest_before: &done.digest_before,
                digest: &done.digest,
            })?;
        } else {
            print(&self.store, &done)?;
        }
        Ok(Answer::Done)
    }
}

fn print(path: &Path, done: &Done) -> io::Result<()> {
    let mut out = io::stdout().lock();
    for DamagedJson { level, x, y, z, what } in done.repaired.iter().map(DamagedJson::from) {
        writeln!(out, "level {level} brick {x},{y},{z} was made anew: {what}")?;
    }
    if let Some(what) = &done.around {
        writeln!(out, "written anew: {what}")?;
    }
    let (path, count) = (path.display(), done.repaired.len());
    if count == 0 && done.around.is_none() {
        return writeln!(out, "{path}: nothing is wrong");
    }
    let how = if done.in_place {
        "in place".into()
    } else {
        format!("in a new file, {} whole bricks fit the source", done.bricks_compared)
    };
    writeln!(out, "{path}: {count} bricks repaired {how}")?;
    if done.digest == done.digest_before {
        writeln!(out, "the digest is what it was: {}", done.digest)
    } else {
        // Only another version may pack what it makes anew otherwise.
        writeln!(
            out,
            "another version packs bricks otherwise; the digest was {}",
            done.digest_before
        )?;
        writeln!(out, "and is now {}", done.digest)
    }
}
