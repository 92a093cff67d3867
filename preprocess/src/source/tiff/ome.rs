//! OME-XML, as OME-TIFF files carry it in the first page's description: sizes, the order of pages,
//! which page is which plane, and the size of a voxel. Of several images the first one is read.

use super::TiffError;
use super::length::{VoxelSize, in_unit, unit_of_word};
use super::pages::{Axis, PageOrder};
use roxmltree::{Document, Node};

/// What OME-XML says of its first image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ome {
    pub(super) order: PageOrder,
    pub(super) voxel_size: VoxelSize,
    /// Images in the file.
    pub(super) images: usize,
    runs: Vec<Run>,
}

/// Pages that follow each other as planes do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    first_page: u64,
    first_plane: u64,
    /// None: as many as there are.
    planes: Option<u64>,
}

/// Whether a description is OME-XML.
pub(super) fn is_ome(description: &str) -> bool {
    description.trim_end().ends_with("OME>") && description.contains("<OME")
}

impl Ome {
    /// Reads a description; `None` where it has no image, as where the metadata are in another file.
    pub(super) fn parse(description: &str) -> Result<Option<Self>, TiffError> {
        let xml = Document::parse(description)
            .map_err(|error| TiffError::OmeXml { what: error.to_string() })?;
        let named = |name: &'static str| {
            move |node: &Node<'_, '_>| node.is_element() && node.tag_name().name() == name
        };
        let images = xml.descendants().filter(named("Image")).count();
        let Some(pixels) = xml.descendants().find(named("Pixels")) else { return Ok(None) };
        let order = page_order(pixels)?;
        let own_uuid = xml.root_element().attribute("UUID");
        let mut runs = Vec::new();
        for data in pixels.children().filter(named("TiffData")) {
            // A page of another file of the set.
            let uuid = data.children().find(named("UUID")).and_then(|uuid| uuid.text());
            if own_uuid.is_some() && uuid.is_some_and(|uuid| Some(uuid.trim()) != own_uuid) {
                continue;
            }
            let number = |name| whole_number(data, name);
            let first_page = number("IFD")?;
            let first = |name| Ok(number(name)?.unwrap_or(0));
            let place = [
                (Axis::Z, first("FirstZ")?),
                (Axis::Channel, first("FirstC")?),
                (Axis::Time, first("FirstT")?),
            ];
            if place.iter().any(|&(axis, at)| at >= order.size(axis)) {
                return Err(TiffError::OmeAttribute { name: "FirstZ, FirstC or FirstT" });
            }
            let planes = number("PlaneCount")?.or(first_page.map(|_| 1));
            let first_page = first_page.unwrap_or(0);
            runs.push(Run { first_page, first_plane: order.index(place), planes });
        }
        if runs.is_empty() && !pixels.children().any(|child| named("TiffData")(&child)) {
            runs.push(Run { first_page: 0, first_plane: 0, planes: None });
        }
        Ok(Some(Self { order, voxel_size: voxel_size(pixels), images, runs }))
    }

    /// The page of each slice of a channel and a time, of `pages` pages in the file, where planes follow
    /// each other in `order`.
    pub(super) fn volume(
        &self,
        order: &PageOrder,
        channel: u64,
        time: u64,
        pages: u64,
    ) -> Result<Vec<u64>, TiffError> {
        let slices = order.size(Axis::Z);
        let count = || TiffError::PageCount {
            metadata: "OME",
            slices,
            channels: order.size(Axis::Channel),
            times: order.size(Axis::Time),
            pages,
        };
        let planes = order.pages().ok_or_else(count)?;
        if slices > pages {
            return Err(count());
        }
        let mut found = vec![None; slices as usize];
        let mut steps = 0;
        for run in &self.runs {
            let most = pages.saturating_sub(run.first_page).min(planes - run.first_plane);
            let run_planes = run.planes.unwrap_or(u64::MAX).min(most);
            // A page belongs to one plane: runs that say otherwise over and over are no good.
            steps += run_planes;
            if steps > 16 * pages {
                return Err(count());
            }
            for step in 0..run_planes {
                let [z, c, t] = order.place(run.first_plane + step);
                if [c, t] == [channel, time] {
                    found[z as usize] = Some(run.first_page + step);
                }
            }
        }
        let page = |(z, page): (usize, Option<u64>)| {
            page.ok_or(TiffError::NoPlane { z: z as u64, channel, time })
        };
        found.into_iter().enumerate().map(page).collect()
    }
}

/// An attribute that is a whole number, if it is there.
fn whole_number(node: Node<'_, '_>, name: &'static str) -> Result<Option<u64>, TiffError> {
    let number = |text: &str| text.trim().parse().ok().ok_or(TiffError::OmeAttribute { name });
    node.attribute(name).map(number).transpose()
}

fn page_order(pixels: Node<'_, '_>) -> Result<PageOrder, TiffError> {
    let size = |name| {
        let size = whole_number(pixels, name)?.filter(|&size| size > 0);
        size.ok_or(TiffError::OmeAttribute { name })
    };
    let (z, c, t) =
        ((Axis::Z, size("SizeZ")?), (Axis::Channel, size("SizeC")?), (Axis::Time, size("SizeT")?));
    let axes = match pixels.attribute("DimensionOrder") {
        Some("XYZCT") => [z, c, t],
        Some("XYZTC") => [z, t, c],
        Some("XYCZT") => [c, z, t],
        Some("XYCTZ") => [c, t, z],
        Some("XYTZC") => [t, z, c],
        Some("XYTCZ") => [t, c, z],
        _ => return Err(TiffError::OmeAttribute { name: "DimensionOrder" }),
    };
    Ok(PageOrder { axes })
}

/// The size of a voxel, in the unit of x; micrometres where none is named.
fn voxel_size(pixels: Node<'_, '_>) -> VoxelSize {
    let length = |size: &str, unit: &str| {
        let size = pixels.attribute(size)?.trim().parse::<f64>().ok()?;
        let scale = unit_of_word(pixels.attribute(unit).unwrap_or("um"))?;
        (size.is_finite() && size > 0.0).then_some((size, scale))
    };
    let x = length("PhysicalSizeX", "PhysicalSizeXUnit");
    let y = length("PhysicalSizeY", "PhysicalSizeYUnit");
    let z = length("PhysicalSizeZ", "PhysicalSizeZUnit");
    let Some((x, scale)) = x.or(y).or(z) else { return VoxelSize::unknown() };
    let unit = scale.1;
    let x = in_unit(x, scale, unit);
    let or_x = |length: Option<(f64, _)>| length.map_or(x, |(v, scale)| in_unit(v, scale, unit));
    let mut notes = Vec::new();
    if z.is_none() {
        notes.push(
            "it does not say how far apart slices are: as far as pixels along x is assumed \
             (--spacing gives another)"
                .into(),
        );
    }
    VoxelSize { spacing_xyz: [x, or_x(y), or_x(z)], unit, notes }
}
