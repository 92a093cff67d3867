//! What files say of their voxels' size, and of channels and times.

use super::super::codec::Compression;
use super::write::Made;
use super::{open, read, samples};
use crate::source::{Source, SourceOptions};
use octree_store::{LengthUnit, SampleType};

/// A file of 3 x 2 pixels; its resolution tags point at `resolution` in its description.
fn file(pages: usize, description: &str, tags: &[(u16, u16, u64)]) -> Vec<u8> {
    let made = Made {
        compression: Compression::PackBits,
        description: description.into(),
        tags: tags.to_vec(),
        ..Made::new([3, 2, pages], SampleType::U8)
    };
    made.file(&samples(made.dims_xyz, made.stored))
}

fn opened(pages: usize, description: &str, tags: &[(u16, u16, u64)]) -> Source {
    open(&file(pages, description, tags), &SourceOptions::default()).unwrap()
}

/// The resolution as whole numbers, which readers take as well as fractions.
fn resolution(pixels: u64, unit: u64) -> [(u16, u16, u64); 3] {
    [(282, 4, pixels), (283, 4, 2 * pixels), (296, 3, unit)]
}

#[test]
fn resolution_tags_give_the_size_of_a_voxel() {
    let size = |tags: &[_]| {
        let source = opened(2, "", tags);
        (source.spacing_xyz, source.unit, source.notes)
    };
    let (spacing, unit, notes) = size(&resolution(100, 3));
    assert_eq!((spacing, unit), ([0.1, 0.05, 0.1], LengthUnit::Mm));
    assert!(notes[0].contains("--spacing"), "{notes:?}");
    let expected = [0.1, 0.05, 0.1];
    let inches = size(&resolution(254, 2)).0;
    assert!(inches.iter().zip(expected).all(|(got, v)| (got - v).abs() < 1e-15), "{inches:?}");
    for nothing in [resolution(100, 1).as_slice(), &resolution(72, 2), &resolution(0, 3), &[]] {
        let (spacing, _, notes) = size(nothing);
        assert_eq!(spacing, [1.0; 3], "{nothing:?}");
        assert!(notes.iter().any(|note| note.contains("1 mm is assumed")), "{notes:?}");
    }
}

#[test]
fn imagej_says_pixels_a_unit() {
    let source = opened(2, "ImageJ=1.5\nimages=2\nunit=\\u00B5m\nspacing=-3\n", &resolution(4, 1));
    assert_eq!((source.spacing_xyz, source.unit), ([0.25, 0.125, 3.0], LengthUnit::Um));
    assert!(source.notes.is_empty(), "{:?}", source.notes);
    let source = opened(2, "ImageJ=1.5\nimages=2\nunit=inch\nspacing=1\n", &resolution(10, 2));
    assert_eq!((source.spacing_xyz, source.unit), ([2.54, 1.27, 25.4], LengthUnit::Mm));
    let source = opened(2, "ImageJ=1.5\nimages=2\nunit=pixel\nspacing=2\n", &resolution(4, 1));
    assert_eq!((source.spacing_xyz, source.unit), ([0.25, 0.125, 2.0], LengthUnit::Mm));
    assert!(source.notes[0].contains("'pixel'"), "{:?}", source.notes);
}

