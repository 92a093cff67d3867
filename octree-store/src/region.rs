//! A region of a level, assembled from the cores of the bricks it touches.

use crate::error::StoreError;
use crate::geometry::Region;
use crate::key::NodeKey;
use crate::sample::{Sample, SampleBuffer};
use crate::store::{BrickScratch, Store};
use crate::with_sample_type;

impl Store {
    /// The samples of a region of a level, x fastest.
    ///
    /// # Errors
    /// When the region is empty or leaves the level, the store's samples are not `T`, or a brick
    /// that it touches is damaged.
    pub fn read_region<T: Sample>(&self, level: u8, region: Region) -> Result<Vec<T>, StoreError> {
        self.check_type::<T>()?;
        let geometry = self.geometry();
        let dims_xyz = geometry.dims_at(level);
        if level > geometry.top_level() || !region.lies_within(dims_xyz) {
            let Region { min, max } = region;
            return Err(StoreError::Region { level, min, max, dims_xyz });
        }
        let out_dims = region.dims_xyz().map(|n| n as usize);
        let mut out = vec![T::default(); out_dims.iter().product()];
        let side = geometry.brick_side();
        let mut brick = vec![T::default(); geometry.brick_samples()];
        let mut scratch = BrickScratch::default();
        let first = geometry.brick_of_voxel(level, region.min).brick_xyz();
        let last = geometry.brick_of_voxel(level, region.max.map(|v| v - 1)).brick_xyz();
        for bz in first[2]..=last[2] {
            for by in first[1]..=last[1] {
                for bx in first[0]..=last[0] {
                    let key = NodeKey::new(level, [bx, by, bz]);
                    self.read_brick_core(key, &mut scratch, &mut brick)?;
                    let shared = geometry.core_region(key).intersection(&region);
                    let origin = geometry.sample_origin(key);
                    let at = |axis: usize, v: u64| (v as i64 - origin[axis]) as usize;
                    let out_at = |axis: usize, v: u64| (v - region.min[axis]) as usize;
                    let length = (shared.max[0] - shared.min[0]) as usize;
                    for z in shared.min[2]..shared.max[2] {
                        for y in shared.min[1]..shared.max[1] {
                            let from = (at(2, z) * side + at(1, y)) * side + at(0, shared.min[0]);
                            let to = (out_at(2, z) * out_dims[1] + out_at(1, y)) * out_dims[0]
                                + out_at(0, shared.min[0]);
                            out[to..to + length].copy_from_slice(&brick[from..from + length]);
                        }
                    }
                }
            }
        }
        Ok(out)
    }

    /// The samples of a region of a level, of whatever type the store has.
    ///
    /// # Errors
    /// As [`Store::read_region`].
    pub fn read_region_samples(
        &self,
        level: u8,
        region: Region,
    ) -> Result<SampleBuffer, StoreError> {
        with_sample_type!(self.metadata().sample_type, T => {
            Ok(T::wrap(self.read_region::<T>(level, region)?))
        })
    }
}
