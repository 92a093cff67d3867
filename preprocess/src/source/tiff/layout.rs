//! Where a file's slices are: pages listed once at opening, the volume among them chosen, every page that
//! belongs to it looked at.

use super::super::{SourceError, SourceOptions};
use super::codec::{Compression, zstd_window_log};
use super::ifd::{Ifd, TiffBytes};
use super::imagej::ImageJ;
use super::length::{VoxelSize, is_screen, unit_of_word};
use super::ome::{Ome, is_ome};
use super::page::{Page, PageKind, is_reduced};
use super::pages::{Axis, PageOrder};
use super::shaped::Shaped;
use super::{TiffError, TiffPlace, decode};
use octree_store::LengthUnit;
use std::path::Path;

/// Where slices are.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Places {
    /// Their samples, at the same distance from each other.
    Even { first: u64, step: u64 },
    /// Their samples.
    Samples(Vec<u64>),
    /// The directories of their pages, whose samples must be decoded.
    Directories(Vec<u64>),
}

/// What opening a file finds.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) kind: PageKind,
    pub(super) slices: u64,
    pub(super) places: Places,
    pub(super) big_endian: bool,
    pub(super) decode_bytes: u64,
    pub(super) window_log: u32,
    pub(super) voxel_size: VoxelSize,
}

/// Whose metadata say how pages follow each other.
enum Metadata {
    None,
    ImageJ(ImageJ),
    Ome(Ome),
    Shaped(Shaped),
}

impl Metadata {
    fn read(ifd: &Ifd<'_>) -> Result<(Self, Vec<String>), TiffError> {
        let description = ifd.text(270).unwrap_or_default();
        let mut notes = Vec::new();
        let metadata = if let Some(imagej) = ImageJ::parse(&description) {
            notes.extend(imagej.value_note());
            Self::ImageJ(imagej)
        } else if is_ome(&description) {
            if let Some(ome) = Ome::parse(&description)? {
                if ome.images > 1 {
                    notes.push(format!("it holds {} images: the first one is used", ome.images));
                }
                Self::Ome(ome)
            } else {
                notes.push("its OME metadata are in another file: its pages are slices".into());
                Self::None
            }
        } else {
            Shaped::parse(&description).map_or(Self::None, Self::Shaped)
        };
        Ok((metadata, notes))
    }

    fn voxel_size(&self, ifd: &Ifd<'_>) -> VoxelSize {
        match self {
            Self::ImageJ(imagej) => imagej.voxel_size(ifd),
            Self::Ome(ome) => ome.voxel_size.clone(),
            Self::None | Self::Shaped(_) => size_of_resolution(ifd),
        }
    }
}

/// The size of a voxel as a page of a series says it.
pub(super) fn voxel_size(ifd: &Ifd<'_>) -> VoxelSize {
    Metadata::read(ifd).map_or_else(|_| size_of_resolution(ifd), |(meta, _)| meta.voxel_size(ifd))
}

/// The size of a voxel from the resolution tags alone.
fn size_of_resolution(ifd: &Ifd<'_>) -> VoxelSize {
    let Some(pixels) = ifd.fraction(282).zip(ifd.fraction(283)) else {
        return VoxelSize::unknown();
    };
    let unit = match ifd.number_or(296, "ResolutionUnit", 2) {
        Ok(2) => "inch",
        Ok(3) => "cm",
        _ => return VoxelSize::unknown(),
    };
    let length = unit_of_word(unit).map_or(1.0, |(millimetres, _)| millimetres);
    if is_screen(pixels.0 * 25.4 / length) {
        let mut size = VoxelSize::unknown();
        size.notes.push("its resolution is a screen's, and says nothing of voxels".into());
        return size;
    }
    VoxelSize::of_resolution([pixels.0, pixels.1], length, LengthUnit::Mm)
}

