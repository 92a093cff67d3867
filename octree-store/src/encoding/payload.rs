//! Payload bytes: compression, its raw fallback, and the checksum.

use super::{Compression, Effort};
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
    /// Made when first needed.
    zstd: Option<zstd::bulk::Compressor<'static>>,
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

    /// The bytes as a Zstandard frame; nothing where there is no memory for it.
    fn zstd(&mut self, bytes: &[u8]) -> Option<&[u8]> {
        if self.zstd.is_none() {
            self.zstd = zstd::bulk::Compressor::new(ZSTD_LEVEL).ok();
        }
        self.packed.resize(zstd::zstd_safe::compress_bound(bytes.len()), 0);
        let length = self.zstd.as_mut()?.compress_to_buffer(bytes, &mut self.packed[..]).ok()?;
        Some(&self.packed[..length])
    }

    /// The bytes as they are to be stored, if not as they came.
    fn pack(&mut self, bytes: &[u8], effort: Effort) -> Option<(Compression, &[u8])> {
        match effort {
            Effort::Fast => None,
            Effort::Balanced => {
                if !worth_trying(bytes, self) {
                    return None;
                }
                let packed = self.lz4(bytes).filter(|packed| gains(packed.len(), bytes.len()));
                packed.map(|packed| (Compression::Lz4, packed))
            }
            Effort::Small => {
                let packed = self.zstd(bytes).filter(|packed| packed.len() < bytes.len());
                packed.map(|packed| (Compression::Zstd, packed))
            }
        }
    }
}

/// The first level that codes entropy. Higher ones search for matches, of which noise has none
/// (bench/NOTES.md).
const ZSTD_LEVEL: i32 = 1;

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

/// Adds a brick's bytes to `payloads`, compressed or raw where that gains nothing, and writes
/// compression, length and checksum into the record.
pub(super) fn compress(
    bytes: &[u8],
    effort: Effort,
    record: &mut NodeRecord,
    packer: &mut Packer,
    payloads: &mut Vec<u8>,
) {
    let (compression, payload) = packer.pack(bytes, effort).unwrap_or((Compression::Raw, bytes));
    record.compression = compression;
    record.place.length = payload.len() as u32;
    record.payload_checksum = XxHash3_128::oneshot(payload);
    payloads.extend_from_slice(payload);
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

/// What unpacking keeps from brick to brick.
#[derive(Default)]
pub(crate) struct Unpacker {
    bytes: Vec<u8>,
    /// Made when first needed.
    zstd: Option<zstd::bulk::Decompressor<'static>>,
}

impl std::fmt::Debug for Unpacker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Unpacker").field("bytes", &self.bytes.len()).finish_non_exhaustive()
    }
}

/// Unpacks a payload into exactly `length` bytes; borrows it where it is raw. However damaged it is, no
/// more memory is taken than that.
///
/// # Errors
/// When it unpacks to anything else.
pub(crate) fn unpack<'a>(
    record: &NodeRecord,
    payload: &'a [u8],
    length: usize,
    unpacker: &'a mut Unpacker,
) -> Result<&'a [u8], Damage> {
    let Unpacker { bytes, zstd } = unpacker;
    let found = match record.compression {
        Compression::Raw if payload.len() == length => return Ok(payload),
        Compression::Raw => {
            return Err(Damage::PayloadLength { expected: length, found: payload.len() });
        }
        Compression::Lz4 => {
            bytes.resize(length, 0);
            lz4_flex::block::decompress_into(payload, bytes).ok()
        }
        Compression::Zstd => {
            bytes.resize(length, 0);
            if zstd.is_none() {
                *zstd = zstd::bulk::Decompressor::new().ok();
            }
            zstd.as_mut().and_then(|zstd| zstd.decompress_to_buffer(payload, &mut bytes[..]).ok())
        }
    };
    match found {
        Some(found) if found == length => Ok(bytes),
        Some(found) => Err(Damage::PayloadLength { expected: length, found }),
        None => Err(Damage::PayloadCompression),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::{EncodeScratch, Encoding, encode_brick, finite_range};
    use crate::key::NodeKey;
    use proptest::prelude::*;

    fn encoded(samples: &[u16], encoding: Encoding, effort: Effort) -> (NodeRecord, Vec<u8>) {
        let (key, all) = (NodeKey::new(0, [0; 3]), std::iter::once(0..samples.len()));
        let range = finite_range(samples);
        let (mut scratch, mut payload) = (EncodeScratch::default(), Vec::new());
        let how = (encoding, effort);
        let record = encode_brick(key, samples, how, range, all, &mut scratch, &mut payload);
        (record, payload)
    }

    /// Bytes of low entropy without repetitions: what the codes of a noisy brick are.
    fn noise(count: usize) -> Vec<u16> {
        let at = |i: usize| (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (0..count).map(|i| (at(i) >> 40).count_ones() as u16 * 1000).collect()
    }

    #[test]
    fn efforts_differ_in_bytes_alone() {
        let samples = noise(46_656);
        for encoding in [Encoding::Quantised8, Encoding::Lossless] {
            let made = [Effort::Fast, Effort::Balanced, Effort::Small]
                .map(|effort| encoded(&samples, encoding, effort));
            let bytes = samples.len() * usize::from(made[0].0.bits) / 8;
            assert_eq!((made[0].0.compression, made[0].1.len()), (Compression::Raw, bytes));
            assert_eq!(made[2].0.compression, Compression::Zstd);
            assert!(made[2].1.len() < bytes * 3 / 4, "entropy is coded");
            let mut unpacker = Unpacker::default();
            for (record, payload) in &made {
                assert_eq!(record.error, made[0].0.error);
                let unpacked = unpack(record, payload, bytes, &mut unpacker).unwrap();
                assert_eq!(unpacked, made[0].1);
                let longer = unpack(record, payload, bytes + 1, &mut unpacker);
                assert!(matches!(longer, Err(Damage::PayloadLength { .. })));
                assert!(unpack(record, payload, bytes - 1, &mut unpacker).is_err());
            }
        }
    }

    proptest! {
        #[test]
        fn a_damaged_payload_is_an_error_or_other_bytes_and_never_a_panic(
            flips in proptest::collection::vec((any::<u32>(), 1_u8..=255), 1..4), cut in any::<u32>(),
        ) {
            let samples = noise(5832);
            for effort in [Effort::Balanced, Effort::Small] {
                let (record, mut payload) = encoded(&samples, Encoding::Lossless, effort);
                let length = payload.len();
                for (at, flip) in &flips {
                    payload[*at as usize % length] ^= flip;
                }
                let mut unpacker = Unpacker::default();
                let bytes = 2 * samples.len();
                for payload in [&payload[..], &payload[..cut as usize % length]] {
                    if let Ok(unpacked) = unpack(&record, payload, bytes, &mut unpacker) {
                        prop_assert_eq!(unpacked.len(), bytes);
                    }
                    prop_assert!(check(&record, payload).is_err());
                }
            }
        }
    }
}
