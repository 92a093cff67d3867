//! Where each header field lies and how wide it is, for reading and for writing: `nifti1.h`'s and
//! `nifti2.h`'s structs as two tables. NIfTI-2 has the same fields, wider and in another order.
//! Analyze 7.5 shares NIfTI-1's table as far as the description.
//!
//! | field        | NIfTI-1   | NIfTI-2   |
//! |--------------|-----------|-----------|
//! | dim          | i16 x 8   | i64 x 8   |
//! | vox_offset   | f32       | i64       |
//! | other floats | f32       | f64       |
//! | xyzt_units   | u8        | i32       |
//! | form codes   | i16       | i32       |

use super::{NiftiHeaderError, NiftiKind};
use std::array::from_fn;

/// Byte offsets of the fields that are used here.
#[derive(Debug, PartialEq)]
pub(super) struct Layout {
    pub(super) version: u8,
    /// `sizeof_hdr`.
    pub(super) header_bytes: usize,
    pub(super) magic: usize,
    pub(super) dim: usize,
    pub(super) datatype: usize,
    pub(super) bitpix: usize,
    pub(super) pixdim: usize,
    pub(super) vox_offset: usize,
    pub(super) scl_slope: usize,
    pub(super) scl_inter: usize,
    pub(super) xyzt_units: usize,
    pub(super) descrip: usize,
    pub(super) qform_code: usize,
    pub(super) sform_code: usize,
    pub(super) quatern: usize,
    pub(super) qoffset: usize,
    pub(super) srow: usize,
}

pub(super) static NIFTI_1: Layout = Layout {
    version: 1,
    header_bytes: 348,
    dim: 40,
    datatype: 70,
    bitpix: 72,
    pixdim: 76,
    vox_offset: 108,
    scl_slope: 112,
    scl_inter: 116,
    xyzt_units: 123,
    descrip: 148,
    qform_code: 252,
    sform_code: 254,
    quatern: 256,
    qoffset: 268,
    srow: 280,
    magic: 344,
};

pub(super) static NIFTI_2: Layout = Layout {
    version: 2,
    header_bytes: 540,
    magic: 4,
    datatype: 12,
    bitpix: 14,
    dim: 16,
    pixdim: 104,
    vox_offset: 168,
    scl_slope: 176,
    scl_inter: 184,
    descrip: 240,
    qform_code: 344,
    sform_code: 348,
    quatern: 352,
    qoffset: 376,
    srow: 400,
    xyzt_units: 500,
};

/// Bytes of `descrip`.
const DESCRIP_BYTES: usize = 80;
/// Bytes after the header that say whether extensions follow.
const EXTENDER_BYTES: usize = 4;
/// NIfTI-2's magic goes on with these, as PNG's does, to show a text-mode transfer.
const LINE_ENDS: [u8; 4] = *b"\r\n\x1a\n";

impl Layout {
    /// Where voxels begin in a single file without extensions: 352 or 544.
    pub(super) fn first_voxel_byte(&self) -> u64 {
        (self.header_bytes + EXTENDER_BYTES) as u64
    }

    pub(super) fn float_bits(&self) -> u32 {
        if self.version == 1 { 32 } else { 64 }
    }

    fn float_bytes(&self) -> usize {
        self.float_bits() as usize / 8
    }

    /// A number as it will be read again.
    pub(super) fn stored_float(&self, value: f64) -> f64 {
        if self.version == 1 { f64::from(value as f32) } else { value }
    }
}

/// A header's bytes, long enough for their layout.
#[derive(Debug)]
pub(super) struct Fields<'a> {
    pub(super) layout: &'static Layout,
    pub(super) big_endian: bool,
    bytes: &'a [u8],
}

impl<'a> Fields<'a> {
    /// Finds version and byte order from `sizeof_hdr`.
    pub(super) fn locate(bytes: &'a [u8]) -> Result<Self, NiftiHeaderError> {
        let found = bytes.len();
        let &sizeof_hdr = bytes
            .first_chunk()
            .ok_or(NiftiHeaderError::TooShort { expected: NIFTI_1.header_bytes, found })?;
        let little = i32::from_le_bytes(sizeof_hdr);
        let (layout, big_endian) = match (little, i32::from_be_bytes(sizeof_hdr)) {
            (348, _) => (&NIFTI_1, false),
            (_, 348) => (&NIFTI_1, true),
            (540, _) => (&NIFTI_2, false),
            (_, 540) => (&NIFTI_2, true),
            _ => return Err(NiftiHeaderError::NotNifti { sizeof_hdr: little }),
        };
        let expected = layout.header_bytes;
        let bytes = bytes.get(..expected).ok_or(NiftiHeaderError::TooShort { expected, found })?;
        Ok(Self { layout, big_endian, bytes })
    }

