//! Words as planes of bits: what few bits a word uses is all that is stored, and planes that hardly
//! change are long runs for LZ4.
//!
//! Bytes are turned 512 at a time, as 64 matrices of 8 x 8 bits side by side: row g of the matrices is
//! bytes 64 g to 64 g + 63, so each step of the transposition is one operation on whole vectors
//! (Hacker's Delight 2nd ed., 7-3). A transposition is its own reverse.

use super::words::Word;
use multiversion::multiversion;

/// Bytes side by side.
const LANES: usize = 64;
/// Bytes that are turned at a time.
const BLOCK: usize = 8 * LANES;

/// Bit b of byte j of row g becomes bit g of byte j of row b.
#[inline(always)]
fn transpose<const N: usize>(rows: &mut [[u8; N]; 8]) {
    swap::<4, 0x0f, N>(rows);
    swap::<2, 0x33, N>(rows);
    swap::<1, 0x55, N>(rows);
}

/// Exchanges the high bits of each row (those not in `MASK`) with the low bits of the row `SHIFT` below.
#[inline(always)]
fn swap<const SHIFT: usize, const MASK: u8, const N: usize>(rows: &mut [[u8; N]; 8]) {
    for low in 0..8 {
        if low & SHIFT == 0 {
            let (above, below) = rows.split_at_mut(low + SHIFT);
            for (a, b) in above[low].iter_mut().zip(&mut below[0]) {
                let t = ((*a >> SHIFT) ^ *b) & MASK;
                *b ^= t;
                *a ^= t << SHIFT;
            }
        }
    }
}

/// Writes as many planes as `bytes` has room for; the planes of each byte of the words, lowest first.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn bit_planes<W: Word>(words: &[W], bytes: &mut [u8]) {
    let plane = words.len().div_ceil(8).max(1);
    for (index, planes) in bytes.chunks_mut(8 * plane).enumerate() {
        let mut start = 0;
        let mut blocks = words.chunks_exact(BLOCK);
        for block in &mut blocks {
            let mut rows = [[0; LANES]; 8];
            for (row, words) in rows.iter_mut().zip(block.chunks_exact(LANES)) {
                for (byte, word) in row.iter_mut().zip(words) {
                    *byte = word.byte(index);
                }
            }
            transpose(&mut rows);
            for (plane, row) in planes.chunks_exact_mut(plane).zip(&rows) {
                plane[start..start + LANES].copy_from_slice(row);
            }
            start += LANES;
        }
        // What is left is turned in the same way, in rows that are shorter; zeros fill them.
        let rest = blocks.remainder();
        let length = rest.len().div_ceil(8);
        for j in 0..length {
            let mut rows = [[0; 1]; 8];
            for (g, row) in rows.iter_mut().enumerate() {
                row[0] = rest.get(g * length + j).map_or(0, |word| word.byte(index));
            }
            transpose(&mut rows);
            for (plane, row) in planes.chunks_exact_mut(plane).zip(&rows) {
                plane[start + j] = row[0];
            }
        }
    }
}

/// The reverse of [`bit_planes`]; planes that are not there are 0.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn from_bit_planes<W: Word>(bytes: &[u8], words: &mut [W]) {
    words.fill(W::default());
    let plane = words.len().div_ceil(8).max(1);
    for (index, planes) in bytes.chunks(8 * plane).enumerate() {
        let mut start = 0;
        let mut blocks = words.chunks_exact_mut(BLOCK);
        for block in &mut blocks {
            let mut rows = [[0; LANES]; 8];
            for (row, plane) in rows.iter_mut().zip(planes.chunks_exact(plane)) {
                row.copy_from_slice(&plane[start..start + LANES]);
            }
            transpose(&mut rows);
            for (row, words) in rows.iter().zip(block.chunks_exact_mut(LANES)) {
                for (byte, word) in row.iter().zip(words) {
                    *word = word.plus(W::of_byte(*byte, index));
                }
            }
            start += LANES;
        }
        let rest = blocks.into_remainder();
        let length = rest.len().div_ceil(8);
        for j in 0..length {
            let mut rows = [[0; 1]; 8];
            for (row, plane) in rows.iter_mut().zip(planes.chunks_exact(plane)) {
                row[0] = plane[start + j];
            }
            transpose(&mut rows);
            for (g, row) in rows.iter().enumerate() {
                if let Some(word) = rest.get_mut(g * length + j) {
                    *word = word.plus(W::of_byte(row[0], index));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// FORMAT.md's words, a bit at a time.
    fn twin<W: Word>(words: &[W], planes: usize) -> Vec<u8> {
        let plane = words.len().div_ceil(8);
        let mut bytes = vec![0; planes * plane];
        for (block, words) in words.chunks(512).enumerate() {
            let length = words.len().div_ceil(8);
            for (i, word) in words.iter().enumerate() {
                for bit in 0..planes {
                    let set = word.byte(bit / 8) >> (bit % 8) & 1;
                    bytes[bit * plane + 64 * block + i % length] |= set << (i / length);
                }
            }
        }
        bytes
    }

    fn assert_planes<W: Word>(words: &[W]) {
        for planes in [1, 3, 8, 9, 14, 16, 30, 64] {
            if planes <= usize::from(W::BITS) {
                let mut bytes = vec![0xff; planes * words.len().div_ceil(8)];
                bit_planes(words, &mut bytes);
                assert_eq!(bytes, twin(words, planes), "{planes} of {} words", words.len());
            }
        }
    }

    proptest! {
        #[test]
        fn planes_are_those_of_the_twin(bits in proptest::collection::vec(any::<u64>(), 0..1600)) {
            assert_planes::<u64>(&bits);
            assert_planes::<u32>(&bits.iter().map(|b| *b as u32).collect::<Vec<_>>());
            assert_planes::<u16>(&bits.iter().map(|b| *b as u16).collect::<Vec<_>>());
            assert_planes::<u8>(&bits.iter().map(|b| *b as u8).collect::<Vec<_>>());
        }
    }
}
