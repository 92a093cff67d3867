//! A volume's TIFF pages: a directory for each slice, all samples in one run between the first directory and
//! the others, so that the file is written from front to back.
//!
//! Sizes of voxels go the way of ImageJ, which most programs read: pixels a unit in the resolution tags, the
//! unit and the distance of slices in the first page's description
//! (<https://imagej.net/ij/developer/source/ij/io/FileInfo.java.html>). Files of 4 GiB and more are BigTIFF.

use crate::error::PreprocessError;
use crate::volume::Volume;
use octree_store::{LengthUnit, SampleType};
use std::io::{self, Write};
use std::path::Path;

/// The types of tags.
const ASCII: u16 = 2;
const SHORT: u16 = 3;
const LONG: u16 = 4;
const RATIONAL: u16 = 5;
const LONG8: u16 = 16;

/// Where the parts of a file lie.
#[derive(Debug, Clone)]
pub(super) struct Pages {
    dims_xyz: [u64; 3],
    sample_type: SampleType,
    /// Pixels along x and y in one unit of length, as fractions.
    pixels_xy: [[u32; 2]; 2],
    description: String,
    big: bool,
}

/// A tag, and its one value, or the bytes of several.
enum Tag {
    Number(u16, u16, u64),
    Bytes(u16, u16, u64, Vec<u8>),
}

impl Pages {
    /// Lays out a volume's pages.
    pub(super) fn of(volume: &Volume, output: &Path) -> Result<Self, PreprocessError> {
        let spacing_xyz @ [x, y, z] = volume.spacing_xyz();
        let unit = match volume.unit() {
            LengthUnit::M => "m",
            LengthUnit::Mm => "mm",
            LengthUnit::Um => "micron",
            LengthUnit::Nm => "nm",
        };
        let Some((x, y)) = pixels_a_unit(x).zip(pixels_a_unit(y)) else {
            let path = output.to_owned();
            return Err(PreprocessError::TiffSpacing { path, spacing_xyz, unit: volume.unit() });
        };
        let depth = volume.dims_xyz()[2];
        let description = format!(
            "ImageJ=1.54f\nimages={depth}\nslices={depth}\nunit={unit}\nspacing={z:?}\nloop=false\n"
        );
        let pages = Self {
            dims_xyz: volume.dims_xyz(),
            sample_type: volume.sample_type(),
            pixels_xy: [x, y],
            description,
            big: false,
        };
        Ok(Self { big: pages.end() > u64::from(u32::MAX), ..pages })
    }

    /// The header and the first directory, up to the first sample.
    pub(super) fn before_samples(&self) -> Vec<u8> {
        let mut bytes = if self.big {
            let mut bytes = b"II+\0\x08\0\0\0".to_vec();
            bytes.extend(16_u64.to_le_bytes());
            bytes
        } else {
            b"II*\0\x08\0\0\0".to_vec()
        };
        let first = self.directory(bytes.len() as u64, 0);
        bytes.extend(first);
        bytes
    }

    /// Writes the directories of all pages but the first.
    pub(super) fn write_after_samples(&self, out: &mut impl Write) -> io::Result<()> {
        let unpadded = self.first_sample() + self.dims_xyz[2] * self.slice_bytes();
        out.write_all(&[0; 8][..(self.directory_at(1) - unpadded) as usize])?;
        (1..self.dims_xyz[2])
            .try_for_each(|page| out.write_all(&self.directory(self.directory_at(page), page)))
    }

    fn slice_bytes(&self) -> u64 {
        self.dims_xyz[0] * self.dims_xyz[1] * self.sample_type.bytes() as u64
    }

    fn first_sample(&self) -> u64 {
        let header = if self.big { 16 } else { 8 };
        header + self.directory_bytes(true)
    }

    /// Where the directory of a page after the first lies.
    fn directory_at(&self, page: u64) -> u64 {
        let end = self.first_sample() + self.dims_xyz[2] * self.slice_bytes();
        end.next_multiple_of(8) + (page - 1) * self.directory_bytes(false)
    }

