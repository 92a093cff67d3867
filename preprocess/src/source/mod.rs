//! Volumes as scanners and other programs write them: one file a format, behind one type.
//!
//! A source is mapped (raw samples at a known place: read anywhere), a row of slices (decoded one by
//! one, from any thread) or a stream (decoded once, front to back); or it stands for another source,
//! enlarged. All give samples of one type, x fastest.

mod ascii;
mod data_files;
mod data_pieces;
mod dicom;
mod error;
mod format;
pub(crate) mod map;
mod meta_image;
mod nifti;
pub mod nifti_header;
mod nrrd;
mod numbered;
mod options;
mod raw;
mod raw_name;
mod reading;
mod slice_files;
mod stack;
mod stream;
mod tiff;
mod voxels;
mod world;

pub use dicom::DicomError;
pub use error::SourceError;
pub use meta_image::MetaImageError;
pub use nrrd::NrrdError;
pub use options::SourceOptions;
pub use raw_name::RawName;
pub use reading::Slices;
pub(crate) use reading::{MappedVoxels, SliceVoxels};
pub(crate) use slice_files::SliceFiles;
pub use stack::{PngError, StackError};
pub(crate) use stream::{StreamCoding, StreamPlace, VoxelStream};
pub use tiff::{TiffError, TiffPlace};
pub use voxels::StoredFormat;

use crate::error::PreprocessError;
use crate::upscale::{Enlarged, SlabLimits, Upscale};
use format::Format;
use memmap2::Mmap;
use octree_store::{Geometry, LengthUnit, Region, SampleType, SourceDescription};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A volume in a file: what it is, and where its voxels are.
#[derive(Debug)]
pub struct Source {
    /// Voxels along x, y, z: of the region of interest, where there is one.
    pub dims_xyz: [u64; 3],
    /// The size of a voxel, in `unit`.
    pub spacing_xyz: [f64; 3],
    /// The unit of spacing and affine.
    pub unit: LengthUnit,
    /// Voxel index to world, row major.
    pub affine: Option<[[f64; 4]; 4]>,
    /// Path, size and stored type.
    pub description: SourceDescription,
    /// What the user should know: a volume chosen of several, a unit assumed.
    pub notes: Vec<String>,
    /// Every file that the volume is read from.
    pub files: Vec<PathBuf>,
    format: StoredFormat,
    place: Place,
    file_dims_xyz: [u64; 3],
    region: Region,
}

/// Where the voxels are.
#[derive(Debug)]
enum Place {
    /// In a map, at this byte.
    Mapped { map: Mmap, offset: u64 },
    /// In a stream.
    Stream(StreamPlace),
    /// In slices of their own.
    Slices(Box<dyn SliceFiles>),
    /// Nowhere: they are computed from another source's.
    Enlarged(Box<Enlarged>),
}

/// What to tell the user of files that lie with those of a volume and are no part of it.
fn left_out_note(files: &[PathBuf]) -> Option<String> {
    let first = files.first()?.display();
    Some(format!("other files are left out: {}, such as {first}", files.len()))
}

/// What opening a file found; a [`Source`] is the whole of it.
#[derive(Debug)]
struct Found {
    dims_xyz: [u64; 3],
    spacing_xyz: [f64; 3],
    unit: LengthUnit,
    affine: Option<[[f64; 4]; 4]>,
    /// What the user gave, for messages and the record.
    path: PathBuf,
    /// Bytes of all files.
    bytes: u64,
    notes: Vec<String>,
    files: Vec<PathBuf>,
    format: StoredFormat,
    place: Place,
}

impl From<Found> for Source {
    fn from(found: Found) -> Self {
        let Found { dims_xyz, spacing_xyz, unit, affine, path, bytes, notes, files, format, place } =
            found;
        let description = SourceDescription {
            path: path.display().to_string(),
            bytes,
            sample_type: Some(format.stored),
        };
        let (file_dims_xyz, region) = (dims_xyz, Region::whole(dims_xyz));
        Self {
            dims_xyz,
            spacing_xyz,
            unit,
            affine,
            description,
            notes,
            files,
            format,
            place,
            file_dims_xyz,
            region,
        }
    }
}

impl Source {
    /// Opens a volume file by its name's ending or its first bytes, a folder of slices, or a pattern
    /// such as `scan/slice_*.tif`. A file or folder whose name is a pattern is taken for itself.
    ///
    /// # Errors
    /// When there is no such file, its kind is unknown, or it is not a volume that can be read.
    pub fn open(path: impl AsRef<Path>, options: &SourceOptions) -> Result<Self, SourceError> {
        let path = path.as_ref();
        let format = Format::of(path, options)?;
        if let Some(kind) = format.headed().filter(|_| options.any_raw()) {
            return Err(SourceError::NotRaw { path: path.to_owned(), kind });
        }
        if let Some(series) = options.series.as_ref().filter(|_| !format.may_have_series()) {
            let source = StackError::NotDicom { series: series.clone() };
            return Err(SourceError::Stack { path: path.to_owned(), source });
        }
        format.open(path, options)
    }

