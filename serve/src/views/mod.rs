//! Stores as other programs' formats describe them. Pure: from metadata to JSON.

pub(crate) mod codes;
pub(crate) mod info;
mod neuroglancer;
pub(crate) mod ome_zarr;
pub(crate) mod precomputed;
mod scales;
mod zarr_array;

pub use neuroglancer::neuroglancer_link;
