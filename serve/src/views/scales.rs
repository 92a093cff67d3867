//! Where a level's voxels lie: the one place that knows of the half voxel.
//!
//! A voxel of level k covers 2^k voxels of level 0 along each axis, so the centre of its first voxel lies
//! (2^k - 1) / 2 voxels of level 0 further in than that of level 0's first.

/// Size of a level's voxels.
pub(crate) fn scale_xyz(spacing_xyz: [f64; 3], level: u8) -> [f64; 3] {
    spacing_xyz.map(|spacing| spacing * 2_f64.powi(i32::from(level)))
}

/// The centre of a level's first voxel, seen from the centre of level 0's first.
pub(crate) fn first_centre_xyz(spacing_xyz: [f64; 3], level: u8) -> [f64; 3] {
    spacing_xyz.map(|spacing| spacing * ((2_f64.powi(i32::from(level)) - 1.0) / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_s_voxel_lies_amid_the_eight_it_was_made_of() {
        let spacing = [0.5, 1.0, 3.25];
        for level in 1..20 {
            for axis in 0..3 {
                let centre = |level: u8, voxel: f64| {
                    first_centre_xyz(spacing, level)[axis] + voxel * scale_xyz(spacing, level)[axis]
                };
                for voxel in [0.0, 1.0, 7.0] {
                    let children = [2.0 * voxel, 2.0 * voxel + 1.0].map(|v| centre(level - 1, v));
                    assert_eq!(centre(level, voxel), f64::midpoint(children[0], children[1]));
                }
            }
        }
    }
}
