//! The bones of a TIFF file: header, directories of tags, and the values of tags, read where they lie
//! in a mapped file. Nothing is copied and nothing is believed: whatever leaves the file is an error.
//!
//! TIFF 6.0 (Aldus, 1992) with BigTIFF's 64-bit offsets.

use super::TiffError;

/// The least bytes of a directory: its count, one entry, and the next one's offset.
const LEAST_IFD: u64 = 2 + 12 + 4;

/// A TIFF file's bytes, and how its numbers are written.
#[derive(Debug, Clone, Copy)]
pub(super) struct TiffBytes<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) big_endian: bool,
    big: bool,
    first_ifd: u64,
}

/// Whether a file that begins with these bytes says that it is TIFF.
pub(crate) fn is_magic(start: &[u8]) -> bool {
    matches!(start.get(..4), Some(b"II\x2a\0" | b"MM\0\x2a" | b"II\x2b\0" | b"MM\0\x2b"))
}

impl<'a> TiffBytes<'a> {
    /// Reads the header.
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, TiffError> {
        if !is_magic(bytes) {
            return Err(TiffError::NotTiff { found: bytes[..bytes.len().min(8)].to_vec() });
        }
        let big_endian = bytes[0] == b'M';
        let big = bytes[2] == 0x2b || bytes[3] == 0x2b;
        let mut file = Self { bytes, big_endian, big, first_ifd: 0 };
        file.first_ifd = if big {
            let offset_bytes = file.number("the header", 4, 2)?;
            if offset_bytes != 8 {
                let (name, expected) = ("size of offsets", "and in BigTIFF it is 8");
                return Err(TiffError::Value { name, found: offset_bytes, expected });
            }
            file.number("the header", 8, 8)?
        } else {
            file.number("the header", 4, 4)?
        };
        Ok(file)
    }

    /// `length` bytes at `offset`.
    pub(super) fn slice(
        &self,
        what: &'static str,
        offset: u64,
        length: u64,
    ) -> Result<&'a [u8], TiffError> {
        let end = offset.checked_add(length).and_then(|end| usize::try_from(end).ok());
        end.and_then(|end| self.bytes.get(offset as usize..end)).ok_or(TiffError::Outside {
            what,
            offset,
            length,
            file_length: self.bytes.len() as u64,
        })
    }

    /// An unsigned number of 2, 4 or 8 bytes.
    fn number(&self, what: &'static str, offset: u64, bytes: u64) -> Result<u64, TiffError> {
        Ok(unsigned(self.slice(what, offset, bytes)?, self.big_endian))
    }

    /// The directory at `offset`.
    pub(super) fn ifd(&self, offset: u64) -> Result<Ifd<'a>, TiffError> {
        let what = "a page's directory";
        let (count_bytes, entry, next_bytes) = if self.big { (8, 20, 8) } else { (2, 12, 4) };
        let count = self.number(what, offset, count_bytes)?;
        let entries = self.slice(what, offset + count_bytes, count.saturating_mul(entry))?;
        let next = offset + count_bytes + entries.len() as u64;
        let next = self.number(what, next, next_bytes)?;
        Ok(Ifd { file: *self, entries, next })
    }

    /// All directories of the file's list, first to last.
    pub(super) fn ifds(self) -> Ifds<'a> {
        Ifds { file: self, next: self.first_ifd, mark: 0, seen: 0, power: 1 }
    }
}

fn unsigned(bytes: &[u8], big_endian: bool) -> u64 {
    let fold = |value: u64, &byte: &u8| value << 8 | u64::from(byte);
    if big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) }
}

/// The directories of a file one after the other, with their offsets; ends after an error. A list that
/// comes back to itself is found by Brent's method, in constant memory.
#[derive(Debug)]
pub(super) struct Ifds<'a> {
    file: TiffBytes<'a>,
    next: u64,
    mark: u64,
    seen: u64,
    power: u64,
}

impl<'a> Iterator for Ifds<'a> {
    type Item = Result<(u64, Ifd<'a>), TiffError>;

    fn next(&mut self) -> Option<Self::Item> {
        let offset = self.next;
        if offset == 0 {
            return None;
        }
        let most = self.file.bytes.len() as u64 / LEAST_IFD + 1;
        if offset == self.mark || self.seen > most {
            self.next = 0;
            return Some(Err(TiffError::PageLoop));
        }
        self.seen += 1;
        if self.seen == self.power {
            self.mark = offset;
            self.power *= 2;
        }
        let ifd = self.file.ifd(offset);
        self.next = ifd.as_ref().map_or(0, |ifd| ifd.next);
        Some(ifd.map(|ifd| (offset, ifd)))
    }
}

/// One directory: a page's tags.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ifd<'a> {
    pub(super) file: TiffBytes<'a>,
    entries: &'a [u8],
    next: u64,
}

