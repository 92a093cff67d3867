//! Why a header cannot be used: what was expected, what was found, what to do.

use super::NiftiDatatype;
use thiserror::Error;

/// Why a header cannot be read, or a volume not be described by one.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum NiftiHeaderError {
    /// The bytes end before the header does.
    #[error(
        "the header needs {expected} bytes and there are only {found}: the file is cut short; get \
         it again from where it came from"
    )]
    TooShort {
        /// Bytes of a whole header.
        expected: usize,
        /// Bytes given.
        found: usize,
    },
    /// The first number is no header size, in neither byte order.
    #[error(
        "this is no NIfTI or Analyze header: it must begin with the number 348 (NIfTI-1, Analyze) \
         or 540 (NIfTI-2) and begins with {sizeof_hdr}; check that it is the header file and not \
         the image, and that a compressed file's name ends in .gz"
    )]
    NotNifti {
        /// The first four bytes as a little-endian number.
        sizeof_hdr: i32,
    },
    /// The size is that of NIfTI-1 or NIfTI-2, the magic bytes are not.
    #[error(
        "the magic bytes should be {expected} and are \"{found}\": the header is damaged (line \
         ends changed by a text-mode transfer?); get the file again from where it came from"
    )]
    BadMagic {
        /// What a header of this size may have.
        expected: &'static str,
        /// The bytes, escaped.
        found: String,
    },
    /// `dim[0]` is out of range.
    #[error(
        "dim[0], the number of dimensions, must be 1 to 7 and is {found}: the header is damaged"
    )]
    BadDimensionCount {
        /// `dim[0]`.
        found: i64,
    },
    /// A dimension is zero or negative.
    #[error(
        "dim[{axis}] must be at least 1 and is {value}: mend the header, or write the file anew"
    )]
    BadDimension {
        /// Which of `dim[1]` to `dim[7]`.
        axis: usize,
        /// Its value.
        value: i64,
    },
    /// No file can hold that many voxels.
    #[error(
        "a volume of {dims:?} voxels of {voxel_bytes} bytes is larger than any file can be: the \
         dimensions are wrong"
    )]
    TooManyVoxels {
        /// All dimensions.
        dims: Vec<u64>,
        /// Bytes a voxel.
        voxel_bytes: usize,
    },
    /// Voxels of a type that is not read.
    #[error("the voxels are {name} (datatype {code}), which cannot be read here: {advice}")]
    UnsupportedDatatype {
        /// The header's `datatype`.
        code: i16,
        /// The type in words.
        name: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// Two fields contradict each other.
    #[error(
        "bitpix is {bitpix} and should be {expected} for datatype {} ({datatype:?}): one of the \
         two is wrong; mend the header, or write the file anew",
        datatype.code()
    )]
    BitpixMismatch {
        /// The type of the voxels.
        datatype: NiftiDatatype,
        /// Its bits.
        expected: i16,
        /// The header's `bitpix`.
        bitpix: i16,
    },
    /// Voxels cannot begin there.
    #[error(
        "vox_offset, the byte where voxels begin, must be at least {minimum} here and is {value}: \
         mend the header, or write the file anew"
    )]
    BadVoxOffset {
        /// The header's `vox_offset`.
        value: f64,
        /// The least that is allowed in this kind of file.
        minimum: u64,
    },
    /// A slope without a usable intercept.
    #[error(
        "scl_slope is {slope}, so that voxels are to be scaled, but scl_inter is {inter}: set \
         scl_inter to a number, or scl_slope to 0 to leave voxels as they are"
    )]
    BadScaling {
        /// The header's `scl_slope`.
        slope: f64,
        /// The header's `scl_inter`.
        inter: f64,
    },
    /// A voxel size that cannot be written.
    #[error(
        "pixdim[{axis}], the size of a voxel, must be a positive number that a {bits}-bit float \
         can hold, and is {value}"
    )]
    BadSpacing {
        /// 1, 2 or 3 for x, y, z.
        axis: usize,
        /// The size asked for.
        value: f64,
        /// Bits of the header's floats.
        bits: u32,
    },
    /// An affine that cannot be written.
    #[error(
        "row {row}, column {column} of the affine (from 0) is {value}: the first three rows must \
         be numbers that a {bits}-bit float can hold, and the last row 0 0 0 1"
    )]
    BadAffine {
        /// 0 to 3.
        row: usize,
        /// 0 to 3.
        column: usize,
        /// The value asked for.
        value: f64,
        /// Bits of the header's floats.
        bits: u32,
    },
}

impl NiftiHeaderError {
    pub(super) fn unsupported_datatype(code: i16) -> Self {
        const COLOUR: &str =
            "convert the volume to one channel or to luminance, as uint8 or float32";
        const COMPLEX: &str = "write their magnitude or real part as float32 or float64";
        const LONG: &str =
            "convert the volume to int32 or uint32 where its values allow that, else to float64";
        let (name, advice) = match code {
            0 => ("of no declared type", "mend the header, or write the file anew"),
            1 => ("single bits (binary)", "convert the volume to uint8"),
            32 => ("complex numbers of two 32-bit floats (complex64)", COMPLEX),
            128 => ("RGB24 colours", COLOUR),
            1024 => ("64-bit signed integers (int64)", LONG),
            1280 => ("64-bit unsigned integers (uint64)", LONG),
            1536 => ("128-bit floats (float128)", "convert the volume to float64"),
            1792 => ("complex numbers of two 64-bit floats (complex128)", COMPLEX),
            2048 => ("complex numbers of two 128-bit floats (complex256)", COMPLEX),
            2304 => ("RGBA32 colours", COLOUR),
            _ => ("of a type that the NIfTI standard does not define", "the header is damaged"),
        };
        Self::UnsupportedDatatype { code, name, advice }
    }
}
