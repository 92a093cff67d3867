//! The roofline of a conversion: what this machine needs for the work that cannot be left out.
//!
//! `cargo run --release -p bench --bin roofline -- NAME_XxYxZ_u16.raw [-o OUT] [--sync]`
//!
//! A mapped u16 file; the bricks of every level (core 32, overlap 2, 2x2x2 means rounded half to
//! even), the very bricks that `octavo convert` makes; eight bits over each brick's range by
//! octree-store's own quantiser; LZ4 by the same library; one plain file, written front to back.
//! What a store has besides is left out: records, errors, deviations, checksums, keys, commits, a
//! bound on memory (levels from 1 up stay whole in memory, 1/7 of the source).
//!
//! `--lz4 tried` does to each brick what a conversion at its default does, so that `bytes_written`
//! equals `payload_bytes` of the store: that shows that the bricks are the same. `--lz4 whole`
//! compresses every brick to its end and keeps the shorter, which noise makes slower.
#![allow(unsafe_code, reason = "mapping a file is unsafe by nature: another process may change it")]

use anyhow::{Context, bail, ensure};
use clap::{Parser, ValueEnum};
use memmap2::Mmap;
use multiversion::multiversion;
use octree_store::encoding::quantised8::Quantiser;
use octree_store::encoding::{BrickFormat, EncodeScratch, encode_brick, finite_range};
use octree_store::{Effort, Encoding, Geometry, NodeKey};
use rayon::prelude::*;
use serde::Serialize;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

const CORE: usize = 32;
const OVERLAP: usize = 2;
const SIDE: usize = CORE + 2 * OVERLAP;

/// Measure how fast this machine gathers, quantises, compresses and writes a volume's bricks
#[derive(Debug, Parser)]
struct Arguments {
    /// Raw u16 volume, little-endian, x fastest
    raw: PathBuf,
    /// Voxels along x, y and z, where the name is not NAME_XxYxZ_u16.raw
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', num_args = 1)]
    dims: Vec<u64>,
    /// File for the bricks, replaced if it exists
    #[arg(short, long, default_value = "roofline.bricks")]
    output: PathBuf,
    /// Threads
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// What is compressed
    #[arg(long, value_enum, default_value_t = Lz4::Whole)]
    lz4: Lz4,
    /// Count the time until the file is on the disk
    #[arg(long)]
    sync: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Lz4 {
    /// Every brick, from first to last byte
    Whole,
    /// An eighth of each brick first, the rest where that gains, and a checksum, as a store's own
    Tried,
    /// Nothing
    None,
}

/// The line of JSON that is printed.
#[derive(Debug, Serialize)]
struct Report {
    seconds: f64,
    bricks: u64,
    bytes_read: u64,
    bytes_written: u64,
    threads: usize,
    lz4: Lz4,
    synced: bool,
    voxels_per_sec: f64,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let dims_xyz = dims_of(&arguments)?;
    let geometry = Geometry::new(dims_xyz, CORE as u32, OVERLAP as u32)?;
    let voxels: u64 = dims_xyz.iter().product();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .thread_name(|index| format!("roofline-{index}"))
        .build()?;

    let started = Instant::now();
    let source = map_file(&arguments.raw)
        .with_context(|| format!("cannot map {}", arguments.raw.display()))?;
    ensure!(
        source.len() as u64 == 2 * voxels,
        "{} has {} bytes, but {dims_xyz:?} voxels of u16 take {}",
        arguments.raw.display(),
        source.len(),
        2 * voxels
    );
    let file = File::create(&arguments.output)
        .with_context(|| format!("cannot write {}", arguments.output.display()))?;
    let output = Output { file: Mutex::new((file, 0)), lz4: arguments.lz4 };
    pool.install(|| convert(&geometry, bytemuck::cast_slice(&source), &output))?;
    let Ok((file, bytes_written)) = output.file.into_inner() else { bail!("a thread stopped") };
    if arguments.sync {
        file.sync_all()?;
    }
    let seconds = started.elapsed().as_secs_f64();

