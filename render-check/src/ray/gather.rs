//! What a segment between two samples adds to a ray: light and extinction, a surface, or a greater value.
//!
//! Twin of `gather.wgsl`.

use super::ray::{Ray, Station, between};
use super::sample::{Leaf, right_level, value_of};
use super::shade::light_at;
use super::trace::{DVR, ISO, Scene, State};
use super::transfer::{Entry, decay, entry_at, mean};
use glam::{Vec3, Vec4Swizzles};

/// Steps that narrow a bracket of a surface, by turns as a chord crosses and in the middle.
const REFINEMENTS: i32 = 6;

/// A segment of a ray within a leaf: its stations, and their places from the corner of the leaf's brick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub(super) from: Station,
    pub(super) to: Station,
    pub(super) at_from: Vec3,
    pub(super) at_to: Vec3,
}

/// The distance from the eye, a share of the way through a segment.
fn distance(ray: &Ray, segment: &Segment, t: f32) -> f32 {
    let index =
        segment.from.index as f32 + segment.from.part + t * between(segment.from, segment.to);
    ray.world_before + index * ray.world
}

fn add_light(
    scene: &Scene,
    leaf: &Leaf,
    ray: &Ray,
    segment: &Segment,
    state: &mut State,
    ends: [&Entry; 2],
) {
    let optics = mean(ends[0], ends[1]);
    if optics.w <= 0.0 {
        return;
    }
    let length = between(segment.from, segment.to) * ray.world;
    let [left, share] = decay(optics.w * length);
    let mut light = optics.xyz();
    if scene.variant.shaded {
        let at = 0.5 * (segment.at_from + segment.at_to);
        let [factor, highlight] =
            light_at(scene, leaf, ray, at, right_level(scene, ray, segment.to));
        light = light * factor + Vec3::splat(optics.w * highlight);
    }
    state.color += (state.left * length * share) * light;
    let taken = state.left * length * share * optics.w;
    if state.alpha < 0.5 && state.alpha + taken >= 0.5 {
        state.depth = distance(ray, segment, (0.5 - state.alpha) / taken);
    }
    state.alpha += taken;
    state.left *= left;
}

fn find_surface(
    scene: &Scene,
    leaf: &Leaf,
    ray: &Ray,
    segment: &Segment,
    state: &mut State,
    value: f32,
) {
    let mut low = 0.0_f32;
    let mut high = 1.0_f32;
    let mut below = state.value - scene.frame.isovalue;
    let mut beyond = value - scene.frame.isovalue;
    if below * beyond > 0.0 || below == beyond {
        return;
    }
    let level = right_level(scene, ray, segment.to);
    let mut t = below / (below - beyond);
    for i in 0..REFINEMENTS {
        let at = segment.at_from + t * (segment.at_to - segment.at_from);
        let found = value_of(scene, leaf, at, level) - scene.frame.isovalue;
        if found * below <= 0.0 {
            high = t;
            beyond = found;
        } else {
            low = t;
            below = found;
        }
        t = 0.5 * (low + high);
        if i % 2 == 1 && below != beyond {
            t = low + (high - low) * (below / (below - beyond));
        }
    }
    let mut color = Vec3::from_array(scene.frame.surface);
    if scene.variant.shaded {
        let at = segment.at_from + t * (segment.at_to - segment.at_from);
        let [factor, highlight] = light_at(scene, leaf, ray, at, level);
        color = color * factor + Vec3::splat(highlight);
    }
    state.color = color;
    state.alpha = 1.0;
    state.left = 0.0;
    state.depth = distance(ray, segment, t);
}

fn take_greater(ray: &Ray, segment: &Segment, state: &mut State, value: f32) {
    if value > state.best {
        state.best = value;
        state.depth = distance(ray, segment, 1.0);
    }
}

/// Takes the first sample of a stretch.
pub(super) fn begin(
    scene: &Scene,
    ray: &Ray,
    station: Station,
    state: &mut State,
    last: &mut Entry,
    value: f32,
) {
    if scene.variant.mode == DVR {
        *last = entry_at(scene.table, value);
    } else if scene.variant.mode != ISO {
        let at = Segment { from: station, to: station, at_from: Vec3::ZERO, at_to: Vec3::ZERO };
        take_greater(ray, &at, state, value);
    }
    state.value = value;
}

/// Takes the segment from the last sample to one with this value.
pub(super) fn gather(
    scene: &Scene,
    leaf: &Leaf,
    ray: &Ray,
    segment: &Segment,
    state: &mut State,
    last: &mut Entry,
    value: f32,
) {
    if scene.variant.mode == DVR {
        let entry = entry_at(scene.table, value);
        add_light(scene, leaf, ray, segment, state, [last, &entry]);
        *last = entry;
    } else if scene.variant.mode == ISO {
        find_surface(scene, leaf, ray, segment, state, value);
    } else {
        take_greater(ray, segment, state, value);
    }
    state.value = value;
}
