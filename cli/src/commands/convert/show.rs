//! What a person is told of a plan and of a finished conversion.

use crate::commands::info::{dropped_line, error_line, overlap_line};
use crate::commands::{by, human_bytes};
use indicatif::HumanDuration;
use octree_store::info_json::bits_per_voxel;
use preprocess::{Conversion, ConversionPlan, ConvertOptions, DiskSpace};
use serde::Serialize;
use std::io::{self, Write};
use std::path::Path;

/// A plan, and whether the disks have room for it.
#[derive(Serialize)]
pub(super) struct PlanJson<'a> {
    #[serde(flatten)]
    plan: &'a ConversionPlan,
    #[serde(flatten)]
    disk: DiskSpace,
}

impl<'a> PlanJson<'a> {
    pub(super) fn new(plan: &'a ConversionPlan, output: &Path, options: &ConvertOptions) -> Self {
        Self { plan, disk: plan.disk_space(output, options) }
    }
}

fn human_secs(secs: f64) -> String {
    HumanDuration(std::time::Duration::from_secs_f64(secs.max(1.0))).to_string()
}

pub(super) fn print_plan(plan: &ConversionPlan, output: &Path) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "would make   {}", output.display())?;
    writeln!(
        out,
        "volume       {} {} voxels, {}",
        by(plan.dims_xyz),
        plan.sample_type,
        human_bytes(plan.source_bytes)
    )?;
    writeln!(
        out,
        "bricks       {} of {}^3 + {} overlap, {}",
        plan.bricks, plan.brick_core, plan.brick_overlap, plan.encoding
    )?;
    for level in &plan.levels {
        writeln!(
            out,
            "level {:2}     {} voxels, {} bricks",
            level.level,
            by(level.dims_xyz),
            level.bricks
        )?;
    }
    writeln!(
        out,
        "memory       {} of the {} allowed, on {} threads",
        human_bytes(plan.predicted_memory_bytes),
        human_bytes(plan.memory_budget_bytes),
        plan.threads
    )?;
    writeln!(out, "scratch      {} at most", human_bytes(plan.scratch_bytes))?;
    writeln!(out, "store        {} at most", human_bytes(plan.output_bytes_max))?;
    writeln!(
        out,
        "time         about {}, as the machine of bench/README.md works",
        human_secs(plan.estimated_secs)
    )
}

pub(super) fn print_summary(done: &Conversion, input: &Path, output: &Path) -> io::Result<()> {
    let metadata = &done.metadata;
    let mut out = io::stdout().lock();
    let voxels: u64 = metadata.dims_xyz.iter().product();
    writeln!(out, "{} -> {}", input.display(), output.display())?;
    writeln!(
        out,
        "  {} {} voxels in {:.2} s: {:.1} million voxels a second",
        by(metadata.dims_xyz),
        metadata.sample_type,
        done.total_secs,
        voxels as f64 / done.total_secs / 1e6
    )?;
    let count =
        |f: fn(&octree_store::LevelSummary) -> u64| metadata.levels.iter().map(f).sum::<u64>();
    writeln!(
        out,
        "  {} levels, {} bricks stored, {} uniform, {} empty",
        metadata.levels.len(),
        count(|level| level.stored),
        count(|level| level.uniform),
        count(|level| level.empty)
    )?;
    writeln!(
        out,
        "  {} in the file, {:.2} bits a voxel, pyramid included",
        human_bytes(done.file_bytes),
        bits_per_voxel(metadata, done.file_bytes)
    )?;
    writeln!(out, "  {}", error_line(metadata))?;
    if let Some(overlap) = overlap_line(metadata) {
        writeln!(out, "  {overlap}")?;
    }
    if metadata.dropped_voxels > 0 {
        writeln!(out, "  {}", dropped_line(metadata))?;
    }
    if let Some(clamped) = done.clamped_voxels {
        writeln!(out, "  enlarged; {clamped} voxels clamped to the type's range")?;
    }
    if done.resumed_bricks > 0 {
        writeln!(out, "  {} bricks were there from an earlier run", done.resumed_bricks)?;
    }
    if let Some(peak) = done.peak_memory_bytes {
        writeln!(
            out,
            "  own memory {} at its peak, {} predicted",
            human_bytes(peak),
            human_bytes(done.plan.predicted_memory_bytes)
        )?;
    }
    Ok(())
}
