//! A store's codes as zarr, and what makes values of them.
//!
//! Codes mean something else in each brick, so this is no OME-Zarr: a viewer that took codes for values would show
//! each brick with a contrast of its own. Level k has `k/codes`, of which a chunk is a brick, and `k/map`: for each
//! brick scale, offset, least and greatest value. docs/HTTP.md ("Codes as zarr") has the rule and six lines that follow it.

use super::ome_zarr::unit_name;
use super::scales::{first_centre_xyz, scale_xyz};
use super::zarr_array::{ZarrArray, level_of, numbers, within};
use crate::options::Compressor;
use octree_store::{Geometry, Metadata, NodeKey, SampleType};
use serde_json::{Value, json};

/// What a path names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// `.zgroup` of the root or of a level, or a level's `zarr.json`.
    Group,
    /// `.zattrs`, or the root's `zarr.json`.
    Root,
    /// The document of a level's codes.
    Codes(u8),
    /// The document of a level's map.
    Map(u8),
    /// A brick's codes.
    CodesChunk(NodeKey),
    /// The map of a block of bricks.
    MapChunk(Block),
}

/// Bricks of a level whose maps are one chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) level: u8,
    pub(crate) place_xyz: [u64; 3],
}

/// Numbers of a brick in the map: scale, offset, least and greatest value.
pub(crate) const MAP_NUMBERS: usize = 4;

/// Bricks along a side of a map's chunk, at most.
const BLOCK_SIDE: u64 = 16;

/// Bricks along the axes of a map's chunk.
pub(crate) fn block_xyz(geometry: &Geometry, level: u8) -> [u64; 3] {
    geometry.grid_at(level).map(|bricks| bricks.min(BLOCK_SIDE))
}

/// What a path names in a volume of this folding; none: nothing is there.
pub(crate) fn part(zarr_format: u8, path: &str, geometry: &Geometry) -> Option<Part> {
    match (zarr_format, path) {
        (2, ".zgroup") => return Some(Part::Group),
        (2, ".zattrs") | (3, "zarr.json") => return Some(Part::Root),
        _ => {}
    }
    let (level, rest) = level_of(path, geometry)?;
    let array = if zarr_format == 2 { ".zarray" } else { "zarr.json" };
    match (zarr_format, rest) {
        (2, ".zgroup") | (3, "zarr.json") => return Some(Part::Group),
        _ => {}
    }
    let (name, rest) = rest.split_once('/')?;
    if rest == array {
        return match name {
            "codes" => Some(Part::Codes(level)),
            "map" => Some(Part::Map(level)),
            _ => None,
        };
    }
    let chunk = if zarr_format == 3 { rest.strip_prefix("c/")? } else { rest };
    let grid = geometry.grid_at(level);
    match name {
        "codes" => {
            let [z, y, x] = numbers(chunk)?;
            Some(Part::CodesChunk(NodeKey::new(level, within([x, y, z], grid)?)))
        }
        "map" => {
            let [z, y, x, 0] = numbers(chunk)? else { return None };
            let block = block_xyz(geometry, level);
            let blocks = [0, 1, 2].map(|axis| grid[axis].div_ceil(block[axis]));
            let place_xyz = within([x, y, z], blocks)?;
            Some(Part::MapChunk(Block { level, place_xyz }))
        }
        _ => None,
    }
}

fn zyx<T: Copy>([x, y, z]: [T; 3]) -> Vec<T> {
    vec![z, y, x]
}

