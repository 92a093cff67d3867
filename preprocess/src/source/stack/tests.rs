//! Folders and patterns of slices: what makes a volume, and what is refused.

use super::super::tiff::write_test_page;
use crate::source::{Source, SourceError, SourceOptions};
use octree_store::SampleType;
use png::{BitDepth, ColorType};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder, and what is put into it.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn tiff(&self, name: &str, dims_xy: [usize; 2], value: u16) {
        let samples = vec![value; dims_xy[0] * dims_xy[1]];
        let file =
            write_test_page(dims_xy, SampleType::U16, bytemuck::cast_slice(samples.as_slice()));
        std::fs::write(self.path(name), file).unwrap();
    }

    fn png(&self, name: &str, color: ColorType, depth: BitDepth, bytes: &[u8]) {
        let mut file = std::fs::File::create(self.path(name)).unwrap();
        let mut encoder = png::Encoder::new(&mut file, 3, 2);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.set_pixel_dims(Some(png::PixelDimensions {
            xppu: 100_000,
            yppu: 50_000,
            unit: png::Unit::Meter,
        }));
        if color == ColorType::Indexed {
            encoder.set_palette(vec![0; 12]);
        }
        encoder.write_header().unwrap().write_image_data(bytes).unwrap();
    }
}

fn open(path: &Path) -> Result<Source, SourceError> {
    Source::open(path, &SourceOptions::default())
}

fn read(source: &Source) -> Vec<u16> {
    let mut slice = vec![0_u16; (source.dims_xyz[0] * source.dims_xyz[1]) as usize];
    let mut slices = source.slices().unwrap();
    let mut out = Vec::new();
    for _ in 0..source.dims_xyz[2] {
        slices.next(&mut slice).unwrap();
        out.extend_from_slice(&slice);
    }
    out
}

fn refused(path: &Path, words: &[&str]) {
    let error = open(path).unwrap_err().to_string();
    for word in words {
        assert!(error.contains(word), "no '{word}' in: {error}");
    }
}

#[test]
fn a_folder_is_a_volume_in_natural_order() {
    let bench = Bench::new();
    for z in [8, 10, 9, 11] {
        bench.tiff(&format!("slice{z}.tif"), [3, 2], z);
    }
    for litter in [".DS_Store", "Thumbs.db", "._slice8.tif", "scan.log", "readme.txt"] {
        std::fs::write(bench.path(litter), "x").unwrap();
    }
    std::fs::create_dir(bench.path("slices12.tif")).unwrap();
    let expected: Vec<u16> = (8..12).flat_map(|z| [z; 6]).collect();
    let folder = bench.0.path().to_owned();
    for path in [folder.clone(), folder.join("slice*.tif"), folder.join("slice[0-9]*")] {
        let source = open(&path).unwrap();
        assert_eq!((source.dims_xyz, source.sample_type()), ([3, 2, 4], SampleType::U16));
        assert_eq!(read(&source), expected);
        let names: Vec<_> = source.files.iter().map(|file| file.file_name().unwrap()).collect();
        assert_eq!(names, ["slice8.tif", "slice9.tif", "slice10.tif", "slice11.tif"]);
        let bytes: u64 = source.files.iter().map(|f| std::fs::metadata(f).unwrap().len()).sum();
        assert_eq!(source.description.bytes, bytes);
        assert_eq!(source.description.path, path.display().to_string());
    }
    let notes = open(&folder).unwrap().notes;
    assert!(
        notes.iter().any(|note| note.contains("other files are left out: 2, such as")),
        "{notes:?}"
    );
}

#[test]
fn gaps_are_refused_unless_they_are_allowed() {
    let bench = Bench::new();
    for z in [1, 2, 5] {
        bench.tiff(&format!("s{z:03}.tif"), [3, 2], z);
    }
    refused(bench.0.path(), &["s003.tif is missing", "missing in all: 2", "--allow-gaps"]);
    let options = SourceOptions { allow_gaps: true, ..SourceOptions::default() };
    assert_eq!(Source::open(bench.0.path(), &options).unwrap().dims_xyz[2], 3);
}

