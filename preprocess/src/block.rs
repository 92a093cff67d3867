//! A parent's core, which an octet's means fill: its checksum, and its place in the chunk of its
//! level's window that holds its slices.
//!
//! A conversion that goes on reads the cores back as they were placed, and checks them.

use octree_store::{Geometry, NodeKey, Sample};
use twox_hash::XxHash3_64;

/// The checksum of a parent's core.
pub(crate) fn block_checksum<T: Sample>(block: &[T]) -> u64 {
    XxHash3_64::oneshot(bytemuck::cast_slice(block))
}

/// Copies a parent's core into the chunk of its level that holds its slices.
pub(crate) fn place_block<T: Sample>(
    geometry: &Geometry,
    parent: NodeKey,
    block: &[T],
    chunk: &mut [T],
) {
    let width = geometry.core_region(parent).dims_xyz()[0] as usize;
    for (row, to) in block.chunks_exact(width).zip(block_rows(geometry, parent)) {
        chunk[to..to + width].copy_from_slice(row);
    }
}

/// Copies a parent's core out of its chunk.
pub(crate) fn read_block<T: Sample>(
    geometry: &Geometry,
    parent: NodeKey,
    chunk: &[T],
    block: &mut Vec<T>,
) {
    let width = geometry.core_region(parent).dims_xyz()[0] as usize;
    block.clear();
    for from in block_rows(geometry, parent) {
        block.extend_from_slice(&chunk[from..from + width]);
    }
}

/// Where the rows of a parent's core begin in its chunk.
fn block_rows(geometry: &Geometry, parent: NodeKey) -> impl Iterator<Item = usize> {
    let region = geometry.core_region(parent);
    let [width, height, _] = geometry.dims_at(parent.level()).map(|n| n as usize);
    let [_, by, bz] = region.dims_xyz().map(|n| n as usize);
    let [x, y] = [region.min[0] as usize, region.min[1] as usize];
    (0..by * bz).map(move |i| (i / by * height + y + i % by) * width + x)
}
