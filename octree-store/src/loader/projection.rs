//! What a camera makes of a brick: whether it is in sight, and how large its voxels are in the image.
//!
//! Every camera becomes three rows (x, y, w) of a projection and a plane in front of which things are seen.
//! A voxel's size is that of its longest edge as projected at the image's middle, at the depth of the
//! brick's nearest corner (2008 text, section 4: the set is sorted by decreasing projected size of
//! voxels). So a child's voxels are never larger than its parent's, and order follows refinement.
//! Edges along the view have no length: a stack of thick slices looked at from above is judged by its
//! pixels, not by its gaps.

use super::camera::{Camera, CameraJson, ClipBox, View, cross, difference, dot, unit};
use crate::geometry::Geometry;

/// An affine function of a point: `n . p + d`, with |n| kept for the extent of boxes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Plane {
    n: [f64; 3],
    d: f64,
    n_abs: [f64; 3],
}

impl Plane {
    fn new(row: [f64; 4]) -> Self {
        let n = [row[0], row[1], row[2]];
        Self { n, d: row[3], n_abs: n.map(f64::abs) }
    }

    /// Least and greatest value over a box.
    #[inline]
    fn over(&self, centre: [f64; 3], half: [f64; 3]) -> (f64, f64) {
        let (middle, extent) = (dot(self.n, centre) + self.d, dot(self.n_abs, half));
        (middle - extent, middle + extent)
    }
}

/// A ray in world units; `direction` has length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: [f64; 3],
    /// Where it goes.
    pub direction: [f64; 3],
}

/// The rays of a view as linear functions of the point in the image, in world units: at (x, y), in pixels from the top
/// left corner, a ray starts at `origin + x origin_across + y origin_down`; its direction, of no particular
/// length, is made likewise. Of rays that meet, directions gain 1 in depth; parallel ones have length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayFan {
    /// Where the ray of the image's top left corner starts.
    pub origin: [f64; 3],
    /// What a pixel to the right adds.
    pub origin_across: [f64; 3],
    /// What a pixel downwards adds.
    pub origin_down: [f64; 3],
    /// Where the ray of the top left corner goes.
    pub direction: [f64; 3],
    /// What a pixel to the right adds.
    pub direction_across: [f64; 3],
    /// What a pixel downwards adds.
    pub direction_down: [f64; 3],
    /// Pixels that an edge of length 1 along each axis covers in the middle of the image: at depth 1, or of parallel rays at any.
    pub pixels_per_unit: [f64; 3],
    /// Whether all rays have one direction.
    pub parallel: bool,
}

/// A view ready for use.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection {
    size: [f64; 2],
    row_x: [f64; 4],
    row_y: [f64; 4],
    row_w: [f64; 4],
    /// The four sides of the image.
    sides: [Plane; 4],
    /// Where things are seen; also the depth that sizes are divided by, unless rays are parallel.
    front: Plane,
    /// Where a parallel camera's rays start; `None` where rays meet.
    parallel_forward: Option<[f64; 3]>,
}

impl Projection {
    /// The projection of a view.
    pub fn new(view: &View) -> Self {
        let size = view.size.map(f64::from);
        let aspect = size[0] / size[1];
        let (row_x, row_y, row_w, front, forward) = match view.camera.fields() {
            CameraJson::Perspective { position, target, up, fov_y_deg } => {
                let [right, up, forward] = axes(*position, *target, *up);
                let t = (fov_y_deg.to_radians() / 2.0).tan();
                let row = |axis: [f64; 3], scale: f64| from(*position, axis, scale);
                let depth = row(forward, 1.0);
                (row(right, 1.0 / (t * aspect)), row(up, 1.0 / t), depth, depth, None)
            }
            CameraJson::Orthographic { position, target, up, height } => {
                let [right, up, forward] = axes(*position, *target, *up);
                let row = |axis: [f64; 3], scale: f64| from(*position, axis, scale);
                let across = (row(right, 2.0 / (height * aspect)), row(up, 2.0 / height));
                let one = [0.0, 0.0, 0.0, 1.0];
                (across.0, across.1, one, row(forward, 1.0), Some(forward))
            }
            CameraJson::Matrix { clip_from_world: [x, y, _, w] } => {
                let three = |row: &[f64; 4]| [row[0], row[1], row[2]];
                let parallel = unit(three(w)).is_none();
                // Looking from +z to -z with x to the right and y up: forward = y x x.
                let forward = parallel.then(|| unit(cross(three(y), three(x)))).flatten();
                let front = if parallel { [0.0, 0.0, 0.0, 1.0] } else { *w };
                (*x, *y, *w, front, forward)
            }
        };
        let side =
            |row: [f64; 4], sign: f64| Plane::new([0, 1, 2, 3].map(|i| row_w[i] + sign * row[i]));
        Self {
            size,
            row_x,
            row_y,
            row_w,
            sides: [side(row_x, 1.0), side(row_x, -1.0), side(row_y, 1.0), side(row_y, -1.0)],
            front: Plane::new(front),
            parallel_forward: forward,
        }
    }

