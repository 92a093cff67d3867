//! A volume's NRRD header: <https://teem.sourceforge.net/nrrd/format.html>.
//!
//! An affine becomes the directions and the origin of a right-anterior-superior space; without one the
//! spacing alone is said, so that no reader takes voxels for placed that are not.

use crate::volume::Volume;
use octree_store::{LengthUnit, SampleType};

/// The header, with the empty line that ends it.
pub(super) fn header(volume: &Volume) -> String {
    let sample_type = match volume.sample_type() {
        SampleType::U8 => "uint8",
        SampleType::I8 => "int8",
        SampleType::U16 => "uint16",
        SampleType::I16 => "int16",
        SampleType::U32 => "uint32",
        SampleType::I32 => "int32",
        SampleType::F32 => "float",
        SampleType::F64 => "double",
    };
    let unit = match volume.unit() {
        LengthUnit::M => "m",
        LengthUnit::Mm => "mm",
        LengthUnit::Um => "um",
        LengthUnit::Nm => "nm",
    };
    let sizes = volume.dims_xyz().map(|size| size.to_string()).join(" ");
    let units = [(); 3].map(|()| format!("\"{unit}\"")).join(" ");
    let world = if let Some(affine) = volume.affine() {
        let column = |axis: usize| {
            format!("({})", [0, 1, 2].map(|row: usize| number(affine[row][axis])).join(","))
        };
        format!(
            "space: right-anterior-superior\nsizes: {sizes}\nspace directions: {} {} {}\n\
             kinds: domain domain domain\nspace units: {units}\nspace origin: {}\n",
            column(0),
            column(1),
            column(2),
            column(3)
        )
    } else {
        let spacings = volume.spacing_xyz().map(number).join(" ");
        format!(
            "sizes: {sizes}\nspacings: {spacings}\nkinds: domain domain domain\nunits: {units}\n"
        )
    };
    format!("NRRD0004\ntype: {sample_type}\ndimension: 3\n{world}endian: little\nencoding: raw\n\n")
}

/// The shortest text that reads back as the same number.
fn number(value: f64) -> String {
    format!("{value:?}")
}
