//! Why a MetaImage header cannot be used.

use thiserror::Error;

/// Why a MetaImage header cannot be read, or its volume not be converted.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MetaImageError {
    /// A line that is no key and value.
    #[error("line {line} of the header is no \"Key = value\": \"{text}\"")]
    Line {
        /// From 1.
        line: usize,
        /// Its first characters, escaped.
        text: String,
    },
    /// A key that must be there.
    #[error("the header has no \"{key}\"")]
    KeyMissing {
        /// The key.
        key: &'static str,
    },
    /// A key stands in the header twice.
    #[error("the header has \"{key}\" twice")]
    Twice {
        /// The key.
        key: &'static str,
    },
    /// A value that makes no sense.
    #[error("\"{key}\" should be {expected}, and is \"{found}\"")]
    Value {
        /// The key.
        key: &'static str,
        /// What it should be.
        expected: &'static str,
        /// Its value, escaped and shortened.
        found: String,
    },
    /// A sample type that is not read.
    #[error(
        "its voxels are {name}, which cannot be read here: convert them to a type of at most 32 bits, or \
         to MET_DOUBLE"
    )]
    Type {
        /// The type.
        name: &'static str,
    },
    /// Colours without a choice.
    #[error(
        "its voxels have {channels} channels of 8 bits, as colours do: --channel N chooses one of them"
    )]
    Colour {
        /// Channels of a voxel.
        channels: u64,
    },
    /// A header that is longer than the one file names of any volume.
    #[error("the header has no end: it must end with ElementDataFile (within {limit} bytes)")]
    Endless {
        /// Bytes looked at.
        limit: u64,
    },
    /// Compressed text.
    #[error("its voxels are text (BinaryData = False) and compressed, which cannot be read here")]
    CompressedText,
}
