//! What can go wrong with a store, each with what a user needs to act on it.

use crate::key::NodeKey;
use crate::sample::SampleType;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// How a part of a store differs from what was written.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum Damage {
    /// The record is missing, though the geometry says that the node exists.
    #[error("its record is missing")]
    RecordMissing,
    /// The record fails its checksum or has unknown fields.
    #[error("its record fails its checksum")]
    RecordChecksum,
    /// The record is of another node.
    #[error("its place holds the record of another node")]
    RecordOfAnotherNode,
    /// The record disagrees with the geometry or with its relatives.
    #[error("its record contradicts the tree: {what}")]
    Tree {
        /// Which fields, and how.
        what: &'static str,
    },
    /// The payload's place lies outside the stream.
    #[error(
        "byte {offset} of payload stream {stream}, where its payload should be, does not exist"
    )]
    PayloadMissing {
        /// The stream.
        stream: u16,
        /// The byte within the stream.
        offset: u64,
    },
    /// The payload fails its checksum.
    #[error("its payload fails its checksum")]
    PayloadChecksum,
    /// The payload cannot be decompressed.
    #[error("its payload cannot be decompressed")]
    PayloadCompression,
    /// The payload has the wrong length.
    #[error("its payload unpacks to {found} bytes, where {expected} were expected")]
    PayloadLength {
        /// Bytes that the geometry asks for.
        expected: usize,
        /// Bytes found.
        found: usize,
    },
    /// The disk does not give its record or its payload back.
    #[error("it cannot be read: {what}")]
    Unreadable {
        /// The system's words.
        what: String,
    },
    /// The store was salvaged, and nothing could be saved of the brick.
    #[error("it was lost before this store was salvaged from a damaged one")]
    Lost,
    /// It does not say what the source says.
    #[error("it does not match the source: {what}")]
    Source {
        /// Which part, and how.
        what: &'static str,
    },
}

/// Why a store cannot be opened, read or written.
#[derive(Debug, Error)]
pub enum StoreError {
    /// The file is not an Octavo store.
    #[error("{}: not an Octavo store: {found}", path.display())]
    NotAStore {
        /// The file.
        path: PathBuf,
        /// What it is instead, as far as can be told.
        found: &'static str,
    },
    /// The store was made by a later version.
    #[error("{}: its format version is {found}, and this program reads versions up to {supported}: \
        use a newer octavo", path.display())]
    NewerFormat {
        /// The file.
        path: PathBuf,
        /// The version found.
        found: u32,
        /// The newest version that this library reads.
        supported: u32,
    },
    /// The store is of a draft of the format.
    #[error("{}: its format version is {found}, a draft that is no longer read: convert the source again",
        path.display())]
    OlderFormat {
        /// The file.
        path: PathBuf,
        /// The version found.
        found: u32,
    },
    /// The store needs what this version cannot do.
    #[error("{}: it uses features that this program does not know (bits {found:#x}): use a newer octavo",
        path.display())]
    UnknownFeatures {
        /// The file.
        path: PathBuf,
        /// The bits that are not known.
        found: u32,
    },
    /// The store's conversion never finished, or the file was cut short.
    #[error("{}: it was not finished or is cut short: convert the source again", path.display())]
    Incomplete {
        /// The file.
        path: PathBuf,
    },
    /// The file is longer or shorter than it says.
    #[error("{}: it should have {expected} bytes and has {found}: it was cut short or added to; get \
        another copy, or convert the source again", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// Bytes that its first page speaks of.
        expected: u64,
        /// Bytes found.
        found: u64,
    },
    /// Another process writes the store.
    #[error("{}: another process has it open for writing: try again when it is done", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// The metadata cannot be read.
    #[error("{}: its metadata is damaged: {what}", path.display())]
    MetadataDamaged {
        /// The file.
        path: PathBuf,
        /// How.
        what: String,
    },
    /// Of a damaged store not even the metadata are left, or next to nothing else.
    #[error("{}: too little is left of it for anything to be saved: convert the source again",
        path.display())]
    NothingLeft {
        /// The file.
        path: PathBuf,
    },
    /// A node is damaged. Other nodes may be whole.
    #[error("{}: {key} is damaged: {damage}; 'octavo verify' lists all damage", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The node.
        key: NodeKey,
        /// How.
        damage: Damage,
    },
    /// The store has no such node.
    #[error("{}: it has no {key}", path.display())]
    Absent {
        /// The file.
        path: PathBuf,
        /// The node.
        key: NodeKey,
    },
    /// A caller asked for samples of a type that the store does not have.
    #[error("the store's samples are {stored}, and {asked} was asked for")]
    SampleType {
        /// The store's type.
        stored: SampleType,
        /// The caller's type.
        asked: SampleType,
    },
    /// A caller's buffer does not fit.
    #[error("a buffer of {found} samples was given where {expected} are needed")]
    BufferLength {
        /// Samples needed.
        expected: usize,
        /// Samples given.
        found: usize,
    },
    /// A region outside the level, or an empty one.
    #[error("the region {}:{},{}:{},{}:{} is empty or leaves level {level} of {} x {} x {} voxels",
        min[0], max[0], min[1], max[1], min[2], max[2], dims_xyz[0], dims_xyz[1], dims_xyz[2])]
    Region {
        /// The level.
        level: u8,
        /// The region's first voxel.
        min: [u64; 3],
        /// One past the region's last voxel.
        max: [u64; 3],
        /// The level's dimensions.
        dims_xyz: [u64; 3],
    },
    /// Reading or writing the file failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The disk does not give a node's record or payload back. Nothing is said of what it holds.
    #[error("{}: {key} cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The node.
        key: NodeKey,
        /// The system's error.
        source: io::Error,
    },
    /// The database of a store in the making reports an error of its own.
    #[error("{}: the database in it cannot be used: {what}", path.display())]
    Database {
        /// The file.
        path: PathBuf,
        /// The database's own words.
        what: String,
    },
}

impl StoreError {
    /// Whether the environment failed (disk, locks), rather than the file or what was asked of it.
    pub fn is_environment(&self) -> bool {
        match self {
            Self::Io { source, .. } => !is_denied(source),
            Self::InUse { .. } | Self::Unreadable { .. } => true,
            _ => false,
        }
    }
}

/// Whether the system refuses a file as such: a fault of what was asked, not of the machine.
pub fn is_denied(error: &io::Error) -> bool {
    // Links that lead round have no stable kind yet: ELOOP.
    let loops = error.raw_os_error() == Some(40);
    loops
        || matches!(
            error.kind(),
            io::ErrorKind::PermissionDenied
                | io::ErrorKind::NotFound
                | io::ErrorKind::IsADirectory
                | io::ErrorKind::NotADirectory
                | io::ErrorKind::InvalidFilename
                | io::ErrorKind::InvalidInput
        )
}
