//! A naive TIFF writer for tests: whole pages in memory, one tag after the other.

use super::super::codec::Compression;
use super::super::page::Predictor;
use octree_store::SampleType;
use std::io::Write;
use weezl::BitOrder;

/// How a file is to be written.
#[derive(Debug, Clone)]
pub(crate) struct Made {
    pub(crate) dims_xyz: [usize; 3],
    pub(crate) stored: SampleType,
    pub(crate) big_endian: bool,
    pub(crate) big_tiff: bool,
    pub(crate) compression: Compression,
    pub(crate) predictor: Predictor,
    /// Tiles of this size, or strips of `rows`.
    pub(crate) tile_xy: Option<[usize; 2]>,
    pub(crate) rows: usize,
    pub(crate) description: String,
    /// Tags of every page beside the usual ones, or in their place: tag, kind, value.
    pub(crate) tags: Vec<(u16, u16, u64)>,
}

impl Made {
    pub(crate) fn new(dims_xyz: [usize; 3], stored: SampleType) -> Self {
        Self {
            dims_xyz,
            stored,
            big_endian: false,
            big_tiff: false,
            compression: Compression::None,
            predictor: Predictor::None,
            tile_xy: None,
            rows: dims_xyz[1],
            description: String::new(),
            tags: Vec::new(),
        }
    }

    fn put(&self, out: &mut Vec<u8>, value: u64, bytes: usize) {
        let little = value.to_le_bytes();
        if self.big_endian {
            out.extend(little[..bytes].iter().rev());
        } else {
            out.extend(&little[..bytes]);
        }
    }

    /// A file of these samples, which are little-endian.
    pub(crate) fn file(&self, samples: &[u8]) -> Vec<u8> {
        let [x, y, _] = self.dims_xyz;
        let offset_bytes = if self.big_tiff { 8 } else { 4 };
        let mut out = if self.big_endian { b"MM".to_vec() } else { b"II".to_vec() };
        self.put(&mut out, if self.big_tiff { 43 } else { 42 }, 2);
        if self.big_tiff {
            self.put(&mut out, 8, 2);
            self.put(&mut out, 0, 2);
        }
        let mut next_at = out.len();
        self.put(&mut out, 0, offset_bytes);
        for page in samples.chunks_exact(x * y * self.stored.bytes()) {
            let mut chunks = Vec::new();
            for chunk in self.chunks(page) {
                chunks.push((out.len() as u64, chunk.len() as u64));
                out.extend(chunk);
            }
            let offsets = self.array(&mut out, chunks.iter().map(|&(offset, _)| offset));
            let counts = self.array(&mut out, chunks.iter().map(|&(_, count)| count));
            let text_at = out.len() as u64;
            out.extend(self.description.as_bytes());
            out.push(0);
            let ifd = out.len() as u64;
            let mut patch = Vec::new();
            self.put(&mut patch, ifd, offset_bytes);
            out[next_at..next_at + offset_bytes].copy_from_slice(&patch);
            self.directory(&mut out, offsets, counts, chunks.len() as u64, text_at);
            next_at = out.len();
            self.put(&mut out, 0, offset_bytes);
        }
        out
    }

    /// Puts numbers down; the value of the tag that has them: their place, or the only one.
    fn array(&self, out: &mut Vec<u8>, values: impl ExactSizeIterator<Item = u64>) -> u64 {
        let at = out.len() as u64;
        let count = values.len();
        let mut last = 0;
        for value in values {
            self.put(out, value, if self.big_tiff { 8 } else { 4 });
            last = value;
        }
        if count == 1 { last } else { at }
    }