    /// The ray through a point of the image, in pixels from the top left corner; pixel (i, j) has its
    /// centre at (i + 0.5, j + 0.5).
    pub fn ray(&self, pixel: [f64; 2]) -> Ray {
        let x = 2.0 * pixel[0] / self.size[0] - 1.0;
        let y = 1.0 - 2.0 * pixel[1] / self.size[1];
        let three = |row: &[f64; 4]| [row[0], row[1], row[2]];
        let (rx, ry, rw) = (three(&self.row_x), three(&self.row_y), three(&self.row_w));
        // The point where three planes a . p = b meet.
        let meet = |a: [[f64; 3]; 3], b: [f64; 3]| {
            let c = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])];
            let det = dot(a[0], c[0]);
            [0, 1, 2].map(|i| (b[0] * c[0][i] + b[1] * c[1][i] + b[2] * c[2][i]) / det)
        };
        if let Some(forward) = self.parallel_forward {
            let w = self.row_w[3];
            let start = if self.front.n == [0.0; 3] { 0.0 } else { -self.front.d };
            let right = [x * w - self.row_x[3], y * w - self.row_y[3], start];
            return Ray { origin: meet([rx, ry, forward], right), direction: forward };
        }
        let eye = meet([rx, ry, rw], [-self.row_x[3], -self.row_y[3], -self.row_w[3]]);
        let along = |row: [f64; 3], at: f64| [0, 1, 2].map(|i| row[i] - at * rw[i]);
        let direction = unit(cross(along(rx, x), along(ry, y))).unwrap_or(rw);
        let ahead = if dot(direction, rw) < 0.0 { direction.map(|c| -c) } else { direction };
        Ray { origin: eye, direction: ahead }
    }

    /// All rays at once: where they start and where they go, as linear functions of the pixel.
    pub fn fan(&self) -> RayFan {
        let three = |row: &[f64; 4]| [row[0], row[1], row[2]];
        let (rx, ry, rw) = (three(&self.row_x), three(&self.row_y), three(&self.row_w));
        let scaled = |v: [f64; 3], by: f64| v.map(|c| c * by);
        let [w, h] = self.size;
        let fan = RayFan {
            origin: self.ray([0.0, 0.0]).origin,
            origin_across: [0.0; 3],
            origin_down: [0.0; 3],
            direction: [0.0; 3],
            direction_across: [0.0; 3],
            direction_down: [0.0; 3],
            pixels_per_unit: self.pixels_per_unit(),
            parallel: self.parallel_forward.is_some(),
        };
        if let Some(forward) = self.parallel_forward {
            let (across, down) = (cross(ry, forward), cross(forward, rx));
            let size = self.row_w[3] / dot(rx, across);
            return RayFan {
                origin_across: scaled(across, 2.0 * size / w),
                origin_down: scaled(down, -2.0 * size / h),
                direction: forward,
                pixels_per_unit: scaled(fan.pixels_per_unit, 1.0 / self.row_w[3]),
                ..fan
            };
        }
        // (rx - x rw) x (ry - y rw), scaled so that depth grows by 1.
        let middle = cross(rx, ry);
        let depth = dot(middle, self.front.n);
        let (x_side, y_side) =
            (scaled(cross(rw, ry), -1.0 / depth), scaled(cross(rx, rw), -1.0 / depth));
        let corner = [0, 1, 2].map(|i| middle[i] / depth - x_side[i] + y_side[i]);
        RayFan {
            direction: corner,
            direction_across: scaled(x_side, 2.0 / w),
            direction_down: scaled(y_side, -2.0 / h),
            ..fan
        }
    }

    /// Pixels that an edge of length 1 along each axis covers in the middle of the image, at depth 1.
    fn pixels_per_unit(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| {
            let [w, h] = self.size;
            (self.row_x[axis] * w / 2.0).hypot(self.row_y[axis] * h / 2.0)
        })
    }

    /// The camera as it will be if it goes on as it went from `before` to now, `frames` frames on.
    pub(super) fn ahead(&self, before: &Self, frames: f64) -> Option<Self> {
        if self.size != before.size
            || self.parallel_forward.is_some() != before.parallel_forward.is_some()
        {
            return None;
        }
        let go = |now: &[f64; 4], then: &[f64; 4]| {
            [0, 1, 2, 3].map(|i| now[i] + frames * (now[i] - then[i]))
        };
        let plane = |now: &Plane, then: &Plane| {
            let row = |p: &Plane| [p.n[0], p.n[1], p.n[2], p.d];
            Plane::new(go(&row(now), &row(then)))
        };
        Some(Self {
            size: self.size,
            row_x: go(&self.row_x, &before.row_x),
            row_y: go(&self.row_y, &before.row_y),
            row_w: go(&self.row_w, &before.row_w),
            sides: [0, 1, 2, 3].map(|i| plane(&self.sides[i], &before.sides[i])),
            front: plane(&self.front, &before.front),
            parallel_forward: self.parallel_forward,
        })
    }
}

