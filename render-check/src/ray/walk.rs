//! From leaf to leaf by neighbour pointers, without a stack (2008 text, 5.2; 2010 text, section 5).
//!
//! Twin of `walk.wgsl`. A leaf is left for the first index of the grid beyond it, and that index's place is a whole
//! voxel and a fraction; so which way to go is decided by comparing whole numbers, and rays along faces, edges and
//! through corners need no care.

use super::fixed::{Place, relative};
use super::node::{NO_NODE, RayNode, corner_of, size_of};
use super::ray::Ray;
use glam::IVec3;

/// The leaf beneath a node that holds a voxel.
pub(super) fn descend(nodes: &[RayNode], core: i32, from: u32, cell: IVec3) -> u32 {
    let mut at = from;
    while nodes[at as usize].first_child != NO_NODE {
        let node = &nodes[at as usize];
        let middle = corner_of(node, core) + size_of(node, core) / 2;
        let upper = IVec3::select(cell.cmpge(middle), IVec3::new(1, 2, 4), IVec3::ZERO);
        at = node.first_child + (upper.x + upper.y + upper.z) as u32;
    }
    at
}

/// The leaf that holds a voxel, from any node.
pub(super) fn walk(nodes: &[RayNode], core: i32, from: u32, cell: IVec3) -> u32 {
    let mut at = from;
    // A step to a neighbour never leaves what other axes have reached: three runs of at most as many nodes as lie along an axis.
    for _ in 0..3 * 64 {
        let node = &nodes[at as usize];
        let low = corner_of(node, core);
        let high = low + size_of(node, core);
        let below = cell.cmplt(low);
        let above = cell.cmpge(high);
        if !(below | above).any() {
            return descend(nodes, core, at, cell);
        }
        let axis = if below.x || above.x {
            0
        } else if below.y || above.y {
            1
        } else {
            2
        };
        let face = 2 * axis + usize::from(cell[axis] >= low[axis]);
        let next = node.neighbours[face];
        if next == NO_NODE {
            break;
        }
        at = next;
    }
    descend(nodes, core, 0, cell)
}

/// The first index beyond a node, of a ray that is at `place`, `part` beyond `index`.
pub(super) fn exit_index(
    node: &RayNode,
    core: i32,
    ray: &Ray,
    place: Place,
    index: i32,
    part: f32,
) -> i32 {
    let at = relative(place, corner_of(node, core));
    let size = size_of(node, core) as f32;
    let mut steps = 2e9_f32;
    for axis in 0..3 {
        if ray.step[axis] != 0.0 {
            let face = if ray.step[axis] > 0.0 { size } else { 0.0 };
            steps = steps.min((face - at[axis]) / ray.step[axis]);
        }
    }
    index.saturating_add((part + steps).ceil().clamp(1.0, 1e9) as i32)
}
