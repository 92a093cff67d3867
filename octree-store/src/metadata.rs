//! The store's one metadata record: what the volume is and how it was converted.
//!
//! In the store it is a JSON document in a frame of magic, version and checksum (FORMAT.md,
//! "Metadata"). JSON, because fields will be added and old readers must skip what they do not know.

use crate::encoding::Encoding;
use crate::geometry::{Geometry, GeometryError};
use crate::sample::SampleType;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use thiserror::Error;
use twox_hash::XxHash3_64;

/// The format version that this library writes; it reads this one and those before.
pub const FORMAT_VERSION: u32 = 1;

/// What the metadata frame begins with.
pub(crate) const MAGIC: [u8; 4] = *b"OCTV";
/// Bytes of the frame before the JSON.
pub(crate) const FRAME_BYTES: usize = 16;

/// The unit of `spacing_xyz`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LengthUnit {
    /// Metre.
    M,
    /// Millimetre; also assumed where a source names none.
    #[default]
    Mm,
    /// Micrometre.
    Um,
    /// Nanometre.
    Nm,
}

impl LengthUnit {
    /// The name used on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::M => "m",
            Self::Mm => "mm",
            Self::Um => "um",
            Self::Nm => "nm",
        }
    }
}

/// How a level is made from the one below it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DownsampleFilter {
    /// The mean of the 2x2x2 cells that exist; integers round half to even.
    #[default]
    Mean,
    /// The greatest of the finite cells that exist.
    Max,
    /// The least of the finite cells that exist.
    Min,
    /// The most frequent of the finite cells that exist, the smallest of several: for labels.
    Mode,
    /// The cell at the lowest corner.
    Nearest,
}

impl DownsampleFilter {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Mean, Self::Max, Self::Min, Self::Mode, Self::Nearest];

    /// The name used on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Max => "max",
            Self::Min => "min",
            Self::Mode => "mode",
            Self::Nearest => "nearest",
        }
    }
}

/// What is known of one level. Errors and bounds are in source units.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelSummary {
    /// The level; 0 is full resolution.
    pub level: u8,
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// Bricks along x, y, z.
    pub grid_xyz: [u64; 3],
    /// Bricks with a payload.
    pub stored: u64,
    /// Bricks of one value.
    pub uniform: u64,
    /// Bricks filtered out.
    pub empty: u64,
    /// Bricks whose data could not be saved; only a salvaged store has any.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lost: u64,
    /// Bytes of the level's payloads.
    pub payload_bytes: u64,
    /// Stored bricks by the bits that their samples have before compression.
    #[serde(default)]
    pub bits: BTreeMap<u8, u64>,
    /// Quantisation RMS over the voxels of stored and uniform bricks.
    pub rms: f64,
    /// Largest quantisation error over the same voxels.
    pub amax: f64,
    /// Bound on the RMS deviation of this level from full resolution, before quantisation.
    pub lod_rms_bound: f64,
    /// Bound on the largest such deviation.
    pub lod_amax_bound: f64,
    /// Bound on the error of a finite overlap sample, within the volume, of a brick that was kept.
    #[serde(default)]
    pub overlap_amax_bound: f64,
    /// Bound on how far such a sample, assembled from neighbours, lies from what would be read if the brick
    /// stored it in its own codes; 0 where it does.
    #[serde(default)]
    pub overlap_extra_amax_bound: f64,
}

/// Keys that say nothing are left out.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// What the store was made from.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SourceDescription {
    /// The path as it was given.
    pub path: String,
    /// Bytes of the file or files.
    pub bytes: u64,
    /// The type of the samples in the file, before any scaling.
    pub sample_type: Option<SampleType>,
}

