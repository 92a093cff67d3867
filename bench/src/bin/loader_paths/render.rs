//! A renderer that makes no picture: it casts rays for the visibility they find, one for some pixels.

use octree_store::loader::{
    Appearance, Brick, Frame, NodeData, Projection, Ray, SpatialIndex, View,
};
use octree_store::{Geometry, NodeKey};
use std::collections::HashMap;
use std::sync::Arc;

/// Pixels between rays: a brick of 32 voxels at one voxel a pixel is met by dozens; in the largest images by four.
fn stride(view: &View) -> usize {
    (view.size[0] as usize / 256).max(4)
}

/// Samples in a leaf, at most.
const SAMPLES: f64 = 8.0;

/// Where values come from.
pub(crate) enum Volume {
    /// The bricks that were uploaded, by slot.
    Pool(HashMap<u32, (NodeKey, Arc<Brick>)>),
    /// A formula over the unit cube.
    Formula(fn([f64; 3]) -> f64),
}

impl Volume {
    pub(crate) fn take(&mut self, frame: &Frame) {
        if let Self::Pool(pool) = self {
            for upload in &frame.uploads {
                pool.insert(upload.slot, (upload.key, Arc::clone(&upload.brick)));
            }
        }
    }

    fn value(&self, geometry: &Geometry, slot: u32, p: [f64; 3]) -> f64 {
        match self {
            Self::Formula(formula) => formula(p.map(|c| c / geometry.dims_xyz()[0] as f64)),
            Self::Pool(pool) => {
                let Some((key, brick)) = pool.get(&slot) else { return 0.0 };
                let (origin, side) = (geometry.sample_origin(*key), geometry.brick_side() as i64);
                let scale = f64::from(1_u32 << key.level());
                let at = [0, 1, 2]
                    .map(|axis| ((p[axis] / scale) as i64 - origin[axis]).clamp(0, side - 1));
                brick.value(((at[2] * side + at[1]) * side + at[0]) as usize)
            }
        }
    }

    /// A byte a node: the octants that rays enter before they end. Spacing is 1.
    pub(crate) fn see(
        &self,
        geometry: &Geometry,
        index: &SpatialIndex,
        view: &View,
        appearance: &Appearance,
    ) -> Vec<u8> {
        let projection = Projection::new(view);
        let mut seen = vec![0; index.nodes().len()];
        for y in (0..view.size[1]).step_by(stride(view)) {
            for x in (0..view.size[0]).step_by(stride(view)) {
                let ray = projection.ray([f64::from(x) + 0.5, f64::from(y) + 0.5]);
                self.cast(geometry, index, appearance, &ray, &mut seen);
            }
        }
        seen
    }

    fn cast(
        &self,
        geometry: &Geometry,
        index: &SpatialIndex,
        appearance: &Appearance,
        ray: &Ray,
        seen: &mut [u8],
    ) {
        let Appearance::Transfer(function) = appearance else { return };
        let mut depth = 0.0;
        index.walk(geometry, ray, |mut step| {
            let node = &index.nodes()[step.node as usize];
            let mut at = step.enter;
            if let NodeData::Slot(slot) = node.data {
                let voxel = f64::from(1_u32 << node.data_level);
                let spacing = voxel.max((step.leave - step.enter) / SAMPLES);
                at += spacing / 2.0;
                while at < step.leave && depth < 9.2 {
                    let p = [0, 1, 2].map(|axis| ray.origin[axis] + at * ray.direction[axis]);
                    depth += spacing * function.at(self.value(geometry, slot, p)).1;
                    at += spacing;
                }
            }
            if depth >= 9.2 {
                step.leave = at.min(step.leave);
            }
            seen[step.node as usize] |= index.octants(geometry, ray, step);
            depth < 9.2
        });
    }
}
