//! Volumes as scanners and other programs write them: one file a format, behind one type.
//!
//! A source is either mapped (raw samples at a known place: read anywhere) or a stream (compressed:
//! decoded once, front to back). Both give samples of one type, x fastest.

mod error;
pub(crate) mod map;
mod nifti;
pub mod nifti_header;
mod raw;
mod raw_name;
mod voxels;

pub use error::SourceError;
pub use raw_name::RawName;
pub use voxels::{StoredFormat, VoxelStream};

use memmap2::Mmap;
use octree_store::{Geometry, LengthUnit, Region, Sample, SampleType, SourceDescription};
use std::path::{Path, PathBuf};

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
    format: StoredFormat,
    place: Place,
    file_dims_xyz: [u64; 3],
    region: Region,
}

/// Where the first voxel is.
#[derive(Debug)]
enum Place {
    /// In a map, at this byte.
    Mapped { map: Mmap, offset: u64 },
    /// In a gzip file, at this byte of the decompressed data.
    Gzip { path: PathBuf, offset: u64, ends_with_volume: bool },
}

impl Source {
    /// Opens a volume file by its name's ending.
    ///
    /// # Errors
    /// When there is no such file, its kind is unknown, or it is not a volume that can be read.
    pub fn open(path: impl AsRef<Path>, options: &SourceOptions) -> Result<Self, SourceError> {
        let path = path.as_ref();
        match std::fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => {
                return Err(SourceError::Folder { path: path.to_owned() });
            }
            Ok(_) => {}
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(SourceError::Missing { path: path.to_owned() });
            }
            Err(source) => return Err(SourceError::Io { path: path.to_owned(), source }),
        }
        if nifti::is_name(path) {
            if options.any_raw() {
                return Err(SourceError::NotRaw { path: path.to_owned(), kind: "a NIfTI file" });
            }
            nifti::open(path, options)
        } else {
            raw::open(path, options)
        }
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
    /// When the region is empty or leaves the volume.
    pub fn crop(mut self, region: Region) -> Result<Self, SourceError> {
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
            Place::Gzip { .. } => None,
        }
    }

    /// The voxels from front to back, whatever the place.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub fn slices(&self) -> Result<Slices<'_>, SourceError> {
        let stream = match &self.place {
            Place::Mapped { .. } => None,
            Place::Gzip { path, offset, .. } => {
                let mut stream = nifti::gzip_stream(path)?;
                stream.skip(offset + self.region.min[2] * self.file_slice_bytes())?;
                Some(stream)
            }
        };
        let bytes =
            if stream.is_some() { vec![0; self.file_slice_bytes() as usize] } else { Vec::new() };
        Ok(Slices { source: self, stream, bytes, next_z: 0 })
    }

    fn file_slice_bytes(&self) -> u64 {
        self.file_dims_xyz[0] * self.file_dims_xyz[1] * self.format.stored.bytes() as u64
    }

    /// Bytes of memory that [`Source::slices`] takes: a stored slice of a stream.
    pub(crate) fn stream_bytes(&self) -> Option<u64> {
        match self.place {
            Place::Mapped { .. } => None,
            Place::Gzip { .. } => Some(self.file_slice_bytes() + (1 << 17)),
        }
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
    bytes: Vec<u8>,
    next_z: u64,
}

impl Slices<'_> {
    /// Reads the next slice: `dims_xyz[0] * dims_xyz[1]` samples, x fastest. After the last one
    /// the end of a stream is checked.
    ///
    /// # Errors
    /// When the file ends early, is damaged, or cannot be read.
    ///
    /// # Panics
    /// When the slice has another size, or there is none left.
    pub fn next<T: Sample>(&mut self, slice: &mut [T]) -> Result<(), SourceError> {
        let Source { dims_xyz, region, file_dims_xyz, format, .. } = self.source;
        assert!(self.next_z < dims_xyz[2]);
        assert_eq!(slice.len() as u64, dims_xyz[0] * dims_xyz[1]);
        let rows = slice.chunks_exact_mut(dims_xyz[0] as usize);
        if let Some(stream) = &mut self.stream {
            stream.read(&mut self.bytes)?;
            let stored = format.stored.bytes();
            for (row, y) in rows.zip(region.min[1]..) {
                let first = (y * file_dims_xyz[0] + region.min[0]) as usize * stored;
                format.read_into(&self.bytes[first..first + row.len() * stored], row);
            }
            let last = self.next_z + 1 == dims_xyz[2] && region.max[2] == file_dims_xyz[2];
            if last && matches!(self.source.place, Place::Gzip { ends_with_volume: true, .. }) {
                stream.finish()?;
            }
        } else if let Some(mapped) = self.source.mapped() {
            for (row, y) in rows.zip(0..) {
                mapped.read_row([0, y, self.next_z], row);
            }
        }
        self.next_z += 1;
        Ok(())
    }
}
