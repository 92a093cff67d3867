//! DICOM series: a folder of files of one slice each, or a file of several frames.
//!
//! Files are read here and not by a library: a volume needs two dozen attributes, the place of its pixels
//! in the file so that any thread can read any slice, and lengths that are held against the file's own
//! before anything is reserved for them.
//!
//! Pixels become real values: where all slopes are 1 and the intercepts whole numbers, integers of the
//! smallest type that holds all that the stored bits can say, else f32. `MONOCHROME1` pixels, of which
//! small values are bright, keep their values. The world is left-posterior-superior and becomes
//! right-anterior-superior.

mod attributes;
mod data_set;
mod error;
mod image;
mod pixels;
mod series;
#[cfg(test)]
mod tests;
mod walk;

pub use error::DicomError;

use super::data_files::read_start;
use super::{Found, Place, SliceFiles, Source, SourceError, SourceOptions, StoredFormat};
use image::Image;
use octree_store::{Geometry, LengthUnit, Sample, SampleType, with_sample_type};
use pixels::{Coding, FramePlace};
use series::Arranged;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Whether a file says that it is DICOM, by its name or by its magic. One that is so named and is something
/// else is refused when it is read, and not passed over: it may be a slice.
pub(super) fn is_dicom(path: &Path) -> Result<bool, SourceError> {
    Ok(is_name(path) || data_set::is_magic(&read_start(path, 132)?))
}

/// Whether a file's name ends in `.dcm`.
pub(super) fn is_name(path: &Path) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case("dcm"))
}

/// Opens one series; `given` is what the user gave: a folder, or the one file. `left_out` are files that lie
/// with those of the series and are none.
pub(super) fn open(
    paths: Vec<PathBuf>,
    mut left_out: Vec<PathBuf>,
    given: &Path,
    options: &SourceOptions,
) -> Result<Source, SourceError> {
    let refused = |(path, source): (PathBuf, DicomError)| {
        let path = if path.as_os_str().is_empty() { given.to_owned() } else { path };
        SourceError::Dicom { path, source }
    };
    for asked in [options.time, options.channel] {
        super::data_files::chosen(given, 1, asked)?;
    }
    let mut images = Vec::new();
    for path in paths {
        match image::read(&path)? {
            Some(image) => images.push(image),
            None => left_out.push(path),
        }
    }
    let chosen = choose_series(&mut images, options.series.as_deref())
        .map_err(|source| refused((PathBuf::new(), source)))?;
    let Arranged { order, spacing_xyz, affine, mut notes } =
        series::arrange(&images, options.allow_gaps).map_err(refused)?;
    let [first, ..] = images.as_slice() else {
        return Err(refused((PathBuf::new(), DicomError::NoImages)));
    };
    let dims_xyz = [first.format.columns, first.format.rows, order.len() as u64];
    Geometry::new(dims_xyz, 128, 0)
        .map_err(|source| SourceError::Geometry { path: given.to_owned(), source })?;
    notes.extend(chosen);
    notes.extend(super::left_out_note(&left_out));
    if images.iter().any(|image| image.inverse) {
        notes.push(
            "its small values are meant to be bright (MONOCHROME1): values stay as stored".into(),
        );
    }
    let output = Output::of(&images);
    let found = Found {
        dims_xyz,
        spacing_xyz,
        unit: LengthUnit::Mm,
        affine,
        path: given.to_owned(),
        bytes: images.iter().map(|image| image.bytes).sum(),
        notes,
        files: images.iter().map(|image| image.path.clone()).collect(),
        format: StoredFormat { stored: output.stored, big_endian: false, scaling: output.scaling },
        place: Place::Slices(Box::new(Series { images, order, output })),
    };
    Ok(found.into())
}

/// Keeps the images of the series that is asked for, or of the only one there is; says which where it left
/// others out.
fn choose_series(
    images: &mut Vec<Image>,
    asked: Option<&str>,
) -> Result<Option<String>, DicomError> {
    let mut series = BTreeMap::new();
    for image in images.iter() {
        let (count, _) = series.entry(&image.series).or_insert((0, &image.description));
        *count += image.frames.len();
    }
    let list = || {
        let shown = series.iter().take(10).map(|(uid, (count, description))| {
            format!(
                "{uid} ({count} slices{}{description})",
                if description.is_empty() { "" } else { ", " }
            )
        });
        let mut list = shown.collect::<Vec<_>>().join("; ");
        if series.len() > 10 {
            list.push_str("; ...");
        }
        list
    };
    let count = series.len();
    let Some(asked) = asked else {
        return if count <= 1 {
            Ok(None)
        } else {
            Err(DicomError::SeveralSeries { count, list: list() })
        };
    };
    if !series.keys().any(|uid| *uid == asked) {
        return Err(DicomError::NoSuchSeries { asked: asked.to_owned(), list: list() });
    }
    images.retain(|image| image.series == asked);
    let note = format!("it holds {count} series: {asked} is used (--series chooses another)");
    Ok((count > 1).then_some(note))
}

/// What the slices give.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Output {
    stored: SampleType,
    /// What is left to be done to a slice, where it is the same for all.
    scaling: Option<(f64, f64)>,
    /// Whether each slice is scaled when it is read.
    scaled: bool,
}

