//! Files that together hold the bytes of one or more volumes: a volume in one of them is mapped or a stream,
//! one that is spread over several is read slice by slice from the files they lie in.

use super::data_files::ArrayShape;
use super::map::map_file;
use super::stream::Pick;
use super::{Place, SliceFiles, SourceError, StreamCoding, StreamPlace};
use std::ops::Range;
use std::path::PathBuf;

/// One of the files.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub(super) path: PathBuf,
    /// Where the data, coded or not, begin.
    pub(super) file_offset: u64,
    /// Decoded bytes before the first voxel.
    pub(super) decoded_skip: u64,
}

/// Slices of a volume that is spread over several files.
#[derive(Debug)]
pub(super) struct PieceSlices {
    pub(super) pieces: Vec<Piece>,
    pub(super) coding: Option<StreamCoding>,
    /// Decoded bytes of each.
    pub(super) piece_bytes: u64,
    /// The volume's first byte in all of them together.
    pub(super) first: u64,
    pub(super) shape: ArrayShape,
    pub(super) big_endian: bool,
}

impl PieceSlices {
    fn pick(&self, after: u64) -> Option<Pick> {
        let sample = self.shape.sample_bytes();
        (self.shape.components > 1).then(|| Pick {
            after,
            group: self.shape.components * sample as u64,
            first: self.shape.component * sample as u64,
            length: sample,
        })
    }

    /// The volume where it lies in one file.
    pub(super) fn in_one_piece(
        &self,
        index: usize,
        offset: u64,
        volume_bytes: u64,
    ) -> Result<Place, SourceError> {
        let Piece { path, file_offset, decoded_skip } = self.pieces[index].clone();
        if self.coding.is_none() && self.shape.components == 1 {
            let map =
                map_file(&path).map_err(|source| SourceError::Io { path: path.clone(), source })?;
            return Ok(Place::Mapped { map, offset: file_offset + offset });
        }
        let pick = self.pick(decoded_skip);
        let offset =
            if pick.is_some() { offset / self.shape.components } else { decoded_skip + offset };
        Ok(Place::Stream(StreamPlace {
            path,
            file_offset,
            coding: self.coding.unwrap_or(StreamCoding::Plain),
            pick,
            offset,
            ends_with_volume: offset_ends(self.first + volume_bytes, self.piece_bytes),
        }))
    }

    /// Reads bytes of all files together.
    fn read(&self, range: Range<u64>, out: &mut [u8]) -> Result<(), SourceError> {
        let (mut at, mut out) = (range.start, out);
        while at < range.end {
            let piece = &self.pieces[(at / self.piece_bytes) as usize];
            let within = at % self.piece_bytes;
            let count = (self.piece_bytes - within).min(range.end - at);
            let (part, rest) = out.split_at_mut(count as usize);
            self.read_piece(piece, within, part)?;
            (at, out) = (at + count, rest);
        }
        Ok(())
    }

    fn read_piece(&self, piece: &Piece, within: u64, out: &mut [u8]) -> Result<(), SourceError> {
        let Piece { path, file_offset, decoded_skip } = piece;
        let place = StreamPlace {
            path: path.clone(),
            file_offset: *file_offset,
            coding: self.coding.unwrap_or(StreamCoding::Plain),
            pick: None,
            offset: 0,
            ends_with_volume: false,
        };
        if self.coding.is_none() {
            let plain = StreamPlace { file_offset: file_offset + within, ..place };
            return plain.open()?.read(out);
        }
        let mut stream = place.open()?;
        stream.skip(decoded_skip + within)?;
        stream.read(out)?;
        if within + out.len() as u64 == self.piece_bytes { stream.finish() } else { Ok(()) }
    }
}

/// Whether a volume that ends at this byte of all ends its file.
fn offset_ends(end: u64, piece_bytes: u64) -> bool {
    end.is_multiple_of(piece_bytes)
}

impl SliceFiles for PieceSlices {
    fn read_slice(&self, z: u64, bytes: &mut [u8]) -> Result<(), SourceError> {
        let slice = self.shape.slice_bytes();
        let start = self.first + z * slice;
        let sample = self.shape.sample_bytes();
        if self.shape.components == 1 {
            self.read(start..start + slice, bytes)?;
        } else {
            let mut all = vec![0; slice as usize];
            self.read(start..start + slice, &mut all)?;
            let first = self.shape.component as usize * sample;
            let groups = all.chunks_exact(self.shape.components as usize * sample);
            for (out, group) in bytes.chunks_exact_mut(sample).zip(groups) {
                out.copy_from_slice(&group[first..first + sample]);
            }
        }
        if self.big_endian {
            bytes.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
        }
        Ok(())
    }

    fn decode_bytes(&self) -> u64 {
        let picked = if self.shape.components > 1 { self.shape.slice_bytes() } else { 0 };
        // bzip2 keeps blocks of 900 kB; all others need less.
        picked + if self.coding.is_some() { 1 << 22 } else { 1 << 16 }
    }
}
