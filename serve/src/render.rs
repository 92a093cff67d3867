//! Where a renderer can be plugged in: the server itself draws nothing.

use octree_store::Store;
use octree_store::loader::{Camera, TransferFunction};
use thiserror::Error;

/// A picture that a client asks for.
#[derive(Debug, Clone)]
pub struct RenderRequest {
    /// Where the eye is.
    pub camera: Camera,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// What values look like.
    pub transfer: TransferFunction,
    /// Pixels that a voxel may cover.
    pub accuracy: f64,
}

/// A finished picture.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Its bytes, in a format that browsers show.
    pub bytes: Vec<u8>,
    /// Of the bytes, as in `image/png`.
    pub content_type: &'static str,
}

/// Why there is no picture.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct RenderError(pub String);

/// Draws pictures of stores. Called on threads that may wait.
pub trait Renderer: Send + Sync {
    /// Draws one picture.
    ///
    /// # Errors
    /// When it cannot.
    fn render(&self, store: &Store, request: &RenderRequest) -> Result<Picture, RenderError>;
}