/// Right, up and forward of a checked camera, each of length 1.
fn axes(position: [f64; 3], target: [f64; 3], up: [f64; 3]) -> [[f64; 3]; 3] {
    const CHECKED: &str = "cameras are checked when they are made";
    let forward = unit(difference(target, position)).expect(CHECKED);
    let right = unit(cross(forward, unit(up).expect(CHECKED))).expect(CHECKED);
    [right, cross(right, forward), forward]
}

/// The row of `scale * axis . (p - position)`.
fn from(position: [f64; 3], axis: [f64; 3], scale: f64) -> [f64; 4] {
    let [x, y, z] = axis.map(|c| c * scale);
    [x, y, z, -dot([x, y, z], position)]
}

/// All views of a frame, over one volume.
#[derive(Debug, Clone)]
pub struct ViewSet {
    views: Vec<Projection>,
    /// For each view, the projected size of a level-0 voxel at depth 1.
    voxel_pixels: Vec<f64>,
    clip: Option<ClipBox>,
    /// World size of a level-0 brick's core, and of the volume.
    brick_size: [f64; 3],
    volume_size: [f64; 3],
}

impl ViewSet {
    /// Views of a volume with the given folding and spacing, of which only `clip` is shown.
    pub fn new(
        views: &[View],
        clip: Option<ClipBox>,
        geometry: &Geometry,
        spacing_xyz: [f64; 3],
    ) -> Self {
        Self::of_projections(
            views.iter().map(Projection::new).collect(),
            clip,
            geometry,
            spacing_xyz,
        )
    }

    pub(super) fn of_projections(
        views: Vec<Projection>,
        clip: Option<ClipBox>,
        geometry: &Geometry,
        spacing_xyz: [f64; 3],
    ) -> Self {
        let longest = |view: &Projection| {
            let pixels = view.pixels_per_unit();
            (0..3).fold(0.0_f64, |most, axis| most.max(pixels[axis] * spacing_xyz[axis]))
        };
        let dims = geometry.dims_xyz();
        Self {
            voxel_pixels: views.iter().map(longest).collect(),
            views,
            clip,
            brick_size: spacing_xyz.map(|s| s * f64::from(geometry.core())),
            volume_size: [0, 1, 2].map(|axis| dims[axis] as f64 * spacing_xyz[axis]),
        }
    }

    /// The views.
    pub fn projections(&self) -> &[Projection] {
        &self.views
    }

    /// The core of a brick as a box in world units: its lower and upper corner.
    pub fn world_box(&self, level: u8, brick_xyz: [u32; 3]) -> ([f64; 3], [f64; 3]) {
        let scale = (1_u64 << level) as f64;
        let size = self.brick_size.map(|s| s * scale);
        let min = [0, 1, 2].map(|axis| f64::from(brick_xyz[axis]) * size[axis]);
        (min, [0, 1, 2].map(|axis| (min[axis] + size[axis]).min(self.volume_size[axis])))
    }

