//! What encodings cost and gain, without any file or thread: `encodings NAME_XxYxZ_u16.raw [E...]`.
//!
//! The volume's bricks of level 0 are gathered first; then each choice encodes them all and decodes them
//! all, on one thread, three times, and the best time counts. Bits a voxel are payload bytes of level 0
//! over the volume's voxels: no pyramid, no records. Decoding is of cores from payloads in memory, with
//! their checksums.

use anyhow::{Context, bail};
use octree_store::encoding::{BrickFormat, EncodeScratch, encode_brick, finite_range};
use octree_store::{
    BrickScratch, Effort, Encoding, ErrorSum, Geometry, Metadata, NodeKey, NodeRecord, SampleType,
    Store, StoreWriter,
};
use std::ops::Range;
use std::path::Path;
use std::time::Instant;

const RUNS: usize = 3;

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().context("name a raw file: NAME_XxYxZ_u16.raw")?;
    let mut bounds = Vec::new();
    for bound in arguments {
        let bound = bound.parse().ok().and_then(Encoding::max_error);
        bounds.push(bound.context("the bounds are numbers of 0 or more")?);
    }
    if bounds.is_empty() {
        bounds.extend([50.0, 200.0].map(|e| Encoding::max_error(e).unwrap_or(Encoding::Lossless)));
    }
    let name = Path::new(&path).file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let dims: Vec<u64> = name
        .split('_')
        .find_map(|part| part.split('x').map(|n| n.parse().ok()).collect::<Option<Vec<u64>>>())
        .filter(|dims| dims.len() == 3)
        .context("the name says no size: NAME_XxYxZ_u16.raw")?;
    let bytes = std::fs::read(&path).with_context(|| path.clone())?;
    let voxels: Vec<u16> =
        bytes.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b)).collect();
    let geometry = Geometry::new([dims[0], dims[1], dims[2]], 32, 2)?;
    if voxels.len() as u64 != geometry.dims_xyz().iter().product::<u64>() {
        bail!("{path} has another size than its name says");
    }
    let bricks = gather(&geometry, &voxels);
    let count = voxels.len() as f64;
    println!(
        "| encoding | effort | overlap | bits a voxel | RMSE | max error | encode Mvoxel/s | decode Mvoxel/s | with overlap | overlap RMSE | overlap max | bricks by filter |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    let encodings = [Encoding::Quantised8].into_iter().chain(bounds).chain([Encoding::Lossless]);
    for encoding in encodings {
        for effort in [Effort::Fast, Effort::Balanced, Effort::Small] {
            for (overlap, cut_overlap) in [("stored", None), ("assembled", Some(2))] {
                let format = BrickFormat { encoding, effort, cut_overlap };
                let made = measure(&geometry, &bricks, format)?;
                println!(
                    "| {encoding} | {} | {overlap} | {:.2} | {:.1} | {} | {:.0} | {:.0} | {:.0} | {:.1} | {} | {} |",
                    effort.name(),
                    8.0 * made.bytes as f64 / count,
                    made.error.rms(),
                    made.error.amax,
                    count / made.encode_secs / 1e6,
                    count / made.decode_secs / 1e6,
                    count / made.whole_secs / 1e6,
                    made.overlap.rms(),
                    made.overlap.amax,
                    made.filters
                );
            }
        }
    }
    Ok(())
}

/// The samples of all bricks of level 0, and the rows of their cores.
fn gather(geometry: &Geometry, voxels: &[u16]) -> Vec<(NodeKey, Vec<u16>)> {
    let [width, height, _] = geometry.dims_xyz().map(|n| n as usize);
    let [gx, gy, gz] = geometry.grid_at(0);
    let side = geometry.brick_side() as i64;
    let keys = (0..gz).flat_map(|z| (0..gy).flat_map(move |y| (0..gx).map(move |x| [x, y, z])));
    let mut keys: Vec<_> = keys.map(|xyz| NodeKey::new(0, xyz)).collect();
    keys.sort_unstable();
    let gathered = keys.into_iter().map(|key| {
        let origin = geometry.sample_origin(key);
        let at = |axis: usize, i: i64| {
            (origin[axis] + i).clamp(0, geometry.dims_xyz()[axis] as i64 - 1) as usize
        };
        let mut samples = Vec::with_capacity(geometry.brick_samples());
        for z in 0..side {
            for y in 0..side {
                let row = (at(2, z) * height + at(1, y)) * width;
                samples.extend((0..side).map(|x| voxels[row + at(0, x)]));
            }
        }
        (key, samples)
    });
    gathered.collect()
}

