//! Headers for our own volumes.

use super::*;

#[test]
fn a_written_volume_is_nifti_1_while_its_dimensions_fit() {
    let header = |dim_x| {
        let (spacing, unit) = ([0.1, 0.2, 0.3], NiftiUnit::Micrometre);
        NiftiHeader::for_volume([dim_x, 2, 3], NiftiDatatype::U16, spacing, unit, None).unwrap()
    };
    let small = header(32_767);
    assert_eq!((small.version, small.vox_offset, small.to_bytes().len()), (1, 352, 352));
    assert_eq!(small.spacing_xyz(), [0.1_f32, 0.2, 0.3].map(f64::from));
    let large = header(32_768);
    assert_eq!((large.version, large.vox_offset, large.to_bytes().len()), (2, 544, 544));
    assert_eq!(large.spacing_xyz(), [0.1, 0.2, 0.3]);
    for header in [small, large] {
        assert_eq!((header.affine(), header.scaling()), (None, None));
        assert_eq!(NiftiHeader::parse(&header.to_bytes()), Ok(header));
    }
}

#[test]
fn unused_dimensions_are_written_as_one() {
    let header = NiftiHeader { dims: vec![5, 6], ..nifti_1(false).parse().unwrap() };
    let oracle = nifti::NiftiHeader::from_reader(&header.to_bytes()[..]).unwrap();
    assert_eq!(oracle.dim, [2, 5, 6, 1, 1, 1, 1, 1]);
}

#[test]
fn a_rotation_is_written_both_ways_and_a_shear_as_sform_only() {
    let written = |affine| {
        let (spacing, unit) = ([2.0, 3.0, 4.0], NiftiUnit::Millimetre);
        NiftiHeader::for_volume([5, 6, 7], NiftiDatatype::F32, spacing, unit, Some(affine)).unwrap()
    };
    let last = [0.0, 0.0, 0.0, 1.0];
    let turned = [[0.0, 3.0, 0.0, 1.5], [0.0, 0.0, 4.0, 2.5], [-2.0, 0.0, 0.0, 3.5], last];
    let header = written(turned);
    assert_eq!((header.qform_code, header.sform_code), (1, 1));
    assert_eq!((header.quatern_bcd, header.pixdim[0]), ([0.5, 0.5, -0.5], -1.0));
    assert_eq!(header.qoffset_xyz, [1.5, 2.5, 3.5]);
    assert_eq!(header.affine(), Some(turned));
    assert_eq!(NiftiHeader { sform_code: 0, ..header }.affine(), Some(turned));

    let sheared = [[2.0, 0.5, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0], last];
    let header = written(sheared);
    assert_eq!((header.qform_code, header.sform_code), (0, 1));
    assert_eq!(header.affine(), Some(sheared));
}

#[test]
fn a_volume_that_no_header_can_hold_is_refused() {
    let written = |dims_xyz, spacing_xyz, affine| {
        let unit = NiftiUnit::Unknown;
        NiftiHeader::for_volume(dims_xyz, NiftiDatatype::U8, spacing_xyz, unit, affine).unwrap_err()
    };
    let error = NiftiHeaderError::BadDimension { axis: 2, value: 0 };
    assert_eq!(written([1, 0, 1], [1.0; 3], None), error);
    let error = written([u64::MAX, 1, 1], [1.0; 3], None);
    assert!(matches!(error, NiftiHeaderError::TooManyVoxels { .. }));
    for value in [0.0, -1.0, f64::NAN, 1e39, 1e-60] {
        let error = written([1; 3], [1.0, 1.0, value], None);
        assert!(matches!(error, NiftiHeaderError::BadSpacing { axis: 3, bits: 32, .. }), "{error}");
    }
    let mut affine = [[0.0; 4]; 4];
    let error = written([1; 3], [1.0; 3], Some(affine));
    assert_eq!(error, NiftiHeaderError::BadAffine { row: 3, column: 3, value: 0.0, bits: 32 });
    affine[1][2] = -1e300;
    let error = written([1; 3], [1.0; 3], Some(affine));
    assert_eq!(error, NiftiHeaderError::BadAffine { row: 1, column: 2, value: -1e300, bits: 32 });
}

#[test]
fn numbers_too_large_for_the_version_are_refused_on_reading() {
    let header = nifti_1(false).parse().unwrap();
    let long = NiftiHeader { dims: vec![40_000, 2], ..header.clone() };
    let error = NiftiHeader::parse(&long.to_bytes()).unwrap_err();
    assert!(matches!(error, NiftiHeaderError::BadDimension { axis: 1, .. }));
    let far = NiftiHeader { vox_offset: (1 << 24) + 1, ..header.clone() };
    let error = NiftiHeader::parse(&far.to_bytes()).unwrap_err();
    assert!(matches!(error, NiftiHeaderError::BadVoxOffset { .. }));
    for dims in [vec![], vec![1; 8], vec![1; 70_000]] {
        let error = NiftiHeader::parse(&NiftiHeader { dims, ..header.clone() }.to_bytes());
        assert!(matches!(error, Err(NiftiHeaderError::BadDimensionCount { .. })));
    }
}

#[test]
fn a_description_is_cut_between_characters() {
    let header = nifti_1(false).parse().unwrap();
    let long = NiftiHeader { description: "é".repeat(50) + "x", ..header };
    assert_eq!(NiftiHeader::parse(&long.to_bytes()).unwrap().description, "é".repeat(40));
}
