//! How a volume folds into levels of bricks: pure arithmetic on voxel and brick coordinates.
//!
//! Level 0 is full resolution; level k halves every axis k times, `dims_k = ceil(dims / 2^k)`; the
//! top level is the first that fits one brick. A brick owns a *core* of `core` voxels a side and
//! carries an *overlap* of its neighbours' voxels on every side.

use crate::key::NodeKey;
use thiserror::Error;

/// Why a volume cannot be folded into bricks.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum GeometryError {
    /// A volume without voxels.
    #[error("a volume of {} x {} x {} voxels holds nothing: every dimension must be at least 1",
        dims_xyz[0], dims_xyz[1], dims_xyz[2])]
    Empty {
        /// The dimensions that were asked for, in voxels.
        dims_xyz: [u64; 3],
    },
    /// More voxels than 2^63 - 1, or more bricks along an axis than a key can name.
    #[error("a volume of {} x {} x {} voxels is too large: an axis holds at most {limit} voxels \
        at this brick size, and the volume at most 2^62 voxels", dims_xyz[0], dims_xyz[1], dims_xyz[2])]
    TooLarge {
        /// The dimensions that were asked for, in voxels.
        dims_xyz: [u64; 3],
        /// The most voxels an axis may have.
        limit: u64,
    },
    /// The brick's core is out of range.
    #[error("a brick core of {found} voxels a side cannot be used: it must be even, 8 to 128")]
    Core {
        /// The core that was asked for.
        found: u32,
    },
    /// The brick's overlap is out of range.
    #[error("a brick overlap of {found} voxels cannot be used: it must be 0 to 4")]
    Overlap {
        /// The overlap that was asked for.
        found: u32,
    },
}

/// A half-open box of voxels of one level: `min <= voxel < max`, in x, y, z order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Region {
    /// The first voxel of every axis.
    pub min: [u64; 3],
    /// One past the last voxel of every axis.
    pub max: [u64; 3],
}

impl Region {
    /// The whole of a volume.
    pub fn whole(dims_xyz: [u64; 3]) -> Self {
        Self { min: [0; 3], max: dims_xyz }
    }

    /// Voxels along x, y and z.
    pub fn dims_xyz(&self) -> [u64; 3] {
        [0, 1, 2].map(|axis| self.max[axis].saturating_sub(self.min[axis]))
    }

    /// Voxels in all.
    pub fn voxels(&self) -> u64 {
        self.dims_xyz().iter().product()
    }

    /// Whether it holds at least one voxel and lies inside `dims_xyz`.
    pub fn lies_within(&self, dims_xyz: [u64; 3]) -> bool {
        (0..3).all(|axis| self.min[axis] < self.max[axis] && self.max[axis] <= dims_xyz[axis])
    }

    /// The voxels that two regions share; empty regions have `min == max` on some axis.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        let min = [0, 1, 2].map(|axis| self.min[axis].max(other.min[axis]));
        let max = [0, 1, 2].map(|axis| self.max[axis].min(other.max[axis]).max(min[axis]));
        Self { min, max }
    }
}

/// The folding of one volume: its size, and the size of its bricks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Geometry {
    dims_xyz: [u64; 3],
    core: u32,
    overlap: u32,
}

impl Geometry {
    /// Folds a volume of `dims_xyz` voxels into bricks of `core` voxels a side with `overlap`
    /// voxels of the neighbours around them.
    ///
    /// # Errors
    /// When a dimension is 0, the core is odd or outside 8..=128, the overlap above 4, or the
    /// volume has more bricks along an axis than a [`NodeKey`] can name (2^19), or more than
    /// 2^62 voxels.
    pub fn new(dims_xyz: [u64; 3], core: u32, overlap: u32) -> Result<Self, GeometryError> {
        if !(8..=128).contains(&core) || !core.is_multiple_of(2) {
            return Err(GeometryError::Core { found: core });
        }
        if overlap > 4 {
            return Err(GeometryError::Overlap { found: overlap });
        }
        if dims_xyz.contains(&0) {
            return Err(GeometryError::Empty { dims_xyz });
        }
        let limit = u64::from(core) << NodeKey::AXIS_BITS;
        let voxels = dims_xyz.iter().try_fold(1_u64, |n, &dim| n.checked_mul(dim));
        if dims_xyz.iter().any(|&dim| dim > limit) || voxels.is_none_or(|n| n > 1 << 62) {
            return Err(GeometryError::TooLarge { dims_xyz, limit });
        }
        Ok(Self { dims_xyz, core, overlap })
    }

    /// Voxels of level 0 along x, y, z.
    pub fn dims_xyz(&self) -> [u64; 3] {
        self.dims_xyz
    }

    /// Core voxels along a brick's side.
    pub fn core(&self) -> u32 {
        self.core
    }

    /// Voxels of the neighbours on every side of the core.
    pub fn overlap(&self) -> u32 {
        self.overlap
    }