/// What one choice made of the volume.
struct Made {
    bytes: usize,
    error: ErrorSum,
    encode_secs: f64,
    decode_secs: f64,
    /// Of whole bricks, overlap assembled where it is not stored.
    whole_secs: f64,
    overlap: ErrorSum,
    filters: String,
}

fn measure(
    geometry: &Geometry,
    bricks: &[(NodeKey, Vec<u16>)],
    format: BrickFormat,
) -> anyhow::Result<Made> {
    let mut scratch = EncodeScratch::default();
    let (mut records, mut payloads) = (Vec::new(), Vec::new());
    let mut encode_secs = f64::INFINITY;
    for _ in 0..RUNS {
        records.clear();
        payloads.clear();
        let started = Instant::now();
        for (key, samples) in bricks {
            let rows = core_rows(geometry, *key);
            let range = finite_range(samples);
            let record =
                encode_brick(*key, samples, format, range, rows, &mut scratch, &mut payloads);
            records.push(record);
        }
        encode_secs = encode_secs.min(started.elapsed().as_secs_f64());
    }
    let store = store_of(geometry, format, records.clone(), &payloads)?;
    let mut samples = vec![0_u16; geometry.brick_samples()];
    let mut scratch = BrickScratch::default();
    let mut decode_secs = f64::INFINITY;
    for _ in 0..RUNS {
        let started = Instant::now();
        let mut outcome = Ok(());
        store.visit_level(0, |record| {
            outcome = store.decode_brick_core(record, &mut scratch, &mut samples);
            outcome.is_ok()
        })?;
        outcome?;
        decode_secs = decode_secs.min(started.elapsed().as_secs_f64());
    }
    let started = Instant::now();
    for record in &records {
        store.decode_brick(&record_of(&store, record)?, &mut scratch, &mut samples)?;
    }
    let whole_secs = started.elapsed().as_secs_f64();
    let mut overlap = ErrorSum::default();
    for ((key, source), record) in bricks.iter().zip(&records) {
        store.decode_brick(&record_of(&store, record)?, &mut scratch, &mut samples)?;
        let mut core = vec![false; source.len()];
        for row in core_rows(geometry, *key) {
            core[row].fill(true);
        }
        for i in (0..source.len()).filter(|i| !core[*i]) {
            overlap.add(f64::from(samples[i]) - f64::from(source[i]));
        }
    }
    let mut error = ErrorSum::default();
    for record in &records {
        error.voxels += record.error.voxels;
        error.squares += record.error.squares;
        error.amax = error.amax.max(record.error.amax);
    }
    let mut filters = std::collections::BTreeMap::new();
    for record in &records {
        let NodeRecord { bits, filter, compression, .. } = record;
        *filters.entry((*bits, filter.id(), *compression as u8)).or_insert(0) += 1;
    }
    let filters: Vec<_> = filters
        .into_iter()
        .map(|((bits, filter, compression), n)| {
            format!("{n} of {bits} bits {filter}/{compression}")
        })
        .collect();
    Ok(Made {
        bytes: payloads.len(),
        error,
        encode_secs,
        decode_secs,
        whole_secs,
        overlap,
        filters: filters.join(", "),
    })
}

/// The record with its place in the store.
fn record_of(store: &Store, record: &NodeRecord) -> anyhow::Result<NodeRecord> {
    Ok(store.node(record.key)?)
}

/// A store of these bricks in a temporary file, which is in the page cache; the levels above are uniform.
fn store_of(
    geometry: &Geometry,
    format: BrickFormat,
    mut records: Vec<NodeRecord>,
    payloads: &[u8],
) -> anyhow::Result<Store> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("bench.octavo");
    let mut writer = StoreWriter::create(&path, &folder.path().join("bench.work"), Vec::new())?;
    let mut at = 0;
    for octet in records.chunk_by_mut(|a, b| a.key.parent() == b.key.parent()) {
        let length: usize = octet.iter().map(|record| record.place.length as usize).sum();
        writer.append(octet, &payloads[at..at + length], Vec::new())?;
        at += length;
    }
    let mut metadata = Metadata::new(geometry, SampleType::U16, format.encoding);
    metadata.stored_overlap = format.cut_overlap.is_none();
    writer.finish(metadata)?;
    Ok(Store::open(&path)?)
}

/// Where the rows of a brick's in-volume core are in its samples.
fn core_rows(geometry: &Geometry, key: NodeKey) -> impl Iterator<Item = Range<usize>> + Clone {
    let [nx, ny, nz] = geometry.core_region(key).dims_xyz().map(|n| n as usize);
    let (side, overlap) = (geometry.brick_side(), geometry.overlap() as usize);
    (0..ny * nz).map(move |row| {
        let start = ((row / ny + overlap) * side + row % ny + overlap) * side + overlap;
        start..start + nx
    })
}
