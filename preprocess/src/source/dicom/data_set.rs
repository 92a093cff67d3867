//! DICOM files as attributes: those that an image's place and pixels need, and where its pixels are.
//!
//! After DICOM PS3.5, section 7 (data elements), and PS3.10 (files). Nothing is read but headers of
//! elements and short values, no more than the file is long; pixels stay where they are.

use super::DicomError;
use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};

/// Group and element.
type Tag = u32;

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
const KEPT: [Tag; 23] = [
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
/// Sequences that hold what all frames of a multi-frame image share, and what each has alone.
const SHARED_GROUPS: Tag = 0x5200_9229;
const PER_FRAME_GROUPS: Tag = 0x5200_9230;
/// The sequences in them that are looked into: of pixel sizes, positions, orientations and values.
const FUNCTIONAL: [Tag; 4] = [0x0028_9110, 0x0020_9113, 0x0020_9116, 0x0028_9145];
const PIXEL_DATA: Tag = 0x7FE0_0010;
const ITEM: Tag = 0xFFFE_E000;
const ITEM_END: Tag = 0xFFFE_E00D;
const SEQUENCE_END: Tag = 0xFFFE_E0DD;
/// A length that is not said.
const UNDEFINED: u32 = u32::MAX;
/// A longer value of a kept attribute is no sensible one; frame offsets are the longest.
const LONGEST_VALUE: u64 = 1 << 20;
/// Deeper nesting is no sensible one.
const DEEPEST: u32 = 32;

/// Attributes by tag, as their bytes.
#[derive(Debug, Clone, Default)]
pub(super) struct Attributes {
    values: BTreeMap<Tag, Vec<u8>>,
    big_endian: bool,
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

/// Where an image's pixels are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelData {
    /// The byte of the file after the element's header.
    pub(super) offset: u64,
    /// `None` where they lie in fragments.
    pub(super) length: Option<u64>,
    /// Whether they are said to be words, not bytes.
    pub(super) words: bool,
}

/// What a file says.
#[derive(Debug, Clone, Default)]
pub(super) struct DataSet {
    pub(super) root: Attributes,
    /// What the frames of a multi-frame image share.
    pub(super) shared: Attributes,
    /// What each of them has alone.
    pub(super) frames: Vec<Attributes>,
    pub(super) transfer_syntax: String,
    pub(super) big_endian: bool,
    pub(super) pixels: Option<PixelData>,
}

pub(super) const IMPLICIT_LITTLE: &str = "1.2.840.10008.1.2";
pub(super) const EXPLICIT_BIG: &str = "1.2.840.10008.1.2.2";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";

/// Whether a file begins as DICOM files do.
pub(super) fn is_magic(bytes: &[u8]) -> bool {
    bytes.get(128..132) == Some(b"DICM")
}

/// Why walking through a file ends.
#[derive(Debug)]
pub(super) enum WalkError {
    Io(io::Error),
    Dicom(DicomError),
}

impl From<io::Error> for WalkError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl DataSet {
    /// Reads a file up to its pixels. A file without the magic is taken for a bare data set, implicit
    /// little-endian, as old programs wrote them.
    pub(super) fn read(file: impl Read + Seek, length: u64) -> Result<Self, WalkError> {
        let mut walk = Walk {
            reader: BufReader::with_capacity(1 << 13, file),
            at: 0,
            length,
            explicit: true,
            big_endian: false,
        };
        let mut found = Self::default();
        let start = walk.reader.fill_buf()?;
        if is_magic(start) {
            walk.seek(132)?;
            walk.meta(&mut found.root)?;
        } else if !matches!(start, [2 | 8, 0, ..]) {
            return Err(walk.damaged("this is no DICOM file"));
        } else if start[0] == 2 {
            walk.meta(&mut found.root)?;
        }
        found.transfer_syntax =
            found.root.text(TRANSFER_SYNTAX).unwrap_or_else(|| IMPLICIT_LITTLE.to_owned());
        let uid = found.transfer_syntax.as_str();
        if uid == DEFLATED {
            let error = DicomError::TransferSyntax { uid: uid.to_owned(), name: "deflated" };
            return Err(WalkError::Dicom(error));
        }
        walk.explicit = uid != IMPLICIT_LITTLE;
        walk.big_endian = uid == EXPLICIT_BIG;
        found.big_endian = walk.big_endian;
        found.root.big_endian = walk.big_endian;
        walk.root(&mut found)?;
        Ok(found)
    }
}

/// An element's header.
#[derive(Debug, Clone, Copy)]
struct Element {
    tag: Tag,
    /// `None` where it is not written.
    representation: Option<[u8; 2]>,
    length: u32,
}

impl Element {
    /// Whether items follow.
    fn is_sequence(&self) -> bool {
        let known =
            FUNCTIONAL.contains(&self.tag) || matches!(self.tag, SHARED_GROUPS | PER_FRAME_GROUPS);
        match &self.representation {
            Some([b'S', b'Q']) => true,
            Some([b'U', b'N']) | None => known || self.length == UNDEFINED,
            Some(_) => self.length == UNDEFINED,
        }
    }
}

/// A place in a file.
struct Walk<R> {
    reader: BufReader<R>,
    at: u64,
    length: u64,
    explicit: bool,
    big_endian: bool,
}

impl<R: Read + Seek> Walk<R> {
    fn damaged(&self, what: &'static str) -> WalkError {
        WalkError::Dicom(DicomError::Damaged { at: self.at, what })
    }

    fn seek(&mut self, to: u64) -> Result<(), WalkError> {
        if to > self.length {
            return Err(self.damaged("an element reaches beyond the end of the file"));
        }
        self.reader.seek_relative(to as i64 - self.at as i64)?;
        self.at = to;
        Ok(())
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], WalkError> {
        let mut bytes = [0; N];
        if self.length - self.at < N as u64 {
            return Err(self.damaged("the file ends within an element"));
        }
        self.reader.read_exact(&mut bytes)?;
        self.at += N as u64;
        Ok(bytes)
    }

    fn u16(&mut self) -> Result<u16, WalkError> {
        let bytes = self.bytes()?;
        Ok(if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn u32(&mut self) -> Result<u32, WalkError> {
        let bytes = self.bytes()?;
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn element(&mut self) -> Result<Element, WalkError> {
        let tag = Tag::from(self.u16()?) << 16 | Tag::from(self.u16()?);
        if matches!(tag, ITEM | ITEM_END | SEQUENCE_END) || !self.explicit {
            return Ok(Element { tag, representation: None, length: self.u32()? });
        }
        let representation: [u8; 2] = self.bytes()?;
        if !representation.iter().all(u8::is_ascii_uppercase) {
            return Err(self.damaged("an element has no value representation"));
        }
        let long = matches!(
            &representation,
            b"OB"
                | b"OD"
                | b"OF"
                | b"OL"
                | b"OV"
                | b"OW"
                | b"SQ"
                | b"SV"
                | b"UC"
                | b"UN"
                | b"UR"
                | b"UT"
                | b"UV"
        );
        let length = if long {
            let _reserved: [u8; 2] = self.bytes()?;
            self.u32()?
        } else {
            u32::from(self.u16()?)
        };
        Ok(Element { tag, representation: Some(representation), length })
    }

    /// Keeps an element's value where it is wanted, else passes over it.
    fn value(&mut self, element: Element, into: &mut Attributes) -> Result<(), WalkError> {
        let length = u64::from(element.length);
        if length > self.length - self.at {
            return Err(self.damaged("an element reaches beyond the end of the file"));
        }
        if !KEPT.contains(&element.tag) || length > LONGEST_VALUE {
            return self.seek(self.at + length);
        }
        let mut value = vec![0; length as usize];
        self.reader.read_exact(&mut value)?;
        self.at += length;
        into.values.insert(element.tag, value);
        Ok(())
    }

    /// Group 2: always explicit and little-endian.
    fn meta(&mut self, into: &mut Attributes) -> Result<(), WalkError> {
        while self.length - self.at >= 2 {
            let group = self.u16()?;
            self.seek(self.at - 2)?;
            if group != 2 {
                break;
            }
            let element = self.element()?;
            self.value(element, into)?;
        }
        Ok(())
    }

    fn root(&mut self, found: &mut DataSet) -> Result<(), WalkError> {
        while self.at < self.length {
            let element = self.element()?;
            if element.tag == PIXEL_DATA {
                let fragments = element.length == UNDEFINED;
                found.pixels = Some(PixelData {
                    offset: self.at,
                    length: (!fragments).then_some(u64::from(element.length)),
                    words: element.representation != Some(*b"OB"),
                });
                return Ok(());
            }
            if element.tag > PIXEL_DATA {
                return Ok(());
            }
            if !element.is_sequence() {
                self.value(element, &mut found.root)?;
                continue;
            }
            let mut items = Vec::new();
            let kept = matches!(element.tag, SHARED_GROUPS | PER_FRAME_GROUPS);
            self.sequence(element, 0, kept.then_some(&mut items))?;
            match element.tag {
                SHARED_GROUPS => found.shared = items.pop().unwrap_or_default(),
                PER_FRAME_GROUPS => found.frames = items,
                _ => {}
            }
        }
        Ok(())
    }

    /// Goes through a sequence; its items' attributes, and those of the sequences in them, are kept
    /// together where they are wanted.
    fn sequence(
        &mut self,
        element: Element,
        depth: u32,
        mut items: Option<&mut Vec<Attributes>>,
    ) -> Result<(), WalkError> {
        let explicit = self.explicit;
        // Of unknown representation and length, a sequence is written without representations.
        if element.representation == Some(*b"UN") {
            self.explicit = false;
        }
        let end = self.end(element)?;
        if items.is_none()
            && let Some(end) = end
        {
            self.explicit = explicit;
            return self.seek(end);
        }
        while end.is_none_or(|end| self.at < end) {
            let item = self.element()?;
            match item.tag {
                SEQUENCE_END => break,
                ITEM => {}
                _ => return Err(self.damaged("a sequence has something else than items")),
            }
            let mut attributes =
                Attributes { big_endian: self.big_endian, ..Attributes::default() };
            self.item(item, depth + 1, items.is_some().then_some(&mut attributes))?;
            if let Some(items) = &mut items {
                items.push(attributes);
            }
        }
        self.explicit = explicit;
        Ok(())
    }

    fn item(
        &mut self,
        item: Element,
        depth: u32,
        mut into: Option<&mut Attributes>,
    ) -> Result<(), WalkError> {
        if depth > DEEPEST {
            return Err(self.damaged("sequences are nested too deeply"));
        }
        let end = self.end(item)?;
        if into.is_none()
            && let Some(end) = end
        {
            return self.seek(end);
        }
        while end.is_none_or(|end| self.at < end) {
            let element = self.element()?;
            if element.tag == ITEM_END {
                break;
            }
            if element.is_sequence() {
                let mut inner = Vec::new();
                let wanted = into.is_some() && FUNCTIONAL.contains(&element.tag);
                self.sequence(element, depth, wanted.then_some(&mut inner))?;
                if let Some(into) = &mut into {
                    for attributes in inner {
                        into.values.extend(attributes.values);
                    }
                }
            } else if let Some(into) = &mut into {
                self.value(element, into)?;
            } else {
                self.value(element, &mut Attributes::default())?;
            }
        }
        Ok(())
    }

    /// Where an element of a said length ends.
    fn end(&self, element: Element) -> Result<Option<u64>, WalkError> {
        if element.length == UNDEFINED {
            return Ok(None);
        }
        let end = self.at + u64::from(element.length);
        if end > self.length {
            return Err(self.damaged("an element reaches beyond the end of the file"));
        }
        Ok(Some(end))
    }
}

/// A piece of coded pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fragment {
    /// The byte of the file at which it begins.
    pub(super) offset: u64,
    /// Its bytes.
    pub(super) length: u64,
}

/// The fragments of an image's pixels, frame by frame. The first item is a table of the frames' places,
/// counted from the first fragment's header; it may be empty.
pub(super) fn fragments(
    mut file: impl Read + Seek,
    length: u64,
    pixels: PixelData,
    frames: usize,
) -> Result<Vec<Vec<Fragment>>, WalkError> {
    file.seek(SeekFrom::Start(pixels.offset))?;
    let mut walk = Walk {
        reader: BufReader::with_capacity(1 << 9, file),
        at: pixels.offset,
        length,
        explicit: true,
        big_endian: false,
    };
    let mut table = Vec::new();
    let mut found = Vec::new();
    let mut first = None;
    loop {
        let item = walk.element()?;
        match item.tag {
            SEQUENCE_END => break,
            ITEM if item.length != UNDEFINED => {}
            _ => return Err(walk.damaged("the pixels have something else than fragments")),
        }
        let fragment = Fragment { offset: walk.at, length: u64::from(item.length) };
        let end = walk.at + fragment.length;
        if end > length {
            return Err(walk.damaged("the file ends within the pixels"));
        }
        if first.is_none() {
            for _ in 0..fragment.length / 4 {
                table.push(u64::from(walk.u32()?));
            }
            first = Some(end);
        } else {
            found.push(fragment);
        }
        walk.seek(end)?;
    }
    if found.is_empty() || frames == 1 {
        return Ok(vec![found]);
    }
    if found.len() == frames {
        return Ok(found.into_iter().map(|fragment| vec![fragment]).collect());
    }
    let start = first.unwrap_or(0);
    if table.len() != frames {
        return Err(walk.damaged("it cannot be told which fragments make a frame"));
    }
    let mut by_frame = vec![Vec::new(); frames];
    for fragment in found {
        // The table counts to the fragment's own header, of 8 bytes.
        let place = fragment.offset - 8 - start;
        let frame = table.partition_point(|&first| first <= place).saturating_sub(1);
        by_frame[frame].push(fragment);
    }
    Ok(by_frame)
}
