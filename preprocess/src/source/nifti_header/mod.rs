//! NIfTI-1, NIfTI-2 and Analyze 7.5 headers, read and written without touching a file.
//!
//! We read them ourselves because the `nifti` crate (0.18) knows NIfTI-1 only (NIfTI-2 has a header
//! of 540 bytes, `i64` dimensions, `f64` slopes), takes dimensions for `u16`, and is more lenient
//! than a converter may be: it checks neither `sizeof_hdr` nor `bitpix` nor `vox_offset`. It serves
//! our tests as an oracle. Sources: `nifti1.h`, `nifti2.h` and their reference library
//! `nifti_clib`; where these leave a choice, nibabel's rule, named where it is used.

mod error;
mod layout;
mod quaternion;
#[cfg(test)]
mod tests;
mod write;

pub use error::NiftiHeaderError;

use layout::Fields;

/// Where the voxels are, seen from the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NiftiKind {
    /// After the header, in the same file (magic `n+1` or `n+2`).
    SingleFile,
    /// In an `.img` file beside the header's `.hdr` (magic `ni1` or `ni2`).
    Pair,
    /// In an `.img` file, and the header is Analyze 7.5: 348 bytes without a magic of NIfTI-1.
    Analyze,
}

/// The stored types that hold one real number a voxel, in at most 32 bits or as a float.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NiftiDatatype {
    /// `DT_UINT8`, code 2.
    U8,
    /// `DT_INT8`, code 256.
    I8,
    /// `DT_UINT16`, code 512.
    U16,
    /// `DT_INT16`, code 4.
    I16,
    /// `DT_UINT32`, code 768.
    U32,
    /// `DT_INT32`, code 8.
    I32,
    /// `DT_FLOAT32`, code 16.
    F32,
    /// `DT_FLOAT64`, code 64.
    F64,
}

impl NiftiDatatype {
    /// Every stored type that can be read.
    pub const ALL: [Self; 8] =
        [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::F32, Self::F64];

    /// The header's `datatype` code.
    pub fn code(self) -> i16 {
        match self {
            Self::U8 => 2,
            Self::I16 => 4,
            Self::I32 => 8,
            Self::F32 => 16,
            Self::F64 => 64,
            Self::I8 => 256,
            Self::U16 => 512,
            Self::U32 => 768,
        }
    }

    /// Bytes a voxel.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The header's `bitpix`.
    fn bits(self) -> i16 {
        8 * self.bytes() as i16
    }

    fn from_code(code: i16) -> Result<Self, NiftiHeaderError> {
        Self::ALL
            .into_iter()
            .find(|datatype| datatype.code() == code)
            .ok_or_else(|| NiftiHeaderError::unsupported_datatype(code))
    }
}

/// The unit of `pixdim[1..=3]` and of world positions: `xyzt_units & 7`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NiftiUnit {
    /// Not said, or a code that the standard does not define.
    Unknown,
    /// `NIFTI_UNITS_METER`, code 1.
    Metre,
    /// `NIFTI_UNITS_MM`, code 2.
    Millimetre,
    /// `NIFTI_UNITS_MICRON`, code 3.
    Micrometre,
}

impl NiftiUnit {
    fn code(self) -> i32 {
        match self {
            Self::Unknown => 0,
            Self::Metre => 1,
            Self::Millimetre => 2,
            Self::Micrometre => 3,
        }
    }

    fn from_xyzt_units(xyzt_units: i32) -> Self {
        match xyzt_units & 7 {
            1 => Self::Metre,
            2 => Self::Millimetre,
            3 => Self::Micrometre,
            _ => Self::Unknown,
        }
    }
}