/// What the volume is, how it was converted, and how good the result is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// Set last: whether the conversion finished.
    pub complete: bool,
    /// Hash of the content; see [`crate::digest`].
    pub digest: String,
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// Size of a voxel along x, y, z, in `unit`.
    pub spacing_xyz: [f64; 3],
    /// Unit of `spacing_xyz` and of the affine's world.
    pub unit: LengthUnit,
    /// Voxel index to world, row major, if the source had one.
    pub affine: Option<[[f64; 4]; 4]>,
    /// The type a reader gets.
    pub sample_type: SampleType,
    /// The encoding of stored bricks.
    pub encoding: Encoding,
    /// Core voxels along a brick's side.
    pub brick_core: u32,
    /// Overlap voxels on every side of the core.
    pub brick_overlap: u32,
    /// Whether payloads hold the overlap (true), or it is assembled from neighbours on reading.
    pub stored_overlap: bool,
    /// The filter between levels.
    pub downsample: DownsampleFilter,
    /// The threshold below which bricks were dropped.
    pub empty_below: Option<f64>,
    /// What an empty brick decodes to.
    pub empty_value: f64,
    /// Least finite voxel of the source; none if the source has no finite voxel.
    pub value_min: Option<f64>,
    /// Greatest finite voxel of the source.
    pub value_max: Option<f64>,
    /// Mean of the finite voxels of the source.
    pub value_mean: Option<f64>,
    /// Voxels that are NaN in the source (before a NaN value replaced them).
    pub nan_count: u64,
    /// Voxels that are infinite in the source.
    pub inf_count: u64,
    /// Level-0 voxels in bricks that were dropped.
    pub dropped_voxels: u64,
    /// RMS of (empty value - source) over them.
    pub dropped_rms: f64,
    /// Largest such error.
    pub dropped_amax: f64,
    /// Sum of the squares of such errors.
    pub dropped_energy: f64,
    /// Least finite sample of the bricks that were dropped, overlap included.
    pub dropped_min: Option<f64>,
    /// Greatest finite sample of the bricks that were dropped, overlap included.
    pub dropped_max: Option<f64>,
    /// The levels, finest first.
    pub levels: Vec<LevelSummary>,
    /// Bytes of all payloads.
    pub payload_bytes: u64,
    /// What the store was made from.
    pub source: SourceDescription,
    /// Program and version.
    pub created_by: String,
    /// Seconds since 1970-01-01 UTC when the conversion finished.
    pub created_unix_secs: u64,
    /// The options of the conversion that change its content, by name.
    pub options: BTreeMap<String, serde_json::Value>,
}

/// The frame's checksum: a version that was changed shows in it too.
fn checksum(version: u32, json: &[u8]) -> u64 {
    XxHash3_64::oneshot_with_seed(version.into(), json)
}

/// Why metadata cannot be read from its bytes.
#[derive(Debug, Error, PartialEq)]
pub(crate) enum MetadataError {
    #[error("not a metadata record")]
    Magic,
    #[error("format version {0}")]
    Newer(u32),
    #[error("it fails its checksum")]
    Checksum,
    #[error("{0}")]
    Json(String),
    #[error("{0}")]
    Geometry(#[from] GeometryError),
    #[error("a voxel's size is not above 0")]
    Spacing,
}

impl Metadata {
    /// Metadata of a volume of which nothing but its folding and types is known yet.
    pub fn new(geometry: &Geometry, sample_type: SampleType, encoding: Encoding) -> Self {
        Self {
            complete: false,
            digest: String::new(),
            dims_xyz: geometry.dims_xyz(),
            spacing_xyz: [1.0; 3],
            unit: LengthUnit::default(),
            affine: None,
            sample_type,
            encoding,
            brick_core: geometry.core(),
            brick_overlap: geometry.overlap(),
            stored_overlap: true,
            downsample: DownsampleFilter::default(),
            empty_below: None,
            empty_value: 0.0,
            value_min: None,
            value_max: None,
            value_mean: None,
            nan_count: 0,
            inf_count: 0,
            dropped_voxels: 0,
            dropped_rms: 0.0,
            dropped_amax: 0.0,
            dropped_energy: 0.0,
            dropped_min: None,
            dropped_max: None,
            levels: Vec::new(),
            payload_bytes: 0,
            source: SourceDescription::default(),
            created_by: String::new(),
            created_unix_secs: 0,
            options: BTreeMap::new(),
        }
    }

