//! What a sound header says.

use super::*;

#[test]
fn every_field_of_a_nifti_1_header_is_read_in_both_byte_orders() {
    for big_endian in [false, true] {
        let header = nifti_1(big_endian).parse().unwrap();
        let f32s = |values: [f32; 4]| values.map(f64::from);
        let expected = NiftiHeader {
            version: 1,
            kind: NiftiKind::SingleFile,
            big_endian,
            dims: vec![128, 96, 24, 2],
            datatype: NiftiDatatype::I16,
            vox_offset: 416,
            scl_slope: 1.0,
            scl_inter: 0.0,
            pixdim: [-1.0, 2.0, 2.0, f64::from(2.199_999_f32), 2000.0, 1.0, 1.0, 1.0],
            spatial_unit: NiftiUnit::Millimetre,
            qform_code: 1,
            sform_code: 1,
            quatern_bcd: [-1.945_106_8e-26_f32, -0.996_708_5, -0.081_068_74].map(f64::from),
            qoffset_xyz: [117.855_1_f32, -35.722_942, -7.248_798_4].map(f64::from),
            srow_xyz: [
                f32s([-2.0, 6.714_715_7e-19, 9.081_024_5e-18, 117.855_1]),
                f32s([-6.714_715_7e-19, 1.973_711_5, -0.355_528_24, -35.722_942]),
                f32s([8.255_481e-18, 0.323_207_62, 2.171_081_8, -7.248_798_4]),
            ],
            description: "FSL3.3".to_owned(),
        };
        assert_eq!(header, expected);
    }
}

#[test]
fn every_field_of_a_nifti_2_header_is_read_in_both_byte_orders() {
    for big_endian in [false, true] {
        let header = nifti_2(big_endian).parse().unwrap();
        let expected = NiftiHeader {
            version: 2,
            kind: NiftiKind::SingleFile,
            big_endian,
            dims: vec![70_000, 40_000, 9],
            datatype: NiftiDatatype::U32,
            vox_offset: 5_000_000_016,
            scl_slope: 0.1,
            scl_inter: -1024.0,
            pixdim: [1.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0],
            spatial_unit: NiftiUnit::Micrometre,
            qform_code: 100_000,
            sform_code: 2,
            quatern_bcd: [0.1, -0.2, 0.3],
            qoffset_xyz: [-10.0, 20.25, 3.5],
            srow_xyz: [[1.1, 1.2, 1.3, 1.4], [2.1, 2.2, 2.3, 2.4], [3.1, 3.2, 3.3, 3.4]],
            description: "micrographs".to_owned(),
        };
        assert_eq!(header, expected);
        assert_eq!(header.scaling(), Some((0.1, -1024.0)));
        let [x, y, z] = header.srow_xyz;
        assert_eq!(header.affine(), Some([x, y, z, [0.0, 0.0, 0.0, 1.0]]));
    }
}

#[test]
fn analyze_keeps_dimensions_type_and_voxel_size_only() {
    for big_endian in [false, true] {
        let header = analyze(big_endian).f32s(112, &[2.0]).parse().unwrap();
        assert_eq!((header.version, header.kind), (1, NiftiKind::Analyze));
        assert_eq!((header.big_endian, header.datatype), (big_endian, NiftiDatatype::I16));
        assert_eq!((header.dims.as_slice(), header.vox_offset), (&[128, 96, 24, 2][..], 0));
        assert_eq!(header.spacing_xyz(), [2.0, 2.0, f64::from(2.199_999_f32)]);
        assert_eq!((header.affine(), header.scaling()), (None, None));
        assert_eq!(header.spatial_unit, NiftiUnit::Unknown);
        assert_eq!((header.qform_code, header.sform_code), (0, 0));
    }
    for (stored, expected) in [(64.0, 64), (-64.0, 0), (f32::NAN, 0), (f32::INFINITY, 0)] {
        assert_eq!(analyze(true).f32s(108, &[stored]).parse().unwrap().vox_offset, expected);
    }
}

#[test]
fn the_nifti_crate_reads_the_same_from_nifti_1() {
    for big_endian in [false, true] {
        let bytes = nifti_1(big_endian);
        assert_same_as_crate(&bytes.parse().unwrap(), &bytes.bytes);
    }
}