impl Output {
    fn of(images: &[Image]) -> Self {
        let frames =
            || images.iter().flat_map(|image| image.frames.iter().map(move |f| (image, f)));
        let first = frames().next().map_or((1.0, 0.0), |(_, frame)| frame.rescale);
        let shifted = frames().all(|(_, frame)| {
            let (slope, intercept) = frame.rescale;
            slope == 1.0 && intercept.fract() == 0.0
        });
        let bits = images.iter().map(|image| image.format.allocated).max().unwrap_or(8);
        let range = |shift: bool| {
            frames().fold((i64::MAX, i64::MIN), |(least, greatest), (image, frame)| {
                let (low, high) = image.format.range();
                let shift = if shift { frame.rescale.1 as i64 } else { 0 };
                (least.min(low.saturating_add(shift)), greatest.max(high.saturating_add(shift)))
            })
        };
        if shifted && let Some(stored) = smallest(range(true), bits) {
            return Self { stored, scaling: None, scaled: true };
        }
        let same = frames().all(|(_, frame)| frame.rescale == first);
        match smallest(range(false), bits) {
            Some(stored) if same => Self { stored, scaling: Some(first), scaled: false },
            _ => Self { stored: SampleType::F32, scaling: None, scaled: true },
        }
    }
}

/// The smallest integer type of at least so many bits that holds a range.
fn smallest((least, greatest): (i64, i64), bits: u32) -> Option<SampleType> {
    [
        SampleType::U8,
        SampleType::I8,
        SampleType::U16,
        SampleType::I16,
        SampleType::U32,
        SampleType::I32,
    ]
    .into_iter()
    .filter(|sample_type| sample_type.bytes() * 8 >= bits as usize)
    .find(|sample_type| {
        let (low, high) = sample_type.limits();
        low as i64 <= least && greatest <= high as i64
    })
}

/// Slices in their order.
#[derive(Debug)]
struct Series {
    images: Vec<Image>,
    order: Vec<(usize, usize)>,
    output: Output,
}

/// A frame's pixels as they are stored, decoded.
fn read_pixels(image: &Image, place: &FramePlace, out: &mut [u8]) -> Result<(), SourceError> {
    let path = &image.path;
    let error = |source: io::Error| match source.kind() {
        io::ErrorKind::UnexpectedEof => SourceError::Truncated { path: path.clone() },
        io::ErrorKind::NotFound => SourceError::Missing { path: path.clone() },
        _ => SourceError::Io { path: path.clone(), source },
    };
    let mut file = File::open(path).map_err(error)?;
    let mut read = |offset, out: &mut [u8]| {
        file.seek(SeekFrom::Start(offset)).and_then(|_| file.read_exact(out)).map_err(error)
    };
    let fragments = match place {
        FramePlace::Native { offset } => return read(*offset, out),
        FramePlace::Coded(fragments) => fragments,
    };
    let mut coded = vec![0; fragments.iter().map(|f| f.length as usize).sum()];
    let mut rest = &mut coded[..];
    for fragment in fragments {
        let (part, tail) = rest.split_at_mut(fragment.length as usize);
        read(fragment.offset, part)?;
        rest = tail;
    }
    let decoded = match image.coding {
        Coding::Jpeg => pixels::decode_jpeg(&coded, &image.format, out),
        Coding::Rle | Coding::Native => pixels::decode_rle(&coded, &image.format, out),
    };
    decoded.map_err(|source| SourceError::Dicom { path: path.clone(), source })
}
impl SliceFiles for Series {
    fn read_slice(&self, z: u64, bytes: &mut [u8]) -> Result<(), SourceError> {
        let (image, frame) = self.order[z as usize];
        let image = &self.images[image];
        let frame = &image.frames[frame];
        // Decoders give little-endian pixels; native big-endian ones are never coded.
        let format = &image.format;
        let (slope, intercept) = if self.output.scaled { frame.rescale } else { (1.0, 0.0) };
        let samples = self.output.stored;
        let as_stored = (slope, intercept) == (1.0, 0.0) && format.is_plain();
        if as_stored && samples.bytes() == format.bytes() && samples.is_integer() {
            return read_pixels(image, &frame.place, bytes);
        }
        let mut pixels = vec![0; format.frame_bytes() as usize];
        read_pixels(image, &frame.place, &mut pixels)?;
        let pixels = pixels.chunks_exact(format.bytes());
        with_sample_type!(samples, T => {
            for (out, pixel) in bytes.chunks_exact_mut(size_of::<T>()).zip(pixels) {
                let value = T::from_f64(format.value(pixel) as f64 * slope + intercept);
                out.copy_from_slice(value.to_le_array().as_ref());
            }
        });
        Ok(())
    }

    fn decode_bytes(&self) -> u64 {
        let images = self.images.iter();
        let coded =
            images.clone().flat_map(|image| &image.frames).map(|frame| match &frame.place {
                FramePlace::Native { .. } => 0,
                FramePlace::Coded(fragments) => {
                    fragments.iter().map(|fragment| fragment.length).sum()
                }
            });
        let frame = images.map(|image| image.format.frame_bytes()).max().unwrap_or(0);
        // The pixels, and for coded ones these and what a decoder holds beside its output.
        let decoding = match coded.max().unwrap_or(0) {
            0 => 0,
            coded => coded + 4 * frame,
        };
        frame + decoding
    }
}
