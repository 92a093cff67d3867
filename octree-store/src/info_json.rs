//! The JSON of `info` and of conversion reports: schema `octavo.info/1`.

use crate::encoding::Encoding;
use crate::metadata::{LevelSummary, Metadata, SourceDescription};
use crate::sample::SampleType;
use serde::Serialize;
use serde_json::{Map, Number, Value};

/// All that the metadata says, with its totals.
#[derive(Debug, Serialize)]
pub struct InfoJson<'a> {
    schema: &'static str,
    format_version: u32,
    complete: bool,
    digest: &'a str,
    dims_xyz: [u64; 3],
    spacing_xyz: [f64; 3],
    unit: &'static str,
    affine: Option<[[f64; 4]; 4]>,
    sample_type: SampleType,
    encoding: Encoding,
    brick_core: u32,
    brick_overlap: u32,
    stored_overlap: bool,
    downsample: Value,
    empty_below: Option<f64>,
    empty_value: Value,
    value_min: Value,
    value_max: Value,
    value_mean: Option<f64>,
    nan_count: u64,
    inf_count: u64,
    rms: f64,
    amax: f64,
    psnr_db: Option<f64>,
    overlap_amax_bound: f64,
    overlap_extra_amax_bound: f64,
    dropped_voxels: u64,
    dropped_rms: f64,
    dropped_amax: f64,
    dropped_energy: f64,
    dropped_min: Value,
    dropped_max: Value,
    bits_per_voxel: f64,
    levels: &'a [LevelSummary],
    payload_bytes: u64,
    file_bytes: u64,
    source: &'a SourceDescription,
    created_by: &'a str,
    created_unix_secs: u64,
    options: Map<String, Value>,
}

impl<'a> InfoJson<'a> {
    /// What is to be said of a store of this version of the format, in a file of so many bytes.
    pub fn new(metadata: &'a Metadata, format_version: u32, file_bytes: u64) -> Self {
        let first = metadata.levels.first();
        let value = |v: Option<f64>| v.map_or(Value::Null, |v| number(v, metadata.sample_type));
        Self {
            schema: "octavo.info/1",
            format_version,
            complete: metadata.complete,
            digest: &metadata.digest,
            dims_xyz: metadata.dims_xyz,
            spacing_xyz: metadata.spacing_xyz,
            unit: metadata.unit.name(),
            affine: metadata.affine,
            sample_type: metadata.sample_type,
            encoding: metadata.encoding,
            brick_core: metadata.brick_core,
            brick_overlap: metadata.brick_overlap,
            stored_overlap: metadata.stored_overlap,
            downsample: serde_json::to_value(metadata.downsample).unwrap_or(Value::Null),
            empty_below: metadata.empty_below,
            empty_value: number(metadata.empty_value, metadata.sample_type),
            value_min: value(metadata.value_min),
            value_max: value(metadata.value_max),
            value_mean: metadata.value_mean,
            nan_count: metadata.nan_count,
            inf_count: metadata.inf_count,
            rms: first.map_or(0.0, |level| level.rms),
            amax: first.map_or(0.0, |level| level.amax),
            psnr_db: metadata.psnr_db(),
            overlap_amax_bound: first.map_or(0.0, |level| level.overlap_amax_bound),
            overlap_extra_amax_bound: first.map_or(0.0, |level| level.overlap_extra_amax_bound),
            dropped_voxels: metadata.dropped_voxels,
            dropped_rms: metadata.dropped_rms,
            dropped_amax: metadata.dropped_amax,
            dropped_energy: metadata.dropped_energy,
            dropped_min: value(metadata.dropped_min),
            dropped_max: value(metadata.dropped_max),
            bits_per_voxel: bits_per_voxel(metadata, file_bytes),
            levels: &metadata.levels,
            payload_bytes: metadata.payload_bytes,
            file_bytes,
            source: &metadata.source,
            created_by: &metadata.created_by,
            created_unix_secs: metadata.created_unix_secs,
            options: metadata.options.clone().into_iter().collect(),
        }
    }
}

/// Bits of the file for each voxel of level 0: the whole pyramid is in it.
pub fn bits_per_voxel(metadata: &Metadata, file_bytes: u64) -> f64 {
    8.0 * file_bytes as f64 / metadata.dims_xyz.iter().map(|&n| n as f64).product::<f64>()
}

/// A value of a sample type: integers without a decimal point.
pub fn number(value: f64, sample_type: SampleType) -> Value {
    if sample_type.is_integer() && value.fract() == 0.0 && value.abs() < 9e15 {
        Value::from(value as i64)
    } else {
        Number::from_f64(value).map_or(Value::Null, Value::Number)
    }
}
