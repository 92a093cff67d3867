//! How a ray goes through an index: the stackless traversal of the 2008 text (5.2), on the CPU.
//!
//! Down to the leaf where the ray enters; out through the face that it reaches first; by that face's
//! neighbour pointer to the node beyond, and down again. It is what a shader does, and serves those who have none: a server
//! that wants visibility, a test.
//!
//! All decisions compare the ray's parameter with the one at a plane between voxels, each worked out by the
//! same formula. So no position is ever rounded, and rays along faces, edges and through corners visit exactly the
//! leaves that they have a part in. Boxes are half-open: a ray in a face belongs to the box above it.

use super::index::{NO_NODE, SpatialIndex};
use super::projection::Ray;
use crate::geometry::Geometry;
use crate::key::NodeKey;

/// A ray's way through one leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// The leaf's place in the index.
    pub node: u32,
    /// Where the ray enters it, in units of its direction's length.
    pub enter: f64,
    /// Where the ray leaves it; above `enter`.
    pub leave: f64,
}

impl SpatialIndex {
    /// Calls `visit` for every leaf that a ray goes through, in order, until it returns false. The ray is given in voxels of
    /// level 0: voxel (i, j, k) is the box from (i, j, k) to (i + 1, j + 1, k + 1). It begins at its origin.
    pub fn walk(&self, geometry: &Geometry, ray: &Ray, mut visit: impl FnMut(Step) -> bool) {
        let Some(&root) = self.keys().first() else { return };
        let Some((mut enter, end)) = crossing(geometry, root, ray) else { return };
        let nodes = self.nodes();
        let mut at = 0;
        loop {
            while nodes[at as usize].first_child != NO_NODE {
                let octant = octant_at(geometry, self.keys()[at as usize], ray, enter);
                at = nodes[at as usize].first_child + octant;
            }
            let (face, leave) = exit(geometry, self.keys()[at as usize], ray);
            let leave = leave.min(end);
            if leave > enter && !visit(Step { node: at, enter, leave }) {
                return;
            }
            enter = enter.max(leave);
            at = nodes[at as usize].neighbours[face];
            if at == NO_NODE || enter >= end {
                return;
            }
        }
    }

    /// Which eighths of a leaf a ray is in between two of its places: bit `x + 2y + 4z`.
    pub fn octants(&self, geometry: &Geometry, ray: &Ray, step: Step) -> u8 {
        let key = self.keys()[step.node as usize];
        let mut places = [step.enter, step.enter, step.enter, step.enter];
        let mut count = 1;
        for axis in 0..3 {
            let at = parameter(ray, axis, middle(geometry, key, axis));
            if at > step.enter && at < step.leave {
                places[count] = at;
                count += 1;
            }
        }
        places[..count]
            .iter()
            .fold(0, |octants, &place| octants | 1 << octant_at(geometry, key, ray, place))
    }
}

/// Where a ray is inside a node's box, from its own origin on; `None` where it has no part in it.
pub(super) fn crossing(geometry: &Geometry, key: NodeKey, ray: &Ray) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let (low, high) = planes(geometry, key, axis);
        if ray.direction[axis] == 0.0 {
            if !(low..high).contains(&ray.origin[axis]) {
                return None;
            }
            continue;
        }
        let (a, b) = (parameter(ray, axis, low), parameter(ray, axis, high));
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter < leave).then_some((enter, leave))
}

/// The ray's parameter at a plane across an axis.
fn parameter(ray: &Ray, axis: usize, plane: f64) -> f64 {
    (plane - ray.origin[axis]) / ray.direction[axis]
}

/// The planes of a node's faces across an axis, in voxels of level 0.
fn planes(geometry: &Geometry, key: NodeKey, axis: usize) -> (f64, f64) {
    let side = u64::from(geometry.core()) << key.level();
    let low = key.brick_xyz()[axis] * side;
    (low as f64, (low + side).min(geometry.dims_xyz()[axis]) as f64)
}

fn middle(geometry: &Geometry, key: NodeKey, axis: usize) -> f64 {
    let side = u64::from(geometry.core()) << key.level();
    key.brick_xyz()[axis] as f64 * side as f64 + side as f64 / 2.0
}

/// The octant of a node in which a ray is just after a place.
fn octant_at(geometry: &Geometry, key: NodeKey, ray: &Ray, place: f64) -> u32 {
    (0..3).fold(0, |octant, axis| {
        let plane = middle(geometry, key, axis);
        let direction = ray.direction[axis];
        let above = if direction == 0.0 {
            ray.origin[axis] >= plane
        } else {
            (place >= parameter(ray, axis, plane)) == (direction > 0.0)
        };
        octant | u32::from(above) << axis
    })
}

/// The face through which a ray leaves a node (-x, +x, -y, …), and where.
fn exit(geometry: &Geometry, key: NodeKey, ray: &Ray) -> (usize, f64) {
    (0..3).filter(|&axis| ray.direction[axis] != 0.0).fold((0, f64::INFINITY), |first, axis| {
        let (low, high) = planes(geometry, key, axis);
        let up = ray.direction[axis] > 0.0;
        let at = parameter(ray, axis, if up { high } else { low });
        if at < first.1 { (2 * axis + usize::from(up), at) } else { first }
    })
}