    /// The volume's folding.
    ///
    /// # Errors
    /// When the fields describe none.
    pub fn geometry(&self) -> Result<Geometry, GeometryError> {
        Geometry::new(self.dims_xyz, self.brick_core, self.brick_overlap)
    }

    /// PSNR of level 0 in dB, its peak the source's value range; none where nothing was lost.
    pub fn psnr_db(&self) -> Option<f64> {
        let level = self.levels.first()?;
        let peak = (self.value_max? - self.value_min?).min(f64::MAX);
        (level.rms > 0.0 && peak > 0.0).then(|| 20.0 * (peak / level.rms).log10())
    }

    /// The metadata as JSON.
    pub(crate) fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("metadata has string keys and finite numbers")
    }

    /// The record's bytes: magic, version, checksum, JSON.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let json = self.to_json();
        let mut bytes = Vec::with_capacity(FRAME_BYTES + json.len());
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&FORMAT_VERSION.to_le_bytes());
        bytes.extend_from_slice(&checksum(FORMAT_VERSION, &json).to_le_bytes());
        bytes.extend_from_slice(&json);
        bytes
    }

    /// Whether a frame that this version reads may begin with these bytes: quickly, and right of all that do.
    pub(crate) fn may_begin(bytes: &[u8]) -> bool {
        let version = bytes.get(4..8).and_then(|bytes| bytes.first_chunk());
        bytes.starts_with(&MAGIC)
            && version.is_some_and(|version| u32::from_le_bytes(*version) <= FORMAT_VERSION)
    }

    /// The metadata in a record's bytes. The version is looked at before anything else, so that a
    /// later version may change all but the first eight bytes.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, MetadataError> {
        if bytes.len() < FRAME_BYTES || bytes[..4] != MAGIC {
            return Err(MetadataError::Magic);
        }
        let field = |at: usize| bytes[at..].first_chunk::<8>().copied().unwrap_or_default();
        let version = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]);
        if version > FORMAT_VERSION {
            return Err(MetadataError::Newer(version));
        }
        let json = &bytes[FRAME_BYTES..];
        if checksum(version, json) != u64::from_le_bytes(field(8)) {
            return Err(MetadataError::Checksum);
        }
        let metadata: Self =
            serde_json::from_slice(json).map_err(|error| MetadataError::Json(error.to_string()))?;
        metadata.geometry()?;
        if !metadata.spacing_xyz.iter().all(|side| side.is_finite() && *side > 0.0) {
            return Err(MetadataError::Spacing);
        }
        Ok(metadata)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metadata() -> Metadata {
        let geometry = Geometry::new([103, 94, 161], 32, 2).unwrap();
        let mut metadata = Metadata::new(&geometry, SampleType::U16, Encoding::Quantised8);
        metadata.spacing_xyz = [0.1, f64::MIN_POSITIVE, 1e300];
        metadata.value_max = Some(f64::MAX);
        metadata
    }

    #[test]
    fn every_bit_of_every_number_comes_back() {
        assert_eq!(Metadata::from_bytes(&metadata().to_bytes()), Ok(metadata()));
    }

    #[test]
    fn a_flipped_bit_is_noticed() {
        let bytes = metadata().to_bytes();
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(Metadata::from_bytes(&damaged).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn a_voxel_has_a_size() {
        for side in [0.0, -0.0, -1.0] {
            let mut metadata = metadata();
            metadata.spacing_xyz[1] = side;
            assert_eq!(Metadata::from_bytes(&metadata.to_bytes()), Err(MetadataError::Spacing));
        }
    }

    #[test]
    fn a_newer_version_is_told_from_damage() {
        let mut bytes = metadata().to_bytes();
        bytes[4] = 9;
        bytes.truncate(20);
        assert_eq!(Metadata::from_bytes(&bytes), Err(MetadataError::Newer(9)));
        assert_eq!(Metadata::from_bytes(b"OC"), Err(MetadataError::Magic));
    }
}
