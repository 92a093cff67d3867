//! What a conversion will do, worked out before it does anything: levels, memory, scratch, sizes.
//!
//! Pure: it reads no file and takes no memory. `convert --plan` prints it.

use super::ConvertOptions;
use crate::error::PreprocessError;
use crate::level_window::{Layout, Slots};
use crate::source::Source;
use crate::walk::{WalkOptions, level_window_chunks, octets_in_row, stream_window_chunks};
use crate::window::{Window, WindowPlace};
use octree_store::{
    Effort, Encoding, Geometry, NodeRecord, OverlapAtRest, SampleType, StoreWriter,
    with_sample_type,
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Memory of the program itself: its data, buffers of the allocator, redb without its cache.
const BASE_BYTES: u64 = 1216 << 10;
/// What each thread takes beside buffers: its stack, and its arena of the allocator.
const THREAD_BYTES: u64 = 64 << 10;
/// Octets that are ahead of the walk for each thread: in the making, or waiting for one before them.
const AHEAD_PER_THREAD: u64 = 2;
/// Octets that wait for the writer for each thread.
const WAITING_PER_THREAD: u64 = 1;
/// Slices that a decoded source is ahead of the walk, where memory allows: a row of octets.
const SLICES_AHEAD: u64 = 64;
/// Nanoseconds of a thread for a voxel of the upscaler's, as measured for u16 (`bench/README.md`).
const TRICUBIC_NANOS: f64 = 1.5;
/// The same with detail.
const DETAIL_NANOS: f64 = 4.0;
/// Slices in a chunk of a stream.
const STREAM_CHUNK: u64 = 4;
/// Bytes of the source after which work is committed, where nothing else is said: what is done anew
/// after a kill is this, and what two commits on their way hold.
pub(super) const COMMIT_SOURCE_BYTES: u64 = 64 << 20;

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
    /// Seconds that the work would take on the machine of `bench/README.md` with so many threads, enlarging as
    /// fast as its arithmetic lets expect: other machines differ, and a packed source or a slow disk may take longer to read.
    pub estimated_secs: f64,
    /// Of the scratch, what the windows' slots take.
    #[serde(skip)]
    pub(crate) slots_bytes: u64,
    /// Octets that wait for the writer at most.
    #[serde(skip)]
    pub(crate) octets_waiting: usize,
    /// Octets that exist at once, and bytes of one's payloads at most.
    #[serde(skip)]
    pub(crate) octets: usize,
    #[serde(skip)]
    pub(crate) octet_payload_bytes: usize,
    /// Bytes of the source after which work is committed.
    #[serde(skip)]
    pub(crate) commit_source_bytes: u64,
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
        let (layouts, slots_bytes) = windows(&geometry, sample_type, options.commit_source_bytes);
        // As many threads as memory allows. More than a row has octets find work only in decoding.
        let mut threads = options.threads.max(1);
        if source.slice_files().is_none() {
            threads = threads.min(octets_in_row(&geometry, 0) as usize);
        }
        let (walk, predicted, stream_bytes) = loop {
            let divided =
                divide_memory(source, &geometry, threads as u64, &folder, &layouts, options);
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
        let payload = geometry.bricks() * coded_bytes(&geometry, options, sample_bytes);
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
            scratch_bytes: slots_bytes + stream_bytes,
            slots_bytes,
            octets_waiting: threads * WAITING_PER_THREAD as usize,
            octets: octets(&geometry, threads as u64) as usize,
            octet_payload_bytes: octet_payload_bytes(
                &geometry,
                coded_bytes(&geometry, options, sample_bytes),
            ) as usize,
            commit_source_bytes: options.commit_source_bytes,
            // redb's leaves are half full at worst; an empty redb file has about 1.5 MB.
            output_bytes_max: payload + 2 * records + (2 << 20),
            estimated_secs: geometry.dims_xyz().map(|n| n as f64).iter().product::<f64>()
                * voxel_nanos(source, options)
                / threads as f64
                * 1e-9,
            walk,
            geometry,
        })
    }
}

