//! What `--report` holds, and `--json` prints.

use octree_store::FORMAT_VERSION;
use octree_store::info_json::InfoJson;
use preprocess::Conversion;
use serde::Serialize;

/// What `info --json` gives, plus timings and memory.
#[derive(Serialize)]
pub(super) struct Report<'a> {
    #[serde(flatten)]
    info: InfoJson<'a>,
    threads: usize,
    /// What the kernels ran on: `AVX-512`, `AVX2` or `baseline`.
    instruction_set: &'static str,
    total_secs: f64,
    bricks_secs: f64,
    finish_secs: f64,
    writer_busy_secs: f64,
    voxels_per_sec: f64,
    peak_memory_bytes: Option<u64>,
    predicted_memory_bytes: u64,
    resumed_bricks: u64,
    /// Of an enlarged source.
    #[serde(skip_serializing_if = "Option::is_none")]
    clamped_voxels: Option<u64>,
}

impl<'a> Report<'a> {
    pub(super) fn of(done: &'a Conversion) -> Self {
        let voxels: u64 = done.metadata.dims_xyz.iter().product();
        Self {
            info: InfoJson::new(&done.metadata, FORMAT_VERSION, done.file_bytes),
            threads: done.plan.threads,
            instruction_set: octree_store::instruction_set(),
            total_secs: done.total_secs,
            bricks_secs: done.bricks_secs,
            finish_secs: done.finish_secs,
            writer_busy_secs: done.writer_busy_secs,
            voxels_per_sec: voxels as f64 / done.total_secs,
            peak_memory_bytes: done.peak_memory_bytes,
            predicted_memory_bytes: done.plan.predicted_memory_bytes,
            resumed_bricks: done.resumed_bricks,
            clamped_voxels: done.clamped_voxels,
        }
    }
}
