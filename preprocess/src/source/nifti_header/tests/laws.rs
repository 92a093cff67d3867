//! What holds of any bytes, any damage, any volume.

use super::*;
use proptest::prelude::*;

/// A valid header of any version, kind and byte order.
fn any_header() -> impl Strategy<Value = Vec<u8>> {
    (0..5, any::<bool>()).prop_map(|(which, big_endian)| {
        let header = match which {
            0 => nifti_1(big_endian),
            1 => nifti_1(big_endian).text(344, b"ni1\0"),
            2 => nifti_2(big_endian),
            3 => nifti_2(big_endian).text(4, b"ni2\0"),
            _ => analyze(big_endian),
        };
        header.bytes
    })
}

/// Up to eight runs of up to eight bytes overwritten, some of them with extreme values.
fn any_damage() -> impl Strategy<Value = Vec<(usize, Vec<u8>)>> {
    let byte = prop_oneof![Just(0_u8), Just(0xff), Just(0x7f), Just(0x80), Just(1), any::<u8>()];
    prop::collection::vec((0..544_usize, prop::collection::vec(byte, 1..9)), 0..9)
}

fn damaged(mut bytes: Vec<u8>, damage: Vec<(usize, Vec<u8>)>) -> Vec<u8> {
    for (at, run) in damage {
        for (byte, new) in bytes.iter_mut().skip(at).zip(run) {
            *byte = new;
        }
    }
    bytes
}

/// What must hold of any bytes: no panic, and of a header that is accepted, all that `parse` says.
fn check(bytes: &[u8]) {
    let Ok(header) = NiftiHeader::parse(bytes) else { return };
    assert!((1..=7).contains(&header.dims.len()));
    let voxels = header.dims.iter().try_fold(1_u64, |n, &dim| n.checked_mul(dim)).unwrap();
    let size = voxels.checked_mul(header.datatype.bytes() as u64).unwrap();
    assert!(voxels > 0 && header.vox_offset.checked_add(size).is_some());
    assert!(header.spacing_xyz().iter().all(|&size| size > 0.0 && size.is_finite()));
    if let Some(affine) = header.affine() {
        assert!(affine.as_flattened().iter().all(|value| value.is_finite()));
    }
    if let Some((slope, inter)) = header.scaling() {
        assert!(slope.is_finite() && slope != 0.0 && inter.is_finite());
    }
    // A description that is no UTF-8 may outgrow its field; a NaN equals itself as text only.
    let as_text = |header: &NiftiHeader| {
        let (big_endian, description) = (false, String::new());
        format!("{:?}", NiftiHeader { big_endian, description, ..header.clone() })
    };
    let again = NiftiHeader::parse(&header.to_bytes()).unwrap();
    assert_eq!(as_text(&again), as_text(&header));
    if header.version == 1 && header.kind != NiftiKind::Analyze {
        assert_same_as_crate(&header, bytes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn any_bytes_are_taken_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..700)) {
        check(&bytes);
    }

    #[test]
    fn damage_is_refused_or_read_as_the_nifti_crate_reads_it(
        bytes in any_header(),
        damage in any_damage(),
        length in 0..1000_usize,
    ) {
        let bytes = damaged(bytes, damage);
        check(&bytes[..length.min(bytes.len())]);
    }

    #[test]
    fn what_is_written_is_read(
        dims_xyz in prop::array::uniform3(1..40_000_u64),
        datatype in prop::sample::select(&NiftiDatatype::ALL[..]),
        spacing_xyz in prop::array::uniform3(1e-6..1e6_f64),
        unit in prop::sample::select(&[
            NiftiUnit::Unknown, NiftiUnit::Metre, NiftiUnit::Millimetre, NiftiUnit::Micrometre,
        ][..]),
        rows in prop::option::of(prop::array::uniform3(prop::array::uniform4(-1e6..1e6_f64))),
    ) {
        let affine = rows.map(|[x, y, z]| [x, y, z, [0.0, 0.0, 0.0, 1.0]]);
        let header =
            NiftiHeader::for_volume(dims_xyz, datatype, spacing_xyz, unit, affine).unwrap();
        prop_assert_eq!(&header.dims, &dims_xyz);
        let is_long = dims_xyz.iter().any(|&dim| dim > 32_767);
        prop_assert_eq!(header.version, if is_long { 2 } else { 1 });
        let bytes = header.to_bytes();
        prop_assert_eq!(bytes.len() as u64, header.vox_offset);
        prop_assert_eq!(NiftiHeader::parse(&bytes), Ok(header));
        check(&bytes);
    }
}
