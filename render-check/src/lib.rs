//! Holds a store's pictures against a reference: a wgpu ray caster that reads the store only as a renderer
//! would, an f64 reference that renders the source itself, and the comparison of the two.
//!
//! [`view`] says what a picture shows; [`transfer`] makes tables of transfer functions; [`mod@reference`] is the truth in
//! f64; [`ray`] holds the shader, and beside each of its files a twin in Rust that does the same in the same order;
//! [`Renderer`] joins a store's loader to a [`Backend`] that draws.

mod backend;
pub mod check;
mod error;
mod finite;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod picture;
pub mod ray;
pub mod reference;
mod renderer;
pub mod transfer;
pub mod view;

pub use backend::{Backend, CpuBackend, Drawing, Drawn};
pub use error::RenderError;
pub use renderer::{Effort, Rendered, Renderer, RendererOptions};
