//! Steps through a DICOM file: headers of elements, short values, and nothing beyond the file's end.
//!
//! After DICOM PS3.5, section 7.1.

use super::DicomError;
use super::attributes::{Attributes, KEPT, LONGEST_VALUE, Tag};
use std::io::{self, BufReader, Read, Seek};

pub(super) const ITEM: Tag = 0xFFFE_E000;
pub(super) const ITEM_END: Tag = 0xFFFE_E00D;
pub(super) const SEQUENCE_END: Tag = 0xFFFE_E0DD;
/// A length that is not said.
pub(super) const UNDEFINED: u32 = u32::MAX;

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

/// An element's header.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element {
    pub(super) tag: Tag,
    /// `None` where it is not written.
    pub(super) representation: Option<[u8; 2]>,
    pub(super) length: u32,
}

/// A place in a file.
pub(super) struct Walk<R> {
    pub(super) reader: BufReader<R>,
    pub(super) at: u64,
    pub(super) length: u64,
    pub(super) explicit: bool,
    pub(super) big_endian: bool,
}

impl<R: Read + Seek> Walk<R> {
    pub(super) fn damaged(&self, what: &'static str) -> WalkError {
        WalkError::Dicom(DicomError::Damaged { at: self.at, what })
    }

    pub(super) fn seek(&mut self, to: u64) -> Result<(), WalkError> {
        if to > self.length {
            return Err(self.damaged("an element reaches beyond the end of the file"));
        }
        self.reader.seek_relative(to as i64 - self.at as i64)?;
        self.at = to;
        Ok(())
    }

    pub(super) fn bytes<const N: usize>(&mut self) -> Result<[u8; N], WalkError> {
        let mut bytes = [0; N];
        if self.length - self.at < N as u64 {
            return Err(self.damaged("the file ends within an element"));
        }
        self.reader.read_exact(&mut bytes)?;
        self.at += N as u64;
        Ok(bytes)
    }

    pub(super) fn u16(&mut self) -> Result<u16, WalkError> {
        let bytes = self.bytes()?;
        Ok(if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    pub(super) fn u32(&mut self) -> Result<u32, WalkError> {
        let bytes = self.bytes()?;
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    pub(super) fn element(&mut self) -> Result<Element, WalkError> {
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
    pub(super) fn value(
        &mut self,
        element: Element,
        into: &mut Attributes,
    ) -> Result<(), WalkError> {
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

    /// Where an element of a said length ends.
    pub(super) fn end(&self, element: Element) -> Result<Option<u64>, WalkError> {
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