impl Layout {
    /// Finds the slices of the volume that the options choose.
    pub(super) fn read(
        bytes: &[u8],
        path: &Path,
        options: &SourceOptions,
    ) -> Result<Self, SourceError> {
        let at = |page: Option<u64>| {
            let place = page.map_or(TiffPlace::Whole, TiffPlace::Page);
            move |source| SourceError::Tiff { path: path.to_owned(), place, source }
        };
        let file = TiffBytes::new(bytes).map_err(at(None))?;
        let mut directories = Vec::new();
        let mut full = Vec::new();
        for ifd in file.ifds() {
            let index = directories.len() as u64;
            let (offset, ifd) = ifd.map_err(at(Some(index)))?;
            if !is_reduced(&ifd) {
                full.push(index);
            }
            directories.push(offset);
        }
        let &first = full.first().ok_or(TiffError::NoPages).map_err(at(None))?;
        let first_ifd = file.ifd(directories[first as usize]).map_err(at(Some(first)))?;
        let (metadata, notes) = Metadata::read(&first_ifd).map_err(at(Some(first)))?;
        let mut voxel_size = metadata.voxel_size(&first_ifd);
        voxel_size.notes.extend(notes);
        let grey_palette = matches!(metadata, Metadata::ImageJ(_));
        let (name, order) = match &metadata {
            Metadata::None => ("", PageOrder::slices(full.len() as u64)),
            Metadata::ImageJ(imagej) => ("ImageJ's", imagej.order()),
            Metadata::Ome(ome) => ("OME", ome.order),
            Metadata::Shaped(shaped) => {
                let number = |tag, name| first_ifd.number(tag, name).map_err(at(Some(first)));
                let dims_xy = [number(256, "ImageWidth")?, number(257, "ImageLength")?];
                let order = shaped.order(path, dims_xy)?;
                if order.is_none() {
                    voxel_size.notes.push(
                        "its description is of pictures of another size: each page is a slice"
                            .into(),
                    );
                }
                ("tifffile's", order.unwrap_or(PageOrder::slices(full.len() as u64)))
            }
        };
        let is_ome = matches!(metadata, Metadata::Ome(_));
        let pages = full.len() as u64;
        let alone = pages == 1 && order.pages() != Some(1) && !is_ome;
        let order = if is_ome || alone || order.pages() == Some(pages) {
            order
        } else if order.size(Axis::Channel) == 1 && order.size(Axis::Time) == 1 {
            // Pages were taken away or added by a program that left the description as it was.
            let slices = order.size(Axis::Z);
            voxel_size.notes.push(format!(
                "its description counts {slices} slices, and it has {pages} pages: each page is a slice"
            ));
            PageOrder::slices(pages)
        } else {
            return Err(at(None)(page_count(name, &order, pages)));
        };
        let (order, note) = order.with_slices(options);
        voxel_size.notes.extend(note);
        let (channel, time, note) = order.choose(path, options)?;
        voxel_size.notes.extend(note);
        if alone {
            let page = Page::new(first_ifd, grey_palette).map_err(at(Some(first)))?;
            let mut layout = Self::of_page(&page, voxel_size);
            layout.find_planes(&page, name, &order, [channel, time]).map_err(at(Some(first)))?;
            return Ok(layout);
        }
        let chosen = match &metadata {
            Metadata::Ome(ome) => {
                let pages = directories.len() as u64;
                ome.volume(&order, channel, time, pages).map_err(at(None))?
            }
            _ => order.volume(channel, time).map(|index| full[index as usize]).collect(),
        };
        let pages = chosen.iter().map(|&index| (index, directories[index as usize]));
        Self::of_pages(file, pages, voxel_size, grey_palette)
            .map_err(|(index, source)| at(Some(index))(source))
    }

    /// What one page says of all, its own place apart.
    pub(super) fn of_page(page: &Page<'_>, mut voxel_size: VoxelSize) -> Self {
        if page.min_is_white {
            voxel_size.notes.push(
                "it says that its least value is to be shown white: values are kept as they are \
                 stored"
                    .into(),
            );
        }
        if page.half {
            voxel_size.notes.push("its 16-bit floats are taken as 32-bit ones".into());
        }
        if page.palette {
            voxel_size.notes.push("its palette only colours its values, and is left out".into());
        }
        let first = page.chunk(0).ok().flatten().unwrap_or(&[]);
        let window_log =
            if page.compression == Compression::Zstd { zstd_window_log(first) } else { 0 };
        Self {
            kind: page.kind,
            slices: 1,
            places: Places::Directories(Vec::new()),
            big_endian: page.big_endian(),
            decode_bytes: decode::decode_bytes(page),
            window_log,
            voxel_size,
        }
    }