    /// The magic, of which the NUL is a part, tells NIfTI-1 from Analyze. Analyze's last field, a
    /// number, lies in its place: one that begins like a magic is taken for a damaged one.
    pub(super) fn kind(&self) -> Result<NiftiKind, NiftiHeaderError> {
        let magic = &self.bytes[self.layout.magic..][..4];
        if self.layout.version == 1 {
            return match magic {
                b"n+1\0" => Ok(NiftiKind::SingleFile),
                b"ni1\0" => Ok(NiftiKind::Pair),
                [b'n', b'+' | b'i', ..] => Err(NiftiHeaderError::BadMagic {
                    expected: "\"n+1\\0\" or \"ni1\\0\"",
                    found: magic.escape_ascii().to_string(),
                }),
                _ => Ok(NiftiKind::Analyze),
            };
        }
        let line_ends = &self.bytes[self.layout.magic + 4..][..4];
        // Some writers leave the line ends out; nibabel takes that, too.
        let undamaged = line_ends == LINE_ENDS || line_ends == [0; 4];
        match magic {
            b"n+2\0" if undamaged => Ok(NiftiKind::SingleFile),
            b"ni2\0" if undamaged => Ok(NiftiKind::Pair),
            _ => Err(NiftiHeaderError::BadMagic {
                expected: "\"n+2\\0\\r\\n\\x1a\\n\" or \"ni2\\0\\r\\n\\x1a\\n\"",
                found: self.bytes[self.layout.magic..][..8].escape_ascii().to_string(),
            }),
        }
    }

    pub(super) fn datatype(&self) -> i16 {
        i16::from_le_bytes(self.little(self.layout.datatype))
    }

    pub(super) fn bitpix(&self) -> i16 {
        i16::from_le_bytes(self.little(self.layout.bitpix))
    }

    /// `dim[index]`; 0 is the number of dimensions.
    pub(super) fn dim(&self, index: usize) -> i64 {
        if self.layout.version == 1 {
            i64::from(i16::from_le_bytes(self.little(self.layout.dim + 2 * index)))
        } else {
            i64::from_le_bytes(self.little(self.layout.dim + 8 * index))
        }
    }

    /// Towards zero, as the standard's `(int)vox_offset`; the stored value where that is no place
    /// in a file. A fraction below 1 is none: 0 means that the field is unset.
    pub(super) fn vox_offset(&self) -> Result<u64, f64> {
        const FILE_END: f64 = (1_u64 << 63) as f64;
        if self.layout.version == 1 {
            let value = self.float(self.layout.vox_offset);
            let a_place = value == 0.0 || (1.0..FILE_END).contains(&value);
            if a_place { Ok(value as u64) } else { Err(value) }
        } else {
            let value = i64::from_le_bytes(self.little(self.layout.vox_offset));
            u64::try_from(value).map_err(|_| value as f64)
        }
    }

    pub(super) fn xyzt_units(&self) -> i32 {
        if self.layout.version == 1 {
            i32::from(self.bytes[self.layout.xyzt_units])
        } else {
            i32::from_le_bytes(self.little(self.layout.xyzt_units))
        }
    }

    /// `qform_code` or `sform_code`.
    pub(super) fn code(&self, at: usize) -> i32 {
        if self.layout.version == 1 {
            i32::from(i16::from_le_bytes(self.little(at)))
        } else {
            i32::from_le_bytes(self.little(at))
        }
    }

    pub(super) fn float(&self, at: usize) -> f64 {
        if self.layout.version == 1 {
            f64::from(f32::from_le_bytes(self.little(at)))
        } else {
            f64::from_le_bytes(self.little(at))
        }
    }

    pub(super) fn floats<const N: usize>(&self, at: usize) -> [f64; N] {
        from_fn(|i| self.float(at + i * self.layout.float_bytes()))
    }

