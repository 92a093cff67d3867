//! Positions in 32.32 fixed point: a whole voxel, and a fraction in units of 2^-32.
//!
//! Twin of `fixed.wgsl`.

use glam::{BVec3, IVec3, UVec3, Vec3};

const TWO_32: f32 = 4_294_967_296.0;

/// A place, or a distance that is not negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) cell: IVec3,
    pub(super) frac: UVec3,
}

/// What is above a whole number, as a fraction; below 1 even where rounding makes it 1.
fn fraction(v: Vec3, whole: Vec3) -> UVec3 {
    ((v - whole).min(Vec3::splat(0.999_999_94)) * TWO_32).as_uvec3()
}

pub(super) fn place_of(v: Vec3) -> Place {
    let whole = v.floor();
    Place { cell: whole.as_ivec3(), frac: fraction(v, whole) }
}

pub(super) fn plus(a: Place, b: Place) -> Place {
    let frac = a.frac.wrapping_add(b.frac);
    let carry = IVec3::select(frac.cmplt(a.frac), IVec3::ONE, IVec3::ZERO);
    Place { cell: a.cell.wrapping_add(b.cell).wrapping_add(carry), frac }
}

/// The negative, where told.
pub(super) fn signed(a: Place, negative: BVec3) -> Place {
    let carry = IVec3::select(a.frac.cmpeq(UVec3::ZERO), IVec3::ONE, IVec3::ZERO);
    let cell = (!a.cell).wrapping_add(carry);
    let frac = (!a.frac).wrapping_add(UVec3::ONE);
    Place {
        cell: IVec3::select(negative, cell, a.cell),
        frac: UVec3::select(negative, frac, a.frac),
    }
}

/// The upper half of the products of 32-bit numbers.
fn multiply_high(a: u32, b: UVec3) -> UVec3 {
    let (a_low, a_high) = (a & 0xffff, a >> 16);
    let (b_low, b_high) = (b & UVec3::splat(0xffff), b >> 16_u32);
    let low = b_low * a_low;
    let middle = b_high * a_low + (low >> 16_u32);
    let other = b_low * a_high + (middle & UVec3::splat(0xffff));
    b_high * a_high + (middle >> 16_u32) + (other >> 16_u32)
}

pub(super) fn times(a: Place, n: u32) -> Place {
    let whole = a.cell.as_uvec3().wrapping_mul(UVec3::splat(n));
    Place {
        cell: whole.wrapping_add(multiply_high(n, a.frac)).as_ivec3(),
        frac: a.frac.wrapping_mul(UVec3::splat(n)),
    }
}

/// Voxels from a corner to a place.
pub(super) fn relative(a: Place, corner: IVec3) -> Vec3 {
    a.cell.wrapping_sub(corner).as_vec3() + a.frac.as_vec3() * (1.0 / TWO_32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bits(place: Place) -> [i64; 3] {
        [0, 1, 2].map(|i| i64::from(place.cell[i]) << 32 | i64::from(place.frac[i]))
    }

    #[test]
    fn fixed_point_is_64_bit_arithmetic() {
        let numbers = [0.0, 1.0, 0.5, 0.999_999_94, 3.25, 1e-7, 1_048_575.9, 0.333_333_34];
        for a in numbers {
            let place = place_of(Vec3::new(a, a * 0.37, a * 1e-3));
            let expected = [a, a * 0.37, a * 1e-3].map(|v| (f64::from(v) * 2_f64.powi(32)) as i64);
            assert_eq!(bits(place), expected, "{a}");
            for n in [0_u32, 1, 7, 65_535, 65_537, 1 << 20] {
                let product = expected.map(|v| v.wrapping_mul(i64::from(n)));
                assert_eq!(bits(times(place, n)), product, "{a} x {n}");
                let negative = signed(times(place, n), BVec3::new(true, false, true));
                assert_eq!(bits(negative), [-product[0], product[1], -product[2]]);
                let sum = plus(negative, place);
                assert_eq!(bits(sum), [0, 1, 2].map(|i| bits(negative)[i] + expected[i]));
            }
        }
    }

    #[test]
    fn a_place_below_zero_has_a_positive_fraction() {
        let place = place_of(Vec3::new(-0.25, -1e-9, -3.0));
        assert_eq!(place.cell, IVec3::new(-1, -1, -3));
        assert_eq!(place.frac.x, 0xc000_0000);
        assert!(
            (relative(place, IVec3::ZERO) - Vec3::new(-0.25, 0.0, -3.0)).abs().max_element() < 1e-6
        );
    }
}
