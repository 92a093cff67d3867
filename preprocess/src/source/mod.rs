//! Volumes as scanners and other programs write them: one file a format, behind one type.
//!
//! A source is mapped (raw samples at a known place: read anywhere), a row of slices (decoded one by
//! one, from any thread) or a stream (decoded once, front to back); or it stands for another source,
//! enlarged. All give samples of one type, x fastest.

mod ascii;
mod data_files;
mod dicom;
mod error;
mod format;
pub(crate) mod map;
mod meta_image;
mod nifti;
pub mod nifti_header;
mod nrrd;
mod numbered;
mod raw;
mod raw_name;
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
pub use raw_name::RawName;
pub(crate) use slice_files::SliceFiles;
pub use stack::{PngError, StackError};
pub(crate) use stream::{StreamCoding, StreamPlace, VoxelStream};
pub use tiff::{TiffError, TiffPlace};
pub use voxels::StoredFormat;

use crate::error::PreprocessError;
use crate::upscale::{Enlarged, EnlargedSlices, SlabLimits, Upscale};
use format::Format;
use memmap2::Mmap;
use octree_store::{Geometry, LengthUnit, Region, Sample, SampleType, SourceDescription};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// What the user said of the input.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SourceOptions {
    /// A raw file's dimensions in voxels.
    pub dims_xyz: Option<[u64; 3]>,
    /// A raw file's sample type.
    pub sample_type: Option<SampleType>,
    /// Whether a raw file is big-endian.
    pub big_endian: bool,
    /// A raw file's bytes before the first voxel.
    pub skip: Option<u64>,
    /// The 3-D volume of a series, from 0.
    pub time: Option<u64>,
    /// The channel, from 0.
    pub channel: Option<u64>,
    /// Whether slices may be missing or lie unevenly, or have names whose order is not certain.
    pub allow_gaps: bool,
}

impl SourceOptions {
    fn any_raw(&self) -> bool {
        self.dims_xyz.is_some()
            || self.sample_type.is_some()
            || self.big_endian
            || self.skip.is_some()
    }
}

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

    /// The voxels, where they can be read anywhere.
    pub(crate) fn mapped(&self) -> Option<MappedVoxels<'_>> {
        match &self.place {
            Place::Mapped { map, offset } => {
                Some(MappedVoxels { source: self, bytes: &map[*offset as usize..] })
            }
            Place::Stream(_) | Place::Slices(_) | Place::Enlarged(_) => None,
        }
    }

    /// The voxels, where they come in slices that are decoded one by one.
    pub(crate) fn slice_files(&self) -> Option<SliceVoxels<'_>> {
        match &self.place {
            Place::Slices(files) => Some(SliceVoxels { source: self, files: files.as_ref() }),
            Place::Mapped { .. } | Place::Stream(_) | Place::Enlarged(_) => None,
        }
    }

    /// The voxels from front to back, whatever the place.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub fn slices(&self) -> Result<Slices<'_>, SourceError> {
        let stream = match &self.place {
            Place::Stream(place) => {
                let mut stream = place.open()?;
                stream.skip(place.offset + self.region.min[2] * self.file_slice_bytes())?;
                Some(stream)
            }
            Place::Mapped { .. } | Place::Slices(_) | Place::Enlarged(_) => None,
        };
        let enlarged = self.enlarged().map(EnlargedSlices::new).transpose()?.map(Box::new);
        Ok(Slices { source: self, stream, enlarged, bytes: Vec::new(), next_z: 0 })
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

    /// Turns a decoded slice of the file into a slice of the region.
    fn cut_slice<T: Sample>(&self, bytes: &[u8], slice: &mut [T]) {
        let stored = self.format.stored.bytes();
        let rows = slice.chunks_exact_mut(self.dims_xyz[0] as usize);
        for (row, y) in rows.zip(self.region.min[1]..) {
            let first = (y * self.file_dims_xyz[0] + self.region.min[0]) as usize * stored;
            self.format.read_into(&bytes[first..first + row.len() * stored], row);
        }
    }

    /// Fills a slice by `read`, which gives the file's own bytes, through `bytes` where these are not
    /// yet what a reader gets.
    fn fill_slice<T: Sample>(
        &self,
        slice: &mut [T],
        bytes: &mut Vec<u8>,
        read: impl FnOnce(&mut [u8]) -> Result<(), SourceError>,
    ) -> Result<(), SourceError> {
        if self.slices_are_plain() && cfg!(target_endian = "little") {
            return read(bytemuck::cast_slice_mut(slice));
        }
        bytes.resize(self.file_slice_bytes() as usize, 0);
        read(bytes)?;
        self.cut_slice(bytes, slice);
        Ok(())
    }
}

