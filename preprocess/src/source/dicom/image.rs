//! One DICOM file as frames: what each says of its place, its pixels and their values.

use super::super::{SourceError, world};
use super::DicomError;
use super::attributes::{self as tags, Attributes};
use super::data_set::{self, DataSet, PixelData};
use super::pixels::{self, Coding, FramePlace, PixelFormatBits};
use super::walk::WalkError;
use std::fs::File;
use std::path::{Path, PathBuf};

/// A file that holds an image.
#[derive(Debug)]
pub(super) struct Image {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
    /// The series' UID.
    pub(super) series: String,
    pub(super) description: String,
    pub(super) instance: Option<f64>,
    /// Whether small values are bright.
    pub(super) inverse: bool,
    pub(super) format: PixelFormatBits,
    pub(super) coding: Coding,
    pub(super) frames: Vec<Frame>,
}

/// One of its frames; positions are in mm, left-posterior-superior.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) place: FramePlace,
    pub(super) position: Option<[f64; 3]>,
    /// The directions in which columns and rows are counted.
    pub(super) orientation: Option<[[f64; 3]; 2]>,
    pub(super) spacing_xy: Option<[f64; 2]>,
    /// From slice to slice, as far as the file knows.
    pub(super) distance: Option<f64>,
    /// Value = pixel * slope + intercept.
    pub(super) rescale: (f64, f64),
}

/// Reads a file's attributes; `None` where it is DICOM but no image, as a report is.
pub(super) fn read(path: &Path) -> Result<Option<Image>, SourceError> {
    let io_error = |source| SourceError::Io { path: path.to_owned(), source };
    let wrong = |source| SourceError::Dicom { path: path.to_owned(), source };
    let walk_error = |error| match error {
        WalkError::Io(source) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
            SourceError::Truncated { path: path.to_owned() }
        }
        WalkError::Io(source) => io_error(source),
        WalkError::Dicom(source) => wrong(source),
    };
    let file = File::open(path).map_err(io_error)?;
    let bytes = file.metadata().map_err(io_error)?.len();
    let found = DataSet::read(&file, bytes).map_err(walk_error)?;
    let root = &found.root;
    let Some(pixel_data) = found.pixels else {
        // An image that was cut short or overwritten is no report.
        if root.has(tags::ROWS) || !root.has(tags::SOP_CLASS) {
            return Err(wrong(DicomError::NoImage));
        }
        return Ok(None);
    };
    let format = format(&found).map_err(wrong)?;
    let coding = pixels::coding(&found.transfer_syntax).map_err(wrong)?;
    let count = count(&found, bytes).map_err(wrong)?;
    let places = if coding == Coding::Native {
        native(pixel_data, &format, count, bytes).map_err(wrong)?
    } else {
        if pixel_data.length.is_some() {
            let what = "coded pixels are not in fragments";
            return Err(wrong(DicomError::Damaged { at: pixel_data.offset, what }));
        }
        let frames = data_set::fragments(&file, bytes, pixel_data, count as usize);
        frames.map_err(walk_error)?.into_iter().map(FramePlace::Coded).collect()
    };
    let frames = places
        .into_iter()
        .enumerate()
        .map(|(index, place)| frame(&found, index, place))
        .collect::<Result<_, _>>()
        .map_err(wrong)?;
    Ok(Some(Image {
        path: path.to_owned(),
        bytes,
        series: root.text(tags::SERIES_UID).unwrap_or_default(),
        description: root.text(tags::SERIES_DESCRIPTION).unwrap_or_default(),
        instance: root.vector(tags::INSTANCE_NUMBER).map(|[number]| number),
        inverse: root.text(tags::PHOTOMETRIC).as_deref() == Some("MONOCHROME1"),
        format,
        coding,
        frames,
    }))
}

