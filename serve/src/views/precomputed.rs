//! Neuroglancer's precomputed: its `info`, and what brick a chunk's name names.

use super::scales::scale_xyz;
use super::zarr_array::long_type;
use crate::product::precomputed_offset;
use octree_store::{Geometry, LengthUnit, Metadata, NodeKey, SampleType};
use serde_json::{Value, json};

/// Nanometres in a unit.
fn nanometres(unit: LengthUnit) -> f64 {
    match unit {
        LengthUnit::M => 1e9,
        LengthUnit::Mm => 1e6,
        LengthUnit::Um => 1e3,
        LengthUnit::Nm => 1.0,
    }
}

/// The type of precomputed samples: signed ones are shifted to unsigned, f64 is narrowed.
fn data_type(sample_type: SampleType) -> &'static str {
    long_type(match sample_type {
        SampleType::I8 => SampleType::U8,
        SampleType::I16 => SampleType::U16,
        SampleType::I32 => SampleType::U32,
        SampleType::F64 => SampleType::F32,
        same => same,
    })
}

/// The `info` document. A level's voxel (0, 0, 0) has its corner at the origin.
pub(crate) fn info(metadata: &Metadata, geometry: &Geometry) -> Value {
    let nanometres = nanometres(metadata.unit);
    let chunk_size = [geometry.core(); 3];
    let scales: Vec<Value> = geometry
        .levels()
        .map(|level| {
            json!({
                "key": level.to_string(),
                "size": geometry.dims_at(level),
                "resolution": scale_xyz(metadata.spacing_xyz, level).map(|s| s * nanometres),
                "voxel_offset": [0, 0, 0],
                "chunk_sizes": [chunk_size],
                "encoding": "raw",
            })
        })
        .collect();
    let mut info = json!({
        "@type": "neuroglancer_multiscale_volume",
        "type": "image",
        "data_type": data_type(metadata.sample_type),
        "num_channels": 1,
        "scales": scales,
    });
    let offset = precomputed_offset(metadata.sample_type);
    if offset != 0 || metadata.sample_type == SampleType::F64 {
        info["octavo"] = json!({
            "source_type": metadata.sample_type.name(),
            "value_offset": offset,
            "note": "value in source units = sample + value_offset",
        });
    }
    info
}

/// The range of precomputed samples.
pub(crate) fn range(metadata: &Metadata) -> [f64; 2] {
    let offset = precomputed_offset(metadata.sample_type) as f64;
    super::info::range(metadata).map(|value| value - offset)
}

/// The brick of a chunk's path, as in `0/64-96_0-32_32-33`; none: there is no such chunk.
pub(crate) fn chunk(path: &str, geometry: &Geometry) -> Option<NodeKey> {
    let (level, name) = path.split_once('/')?;
    let level: u8 = level.parse().ok().filter(|level| geometry.levels().contains(level))?;
    let mut spans = name.split('_').map(|span| {
        let (from, to) = span.split_once('-')?;
        Some((from.parse::<u64>().ok()?, to.parse::<u64>().ok()?))
    });
    let spans = [spans.next()??, spans.next()??, spans.next()??];
    let (core, grid) = (u64::from(geometry.core()), geometry.grid_at(level));
    let brick = spans.map(|(from, _)| from / core);
    if (0..3).any(|axis| brick[axis] >= grid[axis]) {
        return None;
    }
    let key = NodeKey::new(level, brick);
    let region = geometry.core_region(key);
    let whole = (0..3).all(|axis| spans[axis] == (region.min[axis], region.max[axis]));
    // Numbers have one way to be written.
    let [x, y, z] = spans.map(|(from, to)| format!("{from}-{to}"));
    (whole && path == format!("{level}/{x}_{y}_{z}")).then_some(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_named_by_their_clipped_boxes_and_no_others() {
        let geometry = Geometry::new([70, 40, 33], 32, 2).unwrap();
        let name = |path| chunk(path, &geometry);
        assert_eq!(name("0/64-70_32-40_32-33"), Some(NodeKey::new(0, [2, 1, 1])));
        assert_eq!(name("1/32-35_0-20_0-17"), Some(NodeKey::new(1, [1, 0, 0])));
        for path in [
            "0/64-96_32-64_32-64",
            "0/1-33_0-32_0-32",
            "0/0-32_0-32",
            "0/0-32_0-32_0-32_0-32",
            "00/0-32_0-32_0-32",
            "0/00-32_0-32_0-32",
            "9/0-32_0-32_0-32",
            "0/0-32_0-32_64-96",
            "info",
        ] {
            assert_eq!(name(path), None, "{path}");
        }
    }
}
