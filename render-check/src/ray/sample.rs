//! Values within bricks, trilinear, and between the levels of a leaf, its parent and its grandparent.
//!
//! Twin of `sample.wgsl`. A level is right where its voxels are `accuracy` pixels large. Between two such depths the two
//! levels are blended, so that no seam shows where leaves of two levels meet (2010 text, sections 3 and 5).

use super::node::{HIDDEN, NO_NODE, RayNode, UNIFORM, data_corner_of, data_level_of};
use super::ray::{Ray, Station};
use super::trace::Scene;
use glam::{IVec3, Vec3};

/// The data of a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Data {
    slot: u32,
    /// In voxels.
    pub(super) corner: IVec3,
    level: u32,
    values: [f32; 2],
    /// Texels a voxel of level 0.
    scale: f32,
}

/// A leaf's data and those of the two nodes above it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leaf {
    pub(super) own: Data,
    up: Data,
    top: Data,
}

fn data_of(scene: &Scene, node: &RayNode) -> Data {
    let level = data_level_of(node);
    Data {
        slot: node.slot,
        corner: data_corner_of(node, scene.frame.core),
        level,
        values: node.values,
        scale: 1.0 / (1_u32 << level) as f32,
    }
}

/// The data above a node, or its own where there are none.
fn above(scene: &Scene, node: &RayNode, own: Data) -> Data {
    if node.parent == NO_NODE {
        return own;
    }
    let parent = &scene.nodes[node.parent as usize];
    if parent.slot == HIDDEN {
        return own;
    }
    data_of(scene, parent)
}

pub(super) fn leaf_of(scene: &Scene, node: &RayNode) -> Leaf {
    let own = data_of(scene, node);
    if !scene.variant.blended || node.parent == NO_NODE {
        return Leaf { own, up: own, top: own };
    }
    let up = above(scene, node, own);
    Leaf { own, up, top: above(scene, &scene.nodes[node.parent as usize], up) }
}

/// Side of a voxel of the leaf's own data, in voxels of level 0.
pub(super) fn voxel_of(leaf: &Leaf) -> f32 {
    (1_u32 << leaf.own.level) as f32
}

/// The level that is right at a station.
pub(super) fn right_level(scene: &Scene, ray: &Ray, station: Station) -> f32 {
    let depth = ray.depth + (station.index as f32 + station.part) * ray.depth_step;
    (scene.frame.blend_offset + scene.frame.blend_slope * depth).max(1e-30).log2()
}

fn texels(scene: &Scene, data: &Data, at: Vec3) -> f32 {
    let last = scene.frame.side - 1.0;
    let below = at.floor().min(Vec3::splat(last - 1.0));
    let t = at - below;
    let i = below.as_ivec3();
    let texel = |x, y, z| scene.bricks.texel(data.slot, i + IVec3::new(x, y, z));
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let x00 = mix(texel(0, 0, 0), texel(1, 0, 0), t.x);
    let x10 = mix(texel(0, 1, 0), texel(1, 1, 0), t.x);
    let x01 = mix(texel(0, 0, 1), texel(1, 0, 1), t.x);
    let x11 = mix(texel(0, 1, 1), texel(1, 1, 1), t.x);
    mix(mix(x00, x10, t.y), mix(x01, x11, t.y), t.z)
}

/// The value of one brick, `at` voxels of level 0 from its corner.
fn sample(scene: &Scene, data: &Data, at: Vec3) -> f32 {
    if data.slot == UNIFORM {
        return data.values[0];
    }
    let scaled = at * data.scale + (scene.frame.overlap - 0.5);
    let texel = texels(scene, data, scaled.clamp(Vec3::ZERO, Vec3::splat(scene.frame.side - 1.0)));
    data.values[0] + texel * (data.values[1] - data.values[0])
}

/// The value of a leaf, `at` voxels from the corner of its own brick.
pub(super) fn value_of(scene: &Scene, leaf: &Leaf, at: Vec3, level: f32) -> f32 {
    let finer = sample(scene, &leaf.own, at);
    let beyond = level - leaf.own.level as f32;
    if !scene.variant.blended || beyond <= 0.0 {
        return finer;
    }
    let at_up = at + (leaf.own.corner - leaf.up.corner).as_vec3();
    let coarser = sample(scene, &leaf.up, at_up);
    if beyond <= 1.0 {
        return finer + (coarser - finer) * beyond;
    }
    let at_top = at + (leaf.own.corner - leaf.top.corner).as_vec3();
    let coarsest = sample(scene, &leaf.top, at_top);
    coarser + (coarsest - coarser) * (beyond - 1.0).min(1.0)
}
