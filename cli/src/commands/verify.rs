//! `octavo verify`: whether a store is whole, and as good as it says.

use super::against::AgainstArgs;
use super::print_json;
use crate::exit::Answer;
use crate::numbers::exact;
use crate::progress::Bar;
use clap::Args;
use octree_store::verify::{DamagedNode, verify};
use octree_store::{Store, StoreError};
use preprocess::{AgainstReport, PreprocessError, Progress, verify_against};
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
    how: AgainstArgs,
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
pub(super) struct DamagedJson {
    pub(super) level: u8,
    pub(super) x: u64,
    pub(super) y: u64,
    pub(super) z: u64,
    pub(super) what: String,
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
                | StoreError::Length { .. }
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
        let source = self.against.as_ref().map(|path| self.how.open(path, &store)).transpose()?;
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
            let how = self.how.options();
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
        let store_wrong = report.metadata.or(totals_differ);
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
