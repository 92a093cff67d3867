//! The shader on a device, through wgpu.

mod adapter;
mod buffers;
mod draw;
mod lines;
mod pool;
mod shader;

pub use adapter::{AdapterChoice, adapters};
pub use draw::GpuBackend;
pub use shader::{SHADER, Sampling};
