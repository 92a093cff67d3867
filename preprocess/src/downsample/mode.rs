//! The most frequent of the 2x2x2 cells that exist, for volumes of labels: never a new value.
//!
//! Where several are as frequent it is the smallest of them. In float volumes cells that are not
//! finite do not count; where no other is there, it is the first cell.

use super::Blocks;
use octree_store::Sample;

/// Writes the most frequent cell of every block.
pub(super) fn mode<T: Sample>(blocks: Blocks<'_, T>, coarse: &mut [T]) {
    for (i, out) in coarse.chunks_exact_mut(blocks.width()).enumerate() {
        for (x, out) in out.iter_mut().enumerate() {
            let (cells, count) = blocks.cells(i, x);
            let cells = &cells[..count];
            // Within a label all eight are one.
            let uniform = cells.iter().all(|cell| *cell == cells[0]);
            *out = if uniform { cells[0] } else { mode_of(cells) };
        }
    }
}

fn mode_of<T: Sample>(cells: &[T]) -> T {
    let (mut best, mut most) = (cells[0], 0);
    for &cell in cells.iter().filter(|cell| cell.is_finite()) {
        let count = cells.iter().filter(|other| **other == cell).count();
        if count > most || count == most && cell < best {
            (best, most) = (cell, count);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_frequent_wins_and_ties_go_to_the_smallest() {
        assert_eq!(mode_of(&[7_u16, 3, 3, 9, 9, 9, 7, 1]), 9);
        assert_eq!(mode_of(&[9_u16, 3, 9, 3, 5, 7, 8, 6]), 3);
        assert_eq!(mode_of(&[-1_i8, 4]), -1);
        assert_eq!(mode_of(&[f32::NAN, 2.0, f32::NAN, f32::INFINITY, 1.0, 2.0]), 2.0);
        assert!(mode_of(&[f32::NAN, f32::INFINITY]).is_nan());
    }
}
