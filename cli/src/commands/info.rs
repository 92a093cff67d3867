//! `octavo info`: what a store holds, and how good it is.

use super::{by, human_bytes, print_json};
use crate::exit::Answer;
use crate::numbers::{exact, rounded};
use clap::Args;
use octree_store::info_json::{InfoJson, bits_per_voxel};
use octree_store::{Metadata, Store};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::PathBuf;

/// Show what a store holds and how good it is
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  octavo info tooth.octavo --json")]
pub(super) struct Info {
    /// The store
    store: PathBuf,
    /// Print JSON (schema octavo.info/1)
    #[arg(long)]
    json: bool,
}

impl Info {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open(&self.store)?;
        let file_bytes = std::fs::metadata(&self.store)?.len();
        if self.json {
            print_json(&InfoJson::new(store.metadata(), store.format_version(), file_bytes))?;
        } else {
            print(store.metadata(), file_bytes)?;
        }
        Ok(Answer::Done)
    }
}

/// The errors of level 0 in words.
pub(super) fn error_line(metadata: &Metadata) -> String {
    let Some(level) = metadata.levels.first() else { return String::new() };
    let errors = format!("RMS {}, AMAX {}", rounded(level.rms, 4), exact(level.amax));
    match metadata.psnr_db() {
        Some(psnr) => format!("{errors}, PSNR {psnr:.1} dB at full resolution"),
        None if level.amax == 0.0 => "no error at full resolution".into(),
        None => format!("{errors} at full resolution"),
    }
}

/// What overlap that is assembled on reading is worth, in words; none where it is stored.
pub(super) fn overlap_line(metadata: &Metadata) -> Option<String> {
    let level = metadata.levels.first()?;
    (!metadata.stored_overlap && metadata.brick_overlap > 0).then(|| {
        format!(
            "assembled overlap within {} of the source, and {} of overlap in a brick's own codes",
            exact(level.overlap_amax_bound),
            exact(level.overlap_extra_amax_bound)
        )
    })
}

/// How many stored bricks have how many bits a sample, of all levels.
fn bits_line(metadata: &Metadata) -> String {
    let mut bricks = BTreeMap::new();
    for (bits, count) in metadata.levels.iter().flat_map(|level| &level.bits) {
        *bricks.entry(*bits).or_insert(0_u64) += count;
    }
    let each: Vec<_> =
        bricks.iter().map(|(bits, count)| format!("{bits}: {count} bricks")).collect();
    if each.is_empty() { "no brick has a payload".into() } else { each.join(", ") }
}

/// What was dropped, in words.
pub(super) fn dropped_line(metadata: &Metadata) -> String {
    let Metadata { dropped_voxels, empty_value, dropped_rms, dropped_amax, .. } = metadata;
    let range = metadata.dropped_min.zip(metadata.dropped_max);
    let range = range
        .map_or_else(String::new, |(min, max)| format!(" of {} to {}", exact(min), exact(max)));
    format!(
        "{dropped_voxels} voxels{range} in dropped bricks read as {}: RMS {}, AMAX {}, energy {:.4e} there",
        exact(*empty_value),
        rounded(*dropped_rms, 4),
        exact(*dropped_amax),
        metadata.dropped_energy
    )
}

fn print(metadata: &Metadata, file_bytes: u64) -> io::Result<()> {
    let mut out = io::stdout().lock();
    let [sx, sy, sz] = metadata.spacing_xyz;
    writeln!(out, "source       {}", metadata.source.path)?;
    writeln!(out, "volume       {} {} voxels", by(metadata.dims_xyz), metadata.sample_type)?;
    writeln!(out, "spacing      {sx} x {sy} x {sz} {}", metadata.unit.name())?;
    writeln!(out, "affine       {}", if metadata.affine.is_some() { "kept" } else { "none" })?;
    if let (Some(min), Some(max)) = (metadata.value_min, metadata.value_max) {
        let mean = metadata
            .value_mean
            .map_or(String::new(), |mean| format!(", mean {}", rounded(mean, 4)));
        writeln!(out, "values       {} to {}{mean}", exact(min), exact(max))?;
    }
    if metadata.nan_count + metadata.inf_count > 0 {
        writeln!(out, "no numbers   {} NaN, {} infinite", metadata.nan_count, metadata.inf_count)?;
    }
    writeln!(
        out,
        "bricks       {}^3 + {} overlap{}, {}",
        metadata.brick_core,
        metadata.brick_overlap,
        if metadata.stored_overlap { "" } else { " assembled on reading" },
        metadata.encoding
    )?;
    writeln!(out, "bits         {}", bits_line(metadata))?;
    writeln!(
        out,
        "size         {} in the file, {:.2} bits a voxel, {} of payload",
        human_bytes(file_bytes),
        bits_per_voxel(metadata, file_bytes),
        human_bytes(metadata.payload_bytes)
    )?;
    writeln!(out, "error        {}", error_line(metadata))?;
    if let Some(overlap) = overlap_line(metadata) {
        writeln!(out, "overlap      {overlap}")?;
    }
    if metadata.dropped_voxels > 0 {
        writeln!(out, "dropped      {}", dropped_line(metadata))?;
    }
    let lost: u64 = metadata.levels.iter().map(|level| level.lost).sum();
    if lost > 0 {
        writeln!(
            out,
            "LOST         {lost} bricks, before this store was salvaged from a damaged one"
        )?;
    }
    writeln!(out, "made by      {}", metadata.created_by)?;
    writeln!(out, "digest       {}", metadata.digest)?;
    writeln!(
        out,
        "\nlevel {:>18} {:>8} {:>8} {:>8} {:>12} {:>10} {:>10} {:>10} {:>10}",
        "voxels", "stored", "uniform", "empty", "payload", "RMS", "AMAX", "LOD RMS <", "LOD AMAX <"
    )?;
    for level in &metadata.levels {
        writeln!(
            out,
            "{:5} {:>18} {:>8} {:>8} {:>8} {:>12} {:>10} {:>10} {:>10} {:>10}",
            level.level,
            by(level.dims_xyz),
            level.stored,
            level.uniform,
            level.empty,
            human_bytes(level.payload_bytes),
            rounded(level.rms, 4),
            rounded(level.amax, 4),
            rounded(level.lod_rms_bound, 3),
            rounded(level.lod_amax_bound, 3)
        )?;
    }
    Ok(())
}
