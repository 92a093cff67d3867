//! Payload bytes: compression, its raw fallback, and the checksum.

use super::Compression;
use crate::error::Damage;
use crate::record::NodeRecord;
use lz4_flex::block::{CompressTable, compress_into_with_table, get_maximum_output_size};
use twox_hash::XxHash3_128;

/// What compression must gain to be worth the time of unpacking: 1 in 16.
fn gains(packed: usize, bytes: usize) -> bool {
    packed < bytes - bytes / 16
}

/// Pieces of a brick that are tried first, and their share of it.
const PIECES: usize = 8;
const PIECE_SHARE: usize = 64;

/// LZ4's output and its tables, kept from brick to brick.
#[derive(Default)]
pub(super) struct Packer {
    packed: Vec<u8>,
    /// For up to 64 KiB.
    small: CompressTable,
    /// For more, made when first needed.
    large: Option<CompressTable>,
}

impl std::fmt::Debug for Packer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Packer").field("packed", &self.packed.len()).finish_non_exhaustive()
    }
}

impl Packer {
    /// The bytes as an LZ4 block; nothing where LZ4 fails, which it does not.
    fn lz4(&mut self, bytes: &[u8]) -> Option<&[u8]> {
        self.packed.resize(get_maximum_output_size(bytes.len()), 0);
        // A small table would turn into a large one by itself, and never back.
        let table = if bytes.len() < usize::from(u16::MAX) {
            &mut self.small
        } else {
            self.large.get_or_insert_with(CompressTable::large)
        };
        let length = compress_into_with_table(bytes, &mut self.packed, table).ok()?;
        Some(&self.packed[..length])
    }
}

/// Whether LZ4 is likely to gain: it is tried on an eighth of the bytes, spread evenly. Noise fills
/// eight bits in homogeneous bricks, and trying all of it costs more than all other steps together.
fn worth_trying(bytes: &[u8], packer: &mut Packer) -> bool {
    let piece = bytes.len() / PIECE_SHARE;
    if piece < 256 {
        return true;
    }
    let mut tried = [0; PIECES * 1024];
    let piece = piece.min(1024);
    for (i, piece_tried) in tried.chunks_exact_mut(piece).take(PIECES).enumerate() {
        let start = bytes.len() / PIECES * i;
        piece_tried.copy_from_slice(&bytes[start..start + piece]);
    }
    let tried = &tried[..PIECES * piece];
    packer.lz4(tried).is_some_and(|packed| gains(packed.len(), tried.len()))
}

/// Compresses a brick's bytes, or keeps them raw where LZ4 gains nothing, and writes compression,
/// length and checksum into the record.
pub(super) fn compress(bytes: &[u8], record: &mut NodeRecord, packer: &mut Packer) -> Vec<u8> {
    let packed = if worth_trying(bytes, packer) { packer.lz4(bytes) } else { None };
    let packed = packed.filter(|packed| gains(packed.len(), bytes.len()));
    record.compression = if packed.is_some() { Compression::Lz4 } else { Compression::Raw };
    let payload = packed.unwrap_or(bytes).to_vec();
    record.place.length = payload.len() as u32;
    record.payload_checksum = XxHash3_128::oneshot(&payload);
    payload
}

/// Checks a payload against its record's checksum.
///
/// # Errors
/// When it is not what was written.
pub fn check(record: &NodeRecord, payload: &[u8]) -> Result<(), Damage> {
    if XxHash3_128::oneshot(payload) == record.payload_checksum {
        Ok(())
    } else {
        Err(Damage::PayloadChecksum)
    }
}

/// Unpacks a payload into exactly `bytes.len()` bytes; borrows it where it is raw.
///
/// # Errors
/// When it unpacks to anything else.
pub(crate) fn unpack<'a>(
    record: &NodeRecord,
    payload: &'a [u8],
    length: usize,
    buffer: &'a mut Vec<u8>,
) -> Result<&'a [u8], Damage> {
    match record.compression {
        Compression::Raw if payload.len() == length => Ok(payload),
        Compression::Raw => Err(Damage::PayloadLength { expected: length, found: payload.len() }),
        Compression::Lz4 => {
            buffer.resize(length, 0);
            match lz4_flex::block::decompress_into(payload, buffer) {
                Ok(found) if found == length => Ok(buffer),
                Ok(found) => Err(Damage::PayloadLength { expected: length, found }),
                Err(_) => Err(Damage::PayloadCompression),
            }
        }
    }
}
