//! DICOM files as attributes: those that an image's place and pixels need, and where its pixels are.
//!
//! After DICOM PS3.5, section 7 (data elements), and PS3.10 (files). Nothing is read but headers of
//! elements and short values, no more than the file is long; pixels stay where they are.

use super::DicomError;
use super::attributes::{Attributes, TRANSFER_SYNTAX, Tag};
use super::walk::{Element, ITEM, ITEM_END, SEQUENCE_END, UNDEFINED, Walk, WalkError};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};

/// Sequences that hold what all frames of a multi-frame image share, and what each has alone.
const SHARED_GROUPS: Tag = 0x5200_9229;
const PER_FRAME_GROUPS: Tag = 0x5200_9230;
/// The sequences in them that are looked into: of pixel sizes, positions, orientations and values.
const FUNCTIONAL: [Tag; 4] = [0x0028_9110, 0x0020_9113, 0x0020_9116, 0x0028_9145];
const PIXEL_DATA: Tag = 0x7FE0_0010;
/// Deeper nesting is no sensible one.
const DEEPEST: u32 = 32;

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
            let error = DicomError::TransferSyntax {
                uid: uid.to_owned(),
                name: "deflated",
                remedy: "'dcmconv +te IN OUT' of DCMTK or 'gdcmconv --raw IN OUT' of GDCM",
            };
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

impl<R: Read + Seek> Walk<R> {
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
            if element.tag == 0 {
                return Err(self.damaged("there are zeros where an element should be"));
            }
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