    /// Planes that follow each other without directories of their own, as ImageJ writes them beyond 4 GB.
    fn find_planes(
        &mut self,
        page: &Page<'_>,
        name: &'static str,
        order: &PageOrder,
        [channel, time]: [u64; 2],
    ) -> Result<(), TiffError> {
        let count = || page_count(name, order, 1);
        let planes = order.pages().ok_or_else(count)?;
        let plane = self.plane_bytes();
        let start = page.plain_offset().ok_or_else(count)?;
        let length = plane.saturating_mul(planes);
        page.bytes("its planes, which its description counts,", start, length)?;
        self.slices = order.size(Axis::Z);
        let mut pages = order.volume(channel, time);
        let (first, second) = (pages.next().unwrap_or(0), pages.next());
        let step = second.map_or(1, |second| second - first);
        self.places = Places::Even { first: start + first * plane, step: step * plane };
        Ok(())
    }

    fn plane_bytes(&self) -> u64 {
        let [x, y] = self.kind.dims_xy;
        x * y * self.kind.stored.bytes() as u64
    }

    /// Looks at every page of the volume.
    fn of_pages(
        file: TiffBytes<'_>,
        pages: impl ExactSizeIterator<Item = (u64, u64)> + Clone,
        voxel_size: VoxelSize,
        grey_palette: bool,
    ) -> Result<Self, (u64, TiffError)> {
        let mut layout: Option<Self> = None;
        let mut voxel_size = Some(voxel_size);
        let mut samples = Some(Vec::new());
        for (index, directory) in pages.clone() {
            let at = |error| (index, error);
            let page =
                file.ifd(directory).and_then(|ifd| Page::new(ifd, grey_palette)).map_err(at)?;
            page.check_chunks().map_err(at)?;
            let size = &mut voxel_size;
            let layout = layout.get_or_insert_with(|| {
                Self::of_page(&page, size.take().unwrap_or_else(VoxelSize::unknown))
            });
            check_alike(page.kind, layout.kind).map_err(at)?;
            if page.compression == Compression::Zstd {
                layout.window_log = layout.window_log.max(zstd_window_log(&[]));
            }
            layout.decode_bytes = layout.decode_bytes.max(decode::decode_bytes(&page));
            samples = samples.zip(page.plain_offset()).map(|(mut samples, offset)| {
                samples.push(offset);
                samples
            });
        }
        let mut layout = layout.ok_or((0, TiffError::NoPages))?;
        layout.slices = pages.len() as u64;
        layout.places = match samples {
            Some(samples) => even(&samples).unwrap_or(Places::Samples(samples)),
            None => Places::Directories(pages.map(|(_, directory)| directory).collect()),
        };
        Ok(layout)
    }
}

/// Checks that a page is like the first.
pub(super) fn check_alike(found: PageKind, first: PageKind) -> Result<(), TiffError> {
    if found == first {
        return Ok(());
    }
    Err(TiffError::Unlike {
        found_xy: found.dims_xy,
        found: found.stored,
        first_xy: first.dims_xy,
        first: first.stored,
    })
}

fn page_count(metadata: &'static str, order: &PageOrder, pages: u64) -> TiffError {
    let [slices, channels, times] =
        [Axis::Z, Axis::Channel, Axis::Time].map(|axis| order.size(axis));
    TiffError::PageCount { metadata, slices, channels, times, pages }
}

/// Places at one distance, if they are.
fn even(samples: &[u64]) -> Option<Places> {
    let (&first, rest) = samples.split_first()?;
    let step = rest.first().map_or(Some(0), |second| second.checked_sub(first))?;
    let steps = samples.windows(2).all(|pair| pair[0].checked_add(step) == Some(pair[1]));
    steps.then_some(Places::Even { first, step })
}
