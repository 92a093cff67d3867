//! One ray through an octree, twice: as WGSL for a device, and beside each file its twin in Rust, in f32 and in the same
//! order, so that a difference between pictures can be traced to data, to arithmetic or to the driver.
//!
//! ```text
//! frame    what all rays share               fixed     sample positions as 64-bit fixed point
//! node     the spatial index                 walk      from leaf to leaf by neighbour pointers
//! ray      a pixel's ray, clipped            sample    interpolation in bricks and between levels
//! transfer tables, equation 2, exp(-x)       shade     gradients, Blinn and Phong
//! gather   what a segment adds: volume rendering, surface, maximum
//! trace    the loop over leaves
//! ```
//!
//! Sample k of a ray lies at `start + k step`, in 32.32 fixed-point voxels: in a volume 2^31 voxels wide positions
//! are exact to 2^-32 voxels, and both twins find the same leaves by comparing whole numbers. Within a brick
//! positions are f32, relative to the brick.

mod bricks;
mod fixed;
mod frame;
mod gather;
mod node;
#[allow(clippy::module_inception, reason = "the file of a ray is called ray, as its WGSL twin is")]
mod ray;
mod sample;
mod shade;
mod trace;
mod transfer;
mod walk;

pub(crate) use bricks::Bricks;
pub use frame::Frame;
pub(crate) use frame::{Variant, table_rows};
pub use node::RayNode;
pub(crate) use node::pack;
pub(crate) use trace::{Scene, draw_pixel};