    /// Samples along a brick's side: core and overlap.
    pub fn brick_side(&self) -> usize {
        (self.core + 2 * self.overlap) as usize
    }

    /// Samples of a brick, overlap included.
    pub fn brick_samples(&self) -> usize {
        self.brick_side().pow(3)
    }

    /// Voxels of level `level` along x, y, z: `ceil(dims / 2^level)`.
    pub fn dims_at(&self, level: u8) -> [u64; 3] {
        self.dims_xyz.map(|dim| ceil_shift(dim, level))
    }

    /// Bricks of level `level` along x, y, z.
    pub fn grid_at(&self, level: u8) -> [u64; 3] {
        self.dims_at(level).map(|dim| dim.div_ceil(u64::from(self.core)))
    }

    /// The coarsest level, which is one brick.
    pub fn top_level(&self) -> u8 {
        // Halving the largest axis' bricks until one is left.
        let bricks = self.grid_at(0).into_iter().fold(1, u64::max);
        bricks.next_power_of_two().trailing_zeros() as u8
    }

    /// The levels, finest first.
    pub fn levels(&self) -> std::ops::RangeInclusive<u8> {
        0..=self.top_level()
    }

    /// Bricks of level `level`.
    pub fn bricks_at(&self, level: u8) -> u64 {
        self.grid_at(level).iter().product()
    }

    /// Bricks of all levels.
    pub fn bricks(&self) -> u64 {
        self.levels().map(|level| self.bricks_at(level)).sum()
    }

    /// The key of the top level's single brick.
    pub fn root(&self) -> NodeKey {
        NodeKey::new(self.top_level(), [0; 3])
    }

    /// Whether the volume has a brick of this key.
    pub fn contains(&self, key: NodeKey) -> bool {
        let grid = self.grid_at(key.level());
        key.level() <= self.top_level() && (0..3).all(|axis| key.brick_xyz()[axis] < grid[axis])
    }

    /// The keys of a level in key order, by descent from the root: few of them are held at once.
    pub fn keys_at(&self, level: u8) -> impl Iterator<Item = NodeKey> + use<> {
        let geometry = *self;
        let mut pending = vec![geometry.root()];
        std::iter::from_fn(move || {
            while let Some(key) = pending.pop() {
                if key.level() == level {
                    return Some(key);
                }
                let children = key.children().into_iter().rev();
                pending.extend(children.filter(|child| geometry.contains(*child)));
            }
            None
        })
    }

    /// The parents of a level's nodes in key order. That of the top level's lies outside the volume.
    pub fn parents_of(&self, level: u8) -> impl Iterator<Item = NodeKey> + use<> {
        let above = (level == self.top_level()).then(|| self.root().parent());
        let within = (level < self.top_level()).then(|| self.keys_at(level + 1));
        above.into_iter().chain(within.into_iter().flatten())
    }

    /// How many of the volume's keys come before this one of them, in key order.
    pub fn rank(&self, key: NodeKey) -> u64 {
        let below: u64 = (0..key.level()).map(|level| self.bricks_at(level)).sum();
        let grid = self.grid_at(key.level());
        let xyz = key.brick_xyz();
        let mut before = 0;
        // The cube that holds the key, halved along every axis until it is the key alone.
        let mut corner = [0; 3];
        for bit in (0..NodeKey::AXIS_BITS).rev() {
            let half = 1 << bit;
            if grid.iter().all(|n| *n <= half) {
                continue;
            }
            let octant = [0, 1, 2].map(|axis| xyz[axis] >> bit & 1);
            let at = |octant: [u64; 3], axis: usize| corner[axis] + half * octant[axis];
            for i in 0..octant[0] + 2 * octant[1] + 4 * octant[2] {
                let earlier = [i & 1, i >> 1 & 1, i >> 2];
                let cells = |axis: usize| grid[axis].saturating_sub(at(earlier, axis)).min(half);
                before += cells(0) * cells(1) * cells(2);
            }
            corner = [0, 1, 2].map(|axis| at(octant, axis));
        }
        below + before
    }

    /// Which of the eight children of `key` exist: bit `x + 2y + 4z` of the octant. Level 0 has none.
    pub fn child_mask(&self, key: NodeKey) -> u8 {
        if key.level() == 0 {
            return 0;
        }
        let children = key.children().into_iter().enumerate();
        children.filter(|&(_, child)| self.contains(child)).fold(0, |mask, (i, _)| mask | 1 << i)
    }

    /// The in-volume core voxels of a brick, in voxels of its own level.
    pub fn core_region(&self, key: NodeKey) -> Region {
        let core = u64::from(self.core);
        let dims = self.dims_at(key.level());
        let min = key.brick_xyz().map(|brick| brick * core);
        Region { min, max: [0, 1, 2].map(|axis| (min[axis] + core).min(dims[axis])) }
    }

