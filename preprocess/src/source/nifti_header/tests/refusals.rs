//! What is refused, and what the user is told.

use super::*;

#[test]
fn a_short_header_is_told_both_sizes() {
    for (bytes, whole) in [(nifti_1(true), 348), (nifti_2(false), 540)] {
        assert!(NiftiHeader::parse(&bytes.bytes[..whole]).is_ok());
        for found in [4, 200, whole - 1] {
            let error = NiftiHeader::parse(&bytes.bytes[..found]).unwrap_err();
            assert_eq!(error, NiftiHeaderError::TooShort { expected: whole, found });
            assert!(error.to_string().contains(&format!("{whole} bytes")), "{error}");
        }
    }
    let error = NiftiHeaderError::TooShort { expected: 348, found: 3 };
    assert_eq!(NiftiHeader::parse(&[0; 3]), Err(error));
}

#[test]
fn what_does_not_begin_with_a_header_size_is_no_nifti() {
    let error = NiftiHeaderError::NotNifti { sizeof_hdr: 0 };
    assert_eq!(NiftiHeader::parse(&[0; 600]), Err(error));
    let error = NiftiHeader::parse(b"\x1f\x8b\x08\x00 gzip").unwrap_err();
    assert!(matches!(error, NiftiHeaderError::NotNifti { .. }));
    assert!(error.to_string().contains("348"), "{error}");
}

#[test]
fn a_pair_is_told_from_a_single_file() {
    let pair_1 = nifti_1(false).text(344, b"ni1\0").parse().unwrap();
    let pair_2 = nifti_2(true).text(4, b"ni2\0").parse().unwrap();
    assert_eq!((pair_1.kind, pair_1.vox_offset), (NiftiKind::Pair, 416));
    assert_eq!((pair_2.kind, pair_2.vox_offset), (NiftiKind::Pair, 5_000_000_016));
}

#[test]
fn damaged_magic_is_refused() {
    for magic in [b"n+1\n", b"ni2\0", b"n+\0\0"] {
        let error = nifti_1(false).text(344, magic).parse().unwrap_err();
        assert!(matches!(error, NiftiHeaderError::BadMagic { .. }), "{error}");
    }
    // The carriage return was lost, as in a text-mode transfer.
    let error = nifti_2(false).text(4, b"n+2\0\n\x1a\n\0").parse().unwrap_err();
    assert!(error.to_string().contains(r"n+2\x00\n\x1a\n\x00"), "{error}");
    let error = nifti_2(false).text(4, b"n+1\0").parse().unwrap_err();
    assert!(matches!(error, NiftiHeaderError::BadMagic { .. }));
    assert!(nifti_2(true).text(8, &[0; 4]).parse().is_ok());
}

#[test]
fn dimensions_must_be_there_and_positive() {
    for found in [0, 8, -1, 256] {
        let error = NiftiHeaderError::BadDimensionCount { found: i64::from(found) };
        assert_eq!(nifti_1(false).i16s(40, &[found]).parse(), Err(error));
    }
    for value in [0, -1, i16::MIN] {
        let error = NiftiHeaderError::BadDimension { axis: 3, value: i64::from(value) };
        assert_eq!(nifti_1(true).i16s(46, &[value]).parse(), Err(error));
    }
    // Beyond dim[0] they are not looked at, and a trailing 1 within it stays.
    let header = nifti_1(true).i16s(40, &[4, 5, 6, 7, 1, 0, -1, 9]).parse().unwrap();
    assert_eq!(header.dims, [5, 6, 7, 1]);
    let error = NiftiHeaderError::BadDimension { axis: 1, value: i64::MIN };
    assert_eq!(nifti_2(true).i64s(24, &[i64::MIN]).parse(), Err(error));
}

