//! What a picture shows and how: camera positions by name, mode, shading, accuracy, and the rays that follow.

mod cameras;
mod look;
mod rays;

pub use cameras::{NamedView, orbit};
pub use look::{Filter, Look, Mode, Shading};
pub(crate) use rays::{PixelRay, RayGrid};