    /// A source whose voxels are those of `source`, enlarged to `dims_xyz`.
    pub(crate) fn standing_for(source: Self, dims_xyz: [u64; 3], upscale: Upscale) -> Self {
        let format =
            StoredFormat { stored: source.sample_type(), big_endian: false, scaling: None };
        Self {
            dims_xyz,
            spacing_xyz: source.spacing_xyz,
            unit: source.unit,
            affine: source.affine,
            description: source.description.clone(),
            notes: source.notes.clone(),
            files: source.files.clone(),
            format,
            file_dims_xyz: dims_xyz,
            region: Region::whole(dims_xyz),
            place: Place::Enlarged(Box::new(Enlarged {
                source,
                upscale,
                limits: SlabLimits::default(),
                clamped: AtomicU64::new(0),
            })),
        }
    }

    /// What this source stands for, if it is enlarged.
    pub(crate) fn enlarged(&self) -> Option<&Enlarged> {
        match &self.place {
            Place::Enlarged(enlarged) => Some(enlarged),
            Place::Mapped { .. } | Place::Stream(_) | Place::Slices(_) => None,
        }
    }

    /// The source whose voxels are in files: this one, or the one that is enlarged.
    pub(crate) fn in_files(&self) -> &Self {
        self.enlarged().map_or(self, |enlarged| enlarged.source.in_files())
    }

    /// How it is enlarged, if it is.
    pub fn upscaling(&self) -> Option<Upscale> {
        self.enlarged().map(|enlarged| enlarged.upscale)
    }

    /// Bounds the threads that compute an enlarged source's slices, and the own memory that writing
    /// them to a file takes; fewer threads are used where memory is too small for so many.
    ///
    /// # Errors
    /// When the budget is too small for one slice at a time.
    pub fn limit_slices(
        &mut self,
        threads: usize,
        memory_bytes: u64,
    ) -> Result<(), PreprocessError> {
        if let Place::Enlarged(enlarged) = &mut self.place {
            enlarged.limits = SlabLimits::within(enlarged, threads, memory_bytes)?;
        }
        Ok(())
    }

    /// Of the slices of an enlarged source that were last read, the voxels whose values had to be clamped
    /// to the range of the sample type.
    pub fn clamped_voxels(&self) -> Option<u64> {
        self.enlarged().map(|enlarged| enlarged.clamped.load(Ordering::Relaxed))
    }

    /// Where the region begins in the file.
    pub(crate) fn origin_xyz(&self) -> [u64; 3] {
        self.region.min
    }

    /// The type that a reader gets.
    pub fn sample_type(&self) -> SampleType {
        self.format.sample_type()
    }

    /// Sets the size of a voxel; the affine's axes grow with it, its origin stays.
    pub fn set_spacing(&mut self, spacing_xyz: [f64; 3]) {
        if let Some(affine) = &mut self.affine {
            for row in affine.iter_mut().take(3) {
                for axis in 0..3 {
                    row[axis] *= spacing_xyz[axis] / self.spacing_xyz[axis];
                }
            }
        }
        self.spacing_xyz = spacing_xyz;
    }

    /// Keeps a region of the volume; the affine moves so that world positions stay.
    ///
    /// # Errors
    /// When the region is empty or leaves the volume, or the source is enlarged already.
    pub fn crop(mut self, region: Region) -> Result<Self, SourceError> {
        if self.enlarged().is_some() {
            return Err(SourceError::EnlargedRegion { path: self.description.path.into() });
        }
        if !region.lies_within(self.dims_xyz) {
            let Region { min, max } = region;
            return Err(SourceError::Region { min, max, dims_xyz: self.dims_xyz });
        }
        let shift = |v: [u64; 3]| [0, 1, 2].map(|axis| self.region.min[axis] + v[axis]);
        self.region = Region { min: shift(region.min), max: shift(region.max) };
        self.dims_xyz = region.dims_xyz();
        if let Some(affine) = &mut self.affine {
            for row in affine.iter_mut().take(3) {
                row[3] += (0..3).map(|axis| row[axis] * region.min[axis] as f64).sum::<f64>();
            }
        }
        Ok(self)
    }

    /// The folding of the volume into bricks.
    ///
    /// # Errors
    /// When the volume or the bricks cannot be folded.
    pub fn geometry(&self, core: u32, overlap: u32) -> Result<Geometry, SourceError> {
        Geometry::new(self.dims_xyz, core, overlap).map_err(|source| SourceError::Geometry {
            path: self.description.path.clone().into(),
            source,
        })
    }

    fn file_slice_bytes(&self) -> u64 {
        self.file_dims_xyz[0] * self.file_dims_xyz[1] * self.format.stored.bytes() as u64
    }

    /// Whether a slice as the file has it, decoded, is a slice as a reader gets it.
    fn slices_are_plain(&self) -> bool {
        let [x, y, _] = self.dims_xyz;
        self.format.is_plain() && [x, y] == self.file_dims_xyz[..2]
    }

    /// Bytes of memory that decoding takes for each thread that decodes; `None` where there is
    /// nothing to decode.
    pub(crate) fn decode_bytes(&self) -> Option<u64> {
        let slice = if self.slices_are_plain() { 0 } else { self.file_slice_bytes() };
        match &self.place {
            Place::Mapped { .. } => None,
            // bzip2 keeps whole blocks of 900 kB.
            Place::Stream(place) if place.coding == StreamCoding::Bzip2 => Some(slice + (1 << 22)),
            Place::Stream(_) => Some(slice + (1 << 18)),
            Place::Slices(files) => Some(slice + files.decode_bytes()),
            Place::Enlarged(enlarged) => enlarged.source.decode_bytes(),
        }
    }
}
