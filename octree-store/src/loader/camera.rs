//! Cameras as callers describe them, strictly checked.
//!
//! World space is the store's unit: the volume's corner lies at the origin and voxel (i, j, k) is
//! centred at ((i + 0.5) sx, (j + 0.5) sy, (k + 0.5) sz). Right = forward x up. The general 4 x 4
//! matrix is for off-axis projections: those of the many projectors of the 2010 text (section 3), and of
//! the view zones of the multi-view text (section 2).

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why a camera, an image or a clip box cannot be used.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ViewError {
    /// A number that is none, or infinite.
    #[error("{what} must be finite numbers, and {found} was given")]
    NotFinite {
        /// Which field.
        what: &'static str,
        /// The number.
        found: f64,
    },
    /// A camera that looks at where it is.
    #[error("position and target are the same point, {} {} {}: no direction follows from it", at[0], at[1], at[2])]
    NoDirection {
        /// The point.
        at: [f64; 3],
    },
    /// An up vector that is zero.
    #[error("up is zero: give the direction that is to be up in the image, as in [0,-1,0]")]
    ZeroUp,
    /// An up vector along the view.
    #[error("up is parallel to the direction from position to target: choose another")]
    UpAlongView,
    /// A field of view that is none.
    #[error("fov_y_deg must be above 0 and below 180, and is {found}")]
    FieldOfView {
        /// The angle in degrees.
        found: f64,
    },
    /// A height that is none.
    #[error("height, in world units, must be above 0, and is {found}")]
    Height {
        /// The height.
        found: f64,
    },
    /// A matrix that maps the world to less than an image.
    #[error("clip_from_world is singular: its rows x, y and w must be independent")]
    SingularMatrix,
    /// An image without pixels, or of more than any display has.
    #[error("an image of {} x {} pixels cannot be made: each side must be 1 to {limit}", size[0], size[1])]
    ImageSize {
        /// Width and height in pixels.
        size: [u32; 2],
        /// The longest side.
        limit: u32,
    },
    /// A clip box that holds nothing.
    #[error("the clip box is empty along {axis}: it goes from {min} to {max}")]
    EmptyClipBox {
        /// The axis: x, y or z.
        axis: char,
        /// Its lower end in world units.
        min: f64,
        /// Its upper end.
        max: f64,
    },
}

/// Where the eye is and how it projects. JSON as in
/// `{"projection":"perspective","position":[80,60,-200],"target":[50,47,80],"up":[0,-1,0],"fov_y_deg":40}`.
///
/// Nothing behind the position is seen, whatever the projection; there are no other near and far planes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "CameraJson", try_from = "CameraJson")]
pub struct Camera(CameraJson);

/// The fields of a camera's JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "projection", rename_all = "lowercase", deny_unknown_fields)]
pub enum CameraJson {
    /// A pinhole.
    Perspective {
        /// The eye, in world units.
        position: [f64; 3],
        /// A point in the middle of the image.
        target: [f64; 3],
        /// A direction that is up in the image.
        up: [f64; 3],
        /// The image's full height as an angle, in degrees.
        fov_y_deg: f64,
    },
    /// Parallel rays that start in the plane through the position.
    Orthographic {
        /// A point in the middle of the plane where rays start.
        position: [f64; 3],
        /// A point in the middle of the image.
        target: [f64; 3],
        /// A direction that is up in the image.
        up: [f64; 3],
        /// The image's full height in world units.
        height: f64,
    },
    /// Any projection, off-axis ones too: (x, y, z, w) = M (X, Y, Z, 1), seen where |x| <= w and |y| <= w.
    /// The row of z is not looked at: depth conventions differ, and a volume has no near and far.
    Matrix {
        /// M, row by row.
        clip_from_world: [[f64; 4]; 4],
    },
}

impl Camera {
    /// A checked camera.
    ///
    /// # Errors
    /// When a number is not finite, position and target are equal, up is zero or along the view, the
    /// field of view or the height is out of range, or the matrix is singular.
    pub fn new(fields: CameraJson) -> Result<Self, ViewError> {
        match &fields {
            CameraJson::Perspective { position, target, up, fov_y_deg } => {
                check_frame(*position, *target, *up)?;
                check_finite("fov_y_deg", &[*fov_y_deg])?;
                // The tangent of half of it must be a number that can be divided by.
                if !(*fov_y_deg > 1e-6 && *fov_y_deg < 180.0 - 1e-6) {
                    return Err(ViewError::FieldOfView { found: *fov_y_deg });
                }
            }
            CameraJson::Orthographic { position, target, up, height } => {
                check_frame(*position, *target, *up)?;
                check_finite("height", &[*height])?;
                if *height <= 0.0 {
                    return Err(ViewError::Height { found: *height });
                }
            }
            CameraJson::Matrix { clip_from_world } => {
                check_finite("clip_from_world", clip_from_world.as_flattened())?;
                let [x, y, _, w] = clip_from_world;
                if !independent(x, y, w) {
                    return Err(ViewError::SingularMatrix);
                }
            }
        }
        Ok(Self(fields))
    }

