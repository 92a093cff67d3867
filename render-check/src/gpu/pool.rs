//! The brick pool: a 3-D texture cut into slots.

use super::adapter::Device;
use crate::error::RenderError;
use octree_store::loader::{Brick, BrickFormat, Upload};
use std::borrow::Cow;
use wgpu::{Extent3d, Origin3d, TextureFormat};

#[derive(Debug)]
pub(super) struct Pool {
    texture: wgpu::Texture,
    side: u32,
    slots_xyz: [u32; 3],
    slots: u32,
    format: TextureFormat,
}

/// Bricks that are handed to the queue at once: fewer and more were slower.
const BATCH: usize = 64;

impl Pool {
    pub(super) fn new(
        device: &Device,
        bricks: BrickFormat,
        side: usize,
        slots: usize,
    ) -> Result<Self, RenderError> {
        let format = device.pool_format(bricks);
        let side = side as u32;
        let limit = device.handle.limits().max_texture_dimension_3d / side.max(1);
        let grid = grid(slots, limit).ok_or_else(|| RenderError::Adapter {
            adapter: device.name.clone(),
            reason: format!("{slots} bricks of {side} voxels a side do not fit its textures"),
        })?;
        let [width, height, depth_or_array_layers] = grid.map(|n| n * side);
        let texture = device.handle.create_texture(&wgpu::TextureDescriptor {
            label: Some("bricks"),
            size: Extent3d { width, height, depth_or_array_layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        device.check("making the brick pool")?;
        Ok(Self { texture, side, slots_xyz: grid, slots: slots as u32, format })
    }

    pub(super) fn slots_xyz(&self) -> [u32; 3] {
        self.slots_xyz
    }

    pub(super) fn view(&self) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor::default())
    }

    pub(super) fn format(&self) -> TextureFormat {
        self.format
    }

    pub(super) fn upload(&self, device: &Device, uploads: &[Upload]) -> Result<(), RenderError> {
        for batch in uploads.chunks(BATCH) {
            for upload in batch.iter().filter(|upload| upload.slot < self.slots) {
                self.write(device, upload);
            }
            device.queue.submit([]);
        }
        device.check("uploading bricks")
    }

    fn write(&self, device: &Device, upload: &Upload) {
        let [nx, ny, _] = self.slots_xyz;
        let at = [upload.slot % nx, upload.slot / nx % ny, upload.slot / (nx * ny)];
        let [x, y, z] = at.map(|n| n * self.side);
        let texels = texels(&upload.brick, self.format);
        let side = self.side;
        let bytes = texels.len() as u32 / (side * side * side);
        device.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &self.texture,
                mip_level: 0,
                origin: Origin3d { x, y, z },
                aspect: wgpu::TextureAspect::All,
            },
            &texels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(side * bytes),
                rows_per_image: Some(side),
            },
            Extent3d { width: side, height: side, depth_or_array_layers: side },
        );
    }
}

/// Slots along x, y and z, as near to a cube as may be.
fn grid(slots: usize, limit: u32) -> Option<[u32; 3]> {
    let slots = u32::try_from(slots.max(1)).ok()?;
    let x = (f64::from(slots).cbrt().ceil() as u32).clamp(1, limit.max(1));
    let y = (f64::from(slots.div_ceil(x)).sqrt().ceil() as u32).clamp(1, limit.max(1));
    let z = slots.div_ceil(x * y);
    (z <= limit).then_some([x, y, z])
}

/// A brick's texels in the pool's format; the same numbers, if wider.
fn texels(brick: &Brick, format: TextureFormat) -> Cow<'_, [u8]> {
    match (brick.format, format) {
        // 257 c / 65535 = c / 255.
        (BrickFormat::R8, TextureFormat::R16Unorm) => {
            brick.texels.iter().flat_map(|&c| [c, c]).collect()
        }
        (BrickFormat::R8, TextureFormat::R32Float) => {
            brick.texels.iter().flat_map(|&c| (f32::from(c) / 255.0).to_le_bytes()).collect()
        }
        (BrickFormat::R16, TextureFormat::R32Float) => brick
            .texels
            .as_chunks()
            .0
            .iter()
            .flat_map(|&c| (f32::from(u16::from_le_bytes(c)) / 65535.0).to_le_bytes())
            .collect(),
        _ => Cow::Borrowed(&brick.texels),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_slots_have_a_place_and_little_is_wasted() {
        for slots in [1, 2, 9, 65, 1000, 4096, 100_000] {
            let [x, y, z] = grid(slots, 56).unwrap();
            let held = (x * y * z) as usize;
            assert!(held >= slots && [x, y, z].iter().all(|n| *n <= 56), "{slots}: {x} {y} {z}");
            assert!(held <= slots + (x * y) as usize, "{slots}: {x} {y} {z}");
        }
        assert_eq!(grid(56 * 56 * 56 + 1, 56), None);
    }
}
