//! Arrays of 16-byte words as textures, some words a line: software drivers read textures much faster than storage buffers.

use super::adapter::Device;
use wgpu::{Extent3d, TextureFormat, TextureUsages, TextureView};

/// A texture of `words`, from left to right and line by line.
pub(super) fn texture_of_words(
    device: &Device,
    label: &str,
    format: TextureFormat,
    words: &[[u8; 16]],
    line: usize,
) -> TextureView {
    let lines = words.len().div_ceil(line).max(1);
    let mut bytes = words.as_flattened().to_vec();
    bytes.resize(16 * line * lines, 0);
    let size = Extent3d { width: line as u32, height: lines as u32, depth_or_array_layers: 1 };
    let texture = device.handle.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(16 * line as u32),
        rows_per_image: None,
    };
    device.queue.write_texture(texture.as_image_copy(), &bytes, layout, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