    /// The level-local voxel of a brick's first sample; negative where the overlap leaves the volume.
    pub fn sample_origin(&self, key: NodeKey) -> [i64; 3] {
        key.brick_xyz().map(|brick| (brick * u64::from(self.core)) as i64 - i64::from(self.overlap))
    }

    /// The level-0 voxels beneath a brick's in-volume core.
    pub fn voxels_beneath(&self, key: NodeKey) -> u64 {
        let region = self.core_region(key);
        let level = key.level();
        (0..3)
            .map(|axis| {
                (region.max[axis] << level).min(self.dims_xyz[axis]) - (region.min[axis] << level)
            })
            .product()
    }

    /// The brick of level `level` whose core holds a voxel of that level.
    pub fn brick_of_voxel(&self, level: u8, voxel_xyz: [u64; 3]) -> NodeKey {
        NodeKey::new(level, voxel_xyz.map(|v| v / u64::from(self.core)))
    }
}

/// `ceil(value / 2^shift)` without overflow.
fn ceil_shift(value: u64, shift: u8) -> u64 {
    let shift = u32::from(shift);
    if shift >= 64 { 1 } else { (value >> shift) + u64::from(value & ((1 << shift) - 1) != 0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_keys_of_a_level_come_in_order_and_their_parents_once_and_ranks_count_them() {
        for dims in [[1, 1, 1], [40, 33, 20], [100, 8, 300]] {
            let geometry = Geometry::new(dims, 8, 1).unwrap();
            for level in geometry.levels() {
                let keys: Vec<_> = geometry.keys_at(level).collect();
                let below: u64 = (0..level).map(|level| geometry.bricks_at(level)).sum();
                for (before, key) in (below..).zip(&keys) {
                    assert_eq!(geometry.rank(*key), before, "{key}");
                }
                assert_eq!(keys.len() as u64, geometry.bricks_at(level));
                assert!(keys.is_sorted() && keys.iter().all(|key| geometry.contains(*key)));
                let mut parents: Vec<_> = keys.iter().map(|key| key.parent()).collect();
                parents.dedup();
                assert_eq!(geometry.parents_of(level).collect::<Vec<_>>(), parents);
            }
        }
    }
    use proptest::prelude::*;

    #[test]
    fn the_top_level_is_the_first_of_one_brick() {
        for (dims, levels) in [
            ([1, 1, 1], 1),
            ([32, 32, 32], 1),
            ([33, 1, 1], 2),
            ([64, 64, 64], 2),
            ([65, 1, 1], 3),
            ([1024, 1024, 1024], 6),
            ([1, 1, 4096], 8),
        ] {
            let geometry = Geometry::new(dims, 32, 2).unwrap();
            assert_eq!(geometry.levels().count(), levels, "{dims:?}");
            assert_eq!(geometry.bricks_at(geometry.top_level()), 1);
        }
    }

    #[test]
    fn impossible_volumes_and_bricks_are_refused() {
        assert!(matches!(Geometry::new([0, 1, 1], 32, 2), Err(GeometryError::Empty { .. })));
        let huge = Geometry::new([u64::MAX, 1, 1], 32, 2);
        assert!(matches!(huge, Err(GeometryError::TooLarge { .. })));
        let overflow = Geometry::new([1 << 24, 1 << 24, 1 << 24], 32, 2);
        assert!(matches!(overflow, Err(GeometryError::TooLarge { .. })));
        for core in [0, 6, 7, 33, 130] {
            assert!(matches!(Geometry::new([9; 3], core, 2), Err(GeometryError::Core { .. })));
        }
        assert!(matches!(Geometry::new([9; 3], 32, 5), Err(GeometryError::Overlap { .. })));
    }

    proptest! {
        #[test]
        fn levels_nest_and_cover_the_volume_once(
            dims in [1_u64..5000, 1_u64..5000, 1_u64..5000],
            core in (4_u32..=64).prop_map(|half| 2 * half),
        ) {
            let geometry = Geometry::new(dims, core, 2).unwrap();
            for level in geometry.levels() {
                let above = geometry.grid_at(level).map(|n| n.div_ceil(2));
                if level < geometry.top_level() {
                    prop_assert_eq!(geometry.grid_at(level + 1), above);
                }
                // Along each axis the cores are disjoint and their lengths add up to the dimension.
                for axis in 0..3 {
                    let along = (0..geometry.grid_at(level)[axis]).map(|i| {
                        let mut brick = [0; 3];
                        brick[axis] = i;
                        geometry.core_region(NodeKey::new(level, brick)).dims_xyz()[axis]
                    });
                    prop_assert_eq!(along.sum::<u64>(), geometry.dims_at(level)[axis]);
                }
            }
            prop_assert_eq!(geometry.voxels_beneath(geometry.root()), dims.iter().product::<u64>());
        }
    }
}
