//! Chunks as Blosc frames (format 2 of c-blosc 1) of LZ4 with byte shuffle: one block, one stream.
//!
//! ```text
//! 0        1            2      3              4           8           12       16
//! version  LZ4 version  flags  bytes a sample  plain u32   block u32   frame u32
//! 16             20                24
//! block's place  stream's length   LZ4 block, its input shuffled: byte 0 of every sample, then byte 1, …
//! ```
//! Where LZ4 gains nothing, the plain bytes follow the first 16. The layout is that of c-blosc's
//! `README_HEADER.rst`; clients that others wrote read it in the tests.

/// Bytes of a frame's head.
const HEAD_BYTES: usize = 16;

const SHUFFLED: u8 = 1;
const PLAIN: u8 = 1 << 1;
const ONE_STREAM: u8 = 1 << 4;
const LZ4: u8 = 1 << 5;

/// A frame of samples of so many bytes each. Chunks have at most 128^3 samples, so lengths fit 32 bits.
pub(crate) fn compress(plain: &[u8], sample_bytes: usize) -> Vec<u8> {
    let head = |flags: u8, frame_bytes: usize| {
        let mut head = vec![2, 1, flags, sample_bytes as u8];
        for length in [plain.len(), plain.len(), frame_bytes] {
            head.extend_from_slice(&(length as u32).to_le_bytes());
        }
        head
    };
    let shuffled = shuffle(plain, sample_bytes);
    let stream = lz4_flex::block::compress(&shuffled);
    let packed_bytes = HEAD_BYTES + 8 + stream.len();
    if packed_bytes >= HEAD_BYTES + plain.len() {
        let mut frame = head(LZ4 | PLAIN, HEAD_BYTES + plain.len());
        frame.extend_from_slice(plain);
        return frame;
    }
    let shuffled = if sample_bytes > 1 { SHUFFLED } else { 0 };
    let mut frame = head(LZ4 | ONE_STREAM | shuffled, packed_bytes);
    frame.extend_from_slice(&(HEAD_BYTES as u32 + 4).to_le_bytes());
    frame.extend_from_slice(&(stream.len() as u32).to_le_bytes());
    frame.extend_from_slice(&stream);
    frame
}

/// Byte 0 of every sample, then byte 1, and so on.
fn shuffle(plain: &[u8], sample_bytes: usize) -> Vec<u8> {
    let samples = plain.len() / sample_bytes;
    let mut shuffled = vec![0; plain.len()];
    for (at, sample) in plain.chunks_exact(sample_bytes).enumerate() {
        for (byte, value) in sample.iter().enumerate() {
            shuffled[byte * samples + at] = *value;
        }
    }
    shuffled
}
