//! The rays of a view in voxel space, in f64: what the shader's are rounded from, and the reference walks.
//!
//! Samples lie on one grid along each ray: index k lies k steps from where the ray crosses a plane just before the
//! volume, or from the eye if that is nearer. So the grid depends on neither bricks nor levels.

use super::Look;
use glam::DVec3;
use octree_store::loader::{Projection, View};

/// All rays of a view, in voxels of level 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RayGrid {
    pub(crate) size: [u32; 2],
    pub(crate) spacing: DVec3,
    /// Of the image's middle.
    pub(crate) origin: DVec3,
    pub(crate) origin_across: DVec3,
    pub(crate) origin_down: DVec3,
    pub(crate) direction: DVec3,
    pub(crate) direction_across: DVec3,
    pub(crate) direction_down: DVec3,
    /// Lengths of direction between the eye and where rays start.
    pub(crate) plane: f64,
    pub(crate) step_voxels: f64,
    pub(crate) clip_min: DVec3,
    pub(crate) clip_max: DVec3,
    /// The level whose voxels are `accuracy` pixels large is the logarithm of `blend[0] + blend[1] depth`.
    pub(crate) blend: [f64; 2],
}

/// One ray, and what of it lies in the volume.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelRay {
    /// Where index 0 lies, in voxels.
    pub(crate) start: DVec3,
    /// From one index to the next, in voxels.
    pub(crate) step: DVec3,
    /// World length from one index to the next.
    pub(crate) world_per_index: f64,
    /// Direction in the world, of length 1.
    pub(crate) direction: DVec3,
    /// World length between the eye and index 0.
    pub(crate) world_before: f64,
    /// Indices between which the ray is in the volume.
    pub(crate) enter: f64,
    pub(crate) leave: f64,
}

impl RayGrid {
    pub(crate) fn new(view: &View, look: &Look, dims_xyz: [u64; 3], spacing_xyz: [f64; 3]) -> Self {
        let fan = Projection::new(view).fan();
        let spacing = DVec3::from_array(spacing_xyz);
        let dims = DVec3::from_array(dims_xyz.map(|n| n as f64));
        let voxels = |world: [f64; 3]| DVec3::from_array(world) / spacing;
        let middle = view.size.map(|n| f64::from(n) / 2.0);
        let [across, down] = [voxels(fan.origin_across), voxels(fan.origin_down)];
        let [turn_across, turn_down] = [voxels(fan.direction_across), voxels(fan.direction_down)];
        let eye = voxels(fan.origin) + middle[0] * across + middle[1] * down;
        let direction = voxels(fan.direction) + middle[0] * turn_across + middle[1] * turn_down;
        let (clip_min, clip_max) = look.clip.map_or((DVec3::ZERO, dims), |clip| {
            (voxels(clip.min()).max(DVec3::ZERO), voxels(clip.max()).min(dims))
        });
        // All rays gain the same distance from the plane through the eye.
        let normal = if fan.parallel { across.cross(down) } else { turn_across.cross(turn_down) };
        let gain = normal.dot(direction);
        let nearest = (0..8).fold(f64::INFINITY, |nearest, corner| {
            let pick =
                |axis: usize| if corner >> axis & 1 == 0 { clip_min[axis] } else { clip_max[axis] };
            nearest.min(normal.dot(DVec3::new(pick(0), pick(1), pick(2)) - eye) / gain)
        });
        let plane = if nearest.is_finite() { nearest.max(0.0) } else { 0.0 };
        let pixels = (DVec3::from_array(fan.pixels_per_unit) * spacing).max_element();
        let blend = look.accuracy / pixels;
        Self {
            size: view.size,
            spacing,
            origin: eye + plane * direction,
            origin_across: across + plane * turn_across,
            origin_down: down + plane * turn_down,
            direction,
            direction_across: turn_across,
            direction_down: turn_down,
            plane,
            step_voxels: look.step_voxels,
            clip_min,
            clip_max,
            blend: if fan.parallel { [blend, 0.0] } else { [0.0, blend] },
        }
    }

    /// The greatest length of the directions at the image's corners.
    pub(crate) fn longest_direction(&self) -> f64 {
        let [across, down] =
            [(self.size[0], self.direction_across), (self.size[1], self.direction_down)]
                .map(|(pixels, turn)| f64::from(pixels) / 2.0 * turn);
        [across + down, across - down, -across + down, -across - down]
            .map(|turn| (self.direction + turn).length())
            .into_iter()
            .fold(0.0, f64::max)
    }

    /// The ray of a pixel; `None` where it misses the volume. `end` is a world distance from the eye at which it ends.
    pub(crate) fn ray(&self, pixel: [u32; 2], end: f64) -> Option<PixelRay> {
        let [x, y] = [0, 1].map(|i| f64::from(pixel[i]) + 0.5 - f64::from(self.size[i]) / 2.0);
        let start = self.origin + x * self.origin_across + y * self.origin_down;
        let direction = self.direction + x * self.direction_across + y * self.direction_down;
        let step = direction * (self.step_voxels / direction.length());
        let world_per_index = (step * self.spacing).length();
        let world_before = self.plane * (direction * self.spacing).length();
        let (mut enter, mut leave) = (0.0_f64, (end - world_before) / world_per_index);
        for axis in 0..3 {
            let [low, high] = [self.clip_min[axis], self.clip_max[axis]].map(|p| p - start[axis]);
            if step[axis] == 0.0 {
                if low > 0.0 || high <= 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (low / step[axis], high / step[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter < leave).then(|| PixelRay {
            start,
            step,
            world_per_index,
            direction: (step * self.spacing) / world_per_index,
            world_before,
            enter,
            leave,
        })
    }
}
