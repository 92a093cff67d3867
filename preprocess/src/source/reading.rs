//! A source's voxels, as they can be had: rows from a map, slices from any thread, or slices in their order.
//!
//! All cut the region of interest out of what the file has, and turn stored samples into a reader's.

use super::{Place, SliceFiles, Source, SourceError, VoxelStream};
use crate::upscale::EnlargedSlices;
use octree_store::Sample;

impl Source {
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
