//! The cell at the lowest corner of the 2x2x2: the fastest filter, and one that keeps every value and
//! all noise.

use super::Blocks;
use octree_store::Sample;

/// Writes the cell of every block that lies lowest along x, y and z.
pub(super) fn nearest<T: Sample>(blocks: Blocks<'_, T>, coarse: &mut [T]) {
    for (i, out) in coarse.chunks_exact_mut(blocks.width()).enumerate() {
        let (rows, _) = blocks.rows(i);
        for (out, pair) in out.iter_mut().zip(rows[0].chunks(2)) {
            *out = pair[0];
        }
    }
}