    pub(super) fn srow_xyz(&self) -> [[f64; 4]; 3] {
        from_fn(|row| self.floats(self.layout.srow + row * 4 * self.layout.float_bytes()))
    }

    pub(super) fn description(&self) -> String {
        let field = &self.bytes[self.layout.descrip..][..DESCRIP_BYTES];
        let text = field.split(|&byte| byte == 0).next().unwrap_or_default();
        String::from_utf8_lossy(text).into_owned()
    }

    /// `N` bytes, least significant first.
    fn little<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut raw = from_fn(|i| self.bytes[at + i]);
        if self.big_endian {
            raw.reverse();
        }
        raw
    }
}

/// A header under construction: little-endian, with the extender's four zeros.
#[derive(Debug)]
pub(super) struct FieldsMut {
    layout: &'static Layout,
    bytes: Vec<u8>,
}

impl FieldsMut {
    pub(super) fn new(layout: &'static Layout) -> Self {
        let mut fields = Self { layout, bytes: vec![0; layout.header_bytes + EXTENDER_BYTES] };
        fields.put(0, &(layout.header_bytes as i32).to_le_bytes());
        fields
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    pub(super) fn set_kind(&mut self, kind: NiftiKind) {
        let version = b'0' + self.layout.version;
        let magic = match kind {
            NiftiKind::SingleFile => [b'n', b'+', version, 0],
            NiftiKind::Pair => [b'n', b'i', version, 0],
            NiftiKind::Analyze => return,
        };
        self.put(self.layout.magic, &magic);
        if self.layout.version == 2 {
            self.put(self.layout.magic + 4, &LINE_ENDS);
        }
    }

    pub(super) fn set_type(&mut self, datatype: i16, bitpix: i16) {
        self.put(self.layout.datatype, &datatype.to_le_bytes());
        self.put(self.layout.bitpix, &bitpix.to_le_bytes());
    }

    /// A dimension that does not fit becomes 0, which is refused on reading.
    pub(super) fn set_dim(&mut self, index: usize, value: u64) {
        if self.layout.version == 1 {
            let value = i16::try_from(value).unwrap_or(0);
            self.put(self.layout.dim + 2 * index, &value.to_le_bytes());
        } else {
            let value = i64::try_from(value).unwrap_or(0);
            self.put(self.layout.dim + 8 * index, &value.to_le_bytes());
        }
    }

    /// An offset that does not fit becomes -1, which is refused on reading.
    pub(super) fn set_vox_offset(&mut self, value: u64) {
        if self.layout.version == 1 {
            let exact = value as f32 as u64 == value;
            self.set_float(self.layout.vox_offset, if exact { value as f64 } else { -1.0 });
        } else {
            let value = i64::try_from(value).unwrap_or(-1);
            self.put(self.layout.vox_offset, &value.to_le_bytes());
        }
    }

    pub(super) fn set_xyzt_units(&mut self, value: i32) {
        let width = if self.layout.version == 1 { 1 } else { 4 };
        self.put(self.layout.xyzt_units, &value.to_le_bytes()[..width]);
    }

    /// A code that does not fit becomes 0: unknown.
    pub(super) fn set_code(&mut self, at: usize, value: i32) {
        if self.layout.version == 1 {
            self.put(at, &i16::try_from(value).unwrap_or(0).to_le_bytes());
        } else {
            self.put(at, &value.to_le_bytes());
        }
    }

    pub(super) fn set_float(&mut self, at: usize, value: f64) {
        if self.layout.version == 1 {
            self.put(at, &(value as f32).to_le_bytes());
        } else {
            self.put(at, &value.to_le_bytes());
        }
    }

    pub(super) fn set_floats(&mut self, at: usize, values: &[f64]) {
        for (i, &value) in values.iter().enumerate() {
            self.set_float(at + i * self.layout.float_bytes(), value);
        }
    }

    /// As many whole characters as fit.
    pub(super) fn set_description(&mut self, text: &str) {
        let end = text.floor_char_boundary(DESCRIP_BYTES);
        self.put(self.layout.descrip, &text.as_bytes()[..end]);
    }

    fn put(&mut self, at: usize, bytes: &[u8]) {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }
}