/// nibabel 5.4.2: `nibabel.load("example4d.nii.gz").header.get_sform()` and `.get_qform()`.
#[test]
fn an_oblique_scan_lies_where_nibabel_puts_it() {
    let sform = [
        [-2.0, 6.714_715_653_593_746e-19, 9.081_024_511_081_715e-18, 117.855_102_539_062_5],
        [
            -6.714_715_653_593_746e-19,
            1.973_711_490_631_103_5,
            -0.355_528_235_435_485_84,
            -35.722_942_352_294_92,
        ],
        [
            8.255_480_888_960_93e-18,
            0.323_207_616_806_030_3,
            2.171_081_781_387_329,
            -7.248_798_370_361_328,
        ],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let header = nifti_1(false).parse().unwrap();
    assert_eq!(header.affine(), Some(sform));
    assert_eq!(header.scaling(), None);

    let qform = [
        [-2.0, 7.754_818_083_349_146e-26, -6.938_240_866_840_628e-27, 117.855_102_539_062_5],
        [
            7.754_818_083_349_146e-26,
            1.973_711_438_010_041_6,
            -0.355_528_225_109_906_8,
            -35.722_942_352_294_92,
        ],
        [
            6.307_494_294_641_728e-27,
            0.323_207_610_474_032_1,
            2.171_081_687_729_040_4,
            -7.248_798_370_361_328,
        ],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let found = nifti_1(true).i16s(254, &[0]).parse().unwrap().affine().unwrap();
    for (found, expected) in found.as_flattened().iter().zip(qform.as_flattened()) {
        assert!((found - expected).abs() < 1e-13, "{found} is not {expected}");
    }
}

#[test]
fn sform_comes_before_qform_before_nothing() {
    let affine = |sform, qform| nifti_1(false).i16s(252, &[qform, sform]).parse().unwrap().affine();
    assert_eq!(affine(1, 1), affine(4, 0));
    assert_ne!(affine(0, 1), affine(1, 1));
    assert_eq!(affine(-1, 1), affine(0, 1));
    assert_eq!(affine(0, 0), None);
    assert_eq!(affine(-1, -1), None);
}

#[test]
fn a_transform_that_is_not_finite_counts_as_absent() {
    let qform = nifti_1(false).i16s(252, &[1, 0]).parse().unwrap().affine();
    let no_sform = nifti_1(false).f32s(300, &[f32::NAN]);
    assert_eq!(no_sform.parse().unwrap().affine(), qform);
    for at in [256, 272] {
        let neither = no_sform.clone().f32s(at, &[f32::INFINITY]);
        assert_eq!(neither.parse().unwrap().affine(), None, "{at}");
    }
}

#[test]
fn a_qfac_of_zero_counts_as_one() {
    let qform =
        |qfac| nifti_1(false).i16s(254, &[0]).f32s(76, &[qfac]).parse().unwrap().affine().unwrap();
    assert_eq!(qform(0.0), qform(1.0));
    assert_eq!(qform(0.0).map(|[_, _, z, _]| z), qform(-1.0).map(|[_, _, z, _]| -z));
}

#[test]
fn impossible_voxel_sizes_become_one() {
    let spacing = |pixdim: [f32; 3]| nifti_1(true).f32s(80, &pixdim).parse().unwrap().spacing_xyz();
    assert_eq!(spacing([-0.5, 0.0, f32::NAN]), [0.5, 1.0, 1.0]);
    assert_eq!(spacing([f32::NEG_INFINITY, -0.0, 1e-40]), [1.0, 1.0, f64::from(1e-40_f32)]);
}

#[test]
fn scaling_follows_nibabels_rules() {
    let scaling = |slope: f32, inter: f32| {
        nifti_1(false).f32s(112, &[slope, inter]).parse().map(|header| header.scaling())
    };
    assert_eq!(scaling(1.0, 0.0), Ok(None));
    assert_eq!(scaling(1.0, -0.0), Ok(None));
    assert_eq!(scaling(0.0, 7.0), Ok(None));
    assert!(scaling(0.0, f32::NAN).is_ok());
    assert_eq!(scaling(f32::NAN, f32::NAN), Ok(None));
    assert_eq!(scaling(f32::NEG_INFINITY, 7.0), Ok(None));
    assert_eq!(scaling(1.0, 7.0), Ok(Some((1.0, 7.0))));
    assert_eq!(scaling(-0.5, 0.0), Ok(Some((-0.5, 0.0))));
    for inter in [f32::NAN, f32::INFINITY] {
        assert!(matches!(
            scaling(2.0, inter),
            Err(NiftiHeaderError::BadScaling { slope: 2.0, .. })
        ));
    }
    let header = nifti_2(true).f64s(176, &[1.0, f64::NAN]).parse();
    assert!(matches!(header, Err(NiftiHeaderError::BadScaling { .. })));
}

#[test]
fn units_are_three_bits_of_their_field() {
    let unit = |xyzt: u8| nifti_1(true).put(123, [xyzt]).parse().unwrap().spatial_unit;
    assert_eq!(unit(8), NiftiUnit::Unknown);
    assert_eq!(unit(1), NiftiUnit::Metre);
    assert_eq!(unit(16 + 2), NiftiUnit::Millimetre);
    assert_eq!(unit(24 + 3), NiftiUnit::Micrometre);
    assert_eq!(unit(4), NiftiUnit::Unknown);
    let unit = |xyzt: i32| nifti_2(true).put(500, xyzt.to_le_bytes()).parse().unwrap().spatial_unit;
    assert_eq!(unit(8 + 2), NiftiUnit::Millimetre);
    assert_eq!(unit(-1), NiftiUnit::Unknown);
}

#[test]
fn a_description_may_fill_its_field_and_be_no_utf_8() {
    let header = nifti_1(false).text(148, &[b'x'; 80]).parse().unwrap();
    assert_eq!(header.description, "x".repeat(80));
    let header = nifti_1(false).text(148, b"caf\xe9\0").parse().unwrap();
    assert_eq!(header.description, "caf\u{fffd}");
}