/// The document of the root: what the arrays are, and where the levels lie.
pub(crate) fn root(zarr_format: u8, name: &str, metadata: &Metadata) -> Value {
    let levels: Vec<Value> = metadata
        .levels
        .iter()
        .map(|level| {
            let k = level.level;
            json!({
                "codes": format!("{k}/codes"),
                "map": format!("{k}/map"),
                "scale_zyx": zyx(scale_xyz(metadata.spacing_xyz, k)),
                "translation_zyx": zyx(first_centre_xyz(metadata.spacing_xyz, k)),
            })
        })
        .collect();
    let attributes = json!({"octavo": {
        "form": "codes",
        "dataset": name,
        "sample_type": metadata.sample_type.name(),
        "encoding": metadata.encoding,
        "core": metadata.brick_core,
        "unit": unit_name(metadata.unit),
        "map": ["scale", "offset", "min", "max"],
        "value": "clip(offset + scale * code, min, max) of the brick; of integers the nearest whole number",
        "levels": levels,
    }});
    if zarr_format == 2 { attributes } else { group(3, &attributes) }
}

/// The document of a group.
pub(crate) fn group(zarr_format: u8, attributes: &Value) -> Value {
    if zarr_format == 2 {
        return json!({"zarr_format": 2});
    }
    json!({"zarr_format": 3, "node_type": "group", "attributes": attributes})
}

/// The document of a level's codes.
pub(crate) fn codes(
    zarr_format: u8,
    level: u8,
    geometry: &Geometry,
    sample_type: SampleType,
    compressor: Compressor,
) -> Value {
    let shape = zyx(geometry.dims_at(level));
    let chunks = vec![u64::from(geometry.core()); 3];
    let dimension_names = vec!["z", "y", "x"];
    ZarrArray { shape, chunks, sample_type, compressor, dimension_names }.document(zarr_format)
}

/// The document of a level's map.
pub(crate) fn map(zarr_format: u8, level: u8, geometry: &Geometry) -> Value {
    let with_numbers = |bricks| [zyx(bricks), vec![MAP_NUMBERS as u64]].concat();
    ZarrArray {
        shape: with_numbers(geometry.grid_at(level)),
        chunks: with_numbers(block_xyz(geometry, level)),
        sample_type: SampleType::F64,
        compressor: Compressor::None,
        dimension_names: vec!["brick_z", "brick_y", "brick_x", "number"],
    }
    .document(zarr_format)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_name_what_is_there_and_nothing_else() {
        let geometry = Geometry::new([600, 40, 33], 32, 2).unwrap();
        assert_eq!(part(2, ".zattrs", &geometry), Some(Part::Root));
        assert_eq!(part(3, "zarr.json", &geometry), Some(Part::Root));
        assert_eq!(part(2, "1/.zgroup", &geometry), Some(Part::Group));
        assert_eq!(part(3, "1/zarr.json", &geometry), Some(Part::Group));
        assert_eq!(part(3, "0/codes/zarr.json", &geometry), Some(Part::Codes(0)));
        assert_eq!(part(2, "2/map/.zarray", &geometry), Some(Part::Map(2)));
        let brick = Part::CodesChunk(NodeKey::new(0, [18, 1, 0]));
        assert_eq!(part(2, "0/codes/0/1/18", &geometry), Some(brick));
        assert_eq!(part(3, "0/codes/c/0/1/18", &geometry), Some(brick));
        // Nineteen bricks along x are two blocks.
        let block = Part::MapChunk(Block { level: 0, place_xyz: [1, 0, 0] });
        assert_eq!(part(2, "0/map/0/0/1/0", &geometry), Some(block));
        assert_eq!(part(3, "0/map/c/0/0/1/0", &geometry), Some(block));
        for path in [
            "",
            "zarr.json",
            "0",
            "0/codes",
            "0/.zattrs",
            "9/.zgroup",
            "0/more/.zarray",
            "0/codes/0/1/19",
            "0/codes/0/1",
            "0/codes/0/1/18/0",
            "0/codes/c/0/1/18",
            "0/map/0/0/1",
            "0/map/0/0/2/0",
            "0/map/0/0/1/1",
            "0/map/0/0/01/0",
        ] {
            assert_eq!(part(2, path, &geometry), None, "{path}");
        }
        for path in ["0/codes/0/1/18", "0/map/0/0/1/0", ".zgroup", "0/codes/.zarray"] {
            assert_eq!(part(3, path, &geometry), None, "{path}");
        }
    }
}
