//! What a conversion will do, worked out before it does anything: levels, memory, scratch, sizes.
//!
//! Pure: it reads no file and takes no memory. `convert --plan` prints it.

use super::ConvertOptions;
use crate::error::PreprocessError;
use crate::source::Source;
use crate::walk::{STREAM_CHUNK, WalkOptions, level_window_chunks, stream_window_chunks};
use crate::window::{Window, WindowPlace};
use octree_store::{
    Effort, Encoding, Geometry, NodeRecord, SampleType, StoreWriter, with_sample_type,
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Memory of the program itself: stacks, buffers of the allocator, redb without its cache.
const BASE_BYTES: u64 = 8 << 20;
/// Batches of octets alive at once: one in the making, one waiting, one being written.
const BATCHES: u64 = 3;
/// Octets a thread gets of one batch, where memory allows.
const OCTETS_PER_THREAD: u64 = 16;
/// Chunks that a stream is decoded ahead, where memory allows: one row of octets.
const CHUNKS_AHEAD: u64 = 16;

/// A level as it will be made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PlannedLevel {
    /// The level; 0 is full resolution.
    pub level: u8,
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// Bricks along x, y, z.
    pub grid_xyz: [u64; 3],
    /// Bricks in all.
    pub bricks: u64,
}

/// What a conversion will do.
#[derive(Debug, Clone, Serialize)]
pub struct ConversionPlan {
    /// The schema's name and version.
    pub schema: &'static str,
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// The type a reader will get.
    pub sample_type: SampleType,
    /// The encoding.
    pub encoding: Encoding,
    /// Core voxels along a brick's side.
    pub brick_core: u32,
    /// Overlap voxels on every side.
    pub brick_overlap: u32,
    /// The levels, finest first.
    pub levels: Vec<PlannedLevel>,
    /// Bricks of all levels.
    pub bricks: u64,
    /// Bytes of the source's voxels, decompressed.
    pub source_bytes: u64,
    /// Threads that make bricks.
    pub threads: usize,
    /// The budget that was given.
    pub memory_budget_bytes: u64,
    /// Own memory at its peak; pages of mapped files are not own memory.
    pub predicted_memory_bytes: u64,
    /// Space that scratch files take at most.
    pub scratch_bytes: u64,
    /// The store is at most this large: nothing compresses, nothing is uniform.
    pub output_bytes_max: u64,
    #[serde(skip)]
    pub(crate) walk: WalkOptions,
    #[serde(skip)]
    pub(crate) geometry: Geometry,
}

impl ConversionPlan {
    /// Plans the conversion of a source into a store at `output`.
    ///
    /// # Errors
    /// When the volume cannot be folded into such bricks, or the memory budget is too small.
    pub fn new(
        source: &Source,
        output: &Path,
        options: &ConvertOptions,
    ) -> Result<Self, PreprocessError> {
        let geometry = source.geometry(options.brick_core, options.brick_overlap)?;
        let sample_type = source.sample_type();
        let sample_bytes = sample_type.bytes() as u64;
        let folder = options.scratch.clone().unwrap_or_else(|| folder_of(output));
        // As many threads as memory allows.
        let mut threads = options.threads.max(1);
        let (walk, predicted, scratch) = loop {
            let divided =
                divide_memory(source, &geometry, sample_bytes, threads as u64, &folder, options);
            match divided {
                Err(PreprocessError::MemoryTooSmall { .. }) if threads > 1 => threads -= 1,
                divided => break divided?,
            }
        };
        let levels = geometry.levels().map(|level| PlannedLevel {
            level,
            dims_xyz: geometry.dims_at(level),
            grid_xyz: geometry.grid_at(level),
            bricks: geometry.bricks_at(level),
        });
        let payload = geometry.bricks() * coded_bytes(&geometry, options.encoding, sample_bytes);
        let records = geometry.bricks() * NodeRecord::BYTES as u64;
        Ok(Self {
            schema: "octavo.plan/1",
            dims_xyz: geometry.dims_xyz(),
            sample_type,
            encoding: options.encoding,
            brick_core: options.brick_core,
            brick_overlap: options.brick_overlap,
            levels: levels.collect(),
            bricks: geometry.bricks(),
            source_bytes: geometry.dims_xyz().iter().product::<u64>() * sample_bytes,
            threads,
            memory_budget_bytes: options.memory_bytes,
            predicted_memory_bytes: predicted,
            scratch_bytes: scratch,
            // Pages and tree nodes cost 1 in 50 at most; an empty redb file has about 1.5 MB.
            output_bytes_max: (payload + 2 * records) / 50 * 51 + (2 << 20),
            walk,
            geometry,
        })
    }
}

