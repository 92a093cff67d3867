//! Where a renderer can be plugged in: the server itself draws nothing.

use octree_store::Store;
use octree_store::loader::{TransferFunction, View};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use thiserror::Error;

/// A picture that a client asks for.
#[derive(Debug, Clone)]
pub struct RenderRequest {
    /// Where the eye is, and how large the picture.
    pub view: View,
    /// What values look like; none is for the renderer to choose.
    pub transfer: Option<TransferFunction>,
    /// Pixels that a voxel may cover.
    pub accuracy: f64,
    /// Distance of samples, in voxels of the level at hand.
    pub step_voxels: f64,
    /// After so long the picture is to be told as it is, coarse as it may be.
    pub at_most: Duration,
    /// Set when nobody waits for the picture any more: the client left, or its time is over. To be looked at while drawing.
    pub given_up: Arc<AtomicBool>,
}

/// A picture.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Its bytes, in a format that browsers show.
    pub bytes: Vec<u8>,
    /// Of the bytes, as in `image/png`.
    pub content_type: &'static str,
    /// Whether it is as fine as was asked for. If not, the same request gives a finer one.
    pub converged: bool,
}

/// Why there is no picture.
#[derive(Debug, Error)]
pub enum RenderError {
    /// What was asked for cannot be drawn.
    #[error("{0}")]
    Request(String),
    /// Drawing failed.
    #[error("{0}")]
    Failed(String),
}

/// Draws pictures of stores, one at a time, on a thread that may wait.
pub trait Renderer: Send + Sync {
    /// Draws one picture.
    ///
    /// # Errors
    /// When it cannot.
    fn render(&self, store: &Store, request: &RenderRequest) -> Result<Picture, RenderError>;
}
