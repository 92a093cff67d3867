//! A pixel's ray: where it starts, where its samples lie, and what of it is in the volume.
//!
//! Twin of `ray.wgsl`. A station is an index and a part: whole indices are the grid of samples, and a ray's ends lie
//! between them.

use super::fixed::{Place, place_of, plus, signed, times};
use super::frame::Frame;
use glam::{BVec3, IVec3, Vec3};

#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    /// Of index 0.
    pub(super) start: Place,
    /// From one index to the next: its size, and which way.
    pub(super) stride: Place,
    pub(super) negative: BVec3,
    /// The same in f32.
    pub(super) step: Vec3,
    /// World length from one index to the next.
    pub(super) world: f32,
    /// World length between the eye and index 0.
    pub(super) world_before: f32,
    /// In the world, of length 1.
    pub(super) direction: Vec3,
    /// Depth of index 0, and from one index to the next, in lengths of the frame's direction.
    pub(super) depth: f32,
    pub(super) depth_step: f32,
    /// Indices between which the ray is in the box; leave is not above enter where it misses.
    pub(super) enter: f32,
    pub(super) leave: f32,
}

/// A sample's place along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Station {
    pub(super) index: i32,
    pub(super) part: f32,
}

/// The square of a direction's length below which it is none.
const NOWHERE: f32 = 1e-30;

pub(super) fn ray_of(frame: &Frame, pixel: [u32; 2], end: f32) -> Ray {
    let vec = Vec3::from_array;
    let x = pixel[0] as f32 + 0.5 - frame.size[0] as f32 * 0.5;
    let y = pixel[1] as f32 + 0.5 - frame.size[1] as f32 * 0.5;
    let from_cell =
        vec(frame.origin_frac) + x * vec(frame.origin_across) + y * vec(frame.origin_down);
    let towards =
        vec(frame.direction) + x * vec(frame.direction_across) + y * vec(frame.direction_down);
    let squared = towards.dot(towards);
    let length = squared.sqrt();
    let step = towards * (frame.step_voxels / length);
    let world_step = step * vec(frame.spacing);
    let world = world_step.dot(world_step).sqrt();
    let world_towards = towards * vec(frame.spacing);
    let world_before = frame.plane * world_towards.dot(world_towards).sqrt();
    let origin_cell = IVec3::from_array(frame.origin_cell);
    let low = IVec3::from_array(frame.clip_min_cell).wrapping_sub(origin_cell).as_vec3()
        + vec(frame.clip_min_frac)
        - from_cell;
    let high = IVec3::from_array(frame.clip_max_cell).wrapping_sub(origin_cell).as_vec3()
        + vec(frame.clip_max_frac)
        - from_cell;
    let mut enter = 0.0_f32;
    let mut leave = ((end - world_before) / world).min(2e9);
    for axis in 0..3 {
        if step[axis] == 0.0 {
            if low[axis] > 0.0 || high[axis] <= 0.0 {
                leave = -1.0;
            }
        } else {
            let a = low[axis] / step[axis];
            let b = high[axis] / step[axis];
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
    }
    // A pixel between others that look opposite ways looks nowhere.
    if squared < NOWHERE {
        leave = -1.0;
    }
    let offset = place_of(from_cell);
    Ray {
        // Where the eye is further away than whole numbers reach, the shader's go round.
        start: Place { cell: offset.cell.wrapping_add(origin_cell), frac: offset.frac },
        stride: place_of(step.abs()),
        negative: step.cmplt(Vec3::ZERO),
        step,
        world,
        world_before,
        direction: world_step / world,
        depth: frame.plane,
        depth_step: frame.step_voxels / length,
        enter,
        leave,
    }
}

pub(super) fn station_at(index: f32) -> Station {
    let whole = index.floor();
    Station { index: whole as i32, part: index - whole }
}

pub(super) fn place_at(ray: &Ray, station: Station) -> Place {
    let whole = times(ray.stride, station.index as u32);
    let part = place_of(ray.step.abs() * station.part);
    plus(ray.start, signed(plus(whole, part), ray.negative))
}

/// Indices from one station to another.
pub(super) fn between(from: Station, to: Station) -> f32 {
    (to.index - from.index) as f32 + (to.part - from.part)
}

pub(super) fn is_before(a: Station, b: Station) -> bool {
    a.index < b.index || (a.index == b.index && a.part < b.part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_pixel_that_looks_nowhere_misses_and_its_neighbours_do_not() {
        let frame = Frame {
            size: [3, 1],
            step_voxels: 0.5,
            spacing: [1.0; 3],
            direction_across: [1.0, 0.0, 0.0],
            origin_cell: [4; 3],
            clip_max_cell: [8; 3],
            ..Frame::zeroed()
        };
        let reach = [0, 1, 2].map(|x| {
            let ray = ray_of(&frame, [x, 0], f32::INFINITY);
            (ray.enter, ray.leave)
        });
        assert_eq!(reach, [(0.0, 8.0), (0.0, -1.0), (0.0, 8.0)]);
    }
}