    fn end(&self) -> u64 {
        self.directory_at(self.dims_xyz[2])
    }

    /// Bytes of a directory with all its values, a multiple of 8.
    fn directory_bytes(&self, first: bool) -> u64 {
        let tags = 13 + u64::from(first);
        let (entries, outside) =
            if self.big { (8 + 20 * tags + 8, 0) } else { (2 + 12 * tags + 4, 16) };
        let text = if first { self.description.len() as u64 + 1 } else { 0 };
        (entries + outside + text).next_multiple_of(8)
    }

    /// The directory of a page that lies at byte `at`.
    fn directory(&self, at: u64, page: u64) -> Vec<u8> {
        let [width, height, depth] = self.dims_xyz;
        let format = match self.sample_type {
            SampleType::U8 | SampleType::U16 | SampleType::U32 => 1,
            SampleType::I8 | SampleType::I16 | SampleType::I32 => 2,
            SampleType::F32 | SampleType::F64 => 3,
        };
        let place = if self.big { LONG8 } else { LONG };
        let fraction = |tag, parts: [u32; 2]| {
            Tag::Bytes(tag, RATIONAL, 1, parts.into_iter().flat_map(u32::to_le_bytes).collect())
        };
        let mut tags = vec![
            Tag::Number(256, LONG, width),
            Tag::Number(257, LONG, height),
            Tag::Number(258, SHORT, 8 * self.sample_type.bytes() as u64),
            Tag::Number(259, SHORT, 1),
            Tag::Number(262, SHORT, 1),
        ];
        if page == 0 {
            let text = [self.description.as_bytes(), &[0]].concat();
            tags.push(Tag::Bytes(270, ASCII, text.len() as u64, text));
        }
        tags.extend([
            Tag::Number(273, place, self.first_sample() + page * self.slice_bytes()),
            Tag::Number(277, SHORT, 1),
            Tag::Number(278, LONG, height),
            Tag::Number(279, place, self.slice_bytes()),
            fraction(282, self.pixels_xy[0]),
            fraction(283, self.pixels_xy[1]),
            // The unit is in the description.
            Tag::Number(296, SHORT, 1),
            Tag::Number(339, SHORT, format),
        ]);
        let length = self.directory_bytes(page == 0);
        let next = if page + 1 < depth { self.directory_at(page + 1) } else { 0 };
        let bytes = self.entries(at, &tags, next, length);
        debug_assert_eq!(bytes.len() as u64, length);
        bytes
    }

    /// Tags as they lie in the file, their values behind them where they do not fit.
    fn entries(&self, at: u64, tags: &[Tag], next: u64, length: u64) -> Vec<u8> {
        // The size of a count or of a place.
        let word = if self.big { 8 } else { 4 };
        let put = |bytes: &mut Vec<u8>, number: u64| {
            bytes.extend_from_slice(&number.to_le_bytes()[..word]);
        };
        let mut bytes = Vec::with_capacity(length as usize);
        bytes.extend_from_slice(&(tags.len() as u64).to_le_bytes()[..if self.big { 8 } else { 2 }]);
        let behind = bytes.len() + tags.len() * (4 + 2 * word) + word;
        let mut values = Vec::new();
        for tag in tags {
            let (Tag::Number(number, kind, _) | Tag::Bytes(number, kind, _, _)) = tag;
            bytes.extend(number.to_le_bytes());
            bytes.extend(kind.to_le_bytes());
            match tag {
                Tag::Number(_, _, value) => {
                    put(&mut bytes, 1);
                    put(&mut bytes, *value);
                }
                Tag::Bytes(_, _, count, value) => {
                    put(&mut bytes, *count);
                    if value.len() <= word {
                        bytes.extend_from_slice(value);
                        bytes.resize(bytes.len() + word - value.len(), 0);
                    } else {
                        put(&mut bytes, at + (behind + values.len()) as u64);
                        values.extend_from_slice(value);
                    }
                }
            }
        }
        put(&mut bytes, next);
        bytes.extend(values);
        bytes.resize(length as usize, 0);
        bytes
    }
}

