//! A volume's NIfTI header.

use crate::error::PreprocessError;
use crate::source::SourceError;
use crate::source::nifti_header::{NiftiDatatype, NiftiHeader, NiftiUnit};
use crate::volume::Volume;
use octree_store::{LengthUnit, SampleType};
use std::path::Path;

/// The header of a volume: little-endian, 352 or 544 bytes.
pub(super) fn header(volume: &Volume, output: &Path) -> Result<Vec<u8>, PreprocessError> {
    let datatype = match volume.sample_type() {
        SampleType::U8 => NiftiDatatype::U8,
        SampleType::I8 => NiftiDatatype::I8,
        SampleType::U16 => NiftiDatatype::U16,
        SampleType::I16 => NiftiDatatype::I16,
        SampleType::U32 => NiftiDatatype::U32,
        SampleType::I32 => NiftiDatatype::I32,
        SampleType::F32 => NiftiDatatype::F32,
        SampleType::F64 => NiftiDatatype::F64,
    };
    // NIfTI has no nanometre: spacing and affine go to micrometres.
    let (unit, scale) = match volume.unit() {
        LengthUnit::M => (NiftiUnit::Metre, 1.0),
        LengthUnit::Mm => (NiftiUnit::Millimetre, 1.0),
        LengthUnit::Um => (NiftiUnit::Micrometre, 1.0),
        LengthUnit::Nm => (NiftiUnit::Micrometre, 1e-3),
    };
    let spacing = volume.spacing_xyz().map(|spacing| spacing * scale);
    let affine = volume.affine().map(|mut affine| {
        affine.iter_mut().take(3).flatten().for_each(|value| *value *= scale);
        affine
    });
    let header = NiftiHeader::for_volume(volume.dims_xyz(), datatype, spacing, unit, affine)
        .map_err(|source| SourceError::NiftiHeader { path: output.to_owned(), source })?;
    Ok(header.to_bytes())
}
