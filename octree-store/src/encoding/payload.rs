//! Payload bytes: compression, its raw fallback, and the checksum.

use super::Compression;
use crate::error::Damage;
use crate::record::NodeRecord;
use xxhash_rust::xxh3::xxh3_128;

/// Compresses a brick's bytes, or keeps them raw where LZ4 gains less than 1 in 64, and writes
/// compression, length and checksum into the record.
pub(super) fn compress(bytes: &[u8], record: &mut NodeRecord, packed: &mut Vec<u8>) -> Vec<u8> {
    packed.resize(lz4_flex::block::get_maximum_output_size(bytes.len()), 0);
    let length = lz4_flex::block::compress_into(bytes, packed).unwrap_or(bytes.len());
    let payload = if length < bytes.len() - bytes.len() / 64 {
        record.compression = Compression::Lz4;
        packed[..length].to_vec()
    } else {
        record.compression = Compression::Raw;
        bytes.to_vec()
    };
    record.place.length = payload.len() as u32;
    record.payload_checksum = xxh3_128(&payload);
    payload
}

/// Checks a payload against its record's checksum.
///
/// # Errors
/// When it is not what was written.
pub fn check(record: &NodeRecord, payload: &[u8]) -> Result<(), Damage> {
    if xxh3_128(payload) == record.payload_checksum { Ok(()) } else { Err(Damage::PayloadChecksum) }
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
