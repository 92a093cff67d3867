//! One page: what its tags say of its samples, and where its strips or tiles are. What cannot be read
//! is refused here, by name, before any sample is decoded.

use super::TiffError;
use super::codec::Compression;
use super::ifd::{Ifd, Values};
use octree_store::SampleType;

/// The most pixels along an axis: more than a store can hold.
const MOST_PIXELS: u64 = 1 << 26;

/// The widest tile beyond the picture's own width.
const WIDEST_TILE: u64 = 1 << 16;

/// How neighbours predict a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Predictor {
    /// Not at all.
    None,
    /// The sample to the left.
    Horizontal,
    /// The byte to the left, where a row's bytes are sorted by significance.
    Float,
}

/// What a page's samples are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PageKind {
    /// Pixels along x and y.
    pub(crate) dims_xy: [u64; 2],
    /// The type of the samples.
    pub(crate) stored: SampleType,
}

/// A page of grey samples of a known type.
#[derive(Debug, Clone, Copy)]
pub(super) struct Page<'a> {
    pub(super) ifd: Ifd<'a>,
    pub(super) kind: PageKind,
    pub(super) compression: Compression,
    pub(super) predictor: Predictor,
    /// Whether 0 is meant to be shown white.
    pub(super) min_is_white: bool,
    /// Whether samples are 16-bit floats, which are given as 32-bit ones.
    pub(super) half: bool,
    /// Whether it has a palette, which is for showing only.
    pub(super) palette: bool,
    /// Pixels of a strip or tile.
    pub(super) chunk_xy: [u64; 2],
    /// Strips or tiles along x and y.
    pub(super) grid_xy: [u64; 2],
    /// `strip` or `tile`.
    pub(super) chunk_name: &'static str,
    offsets: Values<'a>,
    counts: Option<Values<'a>>,
}

/// Whether a page is no slice but a thumbnail, a level of a pyramid, or a mask.
pub(super) fn is_reduced(ifd: &Ifd<'_>) -> bool {
    let new = ifd.number_or(254, "NewSubfileType", 0).unwrap_or(0);
    let old = ifd.number_or(255, "SubfileType", 1).unwrap_or(1);
    new & 0b101 != 0 || old == 2
}

impl<'a> Page<'a> {
    /// Reads a page's tags. A palette is taken for one of ImageJ's, which only colours grey values,
    /// where `grey_palette` says so.
    pub(super) fn new(ifd: Ifd<'a>, grey_palette: bool) -> Result<Self, TiffError> {
        let dims_xy = [ifd.number(256, "ImageWidth")?, ifd.number(257, "ImageLength")?];
        for (name, found) in [("ImageWidth", dims_xy[0]), ("ImageLength", dims_xy[1])] {
            if !(1..=MOST_PIXELS).contains(&found) {
                return Err(TiffError::Value { name, found, expected: "and must be 1 to 2^26" });
            }
        }
        let photometric = ifd.number_or(262, "PhotometricInterpretation", 1)?;
        let palette = photometric == 3 && grey_palette;
        check_grey(&ifd, photometric, palette)?;
        let (stored, half) = sample_type(&ifd)?;
        let orientation = ifd.number_or(274, "Orientation", 1)?;
        if (2..=8).contains(&orientation) {
            return Err(TiffError::Orientation { found: orientation });
        }
        let fill_order = ifd.number_or(266, "FillOrder", 1)?;
        if fill_order != 1 {
            let expected = "and only 1 is read: save the file anew";
            return Err(TiffError::Value { name: "FillOrder", found: fill_order, expected });
        }
        let compression = Compression::of_tag(ifd.number_or(259, "Compression", 1)?)?;
        let predictor = predictor(&ifd, compression, stored)?;
        let tiled = ifd.find(322, "TileWidth")?.is_some();
        let (chunk_name, chunk_xy, tags) = if tiled {
            let size = [ifd.number(322, "TileWidth")?, ifd.number(323, "TileLength")?];
            ("tile", size, [324, 325])
        } else {
            let rows = ifd.number_or(278, "RowsPerStrip", dims_xy[1])?.min(dims_xy[1]);
            ("strip", [dims_xy[0], rows], [273, 279])
        };
        for (axis, name) in
            [(0, "TileWidth"), (1, if tiled { "TileLength" } else { "RowsPerStrip" })]
        {
            let found = chunk_xy[axis];
            if found == 0 || found > dims_xy[axis].max(WIDEST_TILE) {
                let expected = "which no picture of this size can have";
                return Err(TiffError::Value { name, found, expected });
            }
        }
        let grid_xy = [0, 1].map(|axis| dims_xy[axis].div_ceil(chunk_xy[axis]));
        let name = if tiled { "TileOffsets" } else { "StripOffsets" };
        let offsets = ifd.find(tags[0], name)?.ok_or(TiffError::Tag { name })?;
        let counts = ifd.find(tags[1], "StripByteCounts or TileByteCounts")?;
        if offsets.count() < grid_xy[0] * grid_xy[1] {
            return Err(TiffError::Tag { name });
        }
        let kind = PageKind { dims_xy, stored };
        let min_is_white = photometric == 0;
        Ok(Self {
            ifd,
            kind,
            compression,
            predictor,
            min_is_white,
            half,
            palette,
            chunk_xy,
            grid_xy,
            chunk_name,
            offsets,
            counts,
        })
    }