/// Nanoseconds of a thread for a voxel of level 0 and what becomes of it above, as measured for u16
/// (`bench/README.md`).
fn voxel_nanos(source: &Source, options: &ConvertOptions) -> f64 {
    let bricks = match (options.encoding, options.effort) {
        (Encoding::Quantised8, Effort::Fast) => 6.2,
        (Encoding::Quantised8, Effort::Balanced) => 7.4,
        (Encoding::Quantised8, Effort::Small) => 10.5,
        (Encoding::Lossless | Encoding::MaxError(_), Effort::Fast) => 9.0,
        (Encoding::Lossless | Encoding::MaxError(_), Effort::Balanced | Effort::Small) => 13.8,
    };
    let enlarged = source.upscaling().map_or(0.0, |upscale| {
        if upscale.detail().is_some() { DETAIL_NANOS } else { TRICUBIC_NANOS }
    });
    bricks + enlarged
}

/// The folder that a path lies in.
pub(crate) fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Bytes of a brick's payload at most: what compression does not make smaller is stored as it is.
fn coded_bytes(geometry: &Geometry, options: &ConvertOptions, sample_bytes: u64) -> u64 {
    let bytes = match options.encoding {
        Encoding::Quantised8 => 1,
        // A brick that the bound's codes cannot hold is lossless.
        Encoding::Lossless | Encoding::MaxError(_) => sample_bytes,
    };
    let samples = match options.overlap_at_rest {
        OverlapAtRest::Stored => geometry.brick_samples() as u64,
        OverlapAtRest::Assembled => u64::from(geometry.core()).pow(3),
    };
    samples * bytes
}

/// The windows of the levels above 0, in slots of one scratch file, and the file's size.
///
/// A window needs four slots at most. One more, and so many more as three commits fill, let work go
/// on while what a slot held is not yet needed by a commit alone. It does not depend on the budget:
/// work that was begun with one budget can be gone on with under another.
fn windows(
    geometry: &Geometry,
    sample_type: SampleType,
    commit_source_bytes: u64,
) -> (Vec<Layout>, u64) {
    let [width, height, _] = geometry.dims_xyz();
    let mut offset = 0;
    let layouts = geometry.levels().skip(1).map(|level| {
        let row_bytes =
            width * height * sample_type.bytes() as u64 * (u64::from(geometry.core()) << level);
        let spare = 1 + (3 * commit_source_bytes).div_ceil(row_bytes);
        let all = geometry.grid_at(level)[2];
        let count = (level_window_chunks(geometry, level) + spare).min(all);
        let layout = Layout::new(geometry, level, sample_type.bytes(), Slots { offset, count });
        offset += layout.bytes();
        layout
    });
    let layouts = layouts.collect();
    (layouts, offset)
}

