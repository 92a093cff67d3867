//! A camera that is turned, shifted and brought nearer by hand.
//!
//! It turns about its target, like a ball held by the hand: about the image's own axes, so that nothing is
//! special at the poles.

use octree_store::loader::{Camera, CameraJson, ViewError};

/// A camera in a hand.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct HandCamera {
    fields: CameraJson,
}

/// Right, up and forward of a camera, each of length 1.
struct Axes {
    right: [f64; 3],
    up: [f64; 3],
    forward: [f64; 3],
}

impl HandCamera {
    /// Holds a camera. One that is given as a matrix has no target to turn about, and stays where it is.
    pub(super) fn new(camera: &Camera) -> Self {
        Self { fields: camera.fields().clone() }
    }

    /// The camera as it is now.
    ///
    /// # Errors
    /// When it was moved beyond the numbers.
    pub(super) fn camera(&self) -> Result<Camera, ViewError> {
        Camera::new(self.fields.clone())
    }

    /// Turns it about its target: radians to the right and up, as seen in the image.
    pub(super) fn turn(&mut self, to_right: f64, to_top: f64) {
        let Some(axes) = self.axes() else { return };
        let (CameraJson::Perspective { position, target, up, .. }
        | CameraJson::Orthographic { position, target, up, .. }) = &mut self.fields
        else {
            return;
        };
        let distance = length(difference(*position, *target));
        let about_up = |v| rotated(v, axes.up, to_right);
        let right = about_up(axes.right);
        let about_both = |v| rotated(about_up(v), right, -to_top);
        let backward = unit(about_both(axes.forward.map(|c| -c)));
        *position = [0, 1, 2].map(|i| target[i] + distance * backward[i]);
        *up = unit(about_both(axes.up));
    }

    /// Shifts it within the image's plane, in heights of the image: what lies at the target moves so far to the right and up.
    pub(super) fn pan(&mut self, to_right: f64, to_top: f64) {
        let (Some(axes), height) = (self.axes(), self.height()) else { return };
        let (CameraJson::Perspective { position, target, .. }
        | CameraJson::Orthographic { position, target, .. }) = &mut self.fields
        else {
            return;
        };
        for i in 0..3 {
            let by = -height * (to_right * axes.right[i] + to_top * axes.up[i]);
            position[i] += by;
            target[i] += by;
        }
    }

    /// Brings it nearer: what lies at the target appears `factor` times as large.
    pub(super) fn zoom(&mut self, factor: f64) {
        match &mut self.fields {
            CameraJson::Perspective { position, target, .. } => {
                *position = [0, 1, 2].map(|i| target[i] + (position[i] - target[i]) / factor);
            }
            CameraJson::Orthographic { height, .. } => *height /= factor,
            CameraJson::Matrix { .. } => {}
        }
    }

    /// The image's height at the target, in world units.
    fn height(&self) -> f64 {
        match &self.fields {
            CameraJson::Perspective { position, target, fov_y_deg, .. } => {
                2.0 * length(difference(*position, *target)) * (fov_y_deg.to_radians() / 2.0).tan()
            }
            CameraJson::Orthographic { height, .. } => *height,
            CameraJson::Matrix { .. } => 0.0,
        }
    }

    fn axes(&self) -> Option<Axes> {
        let (CameraJson::Perspective { position, target, up, .. }
        | CameraJson::Orthographic { position, target, up, .. }) = &self.fields
        else {
            return None;
        };
        let forward = unit(difference(*target, *position));
        let right = unit(cross(forward, unit(*up)));
        Some(Axes { right, up: cross(right, forward), forward })
    }
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] - b[i])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = length(v);
    v.map(|c| c / length)
}

/// A vector turned about an axis of length 1 (Rodrigues).
fn rotated(v: [f64; 3], axis: [f64; 3], angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    let across = cross(axis, v);
    let along = dot(axis, v) * (1.0 - cos);
    [0, 1, 2].map(|i| v[i] * cos + across[i] * sin + axis[i] * along)
}

#[cfg(test)]
mod tests {
    use super::*;
    use octree_store::loader::{Projection, View};
    use std::f64::consts::{FRAC_PI_2, TAU};