    /// The greatest projected size of a brick's voxels in pixels, over the views that may see
    /// it; infinite where an eye is in it or beside it, `None` where no view sees it.
    #[inline]
    pub fn voxel_size(&self, level: u8, brick_xyz: [u32; 3]) -> Option<f32> {
        let (mut min, mut max) = self.world_box(level, brick_xyz);
        if let Some(clip) = &self.clip {
            for axis in 0..3 {
                // A box that only touches shows nothing.
                if min[axis] >= clip.max()[axis] || max[axis] <= clip.min()[axis] {
                    return None;
                }
                min[axis] = min[axis].max(clip.min()[axis]);
                max[axis] = max[axis].min(clip.max()[axis]);
            }
        }
        let centre = [0, 1, 2].map(|axis| f64::midpoint(min[axis], max[axis]));
        let half = [0, 1, 2].map(|axis| (max[axis] - min[axis]) / 2.0);
        let scale = (1_u64 << level) as f64;
        let mut largest = None;
        for (view, voxel_pixels) in self.views.iter().zip(&self.voxel_pixels) {
            let (nearest, farthest) = view.front.over(centre, half);
            if farthest < 0.0 || view.sides.iter().any(|side| side.over(centre, half).1 < 0.0) {
                continue;
            }
            let depth = if view.parallel_forward.is_some() { view.row_w[3] } else { nearest };
            let pixels =
                if depth > 0.0 { voxel_pixels * scale / depth } else { f64::INFINITY } as f32;
            largest = Some(largest.map_or(pixels, |most: f32| most.max(pixels)));
        }
        largest
    }

    /// The longest side of a brick in world units: how far a ray may go through it.
    pub(super) fn brick_length(&self, level: u8) -> f64 {
        self.brick_size.into_iter().fold(0.0, f64::max) * (1_u64 << level) as f64
    }
}

/// A camera's view that cannot fail, for callers who have checked both already.
impl From<&View> for Projection {
    fn from(view: &View) -> Self {
        Self::new(view)
    }
}

