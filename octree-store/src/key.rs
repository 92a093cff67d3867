//! The name of a node: its level and brick coordinates in one u64.
//!
//! The level stands in the top six bits and the Morton code of the brick coordinates below, so
//! that a level is one contiguous range of keys, and near bricks have near keys. Morton bits are
//! interleaved x lowest: bit 3i is bit i of x, 3i+1 of y, 3i+2 of z.

use std::fmt;

/// Names one brick: a level and brick coordinates, ordered by level, then along the Morton curve.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeKey(u64);

impl NodeKey {
    /// Bits a coordinate has: brick coordinates are below 2^19.
    pub const AXIS_BITS: u32 = 19;
    const LEVEL_SHIFT: u32 = 58;
    const MORTON_MASK: u64 = (1 << (3 * Self::AXIS_BITS)) - 1;

    /// The key of brick `brick_xyz` of level `level`.
    ///
    /// # Panics
    /// When a coordinate is 2^19 or more, or the level 64 or more: [`crate::Geometry`] makes no such
    /// bricks, and keys from outside come through [`NodeKey::from_u64`].
    pub fn new(level: u8, brick_xyz: [u64; 3]) -> Self {
        assert!(level < 64 && brick_xyz.iter().all(|&v| v >> Self::AXIS_BITS == 0));
        let [x, y, z] = brick_xyz.map(spread);
        Self(u64::from(level) << Self::LEVEL_SHIFT | x | y << 1 | z << 2)
    }

    /// The key of these 64 bits, or `None` where no key has them.
    pub fn from_u64(bits: u64) -> Option<Self> {
        let key = Self(bits);
        (bits & !(63 << Self::LEVEL_SHIFT) <= Self::MORTON_MASK).then_some(key)
    }

    /// The 64 bits that the store uses.
    pub fn to_u64(self) -> u64 {
        self.0
    }

    /// The level; 0 is full resolution.
    pub fn level(self) -> u8 {
        (self.0 >> Self::LEVEL_SHIFT) as u8
    }

    /// Brick coordinates within the level.
    pub fn brick_xyz(self) -> [u64; 3] {
        [0, 1, 2].map(|axis| compact(self.0 >> axis))
    }

    /// The node one level up that covers this one.
    #[must_use]
    pub fn parent(self) -> Self {
        Self::new(self.level() + 1, self.brick_xyz().map(|v| v / 2))
    }

    /// Which child of its parent this is: `x + 2y + 4z` of the lowest coordinate bits.
    pub fn octant(self) -> usize {
        (self.0 & 7) as usize
    }

    /// The eight places beneath this node, in octant order; some may lie outside the volume.
    ///
    /// # Panics
    /// At level 0, which has none.
    pub fn children(self) -> [Self; 8] {
        assert!(self.level() > 0, "level 0 has no children");
        let [x, y, z] = self.brick_xyz();
        [0, 1, 2, 3, 4, 5, 6, 7].map(|octant: u64| {
            Self::new(
                self.level() - 1,
                [2 * x + (octant & 1), 2 * y + (octant >> 1 & 1), 2 * z + (octant >> 2)],
            )
        })
    }

    /// The least key of a level.
    pub fn first_of_level(level: u8) -> Self {
        Self(u64::from(level) << Self::LEVEL_SHIFT)
    }

    /// The greatest key of a level.
    pub fn last_of_level(level: u8) -> Self {
        Self(u64::from(level) << Self::LEVEL_SHIFT | Self::MORTON_MASK)
    }
}

impl fmt::Display for NodeKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.brick_xyz();
        write!(f, "level {} brick {x},{y},{z}", self.level())
    }
}

impl fmt::Debug for NodeKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "NodeKey({self})")
    }
}

/// Spreads the low 19 bits so that bit i moves to bit 3i (the "magic numbers" of bit interleaving).
fn spread(v: u64) -> u64 {
    let v = (v | v << 32) & 0x001f_0000_0000_ffff;
    let v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    let v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    let v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// The reverse of [`spread`]; other bits are dropped.
fn compact(v: u64) -> u64 {
    let v = v & (NodeKey::MORTON_MASK & 0x1249_2492_4924_9249);
    let v = (v | v >> 2) & 0x10c3_0c30_c30c_30c3;
    let v = (v | v >> 4) & 0x100f_00f0_0f00_f00f;
    let v = (v | v >> 8) & 0x001f_0000_ff00_00ff;
    let v = (v | v >> 16) & 0x001f_0000_0000_ffff;
    (v | v >> 32) & 0x0007_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bit by bit, as the definition says.
    fn morton_twin(brick_xyz: [u64; 3]) -> u64 {
        let mut code = 0;
        for bit in 0..NodeKey::AXIS_BITS {
            for (axis, v) in brick_xyz.into_iter().enumerate() {
                code |= (v >> bit & 1) << (3 * bit + axis as u32);
            }
        }
        code
    }

    fn coordinates() -> impl Strategy<Value = [u64; 3]> {
        [0_u64..1 << 19, 0_u64..1 << 19, 0_u64..1 << 19]
    }

    proptest! {
        #[test]
        fn coordinates_come_back(level in 0_u8..20, brick in coordinates()) {
            let key = NodeKey::new(level, brick);
            prop_assert_eq!(key.level(), level);
            prop_assert_eq!(key.brick_xyz(), brick);
            prop_assert_eq!(NodeKey::from_u64(key.to_u64()), Some(key));
            prop_assert_eq!(key.to_u64() & NodeKey::MORTON_MASK, morton_twin(brick));
        }

        #[test]
        fn order_is_level_then_morton(
            a in (0_u8..20, coordinates()), b in (0_u8..20, coordinates()),
        ) {
            let by_definition = (a.0, morton_twin(a.1)).cmp(&(b.0, morton_twin(b.1)));
            prop_assert_eq!(NodeKey::new(a.0, a.1).cmp(&NodeKey::new(b.0, b.1)), by_definition);
        }

        #[test]
        fn a_child_knows_its_parent_and_octant(
            level in 1_u8..20, brick in [0_u64..1 << 18, 0_u64..1 << 18, 0_u64..1 << 18],
        ) {
            let key = NodeKey::new(level, brick);
            for (octant, child) in key.children().into_iter().enumerate() {
                prop_assert_eq!(child.parent(), key);
                prop_assert_eq!(child.octant(), octant);
            }
            prop_assert!(key.children().windows(2).all(|pair| pair[0] < pair[1]));
        }
    }

    #[test]
    fn bits_between_level_and_morton_are_refused() {
        assert_eq!(NodeKey::from_u64(1 << 57), None);
        assert_eq!(NodeKey::from_u64(u64::MAX), None);
        assert!(NodeKey::from_u64(NodeKey::last_of_level(63).to_u64()).is_some());
    }

    #[test]
    fn a_level_is_one_range() {
        assert!(NodeKey::new(3, [(1 << 19) - 1; 3]) == NodeKey::last_of_level(3));
        assert!(NodeKey::last_of_level(3) < NodeKey::first_of_level(4));
    }
}
