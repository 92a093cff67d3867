//! Why an NRRD header cannot be used.

use thiserror::Error;

/// Why an NRRD header cannot be read, or its volume not be converted.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum NrrdError {
    /// The first line is no magic.
    #[error(
        "this is no NRRD header: its first line must be NRRD0001 to NRRD0005, and is \"{found}\""
    )]
    Magic {
        /// The line's first characters, escaped.
        found: String,
    },
    /// No blank line ends the header.
    #[error(
        "the header has no end: an empty line must stand before the voxels (within {limit} bytes)"
    )]
    Endless {
        /// Bytes looked at.
        limit: u64,
    },
    /// A line that is neither comment, field nor key and value.
    #[error("line {line} of the header is no \"field: value\": \"{text}\"")]
    Line {
        /// From 1.
        line: usize,
        /// Its first characters, escaped.
        text: String,
    },
    /// A field stands in the header twice.
    #[error("the header has two fields \"{field}\"")]
    Twice {
        /// The field.
        field: &'static str,
    },
    /// A field that must be there.
    #[error("the header has no field \"{field}\"")]
    FieldMissing {
        /// The field.
        field: &'static str,
    },
    /// A field that makes no sense.
    #[error("the field \"{field}\" should be {expected}, and is \"{found}\"")]
    Field {
        /// The field.
        field: &'static str,
        /// What it should be.
        expected: &'static str,
        /// Its value, escaped and shortened.
        found: String,
    },
    /// A sample type that is not read.
    #[error(
        "its voxels are {name}, which cannot be read here: convert them to a type of at most 32 bits, or \
         to double"
    )]
    Type {
        /// The type.
        name: &'static str,
    },
    /// An encoding that is not read.
    #[error(
        "its voxels are written in the encoding \"{name}\", which cannot be read here: write them as raw, \
         gzip, bzip2 or text (unu save -f nrrd -e gzip)"
    )]
    Encoding {
        /// The encoding.
        name: &'static str,
    },
    /// Colours without a choice.
    #[error(
        "its voxels are colours or other tuples ({kind}): --channel N chooses one of their components"
    )]
    Colour {
        /// The axis's kind.
        kind: String,
    },
    /// Axes among which no volume can be found.
    #[error(
        "axis {axis} of kind \"{kind}\" lies between axes of space, so that no volume can be chosen: \
        permute the axes (unu permute)"
    )]
    AxisBetween {
        /// From 0.
        axis: usize,
        /// Its kind.
        kind: String,
    },
    /// `byte skip: -1` with an encoding.
    #[error(
        "\"byte skip: -1\" is for raw data alone: give the number of decoded bytes to pass over"
    )]
    SkipFromEnd,
}
