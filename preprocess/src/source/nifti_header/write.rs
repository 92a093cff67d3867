//! Headers for volumes that we write.

use super::layout::{FieldsMut, NIFTI_1, NIFTI_2};
use super::quaternion::Qform;
use super::{NiftiDatatype, NiftiHeader, NiftiHeaderError, NiftiKind, NiftiUnit, check_size};

impl NiftiHeader {
    /// The header of a single-file, little-endian, unscaled volume: NIfTI-1, or NIfTI-2 where a
    /// dimension is above 32,767. Spacing and affine are rounded to the header's floats (32 or 64
    /// bits), so that the result is what a reader gets.
    ///
    /// `spacing_xyz` and the affine's columns are in `unit` a voxel. An affine becomes the sform;
    /// it becomes the qform, too, where it is a rotation of `spacing_xyz`, mirrored or not. Their
    /// codes are then 1 (scanner), else 0.
    ///
    /// # Errors
    /// When a dimension is 0, the volume is larger than any file, a spacing is not a positive
    /// number, or the affine is not made of numbers with 0 0 0 1 in its last row.
    pub fn for_volume(
        dims_xyz: [u64; 3],
        datatype: NiftiDatatype,
        spacing_xyz: [f64; 3],
        unit: NiftiUnit,
        affine: Option<[[f64; 4]; 4]>,
    ) -> Result<Self, NiftiHeaderError> {
        if let Some(axis) = dims_xyz.iter().position(|&dim| dim == 0) {
            return Err(NiftiHeaderError::BadDimension { axis: axis + 1, value: 0 });
        }
        check_size(&dims_xyz, datatype)?;
        let fits_nifti_1 = dims_xyz.iter().all(|&dim| i16::try_from(dim).is_ok());
        let layout = if fits_nifti_1 { &NIFTI_1 } else { &NIFTI_2 };
        let bits = layout.float_bits();

        let stored_spacing_xyz = spacing_xyz.map(|size| layout.stored_float(size));
        if let Some(axis) = stored_spacing_xyz.iter().position(|&s| !(s > 0.0 && s.is_finite())) {
            return Err(NiftiHeaderError::BadSpacing {
                axis: axis + 1,
                value: spacing_xyz[axis],
                bits,
            });
        }
        let [size_x, size_y, size_z] = stored_spacing_xyz;
        let mut header = Self {
            version: layout.version,
            kind: NiftiKind::SingleFile,
            big_endian: false,
            dims: dims_xyz.to_vec(),
            datatype,
            vox_offset: layout.first_voxel_byte(),
            scl_slope: 1.0,
            scl_inter: 0.0,
            pixdim: [1.0, size_x, size_y, size_z, 1.0, 1.0, 1.0, 1.0],
            spatial_unit: unit,
            qform_code: 0,
            sform_code: 0,
            quatern_bcd: [0.0; 3],
            qoffset_xyz: [0.0; 3],
            srow_xyz: [[0.0; 4]; 3],
            description: String::new(),
        };
        let Some(affine) = affine else { return Ok(header) };

        let stored = affine.map(|row| row.map(|value| layout.stored_float(value)));
        for (row, values) in stored.iter().enumerate() {
            for (column, &value) in values.iter().enumerate() {
                let last_row = if column == 3 { 1.0 } else { 0.0 };
                let good = if row == 3 { value == last_row } else { value.is_finite() };
                if !good {
                    let value = affine[row][column];
                    return Err(NiftiHeaderError::BadAffine { row, column, value, bits });
                }
            }
        }
        let [x, y, z, _] = stored;
        header.sform_code = 1;
        header.srow_xyz = [x, y, z];
        if let Some(Qform { bcd, qfac }) = Qform::from_affine([x, y, z], stored_spacing_xyz) {
            header.qform_code = 1;
            header.pixdim[0] = qfac;
            header.quatern_bcd = bcd.map(|value| layout.stored_float(value));
            header.qoffset_xyz = [x[3], y[3], z[3]];
        }
        Ok(header)
    }

    /// The header and the four bytes that say "no extensions": 352 bytes, or 544 for version 2.
    ///
    /// Little-endian whatever `big_endian` says, so the voxels after it must be, too. Parsing gives
    /// the same header again if it came from [`NiftiHeader::parse`] or [`NiftiHeader::for_volume`].
    /// In one changed by hand, a dimension that the version cannot hold becomes 0 and an offset -1,
    /// which [`NiftiHeader::parse`] refuses, and a description ends after 80 bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let layout = if self.version == 2 { &NIFTI_2 } else { &NIFTI_1 };
        let mut fields = FieldsMut::new(layout);
        fields.set_kind(self.kind);
        fields.set_type(self.datatype.code(), self.datatype.bits());
        fields.set_dim(0, self.dims.len() as u64);
        for index in 1..8 {
            fields.set_dim(index, self.dims.get(index - 1).copied().unwrap_or(1));
        }
        fields.set_floats(layout.pixdim, &self.pixdim);
        fields.set_vox_offset(self.vox_offset);
        fields.set_float(layout.scl_slope, self.scl_slope);
        fields.set_float(layout.scl_inter, self.scl_inter);
        fields.set_xyzt_units(self.spatial_unit.code());
        fields.set_description(&self.description);
        fields.set_code(layout.qform_code, self.qform_code);
        fields.set_code(layout.sform_code, self.sform_code);
        fields.set_floats(layout.quatern, &self.quatern_bcd);
        fields.set_floats(layout.qoffset, &self.qoffset_xyz);
        fields.set_floats(layout.srow, self.srow_xyz.as_flattened());
        fields.into_bytes()
    }
}