#[test]
fn what_makes_no_volume_is_refused() {
    let bench = Bench::new();
    refused(bench.0.path(), &["no slices in it", ".png"]);
    refused(&bench.path("*.tif"), &["*.tif: no file matches"]);
    refused(&bench.path("a[.tif"), &["this is no pattern"]);
    bench.tiff("a1.tif", [3, 2], 1);
    bench.tiff("a2.tif", [3, 3], 1);
    refused(bench.0.path(), &["a2.tif has 3 x 3 pixels of u16", "a1.tif has 3 x 2"]);
    bench.png("a3.png", ColorType::Grayscale, BitDepth::Eight, &[0; 6]);
    refused(bench.0.path(), &["several kinds", "a1.tif", "a3.png"]);
    bench.tiff("b1.tif", [3, 2], 1);
    refused(&bench.path("*.tif"), &["do not differ in one number alone"]);
    let raw = SourceOptions { big_endian: true, ..SourceOptions::default() };
    let error = Source::open(bench.0.path(), &raw).unwrap_err().to_string();
    assert!(error.contains("this is a folder"), "{error}");
    let time = SourceOptions { time: Some(1), ..SourceOptions::default() };
    let error = Source::open(bench.path("a1*"), &time).unwrap_err();
    assert!(matches!(error, SourceError::NoSuchVolume { count: 1, asked: 1, .. }), "{error}");
    std::fs::write(bench.path("a2.tif"), b"II*\0\x08\0\0\0").unwrap();
    refused(&bench.path("a?.tif"), &["a2.tif", "cut short"]);
}

#[test]
fn a_name_that_looks_like_a_pattern_is_taken_for_itself() {
    let bench = Bench::new();
    bench.tiff("s[1].tif", [3, 2], 7);
    bench.tiff("s1.tif", [3, 2], 8);
    assert_eq!(read(&open(&bench.path("s[1].tif")).unwrap()), [7; 6]);
    std::fs::remove_file(bench.path("s[1].tif")).unwrap();
    assert_eq!(read(&open(&bench.path("s[1].tif")).unwrap()), [8; 6]);
}

#[test]
fn grey_png_files_are_slices() {
    let bench = Bench::new();
    for z in 0..3_u8 {
        let bytes: Vec<u8> = (0..12).map(|i| 20 * z + i).collect();
        bench.png(&format!("p{z}.png"), ColorType::Grayscale, BitDepth::Sixteen, &bytes);
    }
    let source = open(bench.0.path()).unwrap();
    assert_eq!((source.dims_xyz, source.spacing_xyz), ([3, 2, 3], [0.01, 0.02, 0.01]));
    let value = |i: u16| (20 * (i / 6) + 2 * (i % 6)) * 257 + 1;
    assert_eq!(read(&source), (0..18).map(value).collect::<Vec<_>>());
    let one = open(&bench.path("p1.png")).unwrap();
    assert_eq!((one.dims_xyz, read(&one)[0]), ([3, 2, 1], 20 * 257 + 1));
    bench.png("p2.png", ColorType::Grayscale, BitDepth::Eight, &[0; 6]);
    refused(bench.0.path(), &["p2.png has 3 x 2 pixels of u8"]);
}

#[test]
fn other_png_files_are_refused_by_name() {
    let bench = Bench::new();
    for (color, depth, bytes, words) in [
        (ColorType::Rgb, BitDepth::Eight, 18, "colour (RGB)"),
        (ColorType::Rgba, BitDepth::Sixteen, 48, "RGB with transparency"),
        (ColorType::GrayscaleAlpha, BitDepth::Eight, 12, "grey with transparency"),
        (ColorType::Indexed, BitDepth::Eight, 6, "a palette"),
        (ColorType::Grayscale, BitDepth::Four, 4, "4 bits a pixel"),
        (ColorType::Grayscale, BitDepth::One, 2, "1 bits a pixel"),
    ] {
        bench.png("a.png", color, depth, &vec![0; bytes]);
        refused(&bench.path("a.png"), &["a.png", words]);
    }
}

#[test]
fn damaged_png_files_are_refused_or_read() {
    let bench = Bench::new();
    let bytes: Vec<u8> = (0..12).collect();
    bench.png("a.png", ColorType::Grayscale, BitDepth::Sixteen, &bytes);
    let file = std::fs::read(bench.path("a.png")).unwrap();
    let tried = |bytes: &[u8]| {
        std::fs::write(bench.path("a.png"), bytes).unwrap();
        let source = open(&bench.path("a.png"))?;
        assert!(source.dims_xyz[0] * source.dims_xyz[1] <= 1032 * bytes.len() as u64);
        let mut slice = vec![0_u16; (source.dims_xyz[0] * source.dims_xyz[1]) as usize];
        if source.sample_type() == SampleType::U16 {
            source.slices()?.next(&mut slice)
        } else {
            Ok(())
        }
    };
    for keep in 0..file.len() {
        let error = tried(&file[..keep]).unwrap_err().to_string();
        assert!(error.contains("a.png"), "{error}");
    }
    let mut refusals = 0;
    for place in 0..file.len() {
        let mut damaged = file.clone();
        damaged[place] ^= 0x41;
        refusals += usize::from(tried(&damaged).is_err());
    }
    assert!(refusals > file.len() / 2, "{refusals} of {}", file.len());
}
