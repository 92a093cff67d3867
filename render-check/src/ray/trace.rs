//! The loop over the leaves that a ray goes through.
//!
//! Twin of `trace.wgsl`. Samples lie on one grid, every 2^level-th index in a leaf. A segment between samples in
//! two leaves belongs to the second; if that one shows nothing, its end is sampled from the first one's overlap, and
//! where a ray comes out of what shows nothing the segment begins in the overlap of the leaf that it enters. So
//! skipping what is empty changes nothing. A uniform leaf is one segment, whatever its size.

use super::bricks::Bricks;
use super::fixed::relative;
use super::frame::{Frame, Variant};
use super::gather::{Segment, begin, gather};
use super::node::{HIDDEN, RayNode, UNIFORM, data_level_of};
use super::ray::{Ray, Station, is_before, place_at, ray_of, station_at};
use super::sample::{Leaf, leaf_of, right_level, value_of};
use super::transfer::{Entry, entry_at};
use super::walk::{descend, exit_index, walk};
use glam::{IVec3, Vec3};
use std::sync::atomic::{AtomicU32, Ordering};

pub(super) const DVR: u32 = 0;
pub(super) const ISO: u32 = 1;
pub(super) const MIP: u32 = 2;

/// A ray that is less transparent than this has ended.
const OPAQUE: f32 = 1e-4;

const OPEN: u32 = 1;

/// All that is bound.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) variant: Variant,
    pub(crate) nodes: &'a [RayNode],
    pub(crate) table: &'a [[[f32; 4]; 3]],
    pub(crate) bricks: &'a Bricks,
    pub(crate) seen: &'a [AtomicU32],
}

/// How far a ray has come.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    pub(super) color: Vec3,
    /// Transmittance.
    pub(super) left: f32,
    pub(super) alpha: f32,
    pub(super) depth: f32,
    /// Greatest value.
    pub(super) best: f32,
    /// Value of the last sample.
    pub(super) value: f32,
    /// Up to where all is gathered; of an open stretch the station of the last sample.
    done_index: i32,
    done_part: f32,
    /// Where the ray is now.
    index: i32,
    part: f32,
    node: u32,
    /// The leaf of the last sample.
    before: u32,
    flags: u32,
}

/// A pixel of the picture: colour times opacity, opacity, and distance from the eye.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Output {
    pub(crate) color: [f32; 4],
    pub(crate) depth: f32,
}

/// The first index that is a multiple of a stride and not below a station.
fn first_from(index: i32, part: f32, stride: i32) -> i32 {
    let whole = if part > 0.0 { index + 1 } else { index };
    (whole + stride - 1) / stride * stride
}

fn stride_of(node: &RayNode) -> i32 {
    if node.slot == UNIFORM { 1 } else { 1 << data_level_of(node) }
}

fn is_hidden(scene: &Scene, node: &RayNode, state: &State) -> bool {
    node.slot == HIDDEN
        || (scene.variant.mode == MIP && node.values[0].max(node.values[1]) <= state.best)
}

fn inside(frame: &Frame, cell: IVec3) -> IVec3 {
    cell.clamp(IVec3::ZERO, IVec3::from_array(frame.dims) - 1)
}

/// A station's place from the corner of a leaf's brick.
fn place_in(leaf: &Leaf, ray: &Ray, station: Station) -> Vec3 {
    relative(place_at(ray, station), leaf.own.corner)
}

/// The segment from the last sample to a station, and the value there.
#[allow(clippy::too_many_arguments, reason = "as its twin has them")]
fn advance(
    scene: &Scene,
    leaf: &Leaf,
    ray: &Ray,
    state: &mut State,
    last: &mut Entry,
    at_from: Vec3,
    station: Station,
    at: Vec3,
) {
    let done = Station { index: state.done_index, part: state.done_part };
    let value = value_of(scene, leaf, at, right_level(scene, ray, station));
    let segment = Segment { from: done, to: station, at_from, at_to: at };
    gather(scene, leaf, ray, &segment, state, last, value);
    state.done_index = station.index;
    state.done_part = station.part;
}

/// Ends an open stretch where nothing is to be seen, from the overlap of the leaf before.
fn close(scene: &Scene, ray: &Ray, state: &mut State, last: &mut Entry, end: Station) {
    let node = &scene.nodes[state.before as usize];
    let stride = stride_of(node);
    let next = Station { index: (state.done_index / stride + 1) * stride, part: 0.0 };
    let station = if is_before(end, next) { end } else { next };
    let leaf = leaf_of(scene, node);
    let done = Station { index: state.done_index, part: state.done_part };
    let (at_from, at) = (place_in(&leaf, ray, done), place_in(&leaf, ray, station));
    advance(scene, &leaf, ray, state, last, at_from, station, at);
    state.flags = 0;
}

