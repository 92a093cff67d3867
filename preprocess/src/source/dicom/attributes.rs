//! The attributes that an image's place and pixels need, as their bytes and what these say.

use std::collections::BTreeMap;

/// Group and element.
pub(super) type Tag = u32;

pub(super) const TRANSFER_SYNTAX: Tag = 0x0002_0010;
pub(super) const SOP_CLASS: Tag = 0x0002_0002;
pub(super) const SERIES_DESCRIPTION: Tag = 0x0008_103E;
pub(super) const SLICE_THICKNESS: Tag = 0x0018_0050;
pub(super) const SPACING_BETWEEN_SLICES: Tag = 0x0018_0088;
pub(super) const IMAGER_PIXEL_SPACING: Tag = 0x0018_1164;
pub(super) const SERIES_UID: Tag = 0x0020_000E;
pub(super) const INSTANCE_NUMBER: Tag = 0x0020_0013;
pub(super) const POSITION: Tag = 0x0020_0032;
pub(super) const ORIENTATION: Tag = 0x0020_0037;
pub(super) const SAMPLES_PER_PIXEL: Tag = 0x0028_0002;
pub(super) const PHOTOMETRIC: Tag = 0x0028_0004;
pub(super) const FRAMES: Tag = 0x0028_0008;
pub(super) const ROWS: Tag = 0x0028_0010;
pub(super) const COLUMNS: Tag = 0x0028_0011;
pub(super) const PIXEL_SPACING: Tag = 0x0028_0030;
pub(super) const BITS_ALLOCATED: Tag = 0x0028_0100;
pub(super) const BITS_STORED: Tag = 0x0028_0101;
pub(super) const HIGH_BIT: Tag = 0x0028_0102;
pub(super) const PIXEL_REPRESENTATION: Tag = 0x0028_0103;
pub(super) const INTERCEPT: Tag = 0x0028_1052;
pub(super) const SLOPE: Tag = 0x0028_1053;
pub(super) const FRAME_OFFSETS: Tag = 0x3004_000C;

/// The attributes that are kept.
pub(super) const KEPT: [Tag; 23] = [
    TRANSFER_SYNTAX,
    SOP_CLASS,
    SERIES_DESCRIPTION,
    SLICE_THICKNESS,
    SPACING_BETWEEN_SLICES,
    IMAGER_PIXEL_SPACING,
    SERIES_UID,
    INSTANCE_NUMBER,
    POSITION,
    ORIENTATION,
    SAMPLES_PER_PIXEL,
    PHOTOMETRIC,
    FRAMES,
    ROWS,
    COLUMNS,
    PIXEL_SPACING,
    BITS_ALLOCATED,
    BITS_STORED,
    HIGH_BIT,
    PIXEL_REPRESENTATION,
    INTERCEPT,
    SLOPE,
    FRAME_OFFSETS,
];
/// A longer value of a kept attribute is no sensible one; frame offsets are the longest.
pub(super) const LONGEST_VALUE: u64 = 1 << 20;

/// Attributes by tag, as their bytes.
#[derive(Debug, Clone, Default)]
pub(super) struct Attributes {
    pub(super) values: BTreeMap<Tag, Vec<u8>>,
    pub(super) big_endian: bool,
}

impl Attributes {
    /// A value's text without padding.
    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        let bytes = self.values.get(&tag)?;
        let text = String::from_utf8_lossy(bytes);
        Some(text.trim_matches([' ', '\0']).to_owned()).filter(|text| !text.is_empty())
    }

    /// Numbers written as text, backslashes between them; `None` where one is none.
    pub(super) fn decimals(&self, tag: Tag) -> Option<Vec<f64>> {
        let text = self.text(tag)?;
        text.split('\\')
            .map(|word| word.trim().parse().ok().filter(|number: &f64| number.is_finite()))
            .collect()
    }

    /// Exactly so many of them.
    pub(super) fn vector<const N: usize>(&self, tag: Tag) -> Option<[f64; N]> {
        self.decimals(tag)?.try_into().ok()
    }

    /// An unsigned 16-bit number.
    pub(super) fn short(&self, tag: Tag) -> Option<u32> {
        let bytes = *self.values.get(&tag)?.first_chunk::<2>()?;
        let short =
            if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) };
        Some(u32::from(short))
    }

    /// Whether there is such a value.
    pub(super) fn has(&self, tag: Tag) -> bool {
        self.values.contains_key(&tag)
    }
}
