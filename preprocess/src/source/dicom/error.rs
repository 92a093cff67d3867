//! Why DICOM files make no volume.

use std::path::PathBuf;
use thiserror::Error;

/// Why a DICOM file cannot be read, or files not be put together.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DicomError {
    /// The bytes are not what DICOM's encoding allows.
    #[error(
        "the DICOM data set is damaged at byte {at}: {what}; get the file again from where it came from"
    )]
    Damaged {
        /// The byte.
        at: u64,
        /// What is wrong there.
        what: &'static str,
    },
    /// There is no image in it.
    #[error("it holds no image: expected Rows, Columns and Pixel Data")]
    NoImage,
    /// None of a folder's DICOM files is an image.
    #[error("none of its DICOM files holds an image")]
    NoImages,
    /// An attribute that must be there, or makes no sense.
    #[error("{name} should be {expected}, and is {found}")]
    Attribute {
        /// The attribute's name.
        name: &'static str,
        /// What it should be.
        expected: &'static str,
        /// Its value.
        found: String,
    },
    /// Pixels that are coded in a way that is not read.
    #[error(
        "its pixels are {name} (transfer syntax {uid}), which cannot be read here: decompress it first, as \
         with {remedy}"
    )]
    TransferSyntax {
        /// Its UID.
        uid: String,
        /// Its name.
        name: &'static str,
        /// A program that decompresses it.
        remedy: &'static str,
    },
    /// Colours.
    #[error(
        "its pixels are colours ({photometric}, {samples} samples each): convert it to grey values"
    )]
    Colour {
        /// The photometric interpretation.
        photometric: String,
        /// Samples of a pixel.
        samples: u32,
    },
    /// More than one series.
    #[error("there are {count} series in it, and a volume is one: choose by --series UID: {list}")]
    SeveralSeries {
        /// How many.
        count: usize,
        /// What they are.
        list: String,
    },
    /// A series that is not there.
    #[error("there is no series {asked} in it: --series takes one of {list}")]
    NoSuchSeries {
        /// The UID that was asked for.
        asked: String,
        /// What there is.
        list: String,
    },
    /// A slice that is unlike the first one.
    #[error("its {what} is {found}, and that of {} is {expected}: they are no slices of one volume; take \
        away what does not belong to it, or choose its slices by a quoted pattern such as 'FOLDER/IM*'",
        first.display())]
    Differs {
        /// What differs.
        what: &'static str,
        /// The first slice's file.
        first: PathBuf,
        /// What the first slice has.
        expected: String,
        /// What this one has.
        found: String,
    },
    /// Two slices at one place.
    #[error(
        "it lies at the same place as {} ({place}): of a series of volumes, give one alone; --allow-gaps \
         takes the slices as they are", other.display()
    )]
    SamePlace {
        /// The other slice's file.
        other: PathBuf,
        /// Where.
        place: String,
    },
    /// Slices that are not evenly spaced.
    #[error(
        "from the slice before ({}) it is {found} and from most others {expected}: a slice is missing or \
         misplaced; --allow-gaps takes the slices as they are", before.display()
    )]
    Gap {
        /// The slice before.
        before: PathBuf,
        /// The distance that most have.
        expected: String,
        /// The distance found.
        found: String,
    },
    /// Some slices say where they are and some do not.
    #[error("it has no {what}, which others of its series have")]
    Unplaced {
        /// What is missing.
        what: &'static str,
    },
    /// Compressed pixels that cannot be decoded.
    #[error("its pixels cannot be decoded: {what}")]
    Pixels {
        /// What the decoder says.
        what: String,
    },
}
