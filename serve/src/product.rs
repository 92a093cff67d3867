//! What is made of one brick: its bytes in each shape that a client can ask for.

use crate::options::Compressor;
use bytes::Bytes;
use octree_store::{
    BrickScratch, NodeKey, NodeRecord, Sample, SampleType, Store, StoreError, ValueMap,
    with_sample_type,
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
        Shape::Zarr(compressor) => {
            let plain = with_sample_type!(store.metadata().sample_type, T => {
                zarr_chunk::<T>(store, &record, scratch)?
            });
            match compressor {
                Compressor::None => plain,
                Compressor::Zstd => zstd::bulk::compress(&plain, 1)
                    .map_err(|source| StoreError::Io { path: store.path().to_owned(), source })?,
            }
        }
        Shape::Precomputed => with_sample_type!(store.metadata().sample_type, T => {
            precomputed_chunk::<T>(store, &record, scratch)?
        }),
    };
    Ok(Product { bytes: bytes.into(), record, map })
}

/// Calls `row` with each row of a brick's in-volume core and its place (y, z) in the core.
fn rows<T: Sample>(
    store: &Store,
    record: &NodeRecord,
    scratch: &mut BrickScratch,
    mut row: impl FnMut([usize; 2], &[T]),
) -> Result<(), StoreError> {
    let geometry = store.geometry();
    let mut samples = vec![T::default(); geometry.brick_samples()];
    store.decode_brick_core(record, scratch, &mut samples)?;
    let (side, overlap) = (geometry.brick_side(), geometry.overlap() as usize);
    let [nx, ny, nz] = geometry.core_region(record.key).dims_xyz().map(|n| n as usize);
    for z in 0..nz {
        for y in 0..ny {
            let from = ((z + overlap) * side + y + overlap) * side + overlap;
            row([y, z], &samples[from..from + nx]);
        }
    }
    Ok(())
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