/// The folder that a path lies in.
pub(crate) fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Bytes of a brick's payload at most.
fn coded_bytes(geometry: &Geometry, encoding: Encoding, sample_bytes: u64) -> u64 {
    let bytes = match encoding {
        Encoding::Quantised8 => 1,
        Encoding::Lossless => sample_bytes,
    };
    geometry.brick_samples() as u64 * bytes
}

/// Divides the budget: what must be in memory, then the windows from the top level down, then
/// larger batches. Returns the division, the memory it takes, and the scratch it takes.
fn divide_memory(
    source: &Source,
    geometry: &Geometry,
    sample_bytes: u64,
    threads: u64,
    folder: &Path,
    options: &ConvertOptions,
) -> Result<(WalkOptions, u64, u64), PreprocessError> {
    let budget = options.memory_bytes;
    let brick = geometry.brick_samples() as u64 * sample_bytes;
    let coded = coded_bytes(geometry, options.encoding, sample_bytes);
    let core = u64::from(geometry.core()).pow(3) * sample_bytes;
    // What Zstandard keeps at its first level.
    let zstd = if options.effort == Effort::Small { 1 << 20 } else { 0 };
    // Gathered samples, means, codes, and room for compression to fail in.
    let thread_bytes = brick + core / 8 + coded + coded * 11 / 10 + (64 << 10) + zstd;
    let octet_bytes = 8 * (coded + 256) + core;
    let all_octets: u64 = geometry.levels().map(|level| octets_at(geometry, level)).sum();
    let batches = |octets: u64| (BATCHES * octets).min(all_octets) * octet_bytes;
    let store = geometry.bricks() * (coded + 2 * NodeRecord::BYTES as u64);
    // Rows of records that wait for their parents' bricks: two rows of octets a level.
    let [grid_x, grid_y, _] = geometry.grid_at(0);
    let pending = grid_x * grid_y * 96;
    let stream = source.stream_bytes().unwrap_or(0);
    let mut octets = threads;
    let mut memory = BASE_BYTES
        + StoreWriter::memory_bytes(store)
        + threads * thread_bytes
        + batches(octets)
        + pending
        + stream;
    if memory > budget {
        return Err(PreprocessError::MemoryTooSmall { budget, needed: memory });
    }
    let mut scratch = 0;
    // Windows want memory, but a larger batch wants it more than the largest window does.
    let wanted_batch = batches(threads * OCTETS_PER_THREAD) - batches(octets);
    let mut place = |bytes: u64, memory: &mut u64| {
        if *memory + bytes + wanted_batch <= budget {
            *memory += bytes;
            WindowPlace::Memory
        } else {
            scratch += bytes;
            WindowPlace::Scratch(folder.to_owned())
        }
    };
    let mut window_places: Vec<_> = geometry
        .levels()
        .skip(1)
        .rev()
        .map(|level| {
            let chunk =
                chunk_bytes(geometry.dims_at(level), geometry.core().into(), source.sample_type());
            place(level_window_chunks(geometry, level) * chunk, &mut memory)
        })
        .collect();
    window_places.reverse();
    let mut stream_place = WindowPlace::Memory;
    let mut stream_chunks_ahead = 0;
    if source.stream_bytes().is_some() {
        let chunk = chunk_bytes(geometry.dims_xyz(), STREAM_CHUNK, source.sample_type());
        let least = 1 + stream_window_chunks(geometry);
        stream_chunks_ahead = CHUNKS_AHEAD;
        stream_place = place((least + CHUNKS_AHEAD) * chunk, &mut memory);
    }
    let room = (budget - memory) / (BATCHES * octet_bytes);
    octets = (octets + room).min(threads * OCTETS_PER_THREAD);
    memory += batches(octets) - batches(threads);
    let walk = WalkOptions {
        batch_octets: octets as usize,
        downsample: options.downsample,
        window_places,
        stream_place,
        stream_chunks_ahead,
    };
    Ok((walk, memory, scratch))
}

/// Octets of a level.
fn octets_at(geometry: &Geometry, level: u8) -> u64 {
    geometry.grid_at(level).iter().map(|n| n.div_ceil(2)).product()
}

/// Bytes of a window's chunk.
fn chunk_bytes(dims_xyz: [u64; 3], slices: u64, sample_type: SampleType) -> u64 {
    let samples = with_sample_type!(sample_type, T => Window::<T>::chunk_samples(dims_xyz, slices));
    samples * sample_type.bytes() as u64
}