/// A source of slices.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SliceVoxels<'a> {
    source: &'a Source,
    files: &'a dyn SliceFiles,
}

impl SliceVoxels<'_> {
    /// Decodes slice `z` of the region; `bytes` is kept from slice to slice.
    pub(crate) fn read<T: Sample>(
        &self,
        z: u64,
        slice: &mut [T],
        bytes: &mut Vec<u8>,
    ) -> Result<(), SourceError> {
        let z = z + self.source.region.min[2];
        self.source.fill_slice(slice, bytes, |bytes| self.files.read_slice(z, bytes))
    }
}

/// A mapped source's voxels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MappedVoxels<'a> {
    source: &'a Source,
    /// From the file's first voxel on.
    bytes: &'a [u8],
}

impl MappedVoxels<'_> {
    /// Tells the system that these slices of the region will soon be read, so that it reads them
    /// from the disk in one go. A slab of more than a gigabyte is left to the system's own guess.
    pub(crate) fn will_need(&self, slices: std::ops::Range<u64>) {
        let slice = self.source.file_slice_bytes();
        let first = self.source.region.min[2] + slices.start;
        let bytes = (slices.end - slices.start) * slice;
        if let Place::Mapped { map, offset } = &self.source.place
            && (1..1 << 30).contains(&bytes)
        {
            // Advice that the system cannot take is no fault.
            let start = (offset + first * slice) as usize;
            let _ = map.advise_range(memmap2::Advice::WillNeed, start, bytes as usize);
        }
    }

    /// Reads the row from voxel (x, y, z) of the region on.
    #[inline(always)]
    pub(crate) fn read_row<T: Sample>(&self, [x, y, z]: [u64; 3], out: &mut [T]) {
        let Source { region, file_dims_xyz: [dim_x, dim_y, _], format, .. } = self.source;
        let [x, y, z] = [x + region.min[0], y + region.min[1], z + region.min[2]];
        let stored = format.stored.bytes();
        let first = ((z * dim_y + y) * dim_x + x) as usize * stored;
        format.read_into(&self.bytes[first..first + out.len() * stored], out);
    }
}

/// A source's z slices, one after the other.
#[derive(Debug)]
pub struct Slices<'a> {
    source: &'a Source,
    stream: Option<VoxelStream>,
    enlarged: Option<Box<EnlargedSlices<'a>>>,
    bytes: Vec<u8>,
    next_z: u64,
}

impl Slices<'_> {
    /// Passes over slices.
    ///
    /// # Errors
    /// As [`Slices::next`].
    pub(crate) fn skip(&mut self, slices: u64) -> Result<(), SourceError> {
        if let Some(stream) = &mut self.stream {
            stream.skip(slices * self.source.file_slice_bytes())?;
        }
        self.next_z += slices;
        Ok(())
    }

    /// Reads the next slice: `dims_xyz[0] * dims_xyz[1]` samples, x fastest. After the last one
    /// the end of a stream is checked.
    ///
    /// # Errors
    /// When the file ends early, is damaged, or cannot be read.
    ///
    /// # Panics
    /// When the slice has another size, or there is none left.
    pub fn next<T: Sample>(&mut self, slice: &mut [T]) -> Result<(), SourceError> {
        let Source { dims_xyz, region, file_dims_xyz, .. } = self.source;
        assert!(self.next_z < dims_xyz[2]);
        assert_eq!(slice.len() as u64, dims_xyz[0] * dims_xyz[1]);
        if let Some(enlarged) = &mut self.enlarged {
            enlarged.next(slice)?;
        } else if let Some(stream) = &mut self.stream {
            self.source.fill_slice(slice, &mut self.bytes, |bytes| stream.read(bytes))?;
            let last = self.next_z + 1 == dims_xyz[2] && region.max[2] == file_dims_xyz[2];
            if last && matches!(&self.source.place, Place::Stream(p) if p.ends_with_volume) {
                stream.finish()?;
            }
        } else if let Some(files) = self.source.slice_files() {
            files.read(self.next_z, slice, &mut self.bytes)?;
        } else if let Some(mapped) = self.source.mapped() {
            let rows = slice.chunks_exact_mut(dims_xyz[0] as usize);
            for (row, y) in rows.zip(0..) {
                mapped.read_row([0, y, self.next_z], row);
            }
        }
        self.next_z += 1;
        Ok(())
    }
}