    fn perspective() -> HandCamera {
        HandCamera::new(
            &Camera::new(CameraJson::Perspective {
                position: [0.0, 0.0, -10.0],
                target: [0.0; 3],
                up: [0.0, -1.0, 0.0],
                fov_y_deg: 90.0,
            })
            .unwrap(),
        )
    }

    /// Where the camera is, and what is up in its image.
    fn place(hand: &HandCamera) -> [[f64; 3]; 2] {
        let CameraJson::Perspective { position, up, .. } = hand.camera().unwrap().fields().clone()
        else {
            panic!("it stays a perspective one")
        };
        [position, up]
    }

    /// Where a point of the world is seen in an image of 200 x 200 pixels: across from the left, down from the top.
    fn seen(hand: &HandCamera, point: [f64; 3]) -> [f64; 2] {
        let view = View::new(hand.camera().unwrap(), [200, 200]).unwrap();
        let fan = Projection::new(&view).fan();
        // The pixel whose ray passes nearest, by search: the slow way, and none of the code under test.
        let mut best = (f64::INFINITY, [0.0; 2]);
        for at in 0..200 * 200 {
            let pixel = [f64::from(at % 200) + 0.5, f64::from(at / 200) + 0.5];
            let along = |base: [f64; 3], across: [f64; 3], down: [f64; 3]| {
                [0, 1, 2].map(|i| base[i] + pixel[0] * across[i] + pixel[1] * down[i])
            };
            let origin = along(fan.origin, fan.origin_across, fan.origin_down);
            let direction = unit(along(fan.direction, fan.direction_across, fan.direction_down));
            let to = difference(point, origin);
            let off = length(cross(to, direction));
            if off < best.0 {
                best = (off, pixel);
            }
        }
        best.1
    }

    #[test]
    fn turning_keeps_the_distance_and_comes_back() {
        let mut hand = perspective();
        let start = place(&hand);
        for _ in 0..360 {
            hand.turn(TAU / 360.0, 0.0);
            let [position, up] = place(&hand);
            assert!((length(position) - 10.0).abs() < 1e-9);
            assert!(dot(unit(position), up).abs() < 1e-9);
        }
        let near = |a: [[f64; 3]; 2], b: [[f64; 3]; 2]| {
            a.as_flattened().iter().zip(b.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-9)
        };
        assert!(near(place(&hand), start), "{:?}", place(&hand));
        // Over the pole and round, where cameras with a fixed up get stuck.
        for _ in 0..4 {
            hand.turn(0.0, FRAC_PI_2);
        }
        assert!(near(place(&hand), start), "{:?}", place(&hand));
        hand.turn(0.0, FRAC_PI_2);
        assert!(!near(place(&hand), start));
    }

    #[test]
    fn what_is_dragged_follows_the_hand() {
        let (middle, near) = ([0.0; 3], [0.0, 0.0, -1.0]);
        let mut hand = perspective();
        // The camera goes left and down when the thing is to turn to the right and up.
        hand.turn(-0.3, -0.2);
        let [x, y] = seen(&hand, near);
        assert!(x > 101.0 && y < 99.0, "the near side goes right and up: {x} {y}");
        let mut hand = perspective();
        hand.pan(0.25, 0.1);
        let [x, y] = seen(&hand, middle);
        assert!((x - 150.0).abs() <= 1.0 && (y - 80.0).abs() <= 1.0, "{x} {y}");
        let mut hand = perspective();
        let [before, _] = seen(&hand, [1.0, 0.0, 0.0]);
        hand.zoom(2.0);
        let [after, _] = seen(&hand, [1.0, 0.0, 0.0]);
        assert!(((after - 100.0) / (before - 100.0) - 2.0).abs() < 0.2, "{before} {after}");
    }

    #[test]
    fn a_matrix_stays_where_it_is() {
        let clip_from_world =
            [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        let mut hand =
            HandCamera::new(&Camera::new(CameraJson::Matrix { clip_from_world }).unwrap());
        let before = hand.clone();
        hand.turn(1.0, 1.0);
        hand.pan(1.0, 1.0);
        hand.zoom(2.0);
        assert_eq!(hand, before);
    }
}
