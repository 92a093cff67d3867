//! What is made of one brick: its bytes in each shape that a client can ask for.

use crate::blosc;
use crate::options::{Compressor, ZSTD_LEVEL};
use bytes::Bytes;
use octree_store::{
    BrickScratch, Geometry, Metadata, NodeKey, NodeRecord, Sample, SampleType, Store, StoreError,
    Upload, ValueMap, with_sample_type,
};

/// The shapes of a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Shape {
    /// Its samples, overlap included.
    Samples,
    /// Its payload as it is stored.
    Stored,
    /// Its samples as a texture takes them, overlap included.
    Codes,
    /// Its core as a chunk of a zarr array: full size, zeros outside the volume.
    Zarr(Compressor),
    /// The core's codes as a chunk of a zarr array, as [`codes_type`] has them: full size, zeros outside.
    ZarrCodes(Compressor),
    /// Its core as a chunk of precomputed: clipped at the volume's edges, unsigned.
    Precomputed,
}

impl Shape {
    /// The word that tells entity tags apart.
    pub(crate) fn tag(self) -> &'static str {
        match self {
            Self::Samples => "samples",
            Self::Stored => "stored",
            Self::Codes => "codes",
            Self::Zarr(Compressor::None) => "zarr",
            Self::Zarr(Compressor::Zstd) => "zarr-zstd",
            Self::Zarr(Compressor::BloscLz4) => "zarr-blosc",
            Self::ZarrCodes(Compressor::None) => "codes-zarr",
            Self::ZarrCodes(Compressor::Zstd) => "codes-zarr-zstd",
            Self::ZarrCodes(Compressor::BloscLz4) => "codes-zarr-blosc",
            Self::Precomputed => "precomputed",
        }
    }
}

/// A brick in one shape.
#[derive(Debug, Clone)]
pub(crate) struct Product {
    pub(crate) bytes: Bytes,
    pub(crate) record: NodeRecord,
    /// What codes mean.
    pub(crate) map: Option<ValueMap>,
}

/// Makes a brick's product. Uniform and empty bricks have real bytes; damage is an error.
pub(crate) fn make(
    store: &Store,
    key: NodeKey,
    shape: Shape,
    scratch: &mut BrickScratch,
) -> Result<Product, StoreError> {
    let record = store.node(key)?;
    let mut map = None;
    let bytes = match shape {
        Shape::Stored => store.read_payload(&record, scratch)?.to_vec(),
        Shape::Codes => {
            let upload = store.read_upload(&record, scratch)?;
            map = Some(upload.map);
            upload.bytes
        }
        Shape::Samples => with_sample_type!(store.metadata().sample_type, T => {
            let mut samples = vec![T::default(); store.geometry().brick_samples()];
            store.decode_brick(&record, scratch, &mut samples)?;
            octree_store::to_le_bytes(&samples)
        }),
        Shape::Zarr(compressor) => with_sample_type!(store.metadata().sample_type, T => {
            let chunk = zarr_chunk::<T>(store, &record, scratch)?;
            compress(store, chunk, size_of::<T>(), compressor)?
        }),
        Shape::ZarrCodes(compressor) => {
            let upload = store.read_upload_core(&record, scratch)?;
            map = Some(upload.map);
            let (chunk, code_bytes) = codes_chunk(store, key, &upload)?;
            compress(store, chunk, code_bytes, compressor)?
        }
        Shape::Precomputed => with_sample_type!(store.metadata().sample_type, T => {
            precomputed_chunk::<T>(store, &record, scratch)?
        }),
    };
    Ok(Product { bytes: bytes.into(), record, map })
}

/// The type of a store's codes, if all have one that holds them: bytes, or 16-bit words where some need more
/// than eight bits. None where bricks hold samples of more than 16 bits as they are.
pub(crate) fn codes_type(metadata: &Metadata) -> Option<SampleType> {
    let bits = metadata.levels.iter().flat_map(|level| level.bits.keys()).max();
    match bits.copied().unwrap_or(0) {
        0..=8 => Some(SampleType::U8),
        9..=16 => Some(SampleType::U16),
        _ => None,
    }
}

