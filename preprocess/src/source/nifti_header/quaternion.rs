//! The qform: a rotation as a unit quaternion (a, b, c, d) of which b, c, d are stored and a >= 0
//! is worked out; voxel sizes and handedness come from `pixdim`.
//!
//! Source: "METHOD 2" and "QUATERNION REPRESENTATION OF ROTATION MATRIX" in `nifti1.h`; where (b,
//! c, d) is as long as 1 or longer, the repair of `nifti_clib` (`nifti_quatern_to_dmat44`).

use std::array::from_fn;

/// How far scalar products of an affine's directions may be from 0 and 1 for a rotation. Affines
/// often pass through 32-bit floats and texts of four decimals.
const ORTHONORMAL_TOLERANCE: f64 = 1e-4;

/// A rotation and a handedness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Qform {
    /// `quatern_b`, `quatern_c`, `quatern_d`.
    pub(super) bcd: [f64; 3],
    /// `pixdim[0]`: -1 where the third axis is flipped, else 1.
    pub(super) qfac: f64,
}

impl Qform {
    /// The qform that says the same as an affine (rows of voxel index to world position) whose
    /// voxels have the given size; `None` where the affine shears, or has other voxel sizes.
    pub(super) fn from_affine(rows: [[f64; 4]; 3], spacing_xyz: [f64; 3]) -> Option<Self> {
        let mut directions: [[f64; 3]; 3] =
            from_fn(|axis| rows.map(|row| row[axis] / spacing_xyz[axis]));
        let orthonormal = (0..3).all(|i| {
            (0..=i).all(|j| {
                let expected = if i == j { 1.0 } else { 0.0 };
                (dot(directions[i], directions[j]) - expected).abs() <= ORTHONORMAL_TOLERANCE
            })
        });
        if !orthonormal {
            return None;
        }
        let [x, y, z] = directions;
        let cross =
            [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        let qfac = if dot(cross, z) < 0.0 { -1.0 } else { 1.0 };
        directions[2] = z.map(|value| value * qfac);
        Some(Self { bcd: bcd_from_directions(directions), qfac })
    }
}

/// The first three rows of voxel index to world position.
pub(super) fn qform_rows(
    bcd: [f64; 3],
    offset_xyz: [f64; 3],
    spacing_xyz: [f64; 3],
    flip_z: bool,
) -> [[f64; 4]; 3] {
    let [size_x, size_y, size_z] = spacing_xyz;
    let sizes = [size_x, size_y, if flip_z { -size_z } else { size_z }];
    let rotation = rotation_from_bcd(bcd);
    from_fn(|row| {
        let [x, y, z] = from_fn(|column| rotation[row][column] * sizes[column]);
        [x, y, z, offset_xyz[row]]
    })
}

/// Rows of the rotation matrix.
fn rotation_from_bcd([b, c, d]: [f64; 3]) -> [[f64; 3]; 3] {
    let a_squared = 1.0 - (b * b + c * c + d * d);
    // Below that `a` would be made of rounding errors: a turn by 180 degrees is meant.
    let (a, b, c, d) = if a_squared < 1e-7 {
        let length = b.hypot(c).hypot(d);
        (0.0, b / length, c / length, d / length)
    } else {
        (a_squared.sqrt(), b, c, d)
    };
    [
        [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
        [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
        [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c],
    ]
}

/// Shepperd's method: 4 q (a, b, c, d) for the largest component q is free of cancellation.
fn bcd_from_directions([x, y, z]: [[f64; 3]; 3]) -> [f64; 3] {
    let four_squares = [
        1.0 + x[0] + y[1] + z[2],
        1.0 + x[0] - y[1] - z[2],
        1.0 - x[0] + y[1] - z[2],
        1.0 - x[0] - y[1] + z[2],
    ];
    let (four_ab, four_ac, four_ad) = (y[2] - z[1], z[0] - x[2], x[1] - y[0]);
    let (four_bc, four_bd, four_cd) = (x[1] + y[0], x[2] + z[0], y[2] + z[1]);
    let largest = (1..4).fold(0, |at, i| if four_squares[i] > four_squares[at] { i } else { at });
    let [a, b, c, d] = match largest {
        0 => [four_squares[0], four_ab, four_ac, four_ad],
        1 => [four_ab, four_squares[1], four_bc, four_bd],
        2 => [four_ac, four_bc, four_squares[2], four_cd],
        _ => [four_ad, four_bd, four_cd, four_squares[3]],
    };
    let length = (a * a + b * b + c * c + d * d).sqrt();
    let signed_length = if a < 0.0 { -length } else { length };
    [b, c, d].map(|value| value / signed_length)
}

fn dot(u: [f64; 3], v: [f64; 3]) -> f64 {
    u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn assert_near(found: [[f64; 4]; 3], expected: [[f64; 4]; 3], tolerance: f64) {
        for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
        }
    }

    /// Rows of Rz(30°) Rx(-20°) Ry(75°) diag(0.5, 0.75, 2), worked out with numpy.
    const OBLIQUE: [[f64; 4]; 3] = [
        [0.194_663_456_408_344_7, -0.352_384_732_794_715_6, 1.584_511_280_574_239, -90.0],
        [-0.078_347_951_773_701_69, 0.610_348_261_012_030_3, 1.119_249_262_035_666_7, 12.5],
        [-0.453_836_685_595_184_36, -0.256_515_107_494_251_55, 0.486_420_693_603_387_9, 4.0],
    ];
    const OBLIQUE_SIZES: [f64; 3] = [0.5, 0.75, 2.0];
    /// nibabel 5.4.2: `Nifti2Header().set_qform(OBLIQUE, 1)`.
    const OBLIQUE_BCD: [f64; 3] =
        [-0.288_235_530_714_735_84, 0.543_429_025_202_691_5, 0.100_107_133_406_704_25];

    fn mirrored(rows: [[f64; 4]; 3]) -> [[f64; 4]; 3] {
        rows.map(|[x, y, z, t]| [x, y, -z, t])
    }

    #[test]
    fn an_oblique_affine_has_nibabels_quaternion() {
        for (rows, qfac) in [(OBLIQUE, 1.0), (mirrored(OBLIQUE), -1.0)] {
            let qform = Qform::from_affine(rows, OBLIQUE_SIZES).unwrap();
            assert_eq!(qform.qfac, qfac);
            for (found, expected) in qform.bcd.iter().zip(OBLIQUE_BCD) {
                assert!((found - expected).abs() < 1e-14, "{found} is not {expected}");
            }
            let again = qform_rows(qform.bcd, [-90.0, 12.5, 4.0], OBLIQUE_SIZES, qfac < 0.0);
            assert_near(again, rows, 1e-14);
        }
    }

    /// nibabel 5.4.2: `get_qform()` of a `Nifti2Header` with these fields.
    #[test]
    fn quaternions_turn_as_in_nibabel() {
        let oblique = qform_rows([0.1, -0.2, 0.3], [-10.0, 20.25, 3.5], [0.5, 0.75, 2.5], false);
        let expected = [
            [0.37, -0.447_312_832_297_306_7, -0.777_361_849_549_570_4, -10.0],
            [0.258_208_554_864_871_1, 0.6, -0.763_680_924_774_785_2, 20.25],
            [0.215_472_369_909_914_09, 0.049_104_277_432_435_56, 2.25, 3.5],
        ];
        assert_near(oblique, expected, 1e-15);
        let axes = qform_rows([0.5, 0.5, -0.5], [1.0, 2.0, 3.0], [2.0, 3.0, 4.0], true);
        assert_eq!(axes, [[0.0, 3.0, 0.0, 1.0], [0.0, 0.0, 4.0, 2.0], [-2.0, 0.0, 0.0, 3.0]]);
        let half_turn = qform_rows([0.6, 0.8, 0.0], [0.0; 3], [1.0, 2.0, 3.0], false);
        let expected = [[-0.28, 1.92, 0.0, 0.0], [0.96, 0.56, 0.0, 0.0], [0.0, 0.0, -3.0, 0.0]];
        assert_near(half_turn, expected, 1e-15);
    }

    #[test]
    fn a_quaternion_that_is_too_long_is_a_half_turn_about_its_axis() {
        let expected = [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]];
        for b in [1.0, 1.000_001, 3.0, 1e200] {
            assert_eq!(qform_rows([b, 0.0, 0.0], [0.0; 3], [1.0; 3], false), expected, "{b}");
        }
    }

    #[test]
    fn a_turn_just_short_of_a_half_turn_is_kept() {
        let a = 0.001_f64;
        let b = (1.0 - a * a).sqrt();
        let sine = 2.0 * a * b;
        let expected =
            [[1.0, 0.0, 0.0], [0.0, 2.0 * a * a - 1.0, -sine], [0.0, sine, 2.0 * a * a - 1.0]];
        let rows = expected.map(|[x, y, z]| [x, y, z, 0.0]);
        assert_near(qform_rows([b, 0.0, 0.0], [0.0; 3], [1.0; 3], false), rows, 1e-12);
    }

    #[test]
    fn shears_and_other_sizes_are_no_qform() {
        let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let expected = Qform { bcd: [0.0; 3], qfac: 1.0 };
        assert_eq!(Qform::from_affine(identity, [1.0; 3]), Some(expected));
        assert_eq!(Qform::from_affine(identity, [1.0, 1.0, 1.001]), None);
        let mut sheared = identity;
        sheared[0][1] = 0.001;
        assert_eq!(Qform::from_affine(sheared, [1.0; 3]), None);
        assert_eq!(Qform::from_affine([[0.0; 4]; 3], [1.0; 3]), None);
    }

    proptest! {
        #[test]
        fn an_affine_comes_back_from_its_quaternion(
            quaternion in prop::array::uniform4(-1.0_f64..1.0),
            sizes in prop::array::uniform3(0.01_f64..100.0),
            offset in prop::array::uniform3(-1e3_f64..1e3),
            flip in any::<bool>(),
        ) {
            let length = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
            prop_assume!(length > 0.1);
            let [a, b, c, d] = quaternion.map(|q| q / length);
            let bcd = if a < 0.0 { [-b, -c, -d] } else { [b, c, d] };
            let rows = qform_rows(bcd, offset, sizes, flip);
            let qform = Qform::from_affine(rows, sizes).unwrap();
            prop_assert_eq!(qform.qfac, if flip { -1.0 } else { 1.0 });
            // Near a half turn `a` is the root of a small difference, or taken for 0.
            let tolerance = if a.abs() > 0.01 { 1e-9 } else { 1e-3 };
            for (again, row) in qform_rows(qform.bcd, offset, sizes, flip).iter().zip(rows) {
                prop_assert_eq!(again[3], row[3]);
                for axis in 0..3 {
                    prop_assert!((again[axis] - row[axis]).abs() <= tolerance * sizes[axis]);
                }
            }
        }
    }
}