impl<'a> Ifd<'a> {
    /// A tag's values, if it is there.
    pub(super) fn find(
        &self,
        tag: u16,
        name: &'static str,
    ) -> Result<Option<Values<'a>>, TiffError> {
        let file = &self.file;
        let number = |bytes: &[u8]| unsigned(bytes, file.big_endian);
        let size = if file.big { 20 } else { 12 };
        let mut entries = self.entries.chunks_exact(size);
        let Some(entry) = entries.find(|entry| number(&entry[..2]) == u64::from(tag)) else {
            return Ok(None);
        };
        let kind = number(&entry[2..4]) as u16;
        let (count, place) =
            if file.big { (number(&entry[4..12]), 12) } else { (number(&entry[4..8]), 8) };
        let width = match kind {
            1 | 2 | 6 | 7 => 1,
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16 | 17 | 18 => 8,
            _ => return Err(TiffError::Tag { name }),
        };
        let length = count.saturating_mul(width);
        let bytes = if length <= (size - place) as u64 {
            &entry[place..place + length as usize]
        } else {
            file.slice(name, number(&entry[place..]), length)?
        };
        Ok(Some(Values { kind, width: width as usize, bytes, big_endian: file.big_endian }))
    }

    /// A tag's first value, or `default` where the tag is not there.
    pub(super) fn number_or(
        &self,
        tag: u16,
        name: &'static str,
        default: u64,
    ) -> Result<u64, TiffError> {
        match self.find(tag, name)? {
            Some(values) => values.get(0).ok_or(TiffError::Tag { name }),
            None => Ok(default),
        }
    }

    /// A tag's first value, which must be there.
    pub(super) fn number(&self, tag: u16, name: &'static str) -> Result<u64, TiffError> {
        self.find(tag, name)?.and_then(|values| values.get(0)).ok_or(TiffError::Tag { name })
    }

    /// A fraction above 0, if there is one.
    pub(super) fn fraction(&self, tag: u16) -> Option<f64> {
        self.divided(tag, |over, under| over / under)
    }

    /// What 1 is over a fraction above 0, with one rounding alone.
    pub(super) fn inverse_fraction(&self, tag: u16) -> Option<f64> {
        self.divided(tag, |over, under| under / over)
    }

    fn divided(&self, tag: u16, divide: impl FnOnce(f64, f64) -> f64) -> Option<f64> {
        let values = self.find(tag, "resolution").ok()??;
        let number = |at: usize| {
            let bytes = values.bytes.get(at..at + 4)?;
            Some(unsigned(bytes, values.big_endian) as f64)
        };
        let value = match values.kind {
            5 => divide(number(0)?, number(4)?),
            _ => divide(values.get(0)? as f64, 1.0),
        };
        (value.is_finite() && value > 0.0).then_some(value)
    }

    /// A tag's text, up to its first zero; what is not UTF-8 is taken as Latin-1.
    pub(super) fn text(&self, tag: u16) -> Option<String> {
        let values = self.find(tag, "text").ok()??;
        if !matches!(values.kind, 1 | 2 | 7) {
            return None;
        }
        let text = values.bytes.split(|&byte| byte == 0).next()?;
        Some(match std::str::from_utf8(text) {
            Ok(text) => text.to_owned(),
            Err(_) => text.iter().map(|&byte| char::from(byte)).collect(),
        })
    }
}

/// The values of a tag.
#[derive(Debug, Clone, Copy)]
pub(super) struct Values<'a> {
    kind: u16,
    width: usize,
    bytes: &'a [u8],
    big_endian: bool,
}

impl Values<'_> {
    /// How many.
    pub(super) fn count(&self) -> u64 {
        (self.bytes.len() / self.width) as u64
    }

    /// Value `index`, if there is one and it is an unsigned integer.
    pub(super) fn get(&self, index: u64) -> Option<u64> {
        if !matches!(self.kind, 1 | 3 | 4 | 13 | 16 | 18) {
            return None;
        }
        let first = usize::try_from(index).ok()?.checked_mul(self.width)?;
        let bytes = self.bytes.get(first..first.checked_add(self.width)?)?;
        Some(unsigned(bytes, self.big_endian))
    }
}