/// What a header says of its volume; fields bear the standard's names where they hold its values.
///
/// NIfTI-1 stores 32-bit floats: they are widened, never changed.
#[derive(Debug, Clone, PartialEq)]
pub struct NiftiHeader {
    /// 1 (NIfTI-1 and Analyze) or 2.
    pub version: u8,
    /// Where the voxels are.
    pub kind: NiftiKind,
    /// Whether header and voxels have their most significant byte first.
    pub big_endian: bool,
    /// `dim[1..=dim[0]]`: voxels along x, y, z, then time and further axes; x varies fastest. As
    /// many as the header says, trailing ones of length 1 included; each at least 1.
    pub dims: Vec<u64>,
    /// The type of the stored voxels.
    pub datatype: NiftiDatatype,
    /// The byte where voxels begin, in the file that holds them; at least 352 (NIfTI-2: 544) in a
    /// single file. Together with the voxels it stays below 2^64.
    pub vox_offset: u64,
    /// As stored; use [`NiftiHeader::scaling`].
    pub scl_slope: f64,
    /// As stored; use [`NiftiHeader::scaling`].
    pub scl_inter: f64,
    /// As stored: `[0]` is the handedness of the qform, the others are voxel sizes, `[1..=3]` in
    /// `spatial_unit`; use [`NiftiHeader::spacing_xyz`].
    pub pixdim: [f64; 8],
    /// The unit of voxel sizes and world positions.
    pub spatial_unit: NiftiUnit,
    /// Above 0 where the quaternion gives world positions ("method 2").
    pub qform_code: i32,
    /// Above 0 where `srow_xyz` gives world positions ("method 3").
    pub sform_code: i32,
    /// The vector part of the qform's unit quaternion.
    pub quatern_bcd: [f64; 3],
    /// The world position of voxel (0, 0, 0) by the qform.
    pub qoffset_xyz: [f64; 3],
    /// The sform: three rows of world position = row * (i, j, k, 1).
    pub srow_xyz: [[f64; 4]; 3],
    /// `descrip`: up to 80 bytes of text, to the first NUL; what is not UTF-8 becomes U+FFFD.
    pub description: String,
}

impl NiftiHeader {
    /// Reads the header at the start of a file's decompressed bytes; the first 348 (NIfTI-2: 540)
    /// are looked at, and what follows is not.
    ///
    /// A single file's `vox_offset` of 0 counts as unset and becomes 352 (544), as `nifti1.h` has
    /// it. Other values below that are refused, as nibabel does: `nifti1.h` would round them up to
    /// 352, `nifti_clib` to 348. Analyze keeps neither unit nor affine nor scaling, and a
    /// `vox_offset` that is no place in a file counts as 0.
    ///
    /// # Errors
    /// When the bytes are too few, are no such header, or describe voxels that cannot be read.
    pub fn parse(bytes: &[u8]) -> Result<Self, NiftiHeaderError> {
        let fields = Fields::locate(bytes)?;
        let kind = fields.kind()?;
        let dims = parse_dims(&fields)?;
        let datatype = NiftiDatatype::from_code(fields.datatype())?;
        let bitpix = fields.bitpix();
        if bitpix != datatype.bits() {
            return Err(NiftiHeaderError::BitpixMismatch {
                datatype,
                expected: datatype.bits(),
                bitpix,
            });
        }
        check_size(&dims, datatype)?;
        let header = Self {
            version: fields.layout.version,
            kind,
            big_endian: fields.big_endian,
            dims,
            datatype,
            vox_offset: parse_vox_offset(&fields, kind)?,
            scl_slope: fields.float(fields.layout.scl_slope),
            scl_inter: fields.float(fields.layout.scl_inter),
            pixdim: fields.floats(fields.layout.pixdim),
            spatial_unit: NiftiUnit::Unknown,
            qform_code: 0,
            sform_code: 0,
            quatern_bcd: [0.0; 3],
            qoffset_xyz: [0.0; 3],
            srow_xyz: [[0.0; 4]; 3],
            description: fields.description(),
        };
        if kind == NiftiKind::Analyze {
            // Its bytes there mean other things (orientation, patient, dates).
            return Ok(header);
        }
        let (slope, inter) = (header.scl_slope, header.scl_inter);
        if slope != 0.0 && slope.is_finite() && !inter.is_finite() {
            return Err(NiftiHeaderError::BadScaling { slope, inter });
        }
        Ok(Self {
            spatial_unit: NiftiUnit::from_xyzt_units(fields.xyzt_units()),
            qform_code: fields.code(fields.layout.qform_code),
            sform_code: fields.code(fields.layout.sform_code),
            quatern_bcd: fields.floats(fields.layout.quatern),
            qoffset_xyz: fields.floats(fields.layout.qoffset),
            srow_xyz: fields.srow_xyz(),
            ..header
        })
    }