    /// The fields.
    pub fn fields(&self) -> &CameraJson {
        &self.0
    }
}

impl TryFrom<CameraJson> for Camera {
    type Error = ViewError;

    fn try_from(fields: CameraJson) -> Result<Self, ViewError> {
        Self::new(fields)
    }
}

impl From<Camera> for CameraJson {
    fn from(camera: Camera) -> Self {
        camera.0
    }
}

/// One camera and the image that it makes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ViewJson")]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Width and height of the image in pixels.
    pub size: [u32; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewJson {
    camera: Camera,
    size: [u32; 2],
}

impl TryFrom<ViewJson> for View {
    type Error = ViewError;

    fn try_from(json: ViewJson) -> Result<Self, ViewError> {
        Self::new(json.camera, json.size)
    }
}

impl View {
    /// The longest side of an image in pixels.
    pub const SIZE_LIMIT: u32 = 1 << 20;

    /// A view with an image of `size` (width and height) pixels.
    ///
    /// # Errors
    /// When a side is 0 or above [`View::SIZE_LIMIT`].
    pub fn new(camera: Camera, size: [u32; 2]) -> Result<Self, ViewError> {
        if size.iter().any(|side| !(1..=Self::SIZE_LIMIT).contains(side)) {
            return Err(ViewError::ImageSize { size, limit: Self::SIZE_LIMIT });
        }
        Ok(Self { camera, size })
    }
}

/// A box in world units; what lies outside is not shown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ClipBoxJson")]
pub struct ClipBox {
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ClipBoxJson {
    min: [f64; 3],
    max: [f64; 3],
}

impl ClipBox {
    /// The box from `min` to `max`.
    ///
    /// # Errors
    /// When a number is not finite, or `min` is not below `max` on every axis.
    pub fn new(min: [f64; 3], max: [f64; 3]) -> Result<Self, ViewError> {
        check_finite("the clip box's ends", &min)?;
        check_finite("the clip box's ends", &max)?;
        for (axis, name) in ['x', 'y', 'z'].into_iter().enumerate() {
            if min[axis] >= max[axis] {
                let (min, max) = (min[axis], max[axis]);
                return Err(ViewError::EmptyClipBox { axis: name, min, max });
            }
        }
        Ok(Self { min, max })
    }

    /// The lower corner.
    pub fn min(&self) -> [f64; 3] {
        self.min
    }

    /// The upper corner.
    pub fn max(&self) -> [f64; 3] {
        self.max
    }
}

impl TryFrom<ClipBoxJson> for ClipBox {
    type Error = ViewError;

    fn try_from(json: ClipBoxJson) -> Result<Self, ViewError> {
        Self::new(json.min, json.max)
    }
}

fn check_finite(what: &'static str, numbers: &[f64]) -> Result<(), ViewError> {
    match numbers.iter().find(|v| !v.is_finite()) {
        Some(&found) => Err(ViewError::NotFinite { what, found }),
        None => Ok(()),
    }
}

fn check_frame(position: [f64; 3], target: [f64; 3], up: [f64; 3]) -> Result<(), ViewError> {
    check_finite("position", &position)?;
    check_finite("target", &target)?;
    check_finite("up", &up)?;
    let forward =
        unit(difference(target, position)).ok_or(ViewError::NoDirection { at: position })?;
    let up = unit(up).ok_or(ViewError::ZeroUp)?;
    let across = cross(forward, up);
    if dot(across, across) < 1e-24 { Err(ViewError::UpAlongView) } else { Ok(()) }
}

/// Whether the rows span three dimensions; of a parallel projection, where w is constant, x and y two.
fn independent(x: &[f64; 4], y: &[f64; 4], w: &[f64; 4]) -> bool {
    let [rx, ry, rw] = [x, y, w].map(|row| [row[0], row[1], row[2]]);
    match (unit(rx), unit(ry), unit(rw)) {
        (Some(x), Some(y), Some(w)) => dot(cross(x, y), w).abs() > 1e-12,
        (Some(x), Some(y), None) => w[3] > 0.0 && dot(cross(x, y), cross(x, y)) > 1e-24,
        _ => false,
    }
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

/// The vector of length 1 in the same direction; `None` for zero. Scaled first, so that no square
/// overflows or vanishes.
pub(super) fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return None;
    }
    let scaled = v.map(|c| c / largest);
    let length = dot(scaled, scaled).sqrt();
    Some(scaled.map(|c| c / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(json: &str) -> Result<Camera, String> {
        serde_json::from_str(json).map_err(|error| error.to_string())
    }

    #[test]
    fn the_documented_cameras_are_read_and_written() {
        for json in [
            r#"{"projection":"perspective","position":[80.0,60.0,-200.0],"target":[50.0,47.0,80.0],"up":[0.0,-1.0,0.0],"fov_y_deg":40.0}"#,
            r#"{"projection":"orthographic","position":[50.0,47.0,-10.0],"target":[50.0,47.0,80.0],"up":[0.0,-1.0,0.0],"height":120.0}"#,
            r#"{"projection":"matrix","clip_from_world":[[1.0,0.0,0.0,0.0],[0.0,1.0,0.0,0.0],[0.0,0.0,0.0,0.0],[0.0,0.0,0.0,1.0]]}"#,
        ] {
            assert_eq!(serde_json::to_string(&parse(json).unwrap()).unwrap(), json);
        }
    }

    #[test]
    fn what_cannot_be_looked_through_is_refused_with_the_reason() {
        let p = |position: &str, target: &str, up: &str, fov: &str| {
            parse(&format!(
                r#"{{"projection":"perspective","position":{position},"target":{target},"up":{up},"fov_y_deg":{fov}}}"#
            ))
            .unwrap_err()
        };
        let (o, z, y) = ("[0,0,0]", "[0,0,9]", "[0,1,0]");
        assert!(p(o, o, y, "40").contains("same point"));
        assert!(p(o, z, o, "40").contains("up is zero"));
        assert!(p(o, z, "[0,0,-2]", "40").contains("parallel"));
        for fov in ["0", "-3", "180", "1e300"] {
            assert!(p(o, z, y, fov).contains("fov_y_deg"), "{fov}");
        }
        assert!(p("[null,0,0]", z, y, "40").contains("invalid type"));
        assert!(p("[0,0]", z, y, "40").contains("invalid length"));
        assert!(parse(r#"{"projection":"fisheye"}"#).unwrap_err().contains("fisheye"));
        let extra = r#"{"projection":"orthographic","position":[0,0,0],"target":[0,0,1],"up":[0,1,0],"height":1,"fov":3}"#;
        assert!(parse(extra).unwrap_err().contains("fov"));
        let flat = extra.replace(r#""height":1,"fov":3"#, r#""height":0"#);
        assert!(parse(&flat).unwrap_err().contains("height"));
        let singular = r#"{"projection":"matrix","clip_from_world":[[1,0,0,0],[1,0,0,0],[0,0,0,0],[0,0,1,0]]}"#;
        assert!(parse(singular).unwrap_err().contains("singular"));
        let nan = CameraJson::Orthographic {
            position: [f64::NAN, 0.0, 0.0],
            target: [1.0; 3],
            up: [0.0, 1.0, 0.0],
            height: 1.0,
        };
        assert!(matches!(Camera::new(nan), Err(ViewError::NotFinite { what: "position", .. })));
    }

    #[test]
    fn images_and_boxes_of_nothing_are_refused() {
        let camera = parse(
            r#"{"projection":"orthographic","position":[0,0,0],"target":[0,0,1],"up":[0,1,0],"height":1}"#,
        )
        .unwrap();
        assert!(View::new(camera.clone(), [0, 5]).is_err());
        assert!(View::new(camera, [5, u32::MAX]).is_err());
        assert!(ClipBox::new([0.0; 3], [1.0, 0.0, 1.0]).is_err());
        assert!(ClipBox::new([0.0; 3], [1.0, f64::INFINITY, 1.0]).is_err());
    }

    #[test]
    fn directions_do_not_overflow() {
        assert_eq!(unit([1e300, 0.0, 0.0]), Some([1.0, 0.0, 0.0]));
        assert_eq!(unit([0.0, 1e-300, 0.0]), Some([0.0, 1.0, 0.0]));
        assert_eq!(unit([0.0; 3]), None);
    }
}
