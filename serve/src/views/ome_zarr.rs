//! OME-Zarr 0.4 (Zarr v2) and 0.5 (Zarr v3): groups, arrays, and what chunk a path names.

use super::scales::{first_centre_xyz, scale_xyz};
use super::zarr_array::{ZarrArray, level_of, numbers, within};
use crate::options::Compressor;
use octree_store::{Geometry, LengthUnit, Metadata, NodeKey, SampleType};
use serde_json::{Value, json};

/// Which of the four pyramids a path belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Flavour {
    /// 2: OME-Zarr 0.4; 3: OME-Zarr 0.5.
    pub(crate) zarr_format: u8,
    /// Whether arrays are tczyx rather than zyx.
    pub(crate) five_d: bool,
}

/// What a path names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// `.zgroup`
    Group,
    /// `.zattrs`, or the `zarr.json` of the group.
    Pyramid,
    /// `.zarray`, or the `zarr.json` of an array.
    Array(u8),
    /// A chunk.
    Chunk(NodeKey),
}

impl Flavour {
    /// What a path names in a volume of this folding; none: nothing is there.
    pub(crate) fn part(self, path: &str, geometry: &Geometry) -> Option<Part> {
        match (self.zarr_format, path) {
            (2, ".zgroup") => return Some(Part::Group),
            (2, ".zattrs") | (3, "zarr.json") => return Some(Part::Pyramid),
            _ => {}
        }
        let (level, rest) = level_of(path, geometry)?;
        match (self.zarr_format, rest) {
            (2, ".zarray") | (3, "zarr.json") => return Some(Part::Array(level)),
            _ => {}
        }
        let chunk = if self.zarr_format == 3 { rest.strip_prefix("c/")? } else { rest };
        let chunk = if self.five_d { chunk.strip_prefix("0/0/")? } else { chunk };
        let [z, y, x] = numbers(chunk)?;
        let key = NodeKey::new(level, within([x, y, z], geometry.grid_at(level))?);
        Some(Part::Chunk(key))
    }

    fn axes(self) -> Vec<&'static str> {
        let all = ["t", "c", "z", "y", "x"];
        all[if self.five_d { 0 } else { 2 }..].to_vec()
    }

    /// x, y, z as an array's dimensions, slowest first; `first` for time and channel.
    fn dims<T: Copy>(self, xyz: [T; 3], first: T) -> Vec<T> {
        let [x, y, z] = xyz;
        if self.five_d { vec![first, first, z, y, x] } else { vec![z, y, x] }
    }

    /// The group's attributes: `multiscales`, and how to show them.
    fn attributes(self, name: &str, metadata: &Metadata, window: [f64; 2]) -> Value {
        let unit = unit_name(metadata.unit);
        let axes: Vec<Value> = self
            .axes()
            .into_iter()
            .map(|axis| match axis {
                "t" => json!({"name": "t", "type": "time"}),
                "c" => json!({"name": "c", "type": "channel"}),
                axis => json!({"name": axis, "type": "space", "unit": unit}),
            })
            .collect();
        let datasets: Vec<Value> = (0_u8..)
            .zip(&metadata.levels)
            .map(|(level, _)| {
                let scale = self.dims(scale_xyz(metadata.spacing_xyz, level), 1.0);
                let translation = self.dims(first_centre_xyz(metadata.spacing_xyz, level), 0.0);
                json!({"path": level.to_string(), "coordinateTransformations": [
                    {"type": "scale", "scale": scale},
                    {"type": "translation", "translation": translation},
                ]})
            })
            .collect();
        let mut pyramid = json!({
            "name": name,
            "axes": axes,
            "datasets": datasets,
            "type": metadata.downsample.name(),
        });
        if self.zarr_format == 2 {
            pyramid["version"] = json!("0.4");
        }
        let [low, high] = super::info::range(metadata);
        let mut omero = json!({
            "name": name,
            "channels": [{
                "label": name,
                "color": "FFFFFF",
                "active": true,
                "coefficient": 1,
                "family": "linear",
                "inverted": false,
                "window": {"min": low, "max": high, "start": window[0], "end": window[1]},
            }],
            "rdefs": {"model": "greyscale", "defaultT": 0, "defaultZ": metadata.dims_xyz[2] / 2},
        });
        if self.zarr_format == 2 {
            omero["version"] = json!("0.4");
        }
        json!({"multiscales": [pyramid], "omero": omero})
    }

    /// The document of the group.
    pub(crate) fn pyramid(self, name: &str, metadata: &Metadata, window: [f64; 2]) -> Value {
        let mut attributes = self.attributes(name, metadata, window);
        if self.zarr_format == 2 {
            return attributes;
        }
        attributes["version"] = json!("0.5");
        json!({"zarr_format": 3, "node_type": "group", "attributes": {"ome": attributes}})
    }

    /// The document of a level's array.
    pub(crate) fn array(
        self,
        level: u8,
        geometry: &Geometry,
        sample_type: SampleType,
        compressor: Compressor,
    ) -> Value {
        let shape = self.dims(geometry.dims_at(level), 1);
        let chunks = self.dims([u64::from(geometry.core()); 3], 1);
        let dimension_names = self.axes();
        ZarrArray { shape, chunks, sample_type, compressor, dimension_names }
            .document(self.zarr_format)
    }
}

pub(super) fn unit_name(unit: LengthUnit) -> &'static str {
    match unit {
        LengthUnit::M => "meter",
        LengthUnit::Mm => "millimeter",
        LengthUnit::Um => "micrometer",
        LengthUnit::Nm => "nanometer",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_name_what_is_there_and_nothing_else() {
        let geometry = Geometry::new([70, 40, 33], 32, 2).unwrap();
        let zyx = Flavour { zarr_format: 2, five_d: false };
        let five = Flavour { zarr_format: 3, five_d: true };
        assert_eq!(zyx.part(".zattrs", &geometry), Some(Part::Pyramid));
        assert_eq!(zyx.part("1/.zarray", &geometry), Some(Part::Array(1)));
        let chunk = Part::Chunk(NodeKey::new(0, [2, 1, 0]));
        assert_eq!(zyx.part("0/0/1/2", &geometry), Some(chunk));
        assert_eq!(five.part("0/c/0/0/0/1/2", &geometry), Some(chunk));
        assert_eq!(five.part("zarr.json", &geometry), Some(Part::Pyramid));
        for path in [
            "",
            "0",
            "zarr.json",
            "3/.zarray",
            "0/2/0/0",
            "0/0/0/3",
            "0/0/0",
            "0/0/0/0/0",
            "0/00/0/0",
            "0/-0/0/0",
            "0/+0/0/0",
            "00/.zarray",
            ".zarray",
            "0/.zattrs",
            "256/.zarray",
            "0/99999999999999999999/0/0",
            "0/c/0/0/0",
            "../.zattrs",
        ] {
            assert_eq!(zyx.part(path, &geometry), None, "{path}");
        }
        for path in ["0/c/1/0/0/0/0", "0/c/0/0/0", "0/0/0/0/0/0", ".zattrs"] {
            assert_eq!(five.part(path, &geometry), None, "{path}");
        }
    }
}
