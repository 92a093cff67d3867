//! `octavo brick`: one brick, as a reader gets it.

use super::{print_json, write_whole};
use crate::exit::Answer;
use crate::numbers::{exact, rounded};
use crate::parse;
use clap::Args;
use octree_store::info_json::number;
use octree_store::{NodeKey, NodeRecord, Store, StoreError};
use serde_json::json;
use std::io::{self, Write};
use std::path::PathBuf;

/// Show one brick's record, or write its samples, overlap included
///
/// Exit code 1 if the volume has no such brick.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo brick tooth.octavo --level 0 --at 1,1,2 --json\n  \
    octavo brick tooth.octavo --level 0 --at 1,1,2 -o brick_36x36x36_u16.raw")]
pub(super) struct Brick {
    /// The store
    store: PathBuf,
    /// Level
    #[arg(long, value_name = "L")]
    level: u8,
    /// Brick coordinates within the level
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::triple)]
    at: [u64; 3],
    /// Print JSON (schema octavo.brick/1)
    #[arg(long)]
    json: bool,
    /// Write the decoded samples: the source's type, little-endian, x fastest
    #[arg(short, long, value_name = "FILE.raw")]
    output: Option<PathBuf>,
    /// Replace an existing file
    #[arg(long)]
    force: bool,
}

impl Brick {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open(&self.store)?;
        let in_range = self.at.iter().all(|v| v >> NodeKey::AXIS_BITS == 0);
        let key = (in_range && self.level <= store.geometry().top_level())
            .then(|| NodeKey::new(self.level, self.at));
        let record = match key.map(|key| store.node(key)) {
            Some(Err(StoreError::Absent { .. })) | None => None,
            Some(found) => Some(found?),
        };
        if let (Some(path), Some(record)) = (&self.output, &record) {
            let (_, samples) = store.read_brick_samples(record.key)?;
            write_whole(path, self.force, |file| file.write_all(&samples.to_le_bytes()))?;
        }
        let [x, y, z] = self.at;
        let level = self.level;
        match (&record, self.json) {
            (Some(record), true) => print_json(&as_json(record, &store))?,
            (None, true) => print_json(&json!({
                "schema": "octavo.brick/1", "level": level, "x": x, "y": y, "z": z, "state": "absent"
            }))?,
            (Some(record), false) => print(record)?,
            (None, false) => writeln!(io::stdout(), "level {level} brick {x},{y},{z}: absent")?,
        }
        Ok(if record.is_some() { Answer::Done } else { Answer::No })
    }
}

fn as_json(record: &NodeRecord, store: &Store) -> serde_json::Value {
    let [x, y, z] = record.key.brick_xyz();
    let value = |v| number(v, store.metadata().sample_type);
    json!({
        "schema": "octavo.brick/1",
        "level": record.key.level(), "x": x, "y": y, "z": z,
        "state": record.state.name(),
        "brick_min": value(record.brick_min),
        "brick_max": value(record.brick_max),
        "subtree_min": value(record.subtree_min),
        "subtree_max": value(record.subtree_max),
        "rms": record.error.rms(),
        "amax": record.error.amax,
        "lod_rms_bound": record.lod_rms_bound,
        "lod_amax_bound": record.lod_amax_bound,
        "bits": record.bits,
        "coding": record.coding as u8,
        "filter": record.filter.id(),
        "compression": record.compression as u8,
        "payload_offset": record.place.offset,
        "payload_bytes": record.place.length,
        "children": record.child_mask,
    })
}

fn print(record: &NodeRecord) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{}: {}", record.key, record.state.name())?;
    writeln!(out, "  values      {} to {}", exact(record.brick_min), exact(record.brick_max))?;
    writeln!(out, "  beneath it  {} to {}", exact(record.subtree_min), exact(record.subtree_max))?;
    writeln!(
        out,
        "  error       RMS {}, AMAX {}",
        rounded(record.error.rms(), 4),
        exact(record.error.amax)
    )?;
    writeln!(
        out,
        "  its level lies within RMS {}, AMAX {} of full resolution",
        rounded(record.lod_rms_bound, 4),
        rounded(record.lod_amax_bound, 4)
    )?;
    writeln!(out, "  payload     {} bytes, {} bits a sample", record.place.length, record.bits)
}
