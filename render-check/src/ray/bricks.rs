//! The brick pool of those who have no textures: what was uploaded, by slot.

use glam::IVec3;
use octree_store::loader::{Brick, BrickFormat};
use std::sync::Arc;

/// Bricks by slot.
#[derive(Debug, Clone, Default)]
pub(crate) struct Bricks {
    side: i32,
    slots: Vec<Option<Arc<Brick>>>,
}

impl Bricks {
    pub(crate) fn new(side: usize, slots: usize) -> Self {
        Self { side: side as i32, slots: vec![None; slots] }
    }

    pub(crate) fn put(&mut self, slot: u32, brick: Arc<Brick>) {
        if let Some(place) = self.slots.get_mut(slot as usize) {
            *place = Some(brick);
        }
    }

    /// A texel, as a texture of the brick's format gives it.
    pub(crate) fn texel(&self, slot: u32, at: IVec3) -> f32 {
        let index = ((at.z * self.side + at.y) * self.side + at.x) as usize;
        let Some(Some(brick)) = self.slots.get(slot as usize) else { return 0.0 };
        match brick.format {
            BrickFormat::R8 => f32::from(brick.texels[index]) / 255.0,
            BrickFormat::R16 => {
                f32::from(u16::from_le_bytes([
                    brick.texels[2 * index],
                    brick.texels[2 * index + 1],
                ])) / 65535.0
            }
            BrickFormat::R32Float => {
                let at = 4 * index;
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| brick.texels[at + i]);
                f32::from_le_bytes([a, b, c, d])
            }
        }
    }
}