    pub(super) fn big_endian(&self) -> bool {
        self.ifd.file.big_endian
    }

    /// Bytes of the file.
    pub(super) fn bytes(
        &self,
        what: &'static str,
        offset: u64,
        length: u64,
    ) -> Result<&'a [u8], TiffError> {
        self.ifd.file.slice(what, offset, length)
    }

    /// Strips or tiles of the page.
    pub(super) fn chunks(&self) -> u64 {
        self.grid_xy[0] * self.grid_xy[1]
    }

    /// Bytes of a sample as the file has it.
    pub(super) fn sample_bytes(&self) -> usize {
        if self.half { 2 } else { self.kind.stored.bytes() }
    }

    /// Bytes of a row of a strip or tile, decoded.
    pub(super) fn chunk_row_bytes(&self) -> u64 {
        self.chunk_xy[0] * self.sample_bytes() as u64
    }

    /// Rows of strip or tile `index` that lie in the picture.
    pub(super) fn rows_in_picture(&self, index: u64) -> u64 {
        let first = index / self.grid_xy[0] * self.chunk_xy[1];
        (self.kind.dims_xy[1] - first).min(self.chunk_xy[1])
    }

    /// The stored bytes of strip or tile `index`, which can hold what is needed of it; `None` where it was
    /// left out, as writers of sparse files do with zeros: place and length are 0 then.
    pub(super) fn chunk(&self, index: u64) -> Result<Option<&'a [u8]>, TiffError> {
        let needed = self.rows_in_picture(index) * self.chunk_row_bytes();
        let uncompressed = self.compression == Compression::None;
        let offset = self.offsets.get(index).ok_or(TiffError::Tag { name: "StripOffsets" })?;
        let count = self.counts.map(|counts| counts.get(index));
        if offset == 0 && count == Some(Some(0)) {
            return Ok(None);
        }
        let count = match count {
            // Some writers leave out what can be worked out.
            None | Some(Some(0)) if uncompressed => needed,
            Some(Some(count)) => count,
            _ => return Err(TiffError::Tag { name: "StripByteCounts or TileByteCounts" }),
        };
        if count.saturating_mul(self.compression.most_expansion()) < needed {
            let kind = self.chunk_name;
            return Err(TiffError::ShortChunk { kind, index, found: count, needed });
        }
        let what = if self.chunk_name == "tile" { "a tile" } else { "a strip" };
        // Of uncompressed data no more is asked for than is needed: counts are often too large.
        let count = if uncompressed { needed } else { count };
        self.ifd.file.slice(what, offset, count).map(Some)
    }

    /// Checks that every strip or tile lies in the file and is large enough.
    pub(super) fn check_chunks(&self) -> Result<(), TiffError> {
        (0..self.chunks()).try_for_each(|index| self.chunk(index).map(|_| ()))
    }

    /// Where the page's samples begin, if they lie in the file as they are, row by row.
    pub(super) fn plain_offset(&self) -> Option<u64> {
        let whole_rows = self.chunk_xy[0] == self.kind.dims_xy[0];
        if self.compression != Compression::None || self.half || !whole_rows {
            return None;
        }
        // No samples lie at the file's first byte: a chunk there was left out.
        let first = self.offsets.get(0).filter(|&first| first > 0)?;
        let step = self.chunk_xy[1] * self.chunk_row_bytes();
        let follows = |index| self.offsets.get(index) == first.checked_add(index * step);
        (1..self.chunks()).all(follows).then_some(first)
    }
}