    /// Voxel index (of a voxel's centre) to world position in `spatial_unit`, row major: the sform
    /// where its code is above 0, else the qform where its code is, else `None`.
    ///
    /// A transform that holds a NaN or an infinity counts as absent. The matrix may be singular:
    /// nothing in the standard forbids it.
    pub fn affine(&self) -> Option<[[f64; 4]; 4]> {
        let sform = (self.sform_code > 0).then_some(self.srow_xyz);
        let qform = (self.qform_code > 0).then(|| {
            quaternion::qform_rows(
                self.quatern_bcd,
                self.qoffset_xyz,
                self.spacing_xyz(),
                self.pixdim[0] < 0.0,
            )
        });
        let [x, y, z] = [sform, qform]
            .into_iter()
            .flatten()
            .find(|rows| rows.as_flattened().iter().all(|value| value.is_finite()))?;
        Some([x, y, z, [0.0, 0.0, 0.0, 1.0]])
    }

    /// The size of a voxel along x, y, z in `spatial_unit`: `|pixdim[1..=3]|`, and 1 where that is
    /// 0 or not finite (nibabel's and `nifti_clib`'s repairs).
    pub fn spacing_xyz(&self) -> [f64; 3] {
        [1, 2, 3].map(|axis| {
            let size = self.pixdim[axis].abs();
            if size.is_finite() && size > 0.0 { size } else { 1.0 }
        })
    }

    /// `(slope, inter)` of real value = slope * stored + inter; `None` where stored values are real
    /// ones: the slope is 0 or not finite (nibabel's rule), the pair is (1, 0), or this is Analyze.
    pub fn scaling(&self) -> Option<(f64, f64)> {
        let (slope, inter) = (self.scl_slope, self.scl_inter);
        let scaled = self.kind != NiftiKind::Analyze
            && slope.is_finite()
            && slope != 0.0
            && (slope, inter) != (1.0, 0.0);
        scaled.then_some((slope, inter))
    }
}

fn parse_dims(fields: &Fields) -> Result<Vec<u64>, NiftiHeaderError> {
    let found = fields.dim(0);
    if !(1..=7).contains(&found) {
        return Err(NiftiHeaderError::BadDimensionCount { found });
    }
    (1..=found as usize)
        .map(|axis| match fields.dim(axis) {
            value @ 1.. => Ok(value as u64),
            value => Err(NiftiHeaderError::BadDimension { axis, value }),
        })
        .collect()
}

/// No file holds more than 2^63 - 1 bytes; so offset + size never overflows later.
fn check_size(dims: &[u64], datatype: NiftiDatatype) -> Result<(), NiftiHeaderError> {
    let voxel_bytes = datatype.bytes();
    dims.iter()
        .try_fold(voxel_bytes as u64, |bytes, &dim| bytes.checked_mul(dim))
        .filter(|&bytes| i64::try_from(bytes).is_ok())
        .map(|_| ())
        .ok_or_else(|| NiftiHeaderError::TooManyVoxels { dims: dims.to_vec(), voxel_bytes })
}

fn parse_vox_offset(fields: &Fields, kind: NiftiKind) -> Result<u64, NiftiHeaderError> {
    let first = fields.layout.first_voxel_byte();
    match (kind, fields.vox_offset()) {
        (NiftiKind::SingleFile, Ok(0)) => Ok(first),
        (NiftiKind::SingleFile, Ok(offset)) if offset < first => {
            Err(NiftiHeaderError::BadVoxOffset { value: offset as f64, minimum: first })
        }
        (_, Ok(offset)) => Ok(offset),
        (NiftiKind::Analyze, Err(_)) => Ok(0),
        (NiftiKind::SingleFile, Err(value)) => {
            Err(NiftiHeaderError::BadVoxOffset { value, minimum: first })
        }
        (NiftiKind::Pair, Err(value)) => Err(NiftiHeaderError::BadVoxOffset { value, minimum: 0 }),
    }
}
