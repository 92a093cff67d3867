//! The spatial index as rays read it: 64 bytes a node.
//!
//! Twin of `node.wgsl`. It is wider than the 2010 text's 192 bits: a node has its brick's place, so that leaves are
//! found by comparing whole numbers, and its values in units of the transfer table.

use crate::view::Look;
use bytemuck::{Pod, Zeroable};
use glam::IVec3;
use octree_store::loader::{IndexNode, NodeData, SpatialIndex};

/// What stands where a pointer leads nowhere.
pub(super) const NO_NODE: u32 = 0xffff_ffff;

pub(super) const HIDDEN: u32 = 0xffff_ffff;
pub(super) const UNIFORM: u32 = 0xffff_fffe;

/// One node.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayNode {
    pub(crate) brick: [i32; 3],
    /// Level in the low byte, the level of its data in the next.
    pub(crate) levels: u32,
    /// Normalised values of texels 0 and 1.
    pub(crate) values: [f32; 2],
    /// A slot, or what it is instead.
    pub(crate) slot: u32,
    pub(crate) parent: u32,
    pub(crate) first_child: u32,
    /// At -x, +x, -y, +y, -z, +z.
    pub(crate) neighbours: [u32; 6],
    pub(crate) padding: u32,
}

/// Packs an index for a look. Texels 0 and 1 of bricks are those values of `float_range`, if there is one.
pub(crate) fn pack(
    index: &SpatialIndex,
    look: &Look,
    float_range: Option<[f64; 2]>,
) -> Vec<RayNode> {
    let range_of = |node: &IndexNode| match (node.data, float_range) {
        (NodeData::Slot(_), Some(range)) => range,
        _ => node.texel_range,
    };
    let pack_node = |(key, node): (&octree_store::NodeKey, &IndexNode)| RayNode {
        brick: key.brick_xyz().map(|b| b as i32),
        levels: u32::from(node.level) | u32::from(node.data_level) << 8,
        values: range_of(node).map(|v| look.normalised(v) as f32),
        slot: match node.data {
            NodeData::Slot(slot) => slot,
            NodeData::Uniform => UNIFORM,
            NodeData::Empty | NodeData::Missing | NodeData::Absent => HIDDEN,
        },
        parent: node.parent,
        first_child: node.first_child,
        neighbours: node.neighbours,
        padding: 0,
    };
    index.keys().iter().zip(index.nodes()).map(pack_node).collect()
}

pub(super) fn level_of(node: &RayNode) -> u32 {
    node.levels & 0xff
}

pub(super) fn data_level_of(node: &RayNode) -> u32 {
    node.levels >> 8
}

/// Voxels of a node's side.
pub(super) fn size_of(node: &RayNode, core: i32) -> i32 {
    core << level_of(node)
}

pub(super) fn corner_of(node: &RayNode, core: i32) -> IVec3 {
    IVec3::from_array(node.brick) * size_of(node, core)
}

/// The corner of the brick that a node shows: its own, or one above it.
pub(super) fn data_corner_of(node: &RayNode, core: i32) -> IVec3 {
    let up = data_level_of(node) - level_of(node);
    (IVec3::from_array(node.brick) >> up) * (core << data_level_of(node))
}
