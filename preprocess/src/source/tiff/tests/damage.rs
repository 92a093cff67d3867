//! Damaged files are refused by name, or read: never a panic, and never much memory.

use super::super::codec::Compression;
use super::super::page::Predictor;
use super::write::Made;
use super::{COMPRESSIONS, open, read, samples};
use crate::source::{SourceError, SourceOptions};
use octree_store::SampleType;

fn files() -> Vec<(Made, Vec<u8>)> {
    let mut files = Vec::new();
    for compression in COMPRESSIONS {
        for tile_xy in [None, Some([16, 16])] {
            for big_tiff in [false, true] {
                let predicts = !matches!(compression, Compression::None | Compression::PackBits);
                let made = Made {
                    compression,
                    tile_xy,
                    big_tiff,
                    big_endian: big_tiff,
                    rows: 5,
                    predictor: if predicts { Predictor::Horizontal } else { Predictor::None },
                    description: "ImageJ=1.5\nimages=3\nslices=3\nunit=mm\nspacing=2\n".into(),
                    ..Made::new([17, 13, 3], SampleType::U16)
                };
                let file = made.file(&samples(made.dims_xyz, made.stored));
                files.push((made, file));
            }
        }
    }
    files
}

/// Opens and reads; what is refused must be refused by name.
fn tried(file: &[u8]) -> Result<Vec<u8>, SourceError> {
    let tried = open(file, &SourceOptions::default()).and_then(|source| {
        let slice = source.dims_xyz[0] * source.dims_xyz[1] * source.sample_type().bytes() as u64;
        let most = file.len() as u64 * (1 << 16);
        assert!(slice * source.dims_xyz[2] <= most, "{:?} of {}", source.dims_xyz, file.len());
        let decode = source.decode_bytes().unwrap_or(0);
        assert!(decode <= 3 * most + (18 << 20), "{decode} bytes to decode {}", file.len());
        // What a damaged header makes a large picture is not worth the time.
        if slice * source.dims_xyz[2] > 1 << 22 { Ok(Vec::new()) } else { read(&source) }
    });
    if let Err(error) = &tried {
        assert!(error.to_string().contains("a.tif"), "{error}");
    }
    tried
}

#[test]
fn a_file_cut_at_any_length_is_refused() {
    for (made, file) in files() {
        tried(&file).unwrap();
        for keep in (0..file.len()).filter(|keep| keep % 7 == 0 || keep + 40 > file.len()) {
            let cut = tried(&file[..keep]);
            assert!(cut.is_err(), "{keep} of {} bytes: {made:?}", file.len());
        }
    }
}

#[test]
fn a_file_with_flipped_bytes_is_read_or_refused() {
    let mut refused = 0;
    for (_, file) in files() {
        for trial in 0..file.len().min(700) {
            let mut damaged = file.clone();
            let place =
                if trial < 400 { file.len() - 1 - trial } else { trial * 7919 % file.len() };
            damaged[place] ^= [0xff, 1, 0x80, 0x10][trial % 4];
            refused += usize::from(tried(&damaged).is_err());
        }
    }
    assert!(refused > 500, "{refused}");
}

#[test]
fn a_damaged_checksum_is_found() {
    let made = Made { compression: Compression::Deflate, ..Made::new([17, 13, 1], SampleType::U8) };
    let mut file = made.file(&samples(made.dims_xyz, made.stored));
    assert!(tried(&file).is_ok());
    // The strip is the first thing behind the header; its checksum is its last bytes.
    let strip = super::write::packed(Compression::Deflate, &samples(made.dims_xyz, made.stored));
    file[8 + strip.len() - 1] ^= 1;
    let error = tried(&file).unwrap_err().to_string();
    assert!(error.contains("slice 0") && error.contains("strip 0"), "{error}");
}

#[test]
fn a_picture_larger_than_its_file_can_hold_is_refused() {
    for compression in COMPRESSIONS {
        for tags in [
            vec![(256, 4, 1 << 25), (257, 4, 1 << 25), (278, 4, 1 << 25)],
            vec![(256, 4, 0xffff_ffff), (257, 4, 0xffff_ffff)],
        ] {
            let made = Made { compression, tags, ..Made::new([17, 13, 1], SampleType::U16) };
            let error = tried(&made.file(&samples(made.dims_xyz, made.stored))).unwrap_err();
            let error = error.to_string();
            assert!(
                error.contains("cannot hold")
                    || error.contains("cut short")
                    || error.contains("Image")
                    || error.contains("damaged"),
                "{error}"
            );
        }
    }
}