/// Begins a stretch, one sample before the first in this leaf.
fn open(
    scene: &Scene,
    leaf: &Leaf,
    ray: &Ray,
    state: &mut State,
    last: &mut Entry,
    before: Station,
) {
    let done = Station { index: state.done_index, part: state.done_part };
    let station = if is_before(done, before) { before } else { done };
    let at = place_in(leaf, ray, station);
    let value = value_of(scene, leaf, at, right_level(scene, ray, station));
    begin(scene, ray, station, state, last, value);
    state.done_index = station.index;
    state.done_part = station.part;
    state.flags = OPEN;
}

/// Goes on with a ray; false where its iterations are used up.
fn trace(scene: &Scene, ray: &Ray, state: &mut State) -> bool {
    let core = scene.frame.core;
    let end = station_at(ray.leave);
    let mut last = entry_at(scene.table, state.value);
    let mut budget = scene.frame.budget;
    while budget > 0 {
        budget -= 1;
        let node = &scene.nodes[state.node as usize];
        scene.seen[state.node as usize].store(1, Ordering::Relaxed);
        let here = Station { index: state.index, part: state.part };
        let place = place_at(ray, here);
        let exit = exit_index(node, core, ray, place, here.index, here.part);
        let ends = exit > end.index;
        if is_hidden(scene, node, state) {
            if state.flags == OPEN {
                close(scene, ray, state, &mut last, end);
            }
        } else {
            let leaf = leaf_of(scene, node);
            let stride = stride_of(node);
            let first = first_from(here.index, here.part, stride);
            if state.flags != OPEN {
                let before = Station { index: first - stride, part: 0.0 };
                open(scene, &leaf, ray, state, &mut last, before);
            }
            state.before = state.node;
            let done = Station { index: state.done_index, part: state.done_part };
            let mut at_from = place_in(&leaf, ray, done);
            // Within a leaf f32 is exact enough: what it adds is lost with the next leaf.
            let at_first = place_in(&leaf, ray, Station { index: first, part: 0.0 });
            let beyond = exit.min(end.index + 1);
            let mut index = first;
            while index < beyond {
                if budget <= 0 {
                    state.index = index;
                    state.part = 0.0;
                    return false;
                }
                budget -= 1;
                let station = Station { index, part: 0.0 };
                if is_before(Station { index: state.done_index, part: state.done_part }, station) {
                    let at = at_first + (index - first) as f32 * ray.step;
                    advance(scene, &leaf, ray, state, &mut last, at_from, station, at);
                    at_from = at;
                    if state.left < OPAQUE {
                        return true;
                    }
                }
                // A uniform leaf needs its first and last sample alone.
                if node.slot == UNIFORM && index < beyond - 1 {
                    index = beyond - 1;
                } else {
                    index += stride;
                }
            }
            if ends && is_before(Station { index: state.done_index, part: state.done_part }, end) {
                let at = place_in(&leaf, ray, end);
                advance(scene, &leaf, ray, state, &mut last, at_from, end, at);
            }
        }
        if ends || state.left < OPAQUE {
            return true;
        }
        state.index = exit;
        state.part = 0.0;
        let next = place_at(ray, Station { index: exit, part: 0.0 });
        state.node = walk(scene.nodes, core, state.node, inside(scene.frame, next.cell));
    }
    false
}

fn start(scene: &Scene, ray: &Ray) -> State {
    let enter = station_at(ray.enter);
    let cell = inside(scene.frame, place_at(ray, enter).cell);
    State {
        color: Vec3::ZERO,
        left: 1.0,
        alpha: 0.0,
        depth: f32::INFINITY,
        best: -1e30,
        value: 0.0,
        done_index: enter.index,
        done_part: enter.part,
        index: enter.index,
        part: enter.part,
        node: descend(scene.nodes, scene.frame.core, 0, cell),
        before: 0,
        flags: 0,
    }
}

fn output(scene: &Scene, state: &State) -> Output {
    if scene.variant.mode == MIP {
        if state.best <= -1e30 {
            return Output { color: [0.0; 4], depth: f32::INFINITY };
        }
        let grey = state.best.clamp(0.0, 1.0);
        return Output { color: [grey, grey, grey, 1.0], depth: state.depth };
    }
    Output { color: state.color.extend(state.alpha).to_array(), depth: state.depth }
}

/// Draws one pixel. `end` is the distance from the eye at which its ray ends.
pub(crate) fn draw_pixel(scene: &Scene, pixel: [u32; 2], end: f32) -> Output {
    let ray = ray_of(scene.frame, pixel, end);
    if ray.leave <= ray.enter || scene.nodes.is_empty() {
        return Output { color: [0.0; 4], depth: f32::INFINITY };
    }
    let mut state = start(scene, &ray);
    // Here dispatches are turns of a loop.
    while !trace(scene, &ray, &mut state) {}
    output(scene, &state)
}
