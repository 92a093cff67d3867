//! Will hold a store's pictures against a reference: a wgpu ray caster that reads the store only as a
//! renderer would, an f64 reference that renders the source itself, and the comparison of the two.
//!
//! The crate is empty so far. It depends on `octree-store` alone, as ARCHITECTURE.md lays down.
