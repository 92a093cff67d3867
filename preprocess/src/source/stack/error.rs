//! Why files of slices are no volume.

use octree_store::SampleType;
use std::path::PathBuf;
use thiserror::Error;

/// Why a folder or a pattern gives no volume.
#[derive(Debug, Error)]
pub enum StackError {
    /// There is no slice in it.
    #[error(
        "there are no slices in it: files ending in .tif, .tiff or .png, or DICOM files, here or in folders \
        below, are expected, and {others} other files were found"
    )]
    Empty {
        /// Files of other kinds.
        others: usize,
    },
    /// A series is asked for of what has none.
    #[error(
        "--series {series} chooses one of DICOM's series, and there are no DICOM files in it: leave it out"
    )]
    NotDicom {
        /// The series.
        series: String,
    },
    /// No file matches the pattern.
    #[error("no file matches this pattern")]
    NoMatch,
    /// The pattern cannot be read.
    #[error("this is no pattern: {source}")]
    Pattern {
        /// Why not.
        source: glob::PatternError,
    },
    /// Slices of several kinds.
    #[error("it holds slices of several kinds, as {} and {}: choose one by a quoted pattern such as \
        'FOLDER/*.tif' or 'FOLDER/*.dcm'", first.display(), other.display())]
    MixedKinds {
        /// A file.
        first: PathBuf,
        /// One of another kind.
        other: PathBuf,
    },
    /// Names that are no single numbered series.
    #[error("the names of its files, as {} and {}, do not differ in one number alone, so their order is \
        not certain: choose one series by a quoted pattern such as 'FOLDER/NAME_*.tif', or take all in natural order \
        by --allow-gaps", first.display(), other.display())]
    NoSeries {
        /// A file.
        first: PathBuf,
        /// One whose name differs in another way.
        other: PathBuf,
    },
    /// Numbers that are missing.
    #[error("{name} is missing between {} and {} (missing in all: {missing}): add what is missing, or take \
        the slices as neighbours by --allow-gaps", before.display(), after.display())]
    Gap {
        /// The name of the first file that is missing.
        name: String,
        /// The file before it.
        before: PathBuf,
        /// The file after it.
        after: PathBuf,
        /// Files missing in all.
        missing: u64,
    },
    /// Two files of one number.
    #[error("{} and {} have the same number: take one of them away", first.display(), other.display())]
    SameNumber {
        /// A file.
        first: PathBuf,
        /// The other.
        other: PathBuf,
    },
    /// A slice that is not like the first.
    #[error("{} has {} x {} pixels of {found}, and {} has {} x {} of {expected}: a volume's slices are all \
        alike", path.display(), found_xy[0], found_xy[1], first.display(), expected_xy[0], expected_xy[1])]
    Unlike {
        /// The file.
        path: PathBuf,
        /// Its pixels.
        found_xy: [u64; 2],
        /// Its sample type.
        found: SampleType,
        /// The first file.
        first: PathBuf,
        /// Its pixels.
        expected_xy: [u64; 2],
        /// Its sample type.
        expected: SampleType,
    },
}

/// Why a PNG file is no slice.
#[derive(Debug, Error)]
pub enum PngError {
    /// It is not grey.
    #[error(
        "it is a picture in colour ({found}), and a volume's slices are grey: save it as a grey picture"
    )]
    Colour {
        /// Which.
        found: &'static str,
    },
    /// Too few bits.
    #[error("it has {bits} bits a pixel, and only 8 and 16 are read: save it as one of them")]
    Bits {
        /// How many.
        bits: u8,
    },
    /// The file cannot hold so many pixels.
    #[error("it has {found} bytes, which cannot hold {} x {} pixels: it is cut short or damaged", dims_xy[0],
        dims_xy[1])]
    Short {
        /// Its bytes.
        found: u64,
        /// Its pixels.
        dims_xy: [u64; 2],
    },
    /// It cannot be decoded.
    #[error("it is damaged, or no PNG file: {what}")]
    Decode {
        /// The decoder's words.
        what: String,
    },
    /// The file is not what it was when the volume was opened.
    #[error("it has changed since it was opened")]
    Changed,
}