fn compress(
    store: &Store,
    plain: Vec<u8>,
    sample_bytes: usize,
    compressor: Compressor,
) -> Result<Vec<u8>, StoreError> {
    match compressor {
        Compressor::None => Ok(plain),
        Compressor::Zstd => zstd::bulk::compress(&plain, ZSTD_LEVEL)
            .map_err(|source| StoreError::Io { path: store.path().to_owned(), source }),
        Compressor::BloscLz4 => Ok(blosc::compress(&plain, sample_bytes)),
    }
}

/// Calls `row` with each row of a brick's in-volume core and its place (y, z) in the core.
fn rows<T: Sample>(
    store: &Store,
    record: &NodeRecord,
    scratch: &mut BrickScratch,
    row: impl FnMut([usize; 2], &[T]),
) -> Result<(), StoreError> {
    let mut samples = vec![T::default(); store.geometry().brick_samples()];
    store.decode_brick_core(record, scratch, &mut samples)?;
    core_rows(store.geometry(), record.key, &samples, row);
    Ok(())
}

/// The same of what there is one of for each sample of a brick.
fn core_rows<T>(
    geometry: &Geometry,
    key: NodeKey,
    samples: &[T],
    mut row: impl FnMut([usize; 2], &[T]),
) {
    let (side, overlap) = (geometry.brick_side(), geometry.overlap() as usize);
    let [nx, ny, nz] = geometry.core_region(key).dims_xyz().map(|n| n as usize);
    for z in 0..nz {
        for y in 0..ny {
            let from = ((z + overlap) * side + y + overlap) * side + overlap;
            row([y, z], &samples[from..from + nx]);
        }
    }
}

fn zarr_chunk<T: Sample>(
    store: &Store,
    record: &NodeRecord,
    scratch: &mut BrickScratch,
) -> Result<Vec<u8>, StoreError> {
    let core = store.geometry().core() as usize;
    let mut chunk = vec![T::default(); core.pow(3)];
    rows::<T>(store, record, scratch, |[y, z], row| {
        chunk[(z * core + y) * core..][..row.len()].copy_from_slice(row);
    })?;
    Ok(octree_store::to_le_bytes(&chunk))
}

/// A chunk of codes and the bytes of each.
fn codes_chunk(
    store: &Store,
    key: NodeKey,
    upload: &Upload,
) -> Result<(Vec<u8>, usize), StoreError> {
    let (core, from) = (store.geometry().core() as usize, upload.map.format.bytes());
    let to = codes_type(store.metadata()).map_or(0, SampleType::bytes);
    if from > to {
        let what = format!("{key} has codes of {from} bytes, and the levels have none so wide");
        return Err(StoreError::MetadataDamaged { path: store.path().to_owned(), what });
    }
    let codes: Vec<&[u8]> = upload.bytes.chunks_exact(from).collect();
    let mut chunk = vec![0; to * core.pow(3)];
    core_rows(store.geometry(), key, &codes, |[y, z], row| {
        let at = (z * core + y) * core;
        for (code, wide) in row.iter().zip(chunk[to * at..].chunks_exact_mut(to)) {
            wide[..from].copy_from_slice(code);
        }
    });
    Ok((chunk, to))
}

fn precomputed_chunk<T: Sample>(
    store: &Store,
    record: &NodeRecord,
    scratch: &mut BrickScratch,
) -> Result<Vec<u8>, StoreError> {
    let mut samples = Vec::new();
    rows::<T>(store, record, scratch, |_, row| samples.extend_from_slice(row))?;
    if T::TYPE == SampleType::F64 {
        let narrowed: Vec<f32> = samples.iter().map(|v| v.to_f64() as f32).collect();
        return Ok(octree_store::to_le_bytes(&narrowed));
    }
    let mut bytes = octree_store::to_le_bytes(&samples);
    if precomputed_offset(T::TYPE) != 0 {
        // Subtracting the least value of a two's complement number flips its top bit.
        for sample in bytes.chunks_exact_mut(size_of::<T>()) {
            sample[size_of::<T>() - 1] ^= 0x80;
        }
    }
    Ok(bytes)
}

/// What is to be added to a precomputed sample for the source's value.
pub(crate) fn precomputed_offset(sample_type: SampleType) -> i64 {
    match sample_type {
        SampleType::I8 => i64::from(i8::MIN),
        SampleType::I16 => i64::from(i16::MIN),
        SampleType::I32 => i64::from(i32::MIN),
        _ => 0,
    }
}
