//! `octavo verify`: whether a store is whole, and as good as it says.

use super::{RawArgs, SeriesArgs, print_json};
use crate::exit::Answer;
use crate::numbers::exact;
use crate::parse;
use crate::progress::Bar;
use clap::Args;
use octree_store::verify::{DamagedNode, verify};
use octree_store::{Store, StoreError};
use preprocess::{
    AgainstReport, ConvertOptions, PreprocessError, Progress, Source, verify_against,
};
use serde::Serialize;
use std::io::{self, Write};
use std::path::PathBuf;

/// Check a store: every payload's checksum, every record, the tree's shape
///
/// With --against, every error is measured anew from the source and must equal the stored one.
/// Exit code 1 if anything is wrong.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo verify tooth.octavo\n  \
    octavo verify tooth.octavo --against tooth.nii.gz --json")]
pub(super) struct Verify {
    /// The store
    store: PathBuf,
    /// The source it was made from; a raw one without flags or telling name has the store's
    /// dimensions and type
    #[arg(long, value_name = "INPUT")]
    against: Option<PathBuf>,
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
    /// Threads that compare bricks [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Own memory to use at most while comparing, pages of mapped files apart
    #[arg(long, value_name = "SIZE", value_parser = parse::size, default_value = "512MiB")]
    memory: u64,
    /// Folder of scratch files [default: the system's for temporary files]
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
    /// Print JSON (schema octavo.verify/1)
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct VerifyJson {
    schema: &'static str,
    ok: bool,
    bricks_checked: u64,
    damaged: Vec<DamagedJson>,
    /// What is wrong with the store as a whole.
    store: Option<String>,
    against: Option<AgainstReport>,
}

#[derive(Serialize)]
struct DamagedJson {
    level: u8,
    x: u64,
    y: u64,
    z: u64,
    what: String,
}

impl From<&DamagedNode> for DamagedJson {
    fn from(node: &DamagedNode) -> Self {
        let [x, y, z] = node.key.brick_xyz();
        Self { level: node.key.level(), x, y, z, what: node.damage.to_string() }
    }
}

impl Verify {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = match Store::open(&self.store) {
            Ok(store) => store,
            Err(
                error @ (StoreError::Database { .. }
                | StoreError::MetadataDamaged { .. }
                | StoreError::Damaged { .. }
                | StoreError::Incomplete { .. }),
            ) => {
                return self.tell(&VerifyJson {
                    schema: "octavo.verify/1",
                    ok: false,
                    bricks_checked: 0,
                    damaged: Vec::new(),
                    store: Some(error.to_string()),
                    against: None,
                });
            }
            Err(other) => return Err(other.into()),
        };
        // The source is opened first: a wrong path should not cost the wait.
        let source = self.against.as_ref().map(|path| {
            let mut options = self.raw.source_options(Some(&self.series));
            // Of a series, the volume that the store was made from.
            let recorded = |name| store.metadata().options.get(name)?.as_u64();
            options.time = options.time.or_else(|| recorded("time"));
            options.channel = options.channel.or_else(|| recorded("channel"));
            if path.is_dir() && options.series.is_none() {
                let series = store.metadata().options.get("series");
                options.series = series.and_then(|uid| uid.as_str()).map(str::to_owned);
            }
            if path.extension().is_some_and(|extension| extension == "raw") {
                assume_store(&mut options, path, &store);
            }
            Source::open(path, &options)
        });
        let source = source.transpose()?;
        let bar = Bar::new("checking", store.geometry().bricks());
        let report = verify(&store, || {
            bar.bricks_done(1);
            !bar.should_stop()
        });
        bar.finish();
        let report = report?.ok_or(PreprocessError::Cancelled)?;
        let mut damaged: Vec<DamagedJson> = report.damaged.iter().map(DamagedJson::from).collect();
        let mut against = None;
        let mut totals_differ = None;
        if let Some(source) = source {
            let bar = Bar::new("comparing", store.geometry().bricks());
            let defaults = ConvertOptions::default();
            let how = ConvertOptions {
                threads: self.threads.map_or(defaults.threads, usize::from),
                memory_bytes: self.memory,
                scratch: self.scratch.clone(),
                ..defaults
            };
            let measured = verify_against(&store, source, &how, &bar);
            bar.finish();
            let measured = measured?;
            let known: Vec<_> = report.damaged.iter().map(|node| node.key).collect();
            let new = measured.damaged.iter().filter(|node| !known.contains(&node.key));
            damaged.extend(new.map(DamagedJson::from));
            let metadata = store.metadata();
            let level = metadata.levels.first();
            let stored = (
                level.map(|l| l.rms),
                level.map(|l| l.amax),
                metadata.dropped_rms,
                metadata.dropped_amax,
            );
            if stored
                != (
                    Some(measured.rms),
                    Some(measured.amax),
                    measured.dropped_rms,
                    measured.dropped_amax,
                )
            {
                totals_differ = Some("its total errors are not the ones measured".to_owned());
            }
            against = Some(measured);
        }
        let store_wrong = report.metadata.map(str::to_owned).or(totals_differ);
        self.tell(&VerifyJson {
            schema: "octavo.verify/1",
            ok: damaged.is_empty() && store_wrong.is_none(),
            bricks_checked: report.bricks_checked,
            damaged,
            store: store_wrong,
            against,
        })
    }

    fn tell(&self, found: &VerifyJson) -> anyhow::Result<Answer> {
        if self.json {
            print_json(found)?;
        } else {
            self.print(found)?;
        }
        Ok(if found.ok { Answer::Done } else { Answer::No })
    }

    fn print(&self, found: &VerifyJson) -> io::Result<()> {
        let mut out = io::stdout().lock();
        for DamagedJson { level, x, y, z, what } in &found.damaged {
            writeln!(out, "level {level} brick {x},{y},{z} is damaged: {what}")?;
        }
        if let Some(what) = &found.store {
            writeln!(out, "{what}")?;
        }
        if let Some(against) = &found.against {
            let [rms, amax] = [against.rms, against.amax].map(exact);
            writeln!(out, "measured anew: RMS {rms}, AMAX {amax}")?;
            if let Some(overlap) = &against.overlap {
                writeln!(
                    out,
                    "assembled overlap: RMS {}, AMAX {}; from overlap in a brick's own codes: RMS {}, AMAX {}",
                    exact(overlap.rms),
                    exact(overlap.amax),
                    exact(overlap.extra_rms),
                    exact(overlap.extra_amax)
                )?;
            }
        }
        let (path, checked) = (self.store.display(), found.bricks_checked);
        if found.ok {
            writeln!(out, "{path}: {checked} bricks checked, nothing is wrong")
        } else {
            let damaged = found.damaged.len();
            writeln!(out, "{path}: NOT WHOLE: {checked} bricks checked, {damaged} damaged")
        }
    }
}

/// A raw file that says nothing of itself is assumed to be what the store was made from.
fn assume_store(options: &mut preprocess::SourceOptions, path: &std::path::Path, store: &Store) {
    let named = preprocess::source::RawName::parse(path).is_some();
    if !named {
        // It was smaller where the store was enlarged from it.
        let factor = store.metadata().options.get("upscale").and_then(serde_json::Value::as_u64);
        let factor = factor.unwrap_or(1).max(1);
        let dims_xyz = store.metadata().dims_xyz.map(|n| n / factor);
        options.dims_xyz = options.dims_xyz.or(Some(dims_xyz));
        options.sample_type = options.sample_type.or(Some(store.metadata().sample_type));
    }
}