    let report = Report {
        seconds,
        bricks: geometry.bricks(),
        bytes_read: 2 * voxels,
        bytes_written,
        threads: arguments.threads,
        lz4: arguments.lz4,
        synced: arguments.sync,
        voxels_per_sec: voxels as f64 / seconds,
    };
    println!("{}", serde_json::to_string(&report)?);
    Ok(())
}

/// The dimensions that were given, or those in the name `NAME_XxYxZ_u16.raw`.
fn dims_of(arguments: &Arguments) -> anyhow::Result<[u64; 3]> {
    if let [x, y, z] = arguments.dims[..] {
        return Ok([x, y, z]);
    }
    ensure!(arguments.dims.is_empty(), "--dims takes three numbers, as in 512,512,256");
    let stem = arguments.raw.file_stem().map(|stem| stem.to_string_lossy()).unwrap_or_default();
    let dims: Option<Vec<u64>> = stem
        .strip_suffix("_u16")
        .and_then(|stem| stem.rsplit('_').next())
        .and_then(|dims| dims.split('x').map(|dim| dim.parse().ok()).collect());
    match dims.as_deref() {
        Some(&[x, y, z]) => Ok([x, y, z]),
        _ => bail!("the name {stem}.raw tells no dimensions: NAME_XxYxZ_u16.raw does, or --dims"),
    }
}

fn map_file(path: &Path) -> std::io::Result<Mmap> {
    let file = File::open(path)?;
    // SAFETY: the map is read as plain numbers, of which every value is valid. A program that
    // shortened the file meanwhile would end this one by SIGBUS; nothing else can go wrong.
    unsafe { Mmap::map(&file) }
}

/// Level after level; the next one is made while a level's bricks are at hand.
fn convert(geometry: &Geometry, source: &[u16], output: &Output) -> anyhow::Result<()> {
    let mut made: Vec<u16> = Vec::new();
    for level in geometry.levels() {
        let voxels: &[u16] = if level == 0 { source } else { &made };
        let dims = geometry.dims_at(level).map(|dim| dim as usize);
        let next = geometry.dims_at(level + 1).map(|dim| dim as usize);
        let mut coarse = Vec::new();
        if level < geometry.top_level() {
            coarse.resize(next.iter().product(), 0);
        }
        // A slab of bricks in z is one task; its means are whole slices of the next level.
        let slabs = geometry.grid_at(level)[2] as usize;
        let mut coarse_slabs: Vec<&mut [u16]> =
            coarse.chunks_mut(next[0] * next[1] * (CORE / 2)).collect();
        coarse_slabs.resize_with(slabs, Default::default);
        coarse_slabs.into_par_iter().enumerate().try_for_each(|(z, coarse)| {
            slab(geometry, level, z as u64, Volume { voxels, dims }, coarse, output)
        })?;
        made = coarse;
    }
    Ok(())
}

/// One level's voxels, x fastest.
#[derive(Clone, Copy)]
struct Volume<'a> {
    voxels: &'a [u16],
    dims: [usize; 3],
}

/// All bricks of one slab, row by row; what a row gives is written at once.
fn slab(
    geometry: &Geometry,
    level: u8,
    z: u64,
    volume: Volume,
    coarse: &mut [u16],
    output: &Output,
) -> anyhow::Result<()> {
    let [grid_x, grid_y, _] = geometry.grid_at(level);
    let next = geometry.dims_at(level + 1).map(|dim| dim as usize);
    let mut brick = vec![0; SIDE.pow(3)];
    let mut scratch = Scratch::default();
    for y in 0..grid_y {
        for x in 0..grid_x {
            let key = NodeKey::new(level, [x, y, z]);
            gather(volume, geometry.sample_origin(key), &mut brick);
            if !coarse.is_empty() {
                let core = geometry.core_region(key).dims_xyz().map(|dim| dim as usize);
                let at = (y as usize * CORE / 2) * next[0] + x as usize * CORE / 2;
                mean(&brick, core, &mut coarse[at..], next);
            }
            encode(key, &brick, output.lz4, &mut scratch);
        }
        output.write(&mut scratch.row)?;
    }
    Ok(())
}

