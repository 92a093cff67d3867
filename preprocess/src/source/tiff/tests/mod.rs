//! Every way of writing a page gives the same samples; what is damaged or not grey is refused.

mod damage;
mod metadata;
pub(crate) mod write;

use super::codec::Compression;
use super::page::Predictor;
use crate::source::{Place, Source, SourceError, SourceOptions};
use octree_store::{Sample, SampleType, with_sample_type};
use proptest::prelude::*;
use std::path::Path;
use write::Made;

const COMPRESSIONS: [Compression; 5] = [
    Compression::None,
    Compression::Lzw,
    Compression::Deflate,
    Compression::PackBits,
    Compression::Zstd,
];

/// Samples with runs and steps, little-endian.
fn samples(dims_xyz: [usize; 3], stored: SampleType) -> Vec<u8> {
    let count = dims_xyz.iter().product::<usize>() * stored.bytes();
    (0..count).map(|i| (i / 5 * 7 + i / 97 * 31) as u8).collect()
}

fn open(file: &[u8], options: &SourceOptions) -> Result<Source, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    std::fs::write(&path, file).unwrap();
    // The file stays mapped when its name is gone.
    Source::open(&path, options)
}

/// All samples, little-endian.
fn read(source: &Source) -> Result<Vec<u8>, SourceError> {
    let [x, y, z] = source.dims_xyz;
    with_sample_type!(source.sample_type(), T => {
        let mut slices = source.slices()?;
        let mut slice = vec![T::default(); (x * y) as usize];
        let mut out = Vec::new();
        for _ in 0..z {
            slices.next(&mut slice)?;
            for sample in &slice {
                out.extend_from_slice(sample.to_le_array().as_ref());
            }
        }
        Ok(out)
    })
}

fn refusal(made: &Made) -> String {
    let file = made.file(&samples(made.dims_xyz, made.stored));
    let error = open(&file, &SourceOptions::default()).expect_err(&format!("{made:?}")).to_string();
    assert!(error.contains("a.tif"), "{error}");
    error
}

proptest! {
    #[test]
    fn what_is_written_in_any_way_is_read(
        dims in (1_usize..40, 1_usize..40, 1_usize..4),
        stored in prop::sample::select(SampleType::ALL.as_slice()),
        compression in prop::sample::select(COMPRESSIONS.as_slice()),
        predictor in 0..3,
        big_endian: bool,
        big_tiff: bool,
        tile_xy in prop::option::of((1_usize..4, 1_usize..50)),
        rows in 1_usize..50,
        crop: bool,
    ) {
        let dims_xyz = [dims.0, dims.1, dims.2];
        let tile_xy = tile_xy.map(|(w, h)| [16 * w, h]);
        let predictor = match predictor {
            _ if matches!(compression, Compression::None | Compression::PackBits) => Predictor::None,
            1 => Predictor::Horizontal,
            2 if !stored.is_integer() => Predictor::Float,
            _ => Predictor::None,
        };
        let made = Made {
            big_endian, big_tiff, compression, predictor, tile_xy, rows, ..Made::new(dims_xyz, stored)
        };
        let samples = samples(dims_xyz, stored);
        let source = open(&made.file(&samples), &SourceOptions::default()).unwrap();
        prop_assert_eq!(source.dims_xyz, dims_xyz.map(|n| n as u64));
        prop_assert_eq!(source.sample_type(), stored);
        prop_assert!(read(&source).unwrap() == samples);
        if crop {
            let last = source.dims_xyz.map(|n| n - 1);
            let region = octree_store::Region { min: last, max: source.dims_xyz };
            let corner = read(&source.crop(region).unwrap()).unwrap();
            prop_assert_eq!(&corner, &samples[samples.len() - stored.bytes()..]);
        }
    }

    #[test]
    fn any_slice_is_read_from_any_thread(order in Just((0..9_u64).collect::<Vec<_>>()).prop_shuffle()) {
        let made = Made { compression: Compression::Lzw, rows: 3, ..Made::new([20, 10, 9], SampleType::U16) };
        let samples = samples(made.dims_xyz, made.stored);
        let source = open(&made.file(&samples), &SourceOptions::default()).unwrap();
        let voxels = source.slice_files().unwrap();
        std::thread::scope(|scope| {
            for part in order.chunks(3) {
                let (voxels, samples) = (&voxels, &samples);
                scope.spawn(move || for &z in part {
                    let mut slice = vec![0_u16; 200];
                    voxels.read(z, &mut slice, &mut Vec::new()).unwrap();
                    assert_eq!(bytemuck::cast_slice::<_, u8>(&slice), &samples[z as usize * 400..][..400]);
                });
            }
        });
    }
}

