//! Why an input cannot be used, each with what a user needs to act on it.

use super::dicom::DicomError;
use super::meta_image::MetaImageError;
use super::nifti_header::NiftiHeaderError;
use super::nrrd::NrrdError;
use super::stack::{PngError, StackError};
use super::tiff::{TiffError, TiffPlace};
use octree_store::{GeometryError, SampleType, StoreError, is_denied};
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why a source cannot be opened or read.
#[derive(Debug, Error)]
pub enum SourceError {
    /// The system refuses to read the file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// There is no such file.
    #[error("{}: there is no such file", path.display())]
    Missing {
        /// The path.
        path: PathBuf,
    },
    /// A folder where a file of voxels is expected.
    #[error("{}: this is a folder, and a file of voxels was expected", path.display())]
    Folder {
        /// The path.
        path: PathBuf,
    },
    /// A pipe, a socket or a device.
    #[error("{}: this is a pipe, a socket or a device, and sources must be regular files or folders of them: \
        write it to a file first", path.display())]
    NoFile {
        /// The path.
        path: PathBuf,
    },
    /// The file's kind is not known.
    #[error("{}: cannot tell what kind of volume this is: expected a name ending in .nii, .nii.gz, \
        .hdr, .img (or their .gz), .nrrd, .nhdr, .mha, .mhd, .dcm, .tif, .tiff, .png or \
        NAME_XxYxZ_TYPE.raw, or a folder of slices; for another raw file give --dims X,Y,Z and --dtype \
        TYPE", path.display())]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// A raw file whose dimensions or type nobody said.
    #[error("{}: a raw file needs its {missing}: give {flag}, or name it NAME_XxYxZ_TYPE.raw, as in \
        scan_1024x1024x512_u16.raw", path.display())]
    RawUnknown {
        /// The file.
        path: PathBuf,
        /// What is missing.
        missing: &'static str,
        /// The flag that gives it.
        flag: &'static str,
    },
    /// Raw flags for a file that says these things itself.
    #[error("{}: --dims, --dtype, --big-endian and --skip are for raw files, and this is {kind}: leave \
        them out", path.display())]
    NotRaw {
        /// The file.
        path: PathBuf,
        /// What it is.
        kind: &'static str,
    },
    /// The file's size is not what its dimensions need.
    #[error("{}: {} x {} x {} voxels of {stored} after {skip} bytes need {expected} bytes, and the file \
        has {found}{hint}", path.display(), dims_xyz[0], dims_xyz[1], dims_xyz[2])]
    Size {
        /// The file.
        path: PathBuf,
        /// The dimensions in voxels.
        dims_xyz: [u64; 3],
        /// The stored type.
        stored: SampleType,
        /// Bytes before the first voxel.
        skip: u64,
        /// Bytes needed.
        expected: u64,
        /// Bytes found.
        found: u64,
        /// Which dimensions would fit, if any.
        hint: String,
    },
    /// The dimensions describe no volume.
    #[error("{}: {source}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: GeometryError,
    },
    /// A region was to be cut out of an enlarged volume.
    #[error("{}: a region is cut out before the volume is enlarged", path.display())]
    EnlargedRegion {
        /// The file.
        path: PathBuf,
    },
    /// The NIfTI header cannot be used.
    #[error("{}: {source}", path.display())]
    NiftiHeader {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: NiftiHeaderError,
    },
    /// The NRRD header cannot be used.
    #[error("{}: {source}", path.display())]
    Nrrd {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: NrrdError,
    },
    /// The MetaImage header cannot be used.
    #[error("{}: {source}", path.display())]
    MetaImage {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: MetaImageError,
    },
    /// A DICOM file cannot be used.
    #[error("{}: {source}", path.display())]
    Dicom {
        /// The file, or the folder.
        path: PathBuf,
        /// Why not.
        source: DicomError,
    },
    /// A header that belongs to a pair of files, under a single file's name.
    #[error("{}: its header says that the voxels are in a file of their own: rename it to .hdr, with the \
        .img beside it", path.display())]
    HeaderOnly {
        /// The file.
        path: PathBuf,
    },
    /// Neither of a pair's two files may be missing.
    #[error("{}: its other half {} is missing: a header and its image belong together", path.display(),
        partner.display())]
    PartnerMissing {
        /// The file given.
        path: PathBuf,
        /// The file that is missing.
        partner: PathBuf,
    },
    /// A file of voxels that is not as long as its header says.
    #[error("{}: by the header of {} it should have {expected} bytes, and it has {found}: it is cut \
        short, or the header is another file's", path.display(), header.display())]
    DataSize {
        /// The file of voxels.
        path: PathBuf,
        /// The header's file.
        header: PathBuf,
        /// Bytes needed.
        expected: u64,
        /// Bytes found.
        found: u64,
    },
    /// Files of voxels among which the volume cannot be divided.
    #[error("{}: it names {found} data files, and its voxels cannot be divided among so many",
        path.display())]
    DataFileCount {
        /// The header's file.
        path: PathBuf,
        /// Files named.
        found: u64,
    },
    /// A volume of a series that does not exist.
    #[error("{}: it holds {count} volumes, numbered from 0, and number {asked} was asked for",
        path.display())]
    NoSuchVolume {
        /// The file.
        path: PathBuf,
        /// Volumes in the file.
        count: u64,
        /// The number asked for.
        asked: u64,
    },
    /// More dimensions than a series of volumes has.
    #[error("{}: it has dimensions beyond x, y, z, time and channel ({dims:?}), of which no 3-D volume can be \
        chosen", path.display())]
    TooManyDimensions {
        /// The file.
        path: PathBuf,
        /// All its dimensions.
        dims: Vec<u64>,
    },
    /// The data end too early.
    #[error("{}: the data end before the last voxel: the file is cut short", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
    },
    /// There is more data than voxels.
    #[error("{}: there are more data after the last voxel: the header does not belong to them",
        path.display())]
    TrailingData {
        /// The file.
        path: PathBuf,
    },
    /// The compressed data are damaged.
    #[error("{}: cannot be decompressed: {what}", path.display())]
    Decompression {
        /// The file.
        path: PathBuf,
        /// The decoder's words.
        what: String,
    },
    /// A region outside the volume.
    #[error("the region {}:{},{}:{},{}:{} is empty or leaves the volume of {} x {} x {} voxels",
        min[0], max[0], min[1], max[1], min[2], max[2], dims_xyz[0], dims_xyz[1], dims_xyz[2])]
    Region {
        /// First voxel.
        min: [u64; 3],
        /// One past the last voxel.
        max: [u64; 3],
        /// The volume's dimensions.
        dims_xyz: [u64; 3],
    },
    /// The TIFF file cannot be used.
    #[error("{}: {place}{source}", path.display())]
    Tiff {
        /// The file.
        path: PathBuf,
        /// Which part of it.
        place: TiffPlace,
        /// Why not.
        source: TiffError,
    },
    /// The PNG file cannot be used.
    #[error("{}: {source}", path.display())]
    Png {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: PngError,
    },
    /// A folder or a pattern gives no volume.
    #[error("{}: {source}", path.display())]
    Stack {
        /// The folder or the pattern.
        path: PathBuf,
        /// Why not.
        source: StackError,
    },
    /// A store that is read as a volume.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl SourceError {
    /// Whether the environment failed, rather than the file or what was asked of it.
    pub fn is_environment(&self) -> bool {
        match self {
            Self::Io { source, .. } => !is_denied(source),
            Self::Store(error) => error.is_environment(),
            _ => false,
        }
    }
}
