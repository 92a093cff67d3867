//! What can stop a conversion or a comparison.

use crate::source::SourceError;
use octree_store::{GeometryError, LengthUnit, NodeKey, StoreError, is_denied};
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why work on a volume could not be finished.
#[derive(Debug, Error)]
pub enum PreprocessError {
    /// The source cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A store cannot be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The volume cannot be folded into such bricks.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The output is there already.
    #[error("{}: it exists already: give --force to replace it, or -o for another name", path.display())]
    Exists {
        /// The output.
        path: PathBuf,
    },
    /// Earlier work on this output did not finish.
    #[error("{}: unfinished work left this file: give --force to start anew, or, of a conversion, --resume to \
        go on with it", path.display())]
    Unfinished {
        /// What it left.
        path: PathBuf,
    },
    /// Other work is writing to this output.
    #[error("{}: another conversion or repair is writing it: wait for that one, or give -o another name",
        path.display())]
    Busy {
        /// The file being written.
        path: PathBuf,
    },
    /// The output would replace the input.
    #[error("{}: this is the input itself: give -o another name", path.display())]
    OutputIsInput {
        /// The output.
        path: PathBuf,
    },
    /// The output cannot be written.
    #[error("{}: {source}", path.display())]
    Output {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A voxel's size that TIFF's fractions cannot say.
    #[error("{}: TIFF cannot hold a voxel of {} x {} x {} {}: give -o a name ending in .nrrd or .nii",
        path.display(), spacing_xyz[0], spacing_xyz[1], spacing_xyz[2], unit.name())]
    TiffSpacing {
        /// The output.
        path: PathBuf,
        /// The size of a voxel.
        spacing_xyz: [f64; 3],
        /// Its unit.
        unit: LengthUnit,
    },
    /// Unfinished work cannot be gone on with.
    #[error("{}: this unfinished conversion cannot be resumed: {what}; give --force to start anew",
        path.display())]
    CannotResume {
        /// A file that it left.
        path: PathBuf,
        /// Why not.
        what: &'static str,
    },
    /// The work was ended before it was done, and what is durable was kept.
    #[error("{source}; what was done is kept in {}: run the same command with --resume to go on",
        path.display())]
    Kept {
        /// The unfinished store.
        path: PathBuf,
        /// What ended the work.
        source: Box<PreprocessError>,
    },
    /// The scratch file cannot be made or used.
    #[error("{}: scratch space: {source}{}", path.display(), scratch_advice(source))]
    ScratchFile {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Scratch space could not be had.
    #[error("scratch space: {}{}", .0, scratch_advice(.0))]
    Scratch(#[source] io::Error),
    /// The memory budget is too small for this volume.
    #[error("--memory {budget} is too small: this conversion needs at least {needed} bytes; give \
        --memory {}MiB", needed.div_ceil(1 << 20))]
    MemoryTooSmall {
        /// The budget in bytes.
        budget: u64,
        /// The least that works, in bytes.
        needed: u64,
    },
    /// A threshold or value that the sample type cannot hold.
    #[error("{option} {value} cannot be used: {why}")]
    BadValue {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is wrong with it.
        why: &'static str,
    },
    /// The disk has not so much free.
    #[error("{}: it would have {needed} bytes, and the disk has {free} free: free some, or give -o a place on \
        another disk", path.display())]
    DiskTooSmall {
        /// The output.
        path: PathBuf,
        /// Its bytes.
        needed: u64,
        /// The bytes that are free.
        free: u64,
    },
    /// A store's options name an upscaling that this version does not know.
    #[error(
        "the store was made by an upscaling that this version of octavo cannot do ({found}): use the \
        version that made it"
    )]
    UnknownUpscale {
        /// What the options say.
        found: String,
    },
    /// Two volumes of different size cannot be compared.
    #[error("the volumes differ in size: {} x {} x {} and {} x {} x {} voxels",
        a[0], a[1], a[2], b[0], b[1], b[2])]
    DifferentDims {
        /// Voxels of the first.
        a: [u64; 3],
        /// Voxels of the second.
        b: [u64; 3],
    },
    /// A store cannot be repaired from this source.
    #[error("{}: it was not made from this source: {}{what}; nothing that was whole has been changed",
        path.display(), key.map_or_else(String::new, |key| format!("{key}: ")))]
    Misfit {
        /// The store.
        path: PathBuf,
        /// The first brick that shows it.
        key: Option<NodeKey>,
        /// How it does.
        what: String,
    },
    /// A thread could not be started.
    #[error("a thread could not be started: {0}")]
    Thread(#[source] io::Error),
    /// A thread panicked: a bug.
    #[error("the {thread} thread stopped unexpectedly: this is a bug in octavo")]
    Panic {
        /// The thread's name.
        thread: &'static str,
    },
    /// The caller asked to stop.
    #[error("stopped before the end")]
    Cancelled,
}

/// What to do where scratch space cannot be had or used.
fn scratch_advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            ": free some of the disk, or give --scratch another folder"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            ": make the folder writable, or choose another one by -o or --scratch"
        }
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => {
            ": make the folder, or give --scratch another one"
        }
        io::ErrorKind::AlreadyExists => {
            ": another run made it, or is making it now: wait for that one, or take the file away"
        }
        // What an earlier run has left is not what it was.
        io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => ": give --force to start anew",
        _ => "",
    }
}

impl PreprocessError {
    /// Whether the environment failed (disk, memory, threads), rather than the input or the options.
    pub fn is_environment(&self) -> bool {
        match self {
            Self::Source(error) => error.is_environment(),
            Self::Store(error) => error.is_environment(),
            Self::Output { source, .. } => !is_denied(source),
            Self::Kept { source, .. } => source.is_environment(),
            Self::Scratch(_)
            | Self::DiskTooSmall { .. }
            | Self::ScratchFile { .. }
            | Self::Thread(_)
            | Self::Panic { .. }
            | Self::Busy { .. }
            | Self::Cancelled => true,
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_on_scratch_space_fits_what_is_wrong() {
        for (kind, word) in [
            (io::ErrorKind::StorageFull, "free some of the disk"),
            (io::ErrorKind::QuotaExceeded, "free some of the disk"),
            (io::ErrorKind::PermissionDenied, "make the folder writable"),
            (io::ErrorKind::ReadOnlyFilesystem, "make the folder writable"),
            (io::ErrorKind::NotFound, "make the folder, or"),
            (io::ErrorKind::AlreadyExists, "take the file away"),
            (io::ErrorKind::InvalidData, "--force"),
            (io::ErrorKind::UnexpectedEof, "--force"),
            (io::ErrorKind::TimedOut, "scratch space: "),
        ] {
            let full = matches!(kind, io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded);
            let file = PreprocessError::ScratchFile { path: "a".into(), source: kind.into() };
            for said in [file.to_string(), PreprocessError::Scratch(kind.into()).to_string()] {
                assert!(said.contains(word), "{said}");
                assert_eq!(said.contains("free "), full, "{said}");
            }
        }
    }
}
