//! Buffers of one tile of an image, and how results come back.

use super::adapter::Device;
use crate::error::RenderError;
use wgpu::{Buffer, BufferUsages};

/// A ray that goes on in the next dispatch.
pub(super) const STATE_BYTES: u64 = 64;

/// Bytes of the states of a tile: half of what a storage binding may have.
const TILE_BYTES: u64 = 64 << 20;

/// Rows of an image that are drawn at once.
pub(super) fn rows_of_tile(size: [u32; 2]) -> u32 {
    let rows = TILE_BYTES / (STATE_BYTES * u64::from(size[0]));
    rows.clamp(1, u64::from(size[1])) as u32
}

/// Buffers whose size depends on the image.
#[derive(Debug)]
pub(super) struct TileBuffers {
    pub(super) size: [u32; 2],
    pub(super) pixels: u64,
    pub(super) colors: Buffer,
    pub(super) depths: Buffer,
    pub(super) states: Buffer,
}

pub(super) fn buffer(device: &Device, label: &str, size: u64, usage: BufferUsages) -> Buffer {
    device.handle.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: size.max(16).next_multiple_of(4),
        usage,
        mapped_at_creation: false,
    })
}

impl TileBuffers {
    pub(super) fn new(device: &Device, size: [u32; 2]) -> Self {
        let pixels = u64::from(size[0]) * u64::from(rows_of_tile(size));
        let out = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        Self {
            size,
            pixels,
            colors: buffer(device, "colours", 16 * pixels, out),
            depths: buffer(device, "depths", 4 * pixels, out | BufferUsages::COPY_DST),
            states: buffer(device, "states", STATE_BYTES * pixels, BufferUsages::STORAGE),
        }
    }
}

/// Waits for the device, and reads a buffer that it was told to copy to.
pub(super) fn read(device: &Device, buffer: &Buffer, bytes: u64) -> Result<Vec<u8>, RenderError> {
    let failed = |reason: String| RenderError::Driver { doing: "reading a picture", reason };
    let (send, receive) = std::sync::mpsc::sync_channel(1);
    buffer.map_async(wgpu::MapMode::Read, 0..bytes, move |mapped| {
        // Nobody listens any more only if this function has returned.
        let _ = send.send(mapped);
    });
    device
        .handle
        .poll(wgpu::PollType::wait_indefinitely())
        .map_err(|error| failed(error.to_string()))?;
    device.check("drawing")?;
    receive
        .recv()
        .map_err(|error| failed(error.to_string()))?
        .map_err(|error| failed(error.to_string()))?;
    let view = buffer.get_mapped_range(0..bytes).map_err(|error| failed(error.to_string()))?;
    let found = view.to_vec();
    drop(view);
    buffer.unmap();
    Ok(found)
}
