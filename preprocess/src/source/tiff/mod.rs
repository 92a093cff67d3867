//! TIFF and BigTIFF files: each page a slice. The file is mapped; its directories are read here and not
//! by the crate `tiff`, because a slice must be found by its directory's offset from any thread, big
//! ImageJ stacks have no directory a slice, and samples that lie plainly in the file need no decoding.
//!
//! Values are given as they are stored, whatever is to be shown white, as tifffile and libtiff do.

mod codec;
mod decode;
mod error;
mod ifd;
mod imagej;
mod layout;
pub(super) mod length;
mod ome;
mod page;
mod pages;
mod samples;
mod shaped;
#[cfg(test)]
mod tests;

pub use error::{TiffError, TiffPlace};
pub(super) use ifd::is_magic;
pub(super) use page::PageKind;

use super::map::map_file;
use super::{Found, Place, SliceFiles, Source, SourceError, SourceOptions, StoredFormat};
use ifd::TiffBytes;
use layout::{Layout, Places};
use length::VoxelSize;
use memmap2::Mmap;
use octree_store::Geometry;
use page::{Page, is_reduced};
use std::path::{Path, PathBuf};

/// Whether a file's name ends as TIFF's do.
pub(super) fn is_name(path: &Path) -> bool {
    let endings = ["tif", "tiff", "btf", "tf8"];
    path.extension().is_some_and(|end| endings.iter().any(|known| end.eq_ignore_ascii_case(known)))
}

/// Opens a file; of several channels or times, the volume that the options choose.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let map = map_file(path).map_err(|source| SourceError::Io { path: path.to_owned(), source })?;
    let layout = Layout::read(&map, path, options)?;
    let PageKind { dims_xy: [x, y], stored } = layout.kind;
    let dims_xyz = [x, y, layout.slices];
    Geometry::new(dims_xyz, 128, 0)
        .map_err(|source| SourceError::Geometry { path: path.to_owned(), source })?;
    let bytes = map.len() as u64;
    let VoxelSize { spacing_xyz, unit, notes } = layout.voxel_size;
    let plane = x * y * stored.bytes() as u64;
    let mut big_endian = layout.big_endian;
    let place = match layout.places {
        Places::Even { first, step } if step == plane || layout.slices == 1 => {
            Place::Mapped { map, offset: first }
        }
        places => {
            // Decoded slices are little-endian.
            big_endian = false;
            Place::Slices(Box::new(Slices {
                path: path.to_owned(),
                map,
                places,
                kind: layout.kind,
                big_endian: layout.big_endian,
                window_log: layout.window_log,
                decode_bytes: layout.decode_bytes,
            }))
        }
    };
    let found = Found {
        dims_xyz,
        spacing_xyz,
        unit,
        affine: None,
        path: path.to_owned(),
        bytes,
        notes,
        files: vec![path.to_owned()],
        format: StoredFormat { stored, big_endian, scaling: None },
        place,
    };
    Ok(found.into())
}

/// The slices of a file that must be decoded, or lie apart.
struct Slices {
    path: PathBuf,
    map: Mmap,
    places: Places,
    kind: PageKind,
    big_endian: bool,
    window_log: u32,
    decode_bytes: u64,
}

impl std::fmt::Debug for Slices {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("tiff::Slices").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Slices {
    fn read(&self, z: u64, bytes: &mut [u8]) -> Result<(), TiffError> {
        let file = TiffBytes::new(&self.map)?;
        let offset = match &self.places {
            Places::Even { first, step } => first + z * step,
            Places::Samples(offsets) | Places::Directories(offsets) => offsets[z as usize],
        };
        if let Places::Directories(_) = self.places {
            // Whether a palette only colours was settled at opening.
            let page = Page::new(file.ifd(offset)?, true)?;
            return decode_page(&page, self.kind, self.window_log, bytes);
        }
        bytes.copy_from_slice(file.slice("a slice", offset, bytes.len() as u64)?);
        let sample = self.kind.stored.bytes();
        if self.big_endian && sample > 1 {
            bytes.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
        }
        Ok(())
    }
}

impl SliceFiles for Slices {
    fn read_slice(&self, z: u64, bytes: &mut [u8]) -> Result<(), SourceError> {
        self.read(z, bytes).map_err(|source| SourceError::Tiff {
            path: self.path.clone(),
            place: TiffPlace::Slice(z),
            source,
        })
    }

    fn decode_bytes(&self) -> u64 {
        self.decode_bytes
    }
}

fn decode_page(
    page: &Page<'_>,
    kind: PageKind,
    window_log: u32,
    bytes: &mut [u8],
) -> Result<(), TiffError> {
    if page.kind != kind {
        return Err(TiffError::Changed);
    }
    decode::decode(page, window_log, bytes)
}

/// What the header of a file with a single page says.
#[derive(Debug)]
pub(super) struct SinglePage {
    pub(super) kind: PageKind,
    pub(super) voxel_size: VoxelSize,
    pub(super) decode_bytes: u64,
}

/// Looks at a file of one page.
pub(super) fn look_at_single(path: &Path) -> Result<SinglePage, SourceError> {
    with_single(path, |page| {
        page.check_chunks()?;
        let layout = Layout::of_page(page, layout::voxel_size(&page.ifd));
        let Layout { kind, voxel_size, decode_bytes, .. } = layout;
        Ok(SinglePage { kind, voxel_size, decode_bytes })
    })
}

/// Decodes a file of one page, of a known kind.
pub(super) fn read_single(
    path: &Path,
    kind: PageKind,
    bytes: &mut [u8],
) -> Result<(), SourceError> {
    with_single(path, |page| {
        let window_log = Layout::of_page(page, VoxelSize::unknown()).window_log;
        decode_page(page, kind, window_log, bytes)
    })
}

fn with_single<R>(
    path: &Path,
    work: impl FnOnce(&Page<'_>) -> Result<R, TiffError>,
) -> Result<R, SourceError> {
    let map = map_file(path).map_err(|source| SourceError::Io { path: path.to_owned(), source })?;
    let page = || {
        let file = TiffBytes::new(&map)?;
        let mut only = None;
        let mut pages = 0;
        for ifd in file.ifds() {
            let (_, ifd) = ifd?;
            if !is_reduced(&ifd) {
                pages += 1;
                only = only.or(Some(ifd));
            }
        }
        if pages > 1 {
            return Err(TiffError::ManyPages { pages });
        }
        let ifd = only.ok_or(TiffError::NoPages)?;
        let grey_palette = ifd.text(270).is_some_and(|text| text.starts_with("ImageJ="));
        work(&Page::new(ifd, grey_palette)?)
    };
    page().map_err(|source| SourceError::Tiff {
        path: path.to_owned(),
        place: TiffPlace::Whole,
        source,
    })
}

/// A file of one page, for tests of series.
#[cfg(test)]
pub(super) fn write_test_page(
    [x, y]: [usize; 2],
    stored: octree_store::SampleType,
    samples: &[u8],
) -> Vec<u8> {
    tests::write::Made::new([x, y, 1], stored).file(samples)
}