/// Pixels in a unit of length as a fraction of whole numbers, for a pixel of a size: the simplest that gives
/// that size again, else the nearest of the continued fraction, if it is within a billionth.
fn pixels_a_unit(size: f64) -> Option<[u32; 2]> {
    let (mut before, mut now) = ([0_u64, 1], [1_u64, 0]);
    let mut rest = size;
    let mut best = None;
    for _ in 0..64 {
        let whole = rest.floor();
        if !(0.0..=f64::from(u32::MAX)).contains(&whole) {
            break;
        }
        let next = [0, 1].map(|i| (whole as u64).saturating_mul(now[i]).saturating_add(before[i]));
        (before, now) = (now, next);
        let [Ok(over), Ok(under)] = now.map(u32::try_from) else { break };
        let found = f64::from(over) / f64::from(under);
        if over > 0 && (found / size - 1.0).abs() <= 1e-9 {
            best = Some([under, over]);
        }
        if found == size || rest == whole {
            break;
        }
        rest = 1.0 / (rest - whole);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{Source, SourceOptions};

    #[test]
    fn sizes_of_pixels_come_back() {
        for size in [1.0, 0.5, 3.0, 0.05, 0.0123, 0.699_999_988_079_071, 1e-6, 12_345.678, 0.1] {
            let [over, under] = pixels_a_unit(size).unwrap();
            assert_eq!(f64::from(under) / f64::from(over), size, "{over}/{under}");
        }
        let near = pixels_a_unit(std::f64::consts::PI * 1e-6).unwrap();
        let found = f64::from(near[1]) / f64::from(near[0]);
        assert!((found / (std::f64::consts::PI * 1e-6) - 1.0).abs() < 1e-9);
        for size in [1e-11, 1e11, f64::NAN, f64::INFINITY, 0.0, -1.0] {
            assert_eq!(pixels_a_unit(size), None, "{size}");
        }
    }

    #[test]
    fn either_form_is_read_back_with_its_spacing() {
        let folder = tempfile::tempdir().unwrap();
        let types = [SampleType::U8, SampleType::I16, SampleType::I32, SampleType::F64];
        for (sample_type, big) in types.into_iter().flat_map(|t| [(t, false), (t, true)]) {
            let dims_xyz = [5, 3, 7];
            let pages = Pages {
                dims_xyz,
                sample_type,
                pixels_xy: [0.0123, 0.5].map(|size| pixels_a_unit(size).unwrap()),
                description: "ImageJ=1.54f\nimages=7\nslices=7\nunit=micron\nspacing=2.5\n".into(),
                big,
            };
            let count = 5 * 3 * 7 * sample_type.bytes();
            let samples: Vec<u8> = (0..count).map(|i| (i * 37) as u8).collect();
            let mut file = pages.before_samples();
            assert_eq!(file.len() as u64, pages.first_sample());
            file.extend_from_slice(&samples);
            pages.write_after_samples(&mut file).unwrap();
            assert_eq!(file.len() as u64, pages.end());
            let path = folder.path().join("a.tif");
            std::fs::write(&path, &file).unwrap();
            let source = Source::open(&path, &SourceOptions::default()).unwrap();
            assert_eq!((source.dims_xyz, source.sample_type()), (dims_xyz, sample_type));
            assert_eq!(source.spacing_xyz, [0.0123, 0.5, 2.5]);
            assert_eq!(
                (source.unit, source.notes.len()),
                (LengthUnit::Um, 0),
                "{:?}",
                source.notes
            );
            let start = pages.first_sample() as usize;
            assert_eq!(&file[start..start + count], samples);
        }
    }
}