#[test]
fn a_channel_and_a_time_are_chosen() {
    let all = samples([3, 2, 24], SampleType::U8);
    let hyperstack = file(24, "ImageJ=1.5\nimages=24\nchannels=2\nslices=3\nframes=4\n", &[]);
    let ome = file(
        24,
        "<OME><Image><Pixels DimensionOrder=\"XYCZT\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"4\"/></Image></OME>",
        &[],
    );
    let tifffile = file(24, r#"{"shape": [4, 3, 2, 2, 3], "axes": "TZCYX"}"#, &[]);
    for file in [hyperstack, ome, tifffile] {
        let source = open(&file, &SourceOptions::default()).unwrap();
        assert!(source.notes.iter().any(|note| note.contains("4 times and 2 channels")));
        assert_eq!(source.dims_xyz, [3, 2, 3]);
        for (time, channel) in [(0, 0), (3, 1), (2, 0)] {
            let options =
                SourceOptions { time: Some(time), channel: Some(channel), ..Default::default() };
            let got = read(&open(&file, &options).unwrap()).unwrap();
            let page = |z| 6 * ((time * 3 + z) * 2 + channel) as usize;
            let expected: Vec<u8> =
                (0..3).flat_map(|z| all[page(z)..page(z) + 6].to_vec()).collect();
            assert_eq!(got, expected);
        }
        for options in [
            SourceOptions { time: Some(4), ..Default::default() },
            SourceOptions { channel: Some(2), ..Default::default() },
        ] {
            let error = open(&file, &options).unwrap_err().to_string();
            assert!(error.contains("numbered from 0"), "{error}");
        }
    }
}

#[test]
fn many_times_or_channels_of_one_slice_are_slices() {
    let ome = "<OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"4\"/></Image></OME>";
    for (text, flag) in [("ImageJ=1\nimages=4\nchannels=4\n", "--channel"), (ome, "--time")] {
        let source = opened(4, text, &[]);
        assert_eq!(source.dims_xyz, [3, 2, 4]);
        assert_eq!(read(&source).unwrap(), samples([3, 2, 4], SampleType::U8));
        assert!(source.notes.iter().any(|note| note.contains(flag)), "{:?}", source.notes);
        let one = SourceOptions { time: Some(2), ..Default::default() };
        let one =
            if text == ome { one } else { SourceOptions { channel: one.time, time: None, ..one } };
        let source = open(&file(4, text, &[]), &one).unwrap();
        assert_eq!(read(&source).unwrap(), &samples([3, 2, 4], SampleType::U8)[12..18]);
    }
}

#[test]
fn ome_names_sizes_and_pages() {
    let text = "<?xml version=\"1.0\"?><OME UUID=\"urn:a\"><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"3\" \
        SizeC=\"1\" SizeT=\"1\" PhysicalSizeX=\"0.5\" PhysicalSizeY=\"500\" PhysicalSizeYUnit=\"nm\" \
        PhysicalSizeZ=\"0.002\" PhysicalSizeZUnit=\"mm\"><TiffData IFD=\"2\" FirstZ=\"0\"/>\
        <TiffData IFD=\"0\" FirstZ=\"1\" PlaneCount=\"2\"><UUID FileName=\"b.tif\">urn:a</UUID></TiffData>\
        </Pixels></Image></OME>";
    let source = opened(3, text, &[]);
    assert_eq!((source.spacing_xyz, source.unit), ([0.5, 0.5, 2.0], LengthUnit::Um));
    let all = samples([3, 2, 3], SampleType::U8);
    assert_eq!(read(&source).unwrap(), [&all[12..18], &all[..12]].concat());
}

#[test]
fn metadata_that_cannot_be_are_refused() {
    let ome = |pixels: &str| {
        format!("<OME><Image><Pixels DimensionOrder=\"XYZCT\" {pixels}</Pixels></Image></OME>")
    };
    for (text, words) in [
        (
            ome("SizeZ=\"4\" SizeC=\"1\" SizeT=\"1\">"),
            "4 slices, 1 channels and 1 times, and it has 3 pages",
        ),
        (ome("SizeZ=\"3\" SizeC=\"9223372036854775807\" SizeT=\"9\">"), "OME metadata speak"),
        (ome("SizeZ=\"0\" SizeC=\"1\" SizeT=\"1\">"), "usable SizeZ"),
        (
            ome("SizeZ=\"3\" SizeC=\"1\" SizeT=\"1\"><TiffData IFD=\"7\"/>"),
            "no page of this file for slice 0",
        ),
        (ome("SizeZ=\"3\" SizeC=\"1\" SizeT=\"1\"><TiffData FirstZ=\"3\"/>"), "FirstZ"),
        ("<OME><Image></OME>".into(), "OME metadata cannot be read"),
        (
            "ImageJ=1\nimages=8\nchannels=2\nslices=4\n".into(),
            "2 channels and 1 times, and it has 3 pages",
        ),
        (
            r#"{"shape": [3, 3, 2, 3], "axes": "QZYX"}"#.into(),
            "dimensions beyond x, y, z, time and channel",
        ),
    ] {
        let error = open(&file(3, &text, &[]), &SourceOptions::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: no '{words}' in: {error}");
    }
    // A description that another program left as it was, of a stack that has become shorter.
    assert_eq!(opened(3, "ImageJ=1\nimages=8\nslices=8\n", &[]).dims_xyz[2], 3);
    assert_eq!(opened(3, r#"{"shape": [8, 2, 3]}"#, &[]).dims_xyz[2], 3);
}

#[test]
fn a_palette_of_imagej_and_white_zeros_change_no_value() {
    let all = samples([3, 2, 2], SampleType::U8);
    let source = opened(2, "ImageJ=1.5\nimages=2\n", &[(262, 3, 3)]);
    assert_eq!(read(&source).unwrap(), all);
    assert!(source.notes.iter().any(|note| note.contains("palette")));
    let source = opened(2, "", &[(262, 3, 0)]);
    assert_eq!(read(&source).unwrap(), all);
    assert!(source.notes.iter().any(|note| note.contains("shown white")));
}
