//! Zarr itself, whatever an array holds: its document in both formats, and how paths are read.

use crate::options::{Compressor, ZSTD_LEVEL};
use octree_store::{Geometry, SampleType};
use serde_json::{Value, json};

/// What an array is. Lists begin with the slowest dimension; samples lie in C order.
#[derive(Debug)]
pub(super) struct ZarrArray {
    pub(super) shape: Vec<u64>,
    pub(super) chunks: Vec<u64>,
    pub(super) sample_type: SampleType,
    pub(super) compressor: Compressor,
    pub(super) dimension_names: Vec<&'static str>,
}

impl ZarrArray {
    /// The `.zarray` of format 2, or the `zarr.json` of format 3.
    pub(super) fn document(self, zarr_format: u8) -> Value {
        let Self { shape, chunks, sample_type, compressor, dimension_names } = self;
        let fill_value = if sample_type.is_integer() { json!(0) } else { json!(0.0) };
        if zarr_format == 2 {
            return json!({
                "zarr_format": 2,
                "shape": shape,
                "chunks": chunks,
                "dtype": v2_type(sample_type),
                "compressor": v2_compressor(compressor, sample_type),
                "fill_value": fill_value,
                "order": "C",
                "filters": null,
                "dimension_separator": "/",
            });
        }
        let mut codecs = vec![json!({"name": "bytes", "configuration": {"endian": "little"}})];
        codecs.extend(v3_codec(compressor, sample_type));
        json!({
            "zarr_format": 3,
            "node_type": "array",
            "shape": shape,
            "data_type": long_type(sample_type),
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunks}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
            "fill_value": fill_value,
            "codecs": codecs,
            "dimension_names": dimension_names,
            "attributes": {},
        })
    }
}

/// Blosc's level says how hard it was tried; who reads does not need it.
const BLOSC_LEVEL: u8 = 5;

fn v2_compressor(compressor: Compressor, sample_type: SampleType) -> Value {
    match compressor {
        Compressor::None => Value::Null,
        Compressor::Zstd => json!({"id": "zstd", "level": ZSTD_LEVEL}),
        Compressor::BloscLz4 => json!({
            "id": "blosc",
            "cname": "lz4",
            "clevel": BLOSC_LEVEL,
            "shuffle": u8::from(sample_type.bytes() > 1),
            "blocksize": 0,
        }),
    }
}

fn v3_codec(compressor: Compressor, sample_type: SampleType) -> Option<Value> {
    match compressor {
        Compressor::None => None,
        Compressor::Zstd => {
            Some(json!({"name": "zstd", "configuration": {"level": ZSTD_LEVEL, "checksum": false}}))
        }
        Compressor::BloscLz4 => Some(json!({"name": "blosc", "configuration": {
            "cname": "lz4",
            "clevel": BLOSC_LEVEL,
            "shuffle": if sample_type.bytes() > 1 { "shuffle" } else { "noshuffle" },
            "typesize": sample_type.bytes(),
            "blocksize": 0,
        }})),
    }
}

/// The level that a path begins with, if the volume has it, and the rest.
pub(super) fn level_of<'a>(path: &'a str, geometry: &Geometry) -> Option<(u8, &'a str)> {
    let (level, rest) = path.split_once('/')?;
    let level = u8::try_from(number(level)?).ok().filter(|l| geometry.levels().contains(l))?;
    Some((level, rest))
}

/// The numbers of a chunk's path, as many as there are to be.
pub(super) fn numbers<const N: usize>(path: &str) -> Option<[u64; N]> {
    let numbers: Option<Vec<u64>> = path.split('/').map(number).collect();
    numbers?.try_into().ok()
}

/// A place, if it lies in the grid.
pub(super) fn within(place: [u64; 3], grid: [u64; 3]) -> Option<[u64; 3]> {
    place.iter().zip(&grid).all(|(at, count)| at < count).then_some(place)
}

/// A whole number as zarr writes it: no sign, no leading zero.
fn number(text: &str) -> Option<u64> {
    let plain = text.bytes().all(|byte| byte.is_ascii_digit());
    let canonical = plain && (text == "0" || !text.starts_with('0'));
    if canonical { text.parse().ok() } else { None }
}

fn v2_type(sample_type: SampleType) -> &'static str {
    match sample_type {
        SampleType::U8 => "|u1",
        SampleType::I8 => "|i1",
        SampleType::U16 => "<u2",
        SampleType::I16 => "<i2",
        SampleType::U32 => "<u4",
        SampleType::I32 => "<i4",
        SampleType::F32 => "<f4",
        SampleType::F64 => "<f8",
    }
}

/// The type's name in Zarr v3, and in precomputed.
pub(super) fn long_type(sample_type: SampleType) -> &'static str {
    match sample_type {
        SampleType::U8 => "uint8",
        SampleType::I8 => "int8",
        SampleType::U16 => "uint16",
        SampleType::I16 => "int16",
        SampleType::U32 => "uint32",
        SampleType::I32 => "int32",
        SampleType::F32 => "float32",
        SampleType::F64 => "float64",
    }
}