/// A square matrix camera for a perspective: what off-axis displays are made of.
///
/// `left`, `right`, `bottom` and `top` are the sides of the window at distance 1 before the eye at
/// `position`, looking along -z.
///
/// # Errors
/// When the window is empty or a number is not finite.
pub fn off_axis(
    position: [f64; 3],
    [left, right]: [f64; 2],
    [bottom, top]: [f64; 2],
) -> Result<Camera, super::ViewError> {
    let (w, h) = (right - left, top - bottom);
    let x = [2.0 / w, 0.0, (right + left) / w, 0.0];
    let y = [0.0, 2.0 / h, (top + bottom) / h, 0.0];
    let depth = [0.0, 0.0, -1.0, 0.0];
    let at = |row: [f64; 4]| {
        let n = [row[0], row[1], row[2]];
        [n[0], n[1], n[2], row[3] - dot(n, position)]
    };
    Camera::new(CameraJson::Matrix { clip_from_world: [at(x), at(y), [0.0; 4], at(depth)] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn perspective(position: [f64; 3], target: [f64; 3], fov_y_deg: f64) -> Camera {
        let up = [0.1, 1.0, 0.05];
        Camera::new(CameraJson::Perspective { position, target, up, fov_y_deg }).unwrap()
    }

    fn orthographic(position: [f64; 3], target: [f64; 3], height: f64) -> Camera {
        let up = [0.1, 1.0, 0.05];
        Camera::new(CameraJson::Orthographic { position, target, up, height }).unwrap()
    }

    fn set(camera: Camera, spacing_xyz: [f64; 3]) -> ViewSet {
        let geometry = Geometry::new([256; 3], 32, 2).unwrap();
        ViewSet::new(&[View::new(camera, [200, 100]).unwrap()], None, &geometry, spacing_xyz)
    }

    #[test]
    fn a_voxel_at_unit_distance_has_the_size_that_geometry_gives() {
        // 90 degrees: the image of 100 pixels is 2 d high at distance d.
        let views = set(perspective([16.0, 16.0, -68.0], [16.0, 16.0, 0.0], 90.0), [1.0; 3]);
        let up_tilt = 1.0; // x and y are in the image's plane
        let size = f64::from(views.voxel_size(0, [0, 0, 0]).unwrap());
        assert!((size - up_tilt * 100.0 / (2.0 * 68.0)).abs() < 1e-6, "{size}");
        // Twice as large on the next level, at the same nearest depth.
        let above = f64::from(views.voxel_size(1, [0, 0, 0]).unwrap());
        assert!((above - 2.0 * size).abs() < 1e-6);
        let parallel = set(orthographic([16.0, 16.0, -9.0], [16.0, 16.0, 0.0], 50.0), [1.0; 3]);
        assert_eq!(parallel.voxel_size(0, [0, 0, 0]), Some(2.0));
    }

    #[test]
    fn edges_along_the_view_have_no_length() {
        let along =
            set(orthographic([50.0, 50.0, -9.0], [50.0, 50.0, 0.0], 50.0), [1.0, 1.0, 100.0]);
        assert_eq!(along.voxel_size(0, [0, 0, 0]), Some(2.0));
        let across =
            set(orthographic([-9.0, 50.0, 50.0], [0.0, 50.0, 50.0], 50.0), [1.0, 1.0, 100.0]);
        assert!((across.voxel_size(0, [0, 1, 0]).unwrap() - 200.0).abs() < 1e-3);
    }

    #[test]
    fn what_is_behind_beside_or_clipped_is_not_seen() {
        let camera = perspective([128.0, 128.0, 100.0], [128.0, 128.0, 200.0], 30.0);
        let views = set(camera.clone(), [1.0; 3]);
        assert_eq!(views.voxel_size(0, [3, 3, 0]), None, "behind");
        assert_eq!(views.voxel_size(0, [0, 0, 4]), None, "beside");
        assert_eq!(views.voxel_size(0, [3, 3, 3]), Some(f32::INFINITY), "around the eye");
        assert!(views.voxel_size(0, [4, 4, 7]).is_some());
        let geometry = Geometry::new([256; 3], 32, 2).unwrap();
        let clip = ClipBox::new([0.0; 3], [256.0, 256.0, 224.0]).unwrap();
        let view = View::new(camera, [200, 100]).unwrap();
        let views = ViewSet::new(&[view], Some(clip), &geometry, [1.0; 3]);
        assert_eq!(views.voxel_size(0, [4, 4, 7]), None, "clipped");
        assert!(views.voxel_size(0, [4, 4, 6]).is_some());
    }

    #[test]
    fn what_lies_beyond_any_side_of_the_image_is_not_seen() {
        let views = set(perspective([128.0, 128.0, -20.0], [128.0, 128.0, 200.0], 30.0), [1.0; 3]);
        assert!(views.voxel_size(0, [4, 4, 0]).is_some());
        for beyond in [[0, 4, 0], [7, 4, 0], [4, 0, 0], [4, 7, 0]] {
            assert_eq!(views.voxel_size(0, beyond), None, "{beyond:?}");
        }
    }

    #[test]
    fn several_views_take_the_finest() {
        let geometry = Geometry::new([256; 3], 32, 2).unwrap();
        let near = View::new(perspective([16.0, 16.0, -20.0], [16.0, 16.0, 0.0], 40.0), [100; 2]);
        let far = View::new(perspective([16.0, 16.0, -900.0], [16.0, 16.0, 0.0], 40.0), [100; 2]);
        let (near, far) = (near.unwrap(), far.unwrap());
        let size = |views: &[View]| {
            ViewSet::new(views, None, &geometry, [1.0; 3]).voxel_size(0, [0, 0, 0])
        };
        assert_eq!(size(&[far.clone(), near.clone()]), size(std::slice::from_ref(&near)));
        assert!(size(&[far]) < size(&[near]));
    }

    #[test]
    fn an_off_axis_window_in_the_middle_is_the_symmetric_camera() {
        let t = 20_f64.to_radians().tan();
        let matrix = off_axis([3.0, 4.0, 300.0], [-2.0 * t, 2.0 * t], [-t, t]).unwrap();
        let plain = Camera::new(CameraJson::Perspective {
            position: [3.0, 4.0, 300.0],
            target: [3.0, 4.0, 0.0],
            up: [0.0, 1.0, 0.0],
            fov_y_deg: 40.0,
        })
        .unwrap();
        let (a, b) = (set(matrix, [1.0; 3]), set(plain, [1.0; 3]));
        for brick in 0..512_u32 {
            let at = [brick % 8, brick / 8 % 8, brick / 64];
            match (a.voxel_size(0, at), b.voxel_size(0, at)) {
                (Some(x), Some(y)) => assert!((x - y).abs() <= 1e-5 * y, "{at:?}"),
                (x, y) => assert_eq!(x, y, "{at:?}"),
            }
        }
        let (p, q) = (a.projections()[0].ray([20.0, 30.0]), b.projections()[0].ray([20.0, 30.0]));
        for axis in 0..3 {
            assert!((p.origin[axis] - q.origin[axis]).abs() < 1e-9);
            assert!((p.direction[axis] - q.direction[axis]).abs() < 1e-9);
        }
    }

    proptest! {
        /// Rays and planes must tell the same story: a point on a ray of the image is never in a brick that the planes
        /// call out of sight; and its pixel is where its ray started.
        #[test]
        fn no_brick_on_a_ray_is_out_of_sight(
            position in [-300.0..500.0, -300.0..500.0, -300.0..500.0_f64],
            target in [0.0..256.0, 0.0..256.0, 0.0..256.0_f64],
            pixel in [0.0..200.0, 0.0..100.0_f64], fov in 1.0..150.0_f64, parallel in any::<bool>(),
        ) {
            prop_assume!(unit(difference(target, position)).is_some());
            let camera = if parallel {
                orthographic(position, target, fov)
            } else {
                perspective(position, target, fov)
            };
            let views = set(camera, [1.0; 3]);
            let ray = views.projections()[0].ray(pixel);
            for step in 1..900 {
                let p = [0, 1, 2].map(|axis| ray.origin[axis] + f64::from(step) * ray.direction[axis]);
                if p.iter().all(|c| (0.0..256.0).contains(c)) {
                    let brick = p.map(|c| (c / 32.0) as u32);
                    prop_assert!(views.voxel_size(0, brick).is_some(), "{:?}", brick);
                }
            }
        }

        /// The fan of rays is the rays, whatever the projection.
        #[test]
        fn a_fan_has_the_rays_of_all_pixels(
            position in [-300.0..500.0, -300.0..500.0, -300.0..500.0_f64],
            target in [0.0..256.0, 0.0..256.0, 0.0..256.0_f64],
            pixel in [0.0..200.0, 0.0..100.0_f64], fov in 1.0..150.0_f64, parallel in any::<bool>(),
        ) {
            prop_assume!(unit(difference(target, position)).is_some());
            let camera = if parallel {
                orthographic(position, target, fov)
            } else {
                perspective(position, target, fov)
            };
            let views = set(camera, [1.0; 3]);
            let projection = &views.projections()[0];
            let (fan, ray) = (projection.fan(), projection.ray(pixel));
            let at = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
                [0, 1, 2].map(|i| a[i] + pixel[0] * b[i] + pixel[1] * c[i])
            };
            let origin = at(fan.origin, fan.origin_across, fan.origin_down);
            let direction = at(fan.direction, fan.direction_across, fan.direction_down);
            let direction = unit(direction).unwrap();
            for axis in 0..3 {
                prop_assert!((origin[axis] - ray.origin[axis]).abs() < 1e-7);
                prop_assert!((direction[axis] - ray.direction[axis]).abs() < 1e-9);
            }
            prop_assert_eq!(fan.parallel, parallel);
        }

        #[test]
        fn a_childs_voxels_are_at_most_as_large_as_its_parents(
            position in [-300.0..500.0, -300.0..500.0, -300.0..500.0_f64],
            fov in 1.0..150.0_f64, brick in [0_u32..8, 0_u32..8, 0_u32..8],
        ) {
            let views = set(perspective(position, [128.0, 128.0, 128.5], fov), [1.0, 0.5, 3.0]);
            if let Some(size) = views.voxel_size(0, brick) {
                let parent = views.voxel_size(1, brick.map(|b| b / 2));
                prop_assert!(parent.is_some_and(|parent| parent >= size), "{size} {parent:?}");
            }
        }
    }
}