    fn directory(&self, out: &mut Vec<u8>, offsets: u64, counts: u64, chunks: u64, text_at: u64) {
        let [x, y, _] = self.dims_xyz;
        let format = match self.stored {
            SampleType::U8 | SampleType::U16 | SampleType::U32 => 1,
            SampleType::I8 | SampleType::I16 | SampleType::I32 => 2,
            SampleType::F32 | SampleType::F64 => 3,
        };
        let compression = match self.compression {
            Compression::None => 1,
            Compression::Lzw => 5,
            Compression::Deflate => 8,
            Compression::PackBits => 32773,
            Compression::Zstd => 50000,
        };
        let predictor = match self.predictor {
            Predictor::None => 1,
            Predictor::Horizontal => 2,
            Predictor::Float => 3,
        };
        let long = if self.big_tiff { 16 } else { 4 };
        let [offsets_tag, counts_tag] =
            if self.tile_xy.is_some() { [324, 325] } else { [273, 279] };
        let mut tags: Vec<(u16, u16, u64, u64)> = vec![
            (256, 3, 1, x as u64),
            (257, 4, 1, y as u64),
            (258, 3, 1, 8 * self.stored.bytes() as u64),
            (259, 3, 1, compression),
            (262, 3, 1, 1),
            (offsets_tag, long, chunks, offsets),
            (277, 3, 1, 1),
            (counts_tag, long, chunks, counts),
            (317, 3, 1, predictor),
            (339, 3, 1, format),
        ];
        if !self.description.is_empty() {
            tags.push((270, 2, self.description.len() as u64 + 1, text_at));
        }
        match self.tile_xy {
            Some([w, h]) => tags.extend([(322, 3, 1, w as u64), (323, 3, 1, h as u64)]),
            None => tags.push((278, 4, 1, self.rows as u64)),
        }
        for &(tag, kind, value) in &self.tags {
            tags.retain(|&(other, ..)| other != tag);
            tags.push((tag, kind, 1, value));
        }
        tags.sort_unstable();
        self.put(out, tags.len() as u64, if self.big_tiff { 8 } else { 2 });
        for (tag, kind, count, value) in tags {
            self.put(out, u64::from(tag), 2);
            self.put(out, u64::from(kind), 2);
            let place = if self.big_tiff { 8 } else { 4 };
            self.put(out, count, place);
            // A value that is shorter than its place stands at its beginning.
            let bytes = match kind {
                3 if count == 1 => 2,
                4 if count == 1 => 4,
                _ => place,
            };
            if kind == 2 && count as usize <= place {
                let mut text = self.description.clone().into_bytes();
                text.resize(place, 0);
                out.extend(text);
                continue;
            }
            self.put(out, value, bytes);
            out.extend(std::iter::repeat_n(0, place - bytes));
        }
    }

    /// A page's strips or tiles, packed.
    fn chunks(&self, page: &[u8]) -> Vec<Vec<u8>> {
        let [x, y, _] = self.dims_xyz;
        let size = self.stored.bytes();
        let [w, h] = self.tile_xy.unwrap_or([x, self.rows]);
        let mut chunks = Vec::new();
        for top in (0..y).step_by(h) {
            for left in (0..x).step_by(w) {
                let bottom = if self.tile_xy.is_some() { top + h } else { (top + h).min(y) };
                let mut chunk = Vec::new();
                for row in top..bottom {
                    let mut bytes = Vec::new();
                    for column in left..left + w {
                        // Tiles are filled up with something that must not show.
                        let at = (row * x + column) * size;
                        let inside = row < y && column < x;
                        bytes.extend(if inside {
                            page[at..at + size].to_vec()
                        } else {
                            vec![0xaa; size]
                        });
                    }
                    chunk.extend(self.row(&bytes));
                }
                chunks.push(packed(self.compression, &chunk));
            }
        }
        chunks
    }

    /// A row in the file's byte order, differences taken.
    fn row(&self, little: &[u8]) -> Vec<u8> {
        let size = self.stored.bytes();
        let samples: Vec<u64> = little
            .chunks_exact(size)
            .map(|bytes| bytes.iter().rev().fold(0, |v, &b| v << 8 | u64::from(b)))
            .collect();
        let mut out = Vec::new();
        match self.predictor {
            Predictor::None => samples.iter().for_each(|&v| self.put(&mut out, v, size)),
            Predictor::Horizontal => {
                for (i, v) in samples.iter().enumerate() {
                    let left = if i == 0 { 0 } else { samples[i - 1] };
                    self.put(&mut out, v.wrapping_sub(left), size);
                }
            }
            Predictor::Float => {
                for plane in (0..size).rev() {
                    out.extend(samples.iter().map(|v| v.to_le_bytes()[plane]));
                }
                for i in (1..out.len()).rev() {
                    out[i] = out[i].wrapping_sub(out[i - 1]);
                }
            }
        }
        out
    }
}

/// Bytes packed as `compression` says.
pub(crate) fn packed(compression: Compression, bytes: &[u8]) -> Vec<u8> {
    match compression {
        Compression::None => bytes.to_vec(),
        Compression::Lzw => {
            let mut encoder = weezl::encode::Encoder::with_tiff_size_switch(BitOrder::Msb, 8);
            encoder.encode(bytes).unwrap()
        }
        Compression::Deflate => {
            let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
            out.write_all(bytes).unwrap();
            out.finish().unwrap()
        }
        Compression::PackBits => {
            // Short runs as they are, long ones as repeats, and a byte that says nothing before all.
            let mut out = vec![128];
            for run in bytes.chunk_by(|a, b| a == b) {
                for part in run.chunks(128) {
                    if part.len() > 2 {
                        out.extend([(257 - part.len()) as u8, part[0]]);
                    } else {
                        out.push(part.len() as u8 - 1);
                        out.extend(part);
                    }
                }
            }
            out
        }
        Compression::Zstd => zstd::encode_all(bytes, 3).unwrap(),
    }
}
