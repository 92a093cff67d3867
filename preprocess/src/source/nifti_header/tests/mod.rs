//! Headers built byte by byte by the standards' tables (offsets written out again here), against
//! the `nifti` crate, against nibabel 5.4.2's numbers, and against their own writer.

mod laws;
mod reading;
mod refusals;
mod writing;

use super::*;

/// A header whose fields are set by the standard's offsets, in either byte order.
#[derive(Debug, Clone)]
struct Bytes {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Bytes {
    fn put<const N: usize>(mut self, at: usize, mut little: [u8; N]) -> Self {
        if self.big_endian {
            little.reverse();
        }
        self.bytes[at..at + N].copy_from_slice(&little);
        self
    }

    fn i16s(self, at: usize, values: &[i16]) -> Self {
        let put = |bytes: Self, (i, v): (usize, &i16)| bytes.put(at + 2 * i, v.to_le_bytes());
        values.iter().enumerate().fold(self, put)
    }

    fn i64s(self, at: usize, values: &[i64]) -> Self {
        let put = |bytes: Self, (i, v): (usize, &i64)| bytes.put(at + 8 * i, v.to_le_bytes());
        values.iter().enumerate().fold(self, put)
    }

    fn f32s(self, at: usize, values: &[f32]) -> Self {
        let put = |bytes: Self, (i, v): (usize, &f32)| bytes.put(at + 4 * i, v.to_le_bytes());
        values.iter().enumerate().fold(self, put)
    }

    fn f64s(self, at: usize, values: &[f64]) -> Self {
        let put = |bytes: Self, (i, v): (usize, &f64)| bytes.put(at + 8 * i, v.to_le_bytes());
        values.iter().enumerate().fold(self, put)
    }

    fn text(mut self, at: usize, text: &[u8]) -> Self {
        self.bytes[at..at + text.len()].copy_from_slice(text);
        self
    }

    fn parse(&self) -> Result<NiftiHeader, NiftiHeaderError> {
        NiftiHeader::parse(&self.bytes)
    }
}

/// The fields of nibabel's `example4d.nii.gz` that are read here: an oblique time series.
fn nifti_1(big_endian: bool) -> Bytes {
    Bytes { bytes: vec![0; 352], big_endian }
        .put(0, 348_i32.to_le_bytes())
        .i16s(40, &[4, 128, 96, 24, 2, 1, 1, 1])
        .i16s(70, &[4, 16])
        .f32s(76, &[-1.0, 2.0, 2.0, 2.199_999, 2000.0, 1.0, 1.0, 1.0])
        .f32s(108, &[416.0, 1.0, 0.0])
        .put(123, [10])
        .text(148, b"FSL3.3\0 v2.25")
        .i16s(252, &[1, 1])
        .f32s(256, &[-1.945_106_8e-26, -0.996_708_5, -0.081_068_74])
        .f32s(268, &[117.855_1, -35.722_942, -7.248_798_4])
        .f32s(280, &[-2.0, 6.714_715_7e-19, 9.081_024_5e-18, 117.855_1])
        .f32s(296, &[-6.714_715_7e-19, 1.973_711_5, -0.355_528_24, -35.722_942])
        .f32s(312, &[8.255_481e-18, 0.323_207_62, 2.171_081_8, -7.248_798_4])
        .text(344, b"n+1\0")
}

fn nifti_2(big_endian: bool) -> Bytes {
    Bytes { bytes: vec![0; 544], big_endian }
        .put(0, 540_i32.to_le_bytes())
        .text(4, b"n+2\0\r\n\x1a\n")
        .i16s(12, &[768, 32])
        .i64s(16, &[3, 70_000, 40_000, 9, 1, 1, 1, 1])
        .f64s(104, &[1.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0])
        .i64s(168, &[5_000_000_016])
        .f64s(176, &[0.1, -1024.0])
        .text(240, b"micrographs")
        .put(344, 100_000_i32.to_le_bytes())
        .put(348, 2_i32.to_le_bytes())
        .f64s(352, &[0.1, -0.2, 0.3, -10.0, 20.25, 3.5])
        .f64s(400, &[1.1, 1.2, 1.3, 1.4, 2.1, 2.2, 2.3, 2.4, 3.1, 3.2, 3.3, 3.4])
        .put(500, 3_i32.to_le_bytes())
}

fn analyze(big_endian: bool) -> Bytes {
    let header = nifti_1(big_endian);
    header.f32s(108, &[0.0]).text(344, &[0; 4])
}

/// Compares a NIfTI-1 header with the same bytes as the `nifti` crate reads them.
fn assert_same_as_crate(header: &NiftiHeader, bytes: &[u8]) {
    let oracle = nifti::NiftiHeader::from_reader(bytes).unwrap();
    let dims: Vec<u64> = oracle.dim().unwrap().iter().map(|&dim| u64::from(dim)).collect();
    assert_eq!(header.dims, dims);
    assert_eq!(header.big_endian, oracle.endianness == nifti::Endianness::Big);
    assert_eq!(header.datatype.code(), oracle.datatype);
    assert_eq!(header.datatype.bits(), oracle.bitpix);
    let first = if header.kind == NiftiKind::SingleFile { 352 } else { 0 };
    assert_eq!(header.vox_offset, (oracle.vox_offset as u64).max(first));
    let same = |ours: &[f64], theirs: &[f32]| {
        let theirs: Vec<f64> = theirs.iter().map(|&value| f64::from(value)).collect();
        // As text, so that a NaN equals itself.
        assert_eq!(format!("{ours:?}"), format!("{theirs:?}"));
    };
    same(&[header.scl_slope, header.scl_inter], &[oracle.scl_slope, oracle.scl_inter]);
    same(&header.pixdim, &oracle.pixdim);
    same(&header.quatern_bcd, &[oracle.quatern_b, oracle.quatern_c, oracle.quatern_d]);
    same(&header.qoffset_xyz, &[oracle.quatern_x, oracle.quatern_y, oracle.quatern_z]);
    let srows = [oracle.srow_x, oracle.srow_y, oracle.srow_z];
    same(header.srow_xyz.as_flattened(), srows.as_flattened());
    assert_eq!(
        (header.qform_code, header.sform_code),
        (i32::from(oracle.qform_code), i32::from(oracle.sform_code))
    );
    let unit = match oracle.xyzt_units & 7 {
        1 => NiftiUnit::Metre,
        2 => NiftiUnit::Millimetre,
        3 => NiftiUnit::Micrometre,
        _ => NiftiUnit::Unknown,
    };
    assert_eq!(header.spatial_unit, unit);
    let text: Vec<u8> = oracle.descrip.into_iter().take_while(|&byte| byte != 0).collect();
    assert_eq!(header.description, String::from_utf8_lossy(&text));
}
