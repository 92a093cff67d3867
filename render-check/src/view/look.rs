//! How a volume is made into a picture: what the reference, the mirror and the shader all take.

use crate::error::RenderError;
use octree_store::loader::{Appearance, ClipBox, TransferFunction};
use serde::{Deserialize, Serialize};

/// What a ray gathers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Emission and absorption along the ray.
    Dvr,
    /// The first surface of this value.
    Iso(f64),
    /// The greatest value, as grey.
    Mip,
}

/// Between which levels samples are interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// Within the level at hand.
    Trilinear,
    /// Between two levels as well, by the projected size of their voxels (2010 text, section 3).
    #[default]
    Quadrilinear,
}

/// Light and material of Blinn and Phong's model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Shading {
    /// Share of a colour that is there without light.
    pub ambient: f64,
    /// Share that depends on the angle between normal and light.
    pub diffuse: f64,
    /// White highlight.
    pub specular: f64,
    /// Exponent of the highlight.
    pub shininess: f64,
    /// Direction towards the light in world space; none is a light at the eye.
    pub light: Option<[f64; 3]>,
}

impl Default for Shading {
    fn default() -> Self {
        Self { ambient: 0.3, diffuse: 0.7, specular: 0.2, shininess: 32.0, light: None }
    }
}

/// What a picture is made with, besides the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// What a ray gathers.
    pub mode: Mode,
    /// Colour and extinction of values.
    pub transfer: TransferFunction,
    /// Values that stand for 0 and 1 of the tables, and for black and white of maximum intensity.
    pub window: [f64; 2],
    /// Entries of the tables.
    pub table_entries: u32,
    /// Shading, or none.
    pub shading: Option<Shading>,
    /// Colour of an isosurface.
    pub surface_color: [f64; 3],
    /// Distance between samples in voxels of the level at hand.
    pub step_voxels: f64,
    /// Pixels that a voxel may cover.
    pub accuracy: f64,
    /// Filtering between levels.
    pub filter: Filter,
    /// Only what lies in this box is shown.
    pub clip: Option<ClipBox>,
}

impl Look {
    /// Entries of tables where nothing else is said.
    pub const TABLE_ENTRIES: u32 = 4096;
    /// The shortest step in voxels.
    pub const SHORTEST_STEP: f64 = 1e-4;
    /// The greatest extinction per world unit: sums of it along a ray stay within 32-bit floats.
    pub const MOST_EXTINCTION: f64 = 1e30;
    /// The most entries.
    pub const TABLE_LIMIT: u32 = 65_536;

    /// A look of volume rendering; `data_range` is the volume's least and greatest value.
    pub fn new(transfer: TransferFunction, data_range: [f64; 2]) -> Self {
        Self {
            mode: Mode::Dvr,
            window: window(&transfer, data_range),
            transfer,
            table_entries: Self::TABLE_ENTRIES,
            shading: None,
            surface_color: [0.9, 0.85, 0.75],
            step_voxels: 0.5,
            accuracy: 1.0,
            filter: Filter::default(),
            clip: None,
        }
    }

    /// Checks what types cannot.
    ///
    /// # Errors
    /// When a number is out of its range.
    pub fn check(&self) -> Result<(), RenderError> {
        let positive = |what, found: f64, limit: f64| {
            let fits = found > 0.0 && found <= limit;
            if fits { Ok(()) } else { Err(RenderError::Number { what, found, limit }) }
        };
        positive("step", self.step_voxels, 1024.0)?;
        if self.step_voxels < Self::SHORTEST_STEP {
            let (found, least) = (self.step_voxels, Self::SHORTEST_STEP);
            return Err(RenderError::Step { found, least });
        }
        let most = self.transfer.points().iter().map(|p| p.extinction).fold(0.0, f64::max);
        if most > Self::MOST_EXTINCTION {
            let (found, limit) = (most, Self::MOST_EXTINCTION);
            return Err(RenderError::Extinction { found, limit });
        }
        positive("accuracy", self.accuracy, 1e6)?;
        positive(
            "table entries",
            f64::from(self.table_entries) - 1.0,
            f64::from(Self::TABLE_LIMIT),
        )?;
        if let Some(shading) = &self.shading {
            positive("shininess", shading.shininess, 1e4)?;
        }
        if let Mode::Iso(value) = self.mode
            && !value.is_finite()
        {
            return Err(RenderError::Isovalue { found: value });
        }
        Ok(())
    }

    /// What the loader is told.
    pub fn appearance(&self) -> Appearance {
        match self.mode {
            Mode::Dvr => Appearance::Transfer(self.transfer.clone()),
            Mode::Iso(value) => Appearance::Isovalue(value),
            Mode::Mip => Appearance::Everything,
        }
    }

    /// A value where `window` is 0 to 1.
    pub fn normalised(&self, value: f64) -> f64 {
        (value - self.window[0]) / (self.window[1] - self.window[0])
    }
}

/// The part of the data's range in which a transfer function changes; all of it where it does not.
fn window(transfer: &TransferFunction, data_range: [f64; 2]) -> [f64; 2] {
    let points = transfer.points();
    let ends = [points[0].value, points[points.len() - 1].value];
    let [low, high] = [ends[0].max(data_range[0]), ends[1].min(data_range[1])];
    let usable = |low: f64, high: f64| low < high && (high - low).is_finite();
    if usable(low, high) {
        [low, high]
    } else if usable(data_range[0], data_range[1]) {
        data_range
    } else {
        [data_range[0], data_range[0] + data_range[0].abs().max(1.0)]
    }
}