/// Divides the budget: what must be in memory, then the window of a source that must be decoded.
/// Returns the division, the memory it takes, and the scratch of that window.
fn divide_memory(
    source: &Source,
    geometry: &Geometry,
    threads: u64,
    folder: &Path,
    layouts: &[Layout],
    options: &ConvertOptions,
) -> Result<(WalkOptions, u64, u64), PreprocessError> {
    let budget = options.memory_bytes;
    // Where what is decoded is: an enlarged source's slices are another's.
    let files = source.in_files();
    let sample_type = source.sample_type();
    let sample_bytes = sample_type.bytes() as u64;
    let brick = geometry.brick_samples() as u64 * sample_bytes;
    let coded = coded_bytes(geometry, options, sample_bytes);
    let core = u64::from(geometry.core()).pow(3) * sample_bytes;
    // What Zstandard keeps at its first level.
    let zstd = if options.effort == Effort::Small { 320 << 10 } else { 0 };
    // Lossless bricks are packed from their samples.
    let codes = if options.encoding == Encoding::Lossless { 0 } else { coded };
    // Differences and their arrangement; codes of eight bits are tried as they are.
    let filters = match (options.encoding, options.effort) {
        (_, Effort::Fast) | (Encoding::Quantised8, Effort::Balanced) => 0,
        _ => 2 * coded + coded / 8,
    };
    // Gathered samples, means, their parent's block, codes, what filters make of them, and room for
    // compression to fail in.
    let maker_bytes = 8 * brick + core / 8 + core + codes + filters + coded * 11 / 10 + zstd;
    let makers = threads.min(octets_in_row(geometry, 0));
    let octets = octets(geometry, threads) * (octet_payload_bytes(geometry, coded) + 8 * 512);
    // Rows of records that wait for their parents' bricks: two rows of octets a level.
    let [grid_x, grid_y, _] = geometry.grid_at(0);
    let pending = grid_x * grid_y * 96;
    let depth = files.dims_xyz[2];
    let decoding = match source.decode_bytes() {
        Some(bytes) if files.slice_files().is_some() => threads.min(depth) * bytes,
        bytes => bytes.unwrap_or(0),
    };
    let enlarging = source.upscaling().map_or(0, |upscale| {
        let side = 2 * u64::from(geometry.core() + geometry.overlap());
        let side = geometry.dims_xyz().into_iter().fold(0, u64::max).min(side);
        crate::upscale::thread_bytes(&upscale, sample_type, side)
    });
    // Records of one commit that is gathered, one that waits, and one that is written.
    let source_bytes = geometry.dims_xyz().iter().product::<u64>() * sample_bytes;
    let commits = (3 * options.commit_source_bytes).min(source_bytes);
    let waiting = u128::from(geometry.bricks()) * u128::from(commits) / u128::from(source_bytes);
    let waiting = waiting as u64;
    let mut memory = BASE_BYTES
        + StoreWriter::memory_bytes(geometry.bricks(), waiting)
        + threads * THREAD_BYTES
        + makers * (maker_bytes + enlarging)
        + octets
        + pending
        + decoding;
    // What allocators round up.
    memory += memory / 50;
    if memory > budget {
        return Err(PreprocessError::MemoryTooSmall { budget, needed: memory });
    }
    let mut scratch = 0;
    let mut stream_place = WindowPlace::Memory;
    let stream_chunk =
        if files.slice_files().is_some() { STREAM_CHUNK.max(threads) } else { STREAM_CHUNK };
    let all_chunks = depth.div_ceil(stream_chunk);
    let window_chunks = stream_window_chunks(source, geometry, stream_chunk);
    let ahead = source.upscaling().map_or(1, |upscale| u64::from(upscale.factor()));
    let stream_chunks_ahead = SLICES_AHEAD
        .div_ceil(ahead)
        .div_ceil(stream_chunk)
        .min(all_chunks.saturating_sub(window_chunks));
    if source.decode_bytes().is_some() {
        let chunks = window_chunks + stream_chunks_ahead;
        // Of the last chunk, memory for slices that it does not have is never touched.
        let slices = (chunks * stream_chunk).min(depth);
        let bytes = chunk_bytes(files.dims_xyz, slices, sample_type);
        if memory + bytes <= budget {
            memory += bytes;
        } else {
            scratch = chunks * chunk_bytes(files.dims_xyz, stream_chunk, sample_type);
            stream_place = WindowPlace::Unnamed(folder.to_owned());
        }
    }
    let walk = WalkOptions {
        octets_ahead: (threads * AHEAD_PER_THREAD) as usize,
        downsample: options.downsample,
        layouts: layouts.to_vec(),
        stream_place,
        stream_chunk,
        stream_window_chunks: window_chunks,
        stream_chunks_ahead,
    };
    Ok((walk, memory, scratch))
}

/// Octets that exist at once: ahead of the walk, waiting for the writer, and being written.
fn octets(geometry: &Geometry, threads: u64) -> u64 {
    let ahead = (threads * AHEAD_PER_THREAD).min(octets_in_row(geometry, 0));
    let all: u64 = geometry
        .levels()
        .map(|level| geometry.grid_at(level).iter().map(|n| n.div_ceil(2)).product::<u64>())
        .sum();
    (ahead + threads * WAITING_PER_THREAD + 1).min(all)
}

/// Bytes of an octet's payloads at most, each of so many.
fn octet_payload_bytes(geometry: &Geometry, coded: u64) -> u64 {
    let bricks: u64 = geometry.grid_at(0).iter().map(|&n| n.min(2)).product();
    bricks * coded
}

/// Bytes of a window's chunk of so many slices.
fn chunk_bytes(dims_xyz: [u64; 3], slices: u64, sample_type: SampleType) -> u64 {
    let samples = with_sample_type!(sample_type, T => Window::<T>::chunk_samples(dims_xyz, slices));
    samples * sample_type.bytes() as u64
}
