//! Phantoms whose right answer is a formula: every voxel is compared with it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use data_samples::{Kind, Phantom, PhantomError, Sample, SampleType};

fn places(dims_xyz: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let [nx, ny, nz] = dims_xyz;
    (0..nx * ny * nz).map(move |i| [i % nx, i / nx % ny, i / nx / ny])
}

fn check_ramp<T: Sample + PartialEq + std::fmt::Debug>(slope_xyz: [f64; 3]) {
    let dims = [37, 23, 19];
    let (min, max) = T::TYPE.range();
    let volume = Phantom::new(Kind::Ramp { slope_xyz }, dims).unwrap().volume::<T>();
    for ([x, y, z], got) in places(dims).zip(volume) {
        let [a, b, c] = slope_xyz;
        let exact = (a * x as f64 + b * y as f64 + c * z as f64).max(min).min(max);
        let rounded = if T::TYPE == SampleType::F32 { exact } else { (exact + 0.5).floor() };
        assert_eq!(got, T::from_f64(rounded), "{slope_xyz:?} at {x} {y} {z}");
    }
}

#[test]
fn a_ramp_is_its_formula_clamped_to_the_type() {
    for slope in [[1.0, 1.0, 1.0], [3.0, 5.0, 7.0], [-2.0, 0.25, 11.5], [9000.0, 0.0, -4000.0]] {
        check_ramp::<u8>(slope);
        check_ramp::<u16>(slope);
        check_ramp::<f32>(slope);
    }
}

#[test]
fn a_ramp_tells_the_axes_apart() {
    let phantom =
        Phantom::new(Kind::Ramp { slope_xyz: [1.0, 100.0, 10_000.0] }, [9, 8, 6]).unwrap();
    let volume = phantom.volume::<u16>();
    assert_eq!(volume[3 + 9 * (7 + 8 * 5)], 50_703);
    assert_eq!(phantom.voxel::<u16>(3, 7, 5), Some(50_703));
    assert_eq!(phantom.voxel::<u16>(9, 7, 5), None);
}

#[test]
fn a_spheres_volume_is_within_a_percent_of_the_formula() {
    for (dims, radius_voxels) in [([64, 64, 64], 25.0), ([91, 70, 80], 30.3), ([50, 51, 52], 20.5)]
    {
        let kind = Kind::Sphere { radius_voxels, inside: 200.0, outside: 20.0 };
        let volume = Phantom::new(kind, dims).unwrap().volume::<u8>();
        let (inside, outside): (Vec<u8>, Vec<u8>) = volume.iter().partition(|&&v| v == 200);
        assert!(outside.iter().all(|&v| v == 20));
        let inside = inside.len();
        let exact = 4.0 / 3.0 * std::f64::consts::PI * radius_voxels.powi(3);
        assert!((inside as f64 / exact - 1.0).abs() < 0.01, "{inside} voxels for {exact}");
    }
}

#[test]
fn a_sphere_is_the_same_from_every_side() {
    let kind = Kind::Sphere { radius_voxels: 9.7, inside: 1.0, outside: 0.0 };
    let dims = [24, 25, 30];
    let volume = Phantom::new(kind, dims).unwrap().volume::<u8>();
    assert!(volume.iter().eq(volume.iter().rev()), "a point reflection changes it");
    let centre: f64 = places(dims).zip(&volume).map(|(at, &v)| at[0] as f64 * f64::from(v)).sum();
    let inside: f64 = volume.iter().map(|&v| f64::from(v)).sum();
    assert_eq!(centre / inside, 11.5);
}

#[test]
fn exactly_one_voxel_is_hot() {
    let dims = [20, 10, 7];
    for (at_xyz, expected) in [(None, [10, 5, 3]), (Some([19, 0, 6]), [19, 0, 6])] {
        let kind = Kind::HotVoxel { at_xyz, hot: 60_000.0, background: 7.0 };
        let volume = Phantom::new(kind, dims).unwrap().volume::<u16>();
        for (at, got) in places(dims).zip(volume) {
            assert_eq!(got, if at == expected { 60_000 } else { 7 }, "{at:?}");
        }
    }
}

#[test]
fn a_constant_is_constant() {
    let volume = Phantom::new(Kind::Constant { value: 0.1 }, [5, 6, 7]).unwrap().volume::<f32>();
    assert_eq!(volume, [0.1_f32; 210]);
}

#[test]
fn a_senseless_recipe_is_refused() {
    let new = |kind, dims| Phantom::new(kind, dims).map(|_| ()).unwrap_err();
    let constant = Kind::Constant { value: 1.0 };
    assert_eq!(new(constant.clone(), [4, 0, 4]), PhantomError::EmptyAxis { dims_xyz: [4, 0, 4] });
    let dims_xyz = [1 << 30, 1 << 30, 8];
    assert_eq!(new(constant, dims_xyz), PhantomError::TooLarge { dims_xyz });
    let hot = Kind::HotVoxel { at_xyz: Some([0, 0, 4]), hot: 1.0, background: 0.0 };
    assert!(matches!(new(hot, [4; 3]), PhantomError::HotVoxelOutside { .. }));
    for sigma in [-1.0, f64::NAN, f64::INFINITY] {
        let kind = Kind::MicroCt { seed: 0, noise_sigma: sigma };
        assert!(matches!(new(kind, [4; 3]), PhantomError::BadParameter { .. }), "{sigma}");
    }
    let radius = Kind::Sphere { radius_voxels: -1.0, inside: 1.0, outside: 0.0 };
    assert!(matches!(new(radius, [4; 3]), PhantomError::BadParameter { .. }));
    let ramp = Kind::Ramp { slope_xyz: [0.0, f64::NAN, 0.0] };
    assert!(matches!(new(ramp, [4; 3]), PhantomError::BadParameter { .. }));
}

#[test]
fn a_row_or_slice_that_is_not_there_is_refused() {
    let phantom = Phantom::new(Kind::micro_ct(1), [8, 6, 4]).unwrap();
    let outside = |axis, index, count| Err(PhantomError::Outside { axis, index, count });
    assert_eq!(phantom.slice::<u16>(4, &mut [0; 48]), outside("z", 4, 4));
    assert_eq!(phantom.row::<u16>(6, 0, &mut [0; 8]), outside("y", 6, 6));
    let length = |expected, found| Err(PhantomError::BufferLength { expected, found });
    assert_eq!(phantom.slice::<u16>(0, &mut [0; 47]), length(48, 47));
    assert_eq!(phantom.row::<u16>(0, 0, &mut [0; 9]), length(8, 9));
}