/// Core and overlap of a brick; outside the volume the edge repeats.
fn gather(volume: Volume, origin: [i64; 3], brick: &mut [u16]) {
    let [nx, ny, nz] = volume.dims;
    let inside = |at: i64, n: usize| at.clamp(0, n as i64 - 1) as usize;
    let first = (-origin[0]).max(0) as usize;
    let last = (nx as i64 - origin[0]).min(SIDE as i64) as usize;
    let start = (origin[0] + first as i64) as usize;
    for (i, row) in brick.chunks_exact_mut(SIDE).enumerate() {
        let y = inside(origin[1] + (i % SIDE) as i64, ny);
        let z = inside(origin[2] + (i / SIDE) as i64, nz);
        let from = (z * ny + y) * nx + start;
        row[first..last].copy_from_slice(&volume.voxels[from..from + last - first]);
        let (left, right) = (row[first], row[last - 1]);
        row[..first].fill(left);
        row[last..].fill(right);
    }
}

/// The 2x2x2 means of a brick's core, into its place in the next level (`next` voxels along the axes).
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn mean(brick: &[u16], core: [usize; 3], coarse: &mut [u16], next: [usize; 3]) {
    let [nx, ny, nz] = core;
    let row =
        |y: usize, z: usize| &brick[((z + OVERLAP) * SIDE + y + OVERLAP) * SIDE + OVERLAP..][..nx];
    for z in (0..nz).step_by(2) {
        for y in (0..ny).step_by(2) {
            let out = &mut coarse[(z / 2 * next[1] + y / 2) * next[0]..][..nx.div_ceil(2)];
            // At an odd edge the last row and the last slice stand for the missing ones: the mean
            // of twice the same cells is the mean of the cells that exist.
            let (y1, z1) = ((y + 1).min(ny - 1), (z + 1).min(nz - 1));
            let rows = [row(y, z), row(y1, z), row(y, z1), row(y1, z1)];
            for (x, out) in out[..nx / 2].iter_mut().enumerate() {
                let mut sum = 0;
                for row in rows {
                    sum += u32::from(row[2 * x]) + u32::from(row[2 * x + 1]);
                }
                *out = eighth(sum);
            }
            if nx % 2 == 1 {
                let sum = rows.iter().map(|row| 2 * u32::from(row[nx - 1])).sum();
                out[nx / 2] = eighth(sum);
            }
        }
    }
}

/// An eighth, rounded half to even.
#[inline(always)]
fn eighth(sum: u32) -> u16 {
    ((sum + 3 + (sum >> 3 & 1)) >> 3) as u16
}

/// What a thread keeps from brick to brick.
#[derive(Debug, Default)]
struct Scratch {
    codes: Vec<u8>,
    /// Payloads of a row of bricks, one after the other.
    row: Vec<u8>,
    store: EncodeScratch,
}

/// Appends a brick's payload to the row. A brick of one value has none.
fn encode(key: NodeKey, brick: &[u16], lz4: Lz4, scratch: &mut Scratch) {
    let range = finite_range(brick);
    let (min, max) = range.unwrap_or_default();
    if min == max {
        return;
    }
    if let Lz4::Tried = lz4 {
        let spans = std::iter::empty();
        let how = BrickFormat::stored(Encoding::Quantised8, Effort::Balanced);
        encode_brick(key, brick, how, range, spans, &mut scratch.store, &mut scratch.row);
        return;
    }
    scratch.codes.resize(brick.len(), 0);
    Quantiser::new(min, max).quantise(brick, &mut scratch.codes);
    if let Lz4::Whole = lz4 {
        let start = scratch.row.len();
        let room = lz4_flex::block::get_maximum_output_size(brick.len());
        scratch.row.resize(start + room, 0);
        match lz4_flex::block::compress_into(&scratch.codes, &mut scratch.row[start..]) {
            Ok(length) if length < brick.len() => return scratch.row.truncate(start + length),
            _ => scratch.row.truncate(start),
        }
    }
    scratch.row.extend_from_slice(&scratch.codes);
}

/// The file that all threads append to, and how much it holds.
struct Output {
    file: Mutex<(File, u64)>,
    lz4: Lz4,
}

impl Output {
    /// Appends and empties a row of payloads.
    fn write(&self, row: &mut Vec<u8>) -> anyhow::Result<()> {
        let Ok(mut file) = self.file.lock() else { bail!("another thread stopped") };
        file.0.write_all(row)?;
        file.1 += row.len() as u64;
        row.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tie_goes_to_the_even_side() {
        assert_eq!([4, 12, 20, 28].map(eighth), [0, 2, 2, 4]);
        assert_eq!([3, 5, 11, 13, 8 * 65535].map(eighth), [0, 1, 1, 2, 65535]);
    }
}