#[test]
fn plain_pages_at_one_distance_are_mapped() {
    for big_endian in [false, true] {
        // One page after the other, without tags between them.
        let made = Made { big_endian, rows: 2, ..Made::new([5, 7, 1], SampleType::U16) };
        let one = samples(made.dims_xyz, made.stored);
        let source = open(&made.file(&one), &SourceOptions::default()).unwrap();
        assert!(matches!(source.place, Place::Mapped { .. }));
        assert!(read(&source).unwrap() == one);
    }
    // Tags between pages: slices of their own, which are copied.
    let made = Made::new([5, 7, 3], SampleType::F32);
    let three = samples(made.dims_xyz, made.stored);
    let source = open(&made.file(&three), &SourceOptions::default()).unwrap();
    assert!(matches!(source.place, Place::Slices(_)));
    assert!(read(&source).unwrap() == three);
}

#[test]
fn an_imagej_stack_beyond_4_gb_is_mapped() {
    use std::io::{Seek, SeekFrom, Write};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("big.tif");
    let planes = 1100_u64;
    let plane = 2048 * 2048;
    let mut made = Made::new([2048, 1024, 1], SampleType::U16);
    made.big_endian = true;
    made.description =
        format!("ImageJ=1.53t\nimages={planes}\nslices={planes}\nunit=um\nspacing=2\n");
    // ImageJ puts the tags before the samples; here the first plane stands between them.
    let head = made.file(&vec![0; plane as usize]);
    let first = head.len() as u64;
    made.tags = vec![(273, 4, first), (279, 4, plane)];
    let head = made.file(&vec![0; plane as usize]);
    let mut file = std::fs::File::create(&path).unwrap();
    file.write_all(&head).unwrap();
    // Holes in the file take no room on the disk.
    file.set_len(first + planes * plane).unwrap();
    file.seek(SeekFrom::End(-2)).unwrap();
    file.write_all(&[0x12, 0x34]).unwrap();
    let source = Source::open(&path, &SourceOptions::default()).unwrap();
    assert_eq!(source.dims_xyz, [2048, 1024, planes]);
    assert_eq!(source.spacing_xyz, [1.0, 1.0, 2.0]);
    let mut last = [0_u16; 2];
    source.mapped().unwrap().read_row([2046, 1023, planes - 1], &mut last);
    assert_eq!(last, [0, 0x1234]);
    // One plane less, and it is cut short.
    file.set_len(first + planes * plane - 1).unwrap();
    let error = Source::open(&path, &SourceOptions::default()).unwrap_err().to_string();
    assert!(error.contains("big.tif") && error.contains("cut short"), "{error}");
}

#[test]
fn strips_that_were_left_out_are_zeros() {
    for compression in COMPRESSIONS {
        let tags = vec![(273, 4, 0), (279, 4, 0)];
        let made = Made { compression, tags, ..Made::new([9, 6, 2], SampleType::U16) };
        let file = made.file(&samples(made.dims_xyz, made.stored));
        let source = open(&file, &SourceOptions::default()).unwrap();
        assert_eq!(read(&source).unwrap(), vec![0; 9 * 6 * 2 * 2], "{compression:?}");
    }
    // A place without a length is no such strip, nor is a length without a place.
    let made = Made { tags: vec![(273, 4, 0)], ..Made::new([9, 6, 2], SampleType::U16) };
    let source = open(&made.file(&samples(made.dims_xyz, made.stored)), &SourceOptions::default());
    assert_ne!(read(&source.unwrap()).unwrap(), vec![0; 9 * 6 * 2 * 2]);
}