/// Refuses what is in colour, whichever tag says so.
fn check_grey(ifd: &Ifd<'_>, photometric: u64, palette: bool) -> Result<(), TiffError> {
    let samples = ifd.number_or(277, "SamplesPerPixel", 1)?;
    let name = match photometric {
        0 | 1 => None,
        2 => Some("RGB".to_owned()),
        3 if palette => None,
        3 => Some("a palette".to_owned()),
        4 => Some("a transparency mask".to_owned()),
        5 => Some("CMYK".to_owned()),
        6 => Some("YCbCr".to_owned()),
        8..=10 => Some("CIE L*a*b*".to_owned()),
        32803 => Some("a camera's colour filter array".to_owned()),
        32844 | 32845 => Some("LogL or LogLuv".to_owned()),
        34892 => Some("a camera's raw picture".to_owned()),
        other => Some(format!("photometric interpretation {other}")),
    };
    let samples = (samples != 1).then(|| format!("{samples} samples a pixel"));
    match (name, samples) {
        (None, None) => {}
        (Some(name), Some(samples)) => {
            return Err(TiffError::Colour { found: format!("{name}, {samples}") });
        }
        (Some(found), None) | (None, Some(found)) => return Err(TiffError::Colour { found }),
    }
    let depth = ifd.number_or(32997, "ImageDepth", 1)?;
    if depth > 1 {
        let expected = "and a page must be one slice";
        return Err(TiffError::Value { name: "ImageDepth", found: depth, expected });
    }
    Ok(())
}

/// The type that samples are given as, and whether they are halves in the file.
fn sample_type(ifd: &Ifd<'_>) -> Result<(SampleType, bool), TiffError> {
    let bits = ifd.number_or(258, "BitsPerSample", 1)?;
    let format = ifd.number_or(339, "SampleFormat", 1)?;
    let stored = match (format, bits) {
        // 4 is data of an unknown kind, which readers take for unsigned integers.
        (1 | 4, 8) => SampleType::U8,
        (1 | 4, 16) => SampleType::U16,
        (1 | 4, 32) => SampleType::U32,
        (2, 8) => SampleType::I8,
        (2, 16) => SampleType::I16,
        (2, 32) => SampleType::I32,
        (3, 16 | 32) => SampleType::F32,
        (3, 64) => SampleType::F64,
        (format, bits) => {
            let name = match format {
                1 | 4 => "-bit unsigned integers",
                2 => "-bit signed integers",
                3 => "-bit floats",
                5 | 6 => "-bit complex numbers",
                _ => "-bit samples of an unknown format",
            };
            return Err(TiffError::Samples { found: format!("{bits}{name}") });
        }
    };
    Ok((stored, (format, bits) == (3, 16)))
}

fn predictor(
    ifd: &Ifd<'_>,
    compression: Compression,
    stored: SampleType,
) -> Result<Predictor, TiffError> {
    let found = ifd.number_or(317, "Predictor", 1)?;
    let predictor = match found {
        1 => return Ok(Predictor::None),
        2 => Predictor::Horizontal,
        3 if !stored.is_integer() => Predictor::Float,
        _ => {
            let with = format!("samples of {stored}");
            return Err(TiffError::Predictor { predictor: found, with });
        }
    };
    // libtiff does not predict here whatever the tag says, and others do.
    if matches!(compression, Compression::None | Compression::PackBits) {
        let with = compression.name().to_owned();
        return Err(TiffError::Predictor { predictor: found, with });
    }
    Ok(predictor)
}