#[test]
fn a_volume_larger_than_any_file_is_refused() {
    let cube = |dim: i64, datatype: i16, bitpix: i16| {
        nifti_2(false).i64s(16, &[3, dim, dim, dim]).i16s(12, &[datatype, bitpix]).parse()
    };
    assert!(cube((1 << 21) - 1, 2, 8).is_ok());
    let largest = vec![1 << 21; 3];
    let error = NiftiHeaderError::TooManyVoxels { dims: largest, voxel_bytes: 1 };
    assert_eq!(cube(1 << 21, 2, 8), Err(error));
    assert!(cube(1 << 20, 64, 64).unwrap_err().to_string().contains("8 bytes"));
    assert!(matches!(cube(i64::MAX, 2, 8), Err(NiftiHeaderError::TooManyVoxels { .. })));
    let error = nifti_1(false).i16s(40, &[7; 8]).i16s(42, &[i16::MAX; 7]).parse();
    assert!(matches!(error, Err(NiftiHeaderError::TooManyVoxels { .. })));
}

#[test]
fn every_scalar_type_is_read_and_others_are_named() {
    for datatype in NiftiDatatype::ALL {
        let header = nifti_1(true).i16s(70, &[datatype.code(), datatype.bits()]).parse().unwrap();
        assert_eq!(header.datatype, datatype);
        let oracle = nifti::NiftiHeader { datatype: datatype.code(), ..Default::default() };
        assert_eq!(datatype.bytes(), oracle.data_type().unwrap().size_of(), "{datatype:?}");
    }
    for (code, bits, word) in [
        (0, 0, "no declared type"),
        (1, 1, "binary"),
        (32, 64, "complex64"),
        (128, 24, "RGB24"),
        (1024, 64, "int64"),
        (1280, 64, "uint64"),
        (1536, 128, "float128"),
        (1792, 128, "complex128"),
        (2048, 256, "complex256"),
        (2304, 32, "RGBA32"),
        (-9510, 0, "does not define"),
    ] {
        let error = nifti_1(false).i16s(70, &[code, bits]).parse().unwrap_err().to_string();
        assert!(error.contains(word) && error.contains(&code.to_string()), "{error}");
    }
}

#[test]
fn bitpix_must_agree_with_the_type() {
    let error =
        NiftiHeaderError::BitpixMismatch { datatype: NiftiDatatype::U16, expected: 16, bitpix: 8 };
    assert_eq!(nifti_1(false).i16s(70, &[512, 8]).parse(), Err(error.clone()));
    assert!(error.to_string().contains("bitpix is 8 and should be 16 for datatype 512 (U16)"));
}

#[test]
fn voxels_begin_after_the_header_of_a_single_file() {
    let offset_1 = |value: f32| nifti_1(true).f32s(108, &[value]).parse().map(|h| h.vox_offset);
    let offset_2 = |value: i64| nifti_2(true).i64s(168, &[value]).parse().map(|h| h.vox_offset);
    let bad = |value, minimum| Err(NiftiHeaderError::BadVoxOffset { value, minimum });
    assert_eq!((offset_1(0.0), offset_2(0)), (Ok(352), Ok(544)));
    assert_eq!((offset_1(352.0), offset_2(544)), (Ok(352), Ok(544)));
    assert_eq!(offset_1(352.5), Ok(352));
    assert_eq!((offset_1(351.9), offset_2(543)), (bad(351.0, 352), bad(543.0, 544)));
    assert_eq!((offset_1(-1.0), offset_2(-1)), (bad(-1.0, 352), bad(-1.0, 544)));
    assert_eq!(offset_1(0.5), bad(0.5, 352));
    assert_eq!(offset_1(f32::INFINITY), bad(f64::INFINITY, 352));
    assert_eq!(offset_1(9.223_372e18), bad(f64::from(9.223_372e18_f32), 352));
    assert!(matches!(offset_1(f32::NAN), Err(NiftiHeaderError::BadVoxOffset { .. })));

    let pair = |value: f32| nifti_1(false).text(344, b"ni1\0").f32s(108, &[value]).parse();
    assert_eq!(pair(0.0).unwrap().vox_offset, 0);
    assert_eq!(pair(100.0).unwrap().vox_offset, 100);
    assert_eq!(pair(-1.0), Err(NiftiHeaderError::BadVoxOffset { value: -1.0, minimum: 0 }));
}
