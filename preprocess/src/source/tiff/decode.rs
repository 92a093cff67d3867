//! A page decoded into a slice, strip by strip or tile by tile. Strips are decoded where they belong;
//! of a tile no more than a row is held.

use super::TiffError;
use super::page::Page;
use super::samples::{RowFix, widen};
use std::io::{self, BufReader, Read};

/// Bytes that are decoded at a time where rows are short.
const PIECE_BYTES: usize = 1 << 16;

/// Bytes of memory that decoding a page takes. A page's chunks were packed by one program in one way, and the
/// first of them says what all need.
pub(super) fn decode_bytes(page: &Page<'_>) -> u64 {
    let piece = 2 * page.chunk_row_bytes() + PIECE_BYTES as u64;
    let first = (0..page.chunks()).find_map(|index| page.chunk(index).ok().flatten());
    let length = page.chunk_xy[1].saturating_mul(page.chunk_row_bytes());
    let at_once = if belongs_as_it_is(page) {
        page.rows_in_picture(0) * page.chunk_row_bytes()
    } else {
        PIECE_BYTES as u64
    };
    page.compression.decoder_bytes(first.unwrap_or(&[]), length, at_once) + piece
}

/// Whether rows of a chunk are the slice's own rows.
fn belongs_as_it_is(page: &Page<'_>) -> bool {
    page.chunk_xy[0] == page.kind.dims_xy[0] && !page.half
}

/// Decodes a page into `slice`, its samples little-endian.
pub(super) fn decode(page: &Page<'_>, window_log: u32, slice: &mut [u8]) -> Result<(), TiffError> {
    let fix = RowFix {
        predictor: page.predictor,
        big_endian: page.big_endian(),
        sample_bytes: page.sample_bytes(),
    };
    let mut spare = Vec::new();
    for index in 0..page.chunks() {
        // Zeros predict zeros: what was left out is nothing but them.
        let chunk = match page.chunk(index)? {
            Some(stored) => page.compression.reader(stored, window_log),
            None => Ok(Box::new(io::repeat(0)) as Box<dyn Read>),
        };
        let decoded =
            chunk.and_then(|chunk| decode_chunk(page, index, chunk, fix, &mut spare, slice));
        decoded.map_err(|error| {
            let what = match error.kind() {
                io::ErrorKind::UnexpectedEof => "it ends too early".to_owned(),
                _ => error.to_string(),
            };
            TiffError::Decompression { kind: page.chunk_name, index, what }
        })?;
    }
    Ok(())
}

fn decode_chunk(
    page: &Page<'_>,
    index: u64,
    mut chunk: Box<dyn Read + '_>,
    fix: RowFix,
    spare: &mut Vec<u8>,
    slice: &mut [u8],
) -> io::Result<()> {
    let row_bytes = page.chunk_row_bytes() as usize;
    let sample = page.kind.stored.bytes();
    let slice_row = page.kind.dims_xy[0] as usize * sample;
    let rows = page.rows_in_picture(index) as usize;
    let first_row = (index / page.grid_xy[0] * page.chunk_xy[1]) as usize;
    let left = (index % page.grid_xy[0] * page.chunk_xy[0]) as usize * sample;
    let wanted = (page.chunk_xy[0] as usize * sample).min(slice_row - left);
    let slice = &mut slice[first_row * slice_row..(first_row + rows) * slice_row];
    // What follows is of no use, but for the checksum behind it.
    let beyond = (page.chunk_xy[1] - rows as u64) * row_bytes as u64 + 1;
    if belongs_as_it_is(page) {
        chunk.read_exact(slice)?;
        if !fix.is_nothing() {
            slice.chunks_exact_mut(row_bytes).for_each(|row| fix.fix(row, spare));
        }
    } else {
        let mut reader = BufReader::with_capacity(PIECE_BYTES, &mut chunk);
        let mut row = vec![0; row_bytes];
        for out in slice.chunks_exact_mut(slice_row) {
            reader.read_exact(&mut row)?;
            fix.fix(&mut row, spare);
            let out = &mut out[left..left + wanted];
            if page.half {
                widen(&row, out);
            } else {
                out.copy_from_slice(&row[..wanted]);
            }
        }
    }
    if page.compression.has_checksum() {
        match io::copy(&mut chunk.take(beyond), &mut io::sink()) {
            // An end that is missing takes nothing away.
            Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => return Err(error),
            _ => {}
        }
    }
    Ok(())
}
