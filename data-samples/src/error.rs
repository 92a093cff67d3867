//! What can go wrong: a recipe that makes no sense, or a file that cannot be written.

use std::{io, path::PathBuf};

use thiserror::Error;

use crate::SampleType;

/// A recipe, or a question put to it, that makes no sense.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PhantomError {
    /// An axis without voxels.
    #[error("a volume of {dims_xyz:?} voxels is empty: every axis needs at least one voxel")]
    EmptyAxis {
        /// Voxels along x, y and z.
        dims_xyz: [usize; 3],
    },
    /// More bytes than can be counted.
    #[error("a volume of {dims_xyz:?} voxels has more bytes than 2^63: choose a smaller one")]
    TooLarge {
        /// Voxels along x, y and z.
        dims_xyz: [usize; 3],
    },
    /// A parameter that is infinite, not a number, or negative where it cannot be.
    #[error("{name} is {value}: it must be {wanted}")]
    BadParameter {
        /// The parameter's name.
        name: &'static str,
        /// What it was.
        value: f64,
        /// What it has to be.
        wanted: &'static str,
    },
    /// A hot voxel that does not lie in the volume.
    #[error("the hot voxel {at_xyz:?} lies outside the volume of {dims_xyz:?} voxels")]
    HotVoxelOutside {
        /// The place asked for.
        at_xyz: [usize; 3],
        /// Voxels along x, y and z.
        dims_xyz: [usize; 3],
    },
    /// A value that the sample type cannot hold.
    #[error("{name} is {value}, which does not fit in {sample_type}: choose another type or value")]
    ValueOutOfRange {
        /// The parameter's name.
        name: &'static str,
        /// What it was.
        value: f64,
        /// The type asked for.
        sample_type: SampleType,
    },
    /// A row or slice that does not exist.
    #[error("{axis} = {index} lies outside the volume: it has {count} along that axis")]
    Outside {
        /// `"y"` or `"z"`.
        axis: &'static str,
        /// The index asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A buffer of the wrong length.
    #[error("the buffer holds {found} samples, {expected} are needed")]
    BufferLength {
        /// The samples of the row or slice.
        expected: usize,
        /// The length of the buffer.
        found: usize,
    },
}

/// Writing a phantom failed. Nothing stands under the final name unless it stood there before.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The recipe does not go with the sample type.
    #[error(transparent)]
    Phantom(#[from] PhantomError),
    /// The output refused some bytes: a full disk, a closed pipe.
    #[error("writing failed after {byte_offset} bytes: {source}")]
    Stream {
        /// How many bytes had been accepted at least.
        byte_offset: u64,
        /// The cause.
        source: io::Error,
    },
    /// The file beside the output could not be created.
    #[error(
        "cannot create a temporary file beside {path}: {source}; does the folder exist, and may you write to it?",
        path = path.display()
    )]
    Create {
        /// The output.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The finished file could not get its final name.
    #[error("cannot rename the finished file to {path}: {source}", path = path.display())]
    Rename {
        /// The output.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A folder, a device or a pipe stands where the file is to go.
    #[error("{path} exists and is not a plain file: it is left alone", path = path.display())]
    NotAPlainFile {
        /// The output.
        path: PathBuf,
    },
}
