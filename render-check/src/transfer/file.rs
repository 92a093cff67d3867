//! The JSON of a transfer function: control points with colours of their own, or with those of a named map.

use super::ColorMap;
use crate::error::RenderError;
use octree_store::loader::{ControlPoint, TransferFunction};
use serde::{Deserialize, Serialize};

/// Either form: `{"points":[{"value":0,"color":[0,0,0],"extinction":0}, …]}`, or
/// `{"colormap":"viridis","range":[0,900],"points":[{"value":0,"extinction":0}, …]}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum TransferFile {
    /// Colours from a map.
    Mapped(MappedTransfer),
    /// Colours at every point.
    Plain(TransferFunction),
}

/// A transfer function whose colours are a map's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MappedTransfer {
    /// The map's name.
    pub colormap: String,
    /// Values of its first and last colour.
    pub range: [f64; 2],
    /// Extinction.
    pub points: Vec<ExtinctionPoint>,
}

/// A point of a mapped transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExtinctionPoint {
    /// The value, in source units.
    pub value: f64,
    /// Extinction per world unit.
    pub extinction: f64,
}

impl TransferFile {
    /// The transfer function of a file's text.
    ///
    /// # Errors
    /// With what is wrong in it: where the map's form was meant, of that; else of the plain one.
    pub fn parse(json: &str) -> Result<Result<TransferFunction, RenderError>, serde_json::Error> {
        let value: serde_json::Value = serde_json::from_str(json)?;
        if value.get("colormap").is_some() {
            Ok(Self::Mapped(serde_json::from_value(value)?).function())
        } else {
            Ok(Self::Plain(serde_json::from_value(value)?).function())
        }
    }

    /// The function.
    ///
    /// # Errors
    /// When there is no such map, or the points make no function.
    pub fn function(self) -> Result<TransferFunction, RenderError> {
        let mapped = match self {
            Self::Plain(function) => return Ok(function),
            Self::Mapped(mapped) => mapped,
        };
        let map = ColorMap::find(&mapped.colormap)?;
        let [low, high] = mapped.range;
        let place = |value: f64| if high == low { 0.0 } else { (value - low) / (high - low) };
        let points = mapped.points.iter().map(|p| ControlPoint {
            value: p.value,
            color: map.at(place(p.value)),
            extinction: p.extinction,
        });
        let plain = TransferFunction::new(points.collect())?;
        // The map's own colours lie between the points too.
        let mut all = plain.points().to_vec();
        for value in map.knots().map(|k| low + k * (high - low)) {
            if value.is_finite() && all.iter().all(|p| p.value != value) {
                let extinction = plain.at(value).1;
                all.push(ControlPoint { value, color: map.at(place(value)), extinction });
            }
        }
        all.sort_by(|a, b| a.value.total_cmp(&b.value));
        Ok(TransferFunction::new(all)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_named_map_gives_its_colours_between_the_points_too() {
        let json = r#"{"colormap":"viridis","range":[0,800],"points":[{"value":0,"extinction":0},{"value":1000,"extinction":2}]}"#;
        let function = TransferFile::parse(json).unwrap().unwrap();
        let (color, extinction) = function.at(400.0);
        assert!((extinction - 0.8).abs() < 1e-12);
        let middle = ColorMap::find("viridis").unwrap().at(0.5);
        assert!((0..3).all(|c| (color[c] - middle[c]).abs() < 1e-12), "{color:?}");
        let wrong = TransferFile::parse(&json.replace("viridis", "vividis")).unwrap().unwrap_err();
        assert!(wrong.to_string().contains("coolwarm"), "{wrong}");
    }

    #[test]
    fn what_is_wrong_is_said_of_the_form_that_was_meant() {
        let error = TransferFile::parse(r#"{"colormap":"gray","points":[]}"#).unwrap_err();
        assert!(error.to_string().contains("range"), "{error}");
        let error = TransferFile::parse(r#"{"points":[]}"#).unwrap_err();
        assert!(error.to_string().contains("at least one point"), "{error}");
    }
}
