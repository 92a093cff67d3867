//! World positions as other formats have them, brought to the one convention of Octavo's affines: RAS, as
//! in NIfTI, where x grows to the right of a patient, y to the front and z to the head. DICOM and ITK
//! count x to the left and y to the back (LPS).

use octree_store::LengthUnit;

/// Size, unit and place of a volume's voxels, as far as its header says them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct World {
    pub(super) spacing_xyz: [f64; 3],
    pub(super) unit: LengthUnit,
    /// Right-anterior-superior.
    pub(super) affine: Option<[[f64; 4]; 4]>,
    /// What the user should know.
    pub(super) notes: Vec<String>,
}

/// The identity but for columns: voxel axes in world units a voxel, and the first voxel's centre.
pub(super) fn affine(axes: [[f64; 3]; 3], origin: [f64; 3]) -> [[f64; 4]; 4] {
    let row = |i: usize| [axes[0][i], axes[1][i], axes[2][i], origin[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Mirrors the world's axes where `flipped` says so.
pub(super) fn mirrored(affine: [[f64; 4]; 4], flipped: [bool; 3]) -> [[f64; 4]; 4] {
    let mut mirrored = affine;
    for (row, _) in mirrored.iter_mut().zip(flipped).filter(|(_, flip)| *flip) {
        // Not `-v`: there is no use in -0.
        *row = row.map(|v| 0.0 - v);
    }
    mirrored
}

/// From left-posterior-superior to right-anterior-superior.
pub(super) fn ras_from_lps(affine: [[f64; 4]; 4]) -> [[f64; 4]; 4] {
    mirrored(affine, [true, true, false])
}

/// An affine of which every number is one.
pub(super) fn finite(affine: [[f64; 4]; 4]) -> Option<[[f64; 4]; 4]> {
    affine.iter().flatten().all(|v| v.is_finite()).then_some(affine)
}

/// A vector's length.
pub(super) fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// The vector that is normal to both.
pub(super) fn cross([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

/// A unit of length by one of its names, and how many of the unit that stores know make one of it.
pub(super) fn length_unit(name: &str) -> Option<(LengthUnit, f64)> {
    let name = name.trim().to_lowercase();
    let unit = match name.as_str() {
        "m" | "meter" | "meters" | "metre" | "metres" => LengthUnit::M,
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => LengthUnit::Mm,
        "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => {
            return Some((LengthUnit::Mm, 10.0));
        }
        "um" | "\u{b5}m" | "\u{3bc}m" | "micron" | "microns" | "micrometer" | "micrometers"
        | "micrometre" | "micrometres" => LengthUnit::Um,
        "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => LengthUnit::Nm,
        _ => return None,
    };
    Some((unit, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn left_and_posterior_change_their_signs() {
        let lps = affine([[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]], [10.0, -20.0, 30.0]);
        let ras = [
            [-2.0, 0.0, 0.0, -10.0],
            [0.0, -3.0, 0.0, 20.0],
            [0.0, 0.0, 4.0, 30.0],
            [0.0, 0.0, 0.0, 1.0],
        ];
        assert_eq!(ras_from_lps(lps), ras);
        assert!(ras_from_lps(lps).iter().flatten().all(|v| *v != 0.0 || v.is_sign_positive()));
        assert_eq!(ras_from_lps(ras), lps);
    }

    #[test]
    fn units_go_by_many_names() {
        for (name, unit) in [
            ("mm", (LengthUnit::Mm, 1.0)),
            ("Micron", (LengthUnit::Um, 1.0)),
            ("\u{b5}m", (LengthUnit::Um, 1.0)),
            ("cm", (LengthUnit::Mm, 10.0)),
        ] {
            assert_eq!(length_unit(name), Some(unit), "{name}");
        }
        assert_eq!(length_unit("furlong"), None);
    }
}