#[test]
fn what_is_no_grey_volume_is_refused_by_name() {
    let made = Made::new([9, 6, 2], SampleType::U8);
    for (tags, words) in [
        (vec![(262, 3, 2), (277, 3, 3)], "colour (RGB, 3 samples a pixel)"),
        (vec![(277, 3, 2)], "colour (2 samples a pixel)"),
        (vec![(262, 3, 3)], "a palette"),
        (vec![(262, 3, 5)], "CMYK"),
        (vec![(262, 3, 6)], "YCbCr"),
        (vec![(258, 3, 1)], "1-bit unsigned integers"),
        (vec![(258, 3, 12)], "12-bit unsigned integers"),
        (vec![(258, 3, 64)], "64-bit unsigned integers"),
        (vec![(258, 3, 24), (339, 3, 3)], "24-bit floats"),
        (vec![(339, 3, 6)], "complex"),
        (vec![(259, 3, 7)], "compression is JPEG (7)"),
        (vec![(259, 3, 4)], "fax group 4 (4)"),
        (vec![(259, 3, 999)], "of an unknown kind (999)"),
        (vec![(259, 3, 5), (317, 3, 3)], "predictor 3 with samples of u8"),
        (vec![(317, 3, 2)], "predictor 2 with no compression"),
        (vec![(266, 3, 2)], "FillOrder"),
        (vec![(274, 3, 4)], "Orientation is 4"),
        (vec![(256, 3, 0)], "ImageWidth is 0"),
        (vec![(278, 4, 0)], "RowsPerStrip is 0"),
        (vec![(254, 4, 1)], "no page"),
        (vec![(273, 4, 4_000_000_000)], "a strip would lie at byte 4000000000"),
    ] {
        let error = refusal(&Made { tags, ..made.clone() });
        assert!(error.contains(words), "no '{words}' in: {error}");
    }
    let error = open(b"P5 2 2 255\nabcd", &SourceOptions::default()).unwrap_err().to_string();
    assert!(error.contains("no TIFF file"), "{error}");
    assert!(open(b"", &SourceOptions::default()).is_err());
}

#[test]
fn thumbnails_and_masks_are_no_slices_and_other_sizes_are_refused() {
    let made = Made { compression: Compression::Deflate, ..Made::new([9, 6, 1], SampleType::U8) };
    let page = samples(made.dims_xyz, made.stored);
    let small = Made { dims_xyz: [4, 3, 1], ..made.clone() };
    for (tags, words) in [
        (vec![(254, 4, 1)], None),
        (vec![(254, 4, 4)], None),
        (vec![(255, 3, 2)], None),
        (
            vec![],
            Some(
                "page 1 (counted from 0): it has 4 x 3 pixels of u8, and the first slice has 9 x 6",
            ),
        ),
    ] {
        let second = Made { tags, ..small.clone() }.file(&page[..12]);
        let source = open(&joined(&made.file(&page), &second), &SourceOptions::default());
        match words {
            None => assert!(read(&source.unwrap()).unwrap() == page),
            Some(words) => {
                let error = source.unwrap_err().to_string();
                assert!(error.contains(words), "{error}");
            }
        }
    }
}

/// A file of one page with the pages of another behind it. Both are classic and little-endian.
fn joined(first: &[u8], second: &[u8]) -> Vec<u8> {
    let number = |bytes: &[u8], at: usize| {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
    };
    let shift = first.len();
    let mut out = first.to_vec();
    let end = out.len();
    out.extend(second);
    out[end - 4..end].copy_from_slice(&((number(second, 4) + shift) as u32).to_le_bytes());
    // The second file has one strip, whose place stands in its tag.
    let directory = number(second, 4) + shift;
    let entries = usize::from(u16::from_le_bytes([out[directory], out[directory + 1]]));
    for entry in (0..entries).map(|i| directory + 2 + 12 * i) {
        if out[entry..entry + 2] == 273_u16.to_le_bytes() {
            let place = (number(&out, entry + 8) + shift) as u32;
            out[entry + 8..entry + 12].copy_from_slice(&place.to_le_bytes());
        }
    }
    out
}

#[test]
fn a_list_of_pages_that_runs_in_a_circle_is_refused() {
    let made = Made::new([3, 2, 5], SampleType::U8);
    let mut file = made.file(&samples(made.dims_xyz, made.stored));
    let first = file[4..8].to_vec();
    let end = file.len();
    file[end - 4..].copy_from_slice(&first);
    let error = open(&file, &SourceOptions::default()).unwrap_err().to_string();
    assert!(error.contains("circle"), "{error}");
}

#[test]
fn endings_and_first_bytes_tell_tiff_files() {
    let folder = tempfile::tempdir().unwrap();
    let made = Made::new([3, 2, 1], SampleType::U8);
    let file = made.file(&samples(made.dims_xyz, made.stored));
    for name in ["a.tif", "a.TIFF", "a.btf", "a.scan", "a"] {
        let path = folder.path().join(name);
        std::fs::write(&path, &file).unwrap();
        assert_eq!(Source::open(&path, &SourceOptions::default()).unwrap().dims_xyz, [3, 2, 1]);
        let raw = SourceOptions { skip: Some(1), ..SourceOptions::default() };
        let error = Source::open(&path, &raw).unwrap_err().to_string();
        if Path::new(name).extension().is_some_and(|end| end != "scan") {
            assert!(error.contains("this is a TIFF file"), "{error}");
        }
    }
}