/// What the pixels are, where they are grey values of a size that is read.
fn format(found: &DataSet) -> Result<PixelFormatBits, DicomError> {
    let root = &found.root;
    let wrong = |name, expected, found: Option<u32>| DicomError::Attribute {
        name,
        expected,
        found: found.map_or("missing".to_owned(), |number| number.to_string()),
    };
    let side = |tag, name| match root.short(tag) {
        Some(side) if side > 0 => Ok(u64::from(side)),
        found => Err(wrong(name, "at least 1", found)),
    };
    let rows = side(tags::ROWS, "Rows")?;
    let columns = side(tags::COLUMNS, "Columns")?;
    let samples = root.short(tags::SAMPLES_PER_PIXEL).unwrap_or(1);
    let photometric = root.text(tags::PHOTOMETRIC).unwrap_or_else(|| "MONOCHROME2".to_owned());
    if samples != 1 || !matches!(photometric.as_str(), "MONOCHROME1" | "MONOCHROME2") {
        return Err(DicomError::Colour { photometric, samples });
    }
    let allocated = match root.short(tags::BITS_ALLOCATED) {
        Some(bits @ (8 | 16 | 32)) => bits,
        found => return Err(wrong("BitsAllocated", "8, 16 or 32", found)),
    };
    let stored = match root.short(tags::BITS_STORED) {
        None => allocated,
        Some(bits) if (1..=allocated).contains(&bits) => bits,
        found => return Err(wrong("BitsStored", "1 to BitsAllocated", found)),
    };
    let high = match root.short(tags::HIGH_BIT) {
        None => stored - 1,
        Some(bit) if (stored - 1..allocated).contains(&bit) => bit,
        found => return Err(wrong("HighBit", "BitsStored - 1 to BitsAllocated - 1", found)),
    };
    let signed = match root.short(tags::PIXEL_REPRESENTATION).unwrap_or(0) {
        0 => false,
        1 => true,
        found => return Err(wrong("PixelRepresentation", "0 or 1", Some(found))),
    };
    let words = found.pixels.is_some_and(|pixels| pixels.words);
    if found.big_endian && allocated == 8 && words {
        return Err(wrong("BitsAllocated", "16 where big-endian words hold the pixels", Some(8)));
    }
    let big_endian = found.big_endian;
    Ok(PixelFormatBits { columns, rows, allocated, stored, high, signed, big_endian })
}

/// The number of frames; each takes at least a byte of the file.
fn count(found: &DataSet, bytes: u64) -> Result<u64, DicomError> {
    let Some(text) = found.root.text(tags::FRAMES) else { return Ok(1) };
    text.parse().ok().filter(|count| (1..=bytes).contains(count)).ok_or(DicomError::Attribute {
        name: "NumberOfFrames",
        expected: "a number of frames that the file can hold",
        found: text.chars().take(40).collect(),
    })
}

fn native(
    pixel_data: PixelData,
    format: &PixelFormatBits,
    count: u64,
    bytes: u64,
) -> Result<Vec<FramePlace>, DicomError> {
    pixels::native_frames(pixel_data, format, count, bytes)
}

/// What the file says of a frame: what is the frame's own goes before what all share.
fn frame(found: &DataSet, index: usize, place: FramePlace) -> Result<Frame, DicomError> {
    let DataSet { root, shared, frames, .. } = found;
    let groups = || frames.get(index).into_iter().chain([shared, root]);
    let vector3 = |tag| groups().find_map(|group: &Attributes| group.vector::<3>(tag));
    let number =
        |tag| groups().find_map(|group| group.vector(tag)).map(|[number]: [f64; 1]| number);
    let size = |tag| number(tag).map(f64::abs).filter(|&size| size > 0.0);
    let spacing = [tags::PIXEL_SPACING, tags::IMAGER_PIXEL_SPACING]
        .into_iter()
        .find_map(|tag| groups().find_map(|group| group.vector::<2>(tag)))
        .filter(|spacing| spacing.iter().all(|&size| size > 0.0));
    let orientation = groups()
        .find_map(|group| group.vector::<6>(tags::ORIENTATION))
        .map(|[a, b, c, d, e, f]| [[a, b, c], [d, e, f]]);
    let offset = root
        .decimals(tags::FRAME_OFFSETS)
        .and_then(|offsets| Some(offsets.get(index)? - offsets.first()?));
    let mut position = vector3(tags::POSITION);
    if let (Some(position), Some(offset), Some([x, y]), true) =
        (&mut position, offset, orientation, frames.is_empty())
    {
        let normal = world::cross(x, y);
        for (p, n) in position.iter_mut().zip(normal) {
            *p += offset * n;
        }
    } else if found.frames.is_empty() && index > 0 {
        // All frames share the one place that is said: that of the first.
        position = None;
    }
    let rescale = (number(tags::SLOPE).unwrap_or(1.0), number(tags::INTERCEPT).unwrap_or(0.0));
    if rescale.0 == 0.0 {
        let (name, expected, found) = ("RescaleSlope", "a number other than 0", "0".to_owned());
        return Err(DicomError::Attribute { name, expected, found });
    }
    Ok(Frame {
        place,
        position,
        orientation,
        // Files say the distance of rows first, which is along y.
        spacing_xy: spacing.map(|[y, x]| [x, y]),
        distance: size(tags::SPACING_BETWEEN_SLICES).or_else(|| size(tags::SLICE_THICKNESS)),
        rescale,
    })
}
