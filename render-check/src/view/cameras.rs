//! Views by name, and cameras that go around.

use crate::error::RenderError;
use octree_store::Metadata;
use octree_store::loader::{Camera, CameraJson};
use std::f64::consts::TAU;

/// Where a volume is looked at from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NamedView {
    /// Along an axis, from its low (-) or high (+) end.
    Axis {
        /// 0 to 2.
        axis: usize,
        /// Whether from the high end.
        from_high: bool,
    },
    /// From one of three directions between axes.
    Oblique(usize),
    /// From the middle.
    Inside,
    /// Along a face, from just beyond an edge.
    Grazing,
}

const OBLIQUES: [[f64; 3]; 3] = [[-0.8, -0.6, -1.0], [1.0, -0.35, 0.6], [-0.3, 1.0, 0.9]];

impl NamedView {
    /// All, as `render-check` takes them.
    pub const ALL: [Self; 11] = [
        Self::Axis { axis: 0, from_high: false },
        Self::Axis { axis: 0, from_high: true },
        Self::Axis { axis: 1, from_high: false },
        Self::Axis { axis: 1, from_high: true },
        Self::Axis { axis: 2, from_high: false },
        Self::Axis { axis: 2, from_high: true },
        Self::Oblique(0),
        Self::Oblique(1),
        Self::Oblique(2),
        Self::Inside,
        Self::Grazing,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Axis { axis, from_high } => {
                [["x-", "x+"], ["y-", "y+"], ["z-", "z+"]][axis.min(2)][usize::from(from_high)]
            }
            Self::Oblique(0) => "oblique1",
            Self::Oblique(1) => "oblique2",
            Self::Oblique(_) => "oblique3",
            Self::Inside => "inside",
            Self::Grazing => "grazing",
        }
    }

    /// The view of a name.
    ///
    /// # Errors
    /// When there is none.
    pub fn find(name: &str) -> Result<Self, RenderError> {
        Self::ALL.into_iter().find(|view| view.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            RenderError::NamedView { found: name.to_owned(), known }
        })
    }

    /// The camera that shows a whole volume so, in an image of this shape (width over height).
    ///
    /// # Errors
    /// When the volume's size makes no camera.
    pub fn camera(self, metadata: &Metadata, aspect: f64) -> Result<Camera, RenderError> {
        let size = world_size(metadata);
        let middle = size.map(|s| s / 2.0);
        let camera = match self {
            Self::Axis { axis, from_high } => {
                let mut direction = [0.0; 3];
                direction[axis.min(2)] = if from_high { 1.0 } else { -1.0 };
                around(size, direction, aspect)
            }
            Self::Oblique(which) => around(size, OBLIQUES[which.min(2)], aspect),
            Self::Inside => CameraJson::Perspective {
                position: middle,
                target: [size[0], size[1] * 0.6, size[2] * 0.9],
                up: [0.0, -1.0, 0.0],
                fov_y_deg: 75.0,
            },
            Self::Grazing => CameraJson::Perspective {
                position: [-0.3 * size[0], middle[1], 0.002 * size[2]],
                target: [size[0], middle[1], 0.0],
                up: [0.0, 0.0, -1.0],
                fov_y_deg: 40.0,
            },
        };
        Ok(Camera::new(camera)?)
    }
}

/// `count` cameras around the y axis, the first from the first oblique direction.
///
/// # Errors
/// When the volume's size makes no camera.
pub fn orbit(metadata: &Metadata, aspect: f64, count: u32) -> Result<Vec<Camera>, RenderError> {
    let [x, y, z] = OBLIQUES[0];
    (0..count)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(count)).sin_cos();
            let direction = [cos * x + sin * z, y, cos * z - sin * x];
            Ok(Camera::new(around(world_size(metadata), direction, aspect))?)
        })
        .collect()
}

fn world_size(metadata: &Metadata) -> [f64; 3] {
    [0, 1, 2].map(|axis| metadata.dims_xyz[axis] as f64 * metadata.spacing_xyz[axis])
}

/// A camera from a direction, as far as the whole box takes.
fn around(size: [f64; 3], direction: [f64; 3], aspect: f64) -> CameraJson {
    let length = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
    let (fov_y_deg, radius) = (30.0_f64, length(size) / 2.0);
    let half_angle = (fov_y_deg.to_radians() / 2.0).tan() * aspect.min(1.0);
    let distance = radius / half_angle.atan().sin() / length(direction);
    let up = if direction[0].abs() + direction[2].abs() > 1e-9 {
        [0.0, -1.0, 0.0]
    } else {
        [0.0, 0.0, -1.0]
    };
    CameraJson::Perspective {
        position: [0, 1, 2].map(|axis| size[axis] / 2.0 + direction[axis] * distance),
        target: size.map(|s| s / 2.0),
        up,
        fov_y_deg,
    }
}
