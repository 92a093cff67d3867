//! Volumes made up for a test, and their conversion.

use octree_store::{DownsampleFilter, Encoding, Geometry, NodeKey, Sample, Store};
use preprocess::{Conversion, ConvertOptions, NoProgress, Source, SourceOptions, convert};
use std::path::PathBuf;
use tempfile::TempDir;

/// A volume in memory, its raw file, and the store made of it.
pub(crate) struct Converted<T> {
    pub(crate) folder: TempDir,
    pub(crate) raw: PathBuf,
    pub(crate) voxels: Vec<T>,
    pub(crate) dims: [u64; 3],
    pub(crate) store: Store,
    pub(crate) conversion: Conversion,
}

/// Small bricks, so that small volumes have many.
pub(crate) fn small_bricks(encoding: Encoding) -> ConvertOptions {
    ConvertOptions { brick_core: 8, brick_overlap: 2, encoding, ..ConvertOptions::default() }
}

/// Pseudo-random bits of a place: the splitmix64 finaliser.
pub(crate) fn bits(seed: u64, [x, y, z]: [u64; 3]) -> u64 {
    let mut h = seed ^ x.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y << 21) ^ (z << 42);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ (h >> 31)
}

/// A volume with structure and noise: what scanners give, not what compressors like.
pub(crate) fn scan<T: Sample>(dims: [u64; 3], seed: u64) -> Vec<T> {
    let (least, greatest) = T::TYPE.limits();
    let (least, greatest) = (least.max(-30_000.0), greatest.min(30_000.0));
    voxels(dims, |at| {
        let [x, y, z] = at.map(|v| v as f64);
        let wave = ((x / 5.0).sin() + (y / 7.0).cos() + (z / 3.0).sin()) / 6.0 + 0.5;
        let noise = (bits(seed, at) >> 40) as f64 / (1_u64 << 24) as f64;
        T::from_f64(least + (0.8 * wave + 0.2 * noise) * (greatest - least))
    })
}

/// The voxels of a formula, x fastest.
pub(crate) fn voxels<T>(dims: [u64; 3], value: impl Fn([u64; 3]) -> T) -> Vec<T> {
    let [nx, ny, nz] = dims;
    let mut voxels = Vec::with_capacity((nx * ny * nz) as usize);
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                voxels.push(value([x, y, z]));
            }
        }
    }
    voxels
}

/// The index of a voxel, x fastest.
pub(crate) fn index(dims: [u64; 3], [x, y, z]: [u64; 3]) -> usize {
    ((z * dims[1] + y) * dims[0] + x) as usize
}

/// Converts voxels by way of a raw file.
pub(crate) fn converted<T: Sample>(
    dims: [u64; 3],
    voxels: Vec<T>,
    options: &ConvertOptions,
) -> Converted<T> {
    let folder = tempfile::tempdir().unwrap();
    let [x, y, z] = dims;
    let raw = folder.path().join(format!("a_{x}x{y}x{z}_{}.raw", T::TYPE));
    std::fs::write(&raw, octree_store::to_le_bytes(&voxels)).unwrap();
    let source = Source::open(&raw, &SourceOptions::default()).unwrap();
    let path = folder.path().join("a.octavo");
    let conversion = convert(&source, &path, options, &NoProgress).unwrap();
    let store = Store::open(&path).unwrap();
    Converted { folder, raw, voxels, dims, store, conversion }
}

/// All keys of a store's levels.
pub(crate) fn keys(geometry: &Geometry) -> Vec<NodeKey> {
    let mut keys = Vec::new();
    for level in geometry.levels() {
        let grid = geometry.grid_at(level);
        keys.extend(voxels(grid, |at| NodeKey::new(level, at)));
    }
    keys
}

/// The pyramid of means.
pub(crate) fn pyramid<T: Sample>(dims: [u64; 3], level0: &[T], levels: u8) -> Vec<Vec<T>> {
    pyramid_of(DownsampleFilter::Mean, dims, level0, levels)
}

/// The pyramid by its definition: each cell made of the 2x2x2 cells that exist below.
pub(crate) fn pyramid_of<T: Sample>(
    filter: DownsampleFilter,
    dims: [u64; 3],
    level0: &[T],
    levels: u8,
) -> Vec<Vec<T>> {
    let mut pyramid = vec![level0.to_vec()];
    let mut below_dims = dims;
    for _ in 1..levels {
        let below = pyramid.last().unwrap();
        let dims = below_dims.map(|n| n.div_ceil(2));
        let level = voxels(dims, |[x, y, z]| {
            let mut cells = Vec::new();
            for dz in 0..2 {
                for dy in 0..2 {
                    for dx in 0..2 {
                        let at = [2 * x + dx, 2 * y + dy, 2 * z + dz];
                        if (0..3).all(|axis| at[axis] < below_dims[axis]) {
                            cells.push(below[index(below_dims, at)]);
                        }
                    }
                }
            }
            cell_of(filter, &cells)
        });
        pyramid.push(level);
        below_dims = dims;
    }
    pyramid
}

/// What a filter makes of cells of which some are finite or all are the same.
fn cell_of<T: Sample>(filter: DownsampleFilter, cells: &[T]) -> T {
    let finite: Vec<T> = cells.iter().copied().filter(|v| v.is_finite()).collect();
    let of = if finite.is_empty() { cells } else { &finite };
    let by_value = |a: &&T, b: &&T| a.to_f64().total_cmp(&b.to_f64());
    match filter {
        // Integers to the nearest, ties to the even side: eight integers of 32 bits and their mean
        // are exact in f64.
        DownsampleFilter::Mean => {
            T::from_f64(of.iter().map(|v| v.to_f64()).sum::<f64>() / of.len() as f64)
        }
        DownsampleFilter::Max => *of.iter().max_by(by_value).unwrap(),
        DownsampleFilter::Min => *of.iter().min_by(by_value).unwrap(),
        DownsampleFilter::Mode => {
            let count = |v: &T| of.iter().filter(|other| *other == v).count();
            let most = of.iter().map(count).max().unwrap_or(0);
            *of.iter().filter(|v| count(v) == most).min_by(by_value).unwrap()
        }
        DownsampleFilter::Nearest => cells[0],
    }
}

/// Sizes at which things go wrong: one voxel, one slice, one row, one over and one under a brick.
pub(crate) const AWKWARD_DIMS: [[u64; 3]; 12] = [
    [1, 1, 1],
    [1, 9, 17],
    [17, 1, 9],
    [9, 17, 1],
    [1, 1, 33],
    [7, 8, 9],
    [8, 8, 8],
    [15, 16, 17],
    [31, 32, 33],
    [33, 31, 32],
    [40, 3, 25],
    [64, 16, 8],
];
