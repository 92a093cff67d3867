//! The shader on a device against its mirror. Without a device these tests say so, and fail where CI is set.

use crate::support::*;
use octree_store::{Encoding, Store};
use render_check::gpu::{AdapterChoice, GpuBackend, Sampling, adapters};
use render_check::picture::Picture;
use render_check::view::{Filter, Look, Mode, Shading};
use render_check::{RenderError, Renderer, RendererOptions};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const DIMS: [u64; 3] = [70, 61, 55];

/// A renderer on the first device there is.
fn on_device(made: &Made, sampling: Sampling) -> Option<Renderer> {
    let store = Store::open(&made.path).unwrap();
    let options = RendererOptions::default();
    let slots = options.slots_for(store.geometry());
    let choice = AdapterChoice { name: std::env::var("OCTAVO_TEST_ADAPTER").ok() };
    match GpuBackend::new(&choice, sampling, store.geometry(), store.metadata(), slots) {
        Ok(backend) => Some(Renderer::new(store, Box::new(backend), &options).unwrap()),
        Err(error) => {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "{error}");
            eprintln!("not tested: {error}");
            None
        }
    }
}

/// Whether a surface ends within a pixel of this one, or lies behind another: its depth jumps, or one of two is missed.
fn at_silhouette(depths: &[f32], [width, height]: [u32; 2], pixel: usize) -> bool {
    let [width, height] = [width as usize, height as usize];
    let [x, y] = [pixel % width, pixel / width];
    let near = (y.saturating_sub(1)..=(y + 1).min(height - 1))
        .flat_map(|y| (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |x| y * width + x));
    let depths: Vec<f32> = near.map(|i| depths[i]).collect();
    let farthest = depths.iter().copied().fold(0.0, f32::max);
    let nearest = depths.iter().copied().fold(f32::MAX, f32::min);
    // A surface that is seen at 45 degrees goes back by one pixel's width a pixel.
    farthest > nearest * 1.05
}

/// The device's picture against the mirror's: at most 2/255 anywhere and 0.1/255 in the mean. Of surfaces, a thousandth
/// of the pixels may differ by more, at silhouettes, where one of the two may miss; they are listed.
fn assert_alike(what: &str, device: &Picture, mirror: &Picture, surface: bool) {
    let (a, b) = (device.over([0.2, 0.3, 0.4]), mirror.over([0.2, 0.3, 0.4]));
    let apart =
        |(p, q): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (p[c] - q[c]).abs()).fold(0.0, f32::max);
    let all: Vec<f32> = a.pixels.iter().zip(&b.pixels).map(apart).collect();
    let far: Vec<usize> = (0..all.len()).filter(|&i| all[i] > 2.0 / 255.0).collect();
    for &i in &far {
        println!("{what}: pixel {i}: {:?} and {:?}", a.pixels[i], b.pixels[i]);
        assert!(
            at_silhouette(&mirror.depths, mirror.size, i),
            "{what}: pixel {i} is at no silhouette"
        );
    }
    let allowed = if surface { all.len() / 1000 } else { 0 };
    assert!(far.len() <= allowed, "{what}: {} pixels differ", far.len());
    let mean = all.iter().sum::<f32>() / all.len() as f32;
    let worst = all.iter().copied().fold(0.0, f32::max);
    println!("{what}: worst {worst:e}, mean {mean:e}");
    assert!(mean <= 0.1 / 255.0, "{what}: mean {mean}");
}

#[test]
fn a_device_gives_up_a_picture_that_nobody_waits_for_and_draws_the_next() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    let Some(mut renderer) = on_device(&made, Sampling::Manual) else { return };
    let [(_, look), _] = looks();
    let view = perspective(&made, [0.3, -0.5, -1.0], 150.0, [96, 80]);
    renderer.stop_on(Arc::new(AtomicBool::new(true)));
    let given_up = renderer.converge(&view, &look, None, None).map(drop);
    assert!(matches!(given_up, Err(RenderError::Stopped)), "{given_up:?}");
    renderer.stop_on(Arc::default());
    assert!(renderer.converge(&view, &look, None, None).unwrap().converged);
}

#[test]
fn the_device_draws_what_its_mirror_draws_in_every_mode() {
    for encoding in [Encoding::Quantised8, Encoding::Lossless] {
        let made = make_u16(DIMS, Folding { encoding, ..Folding::default() }, blob(DIMS));
        let Some(mut renderer) = on_device(&made, Sampling::Manual) else { return };
        for (name, look) in looks() {
            for shading in [None, Some(Shading::default())] {
                for mode in [Mode::Dvr, Mode::Iso(420.0), Mode::Mip] {
                    for (filter, distance) in
                        [(Filter::Trilinear, 150.0), (Filter::Quadrilinear, 400.0)]
                    {
                        let look = Look { mode, shading, filter, ..look.clone() };
                        let view = perspective(&made, [0.3, -0.5, -1.0], distance, [96, 80]);
                        let device = renderer.converge(&view, &look, None, None).unwrap();
                        let mirror = made.mirrored(&view, &look);
                        let what = format!("{encoding:?} {name} {mode:?} {filter:?} {shading:?}");
                        let surface = matches!(mode, Mode::Iso(_));
                        assert_alike(&what, &device.picture, &mirror.picture, surface);
                    }
                }
            }
        }
    }
}

#[test]
fn floats_on_the_device_are_those_of_the_mirror() {
    let shape = blob(DIMS);
    for [low, high] in [[0.0_f32, 1.0], [1e5, 1.01e5], [-3e38, 3e38]] {
        let at = |t: f64| f64::from(low) + t * (f64::from(high) - f64::from(low));
        let made = make_f32(DIMS, Folding::default(), |p| at(f64::from(shape(p)) / 1000.0) as f32);
        let color = [0.9, 0.5, 0.2];
        let transfer =
            transfer(&[(0.15, 0.0), (0.4, 0.1), (1.0, 0.5)].map(|(t, tau)| (at(t), color, tau)));
        let Some(mut renderer) = on_device(&made, Sampling::Manual) else { return };
        for mode in [Mode::Dvr, Mode::Iso(at(0.42)), Mode::Mip] {
            let range = [f64::from(low), f64::from(high)];
            let look = Look { mode, ..Look::new(transfer.clone(), range) };
            let view = perspective(&made, [0.3, -0.5, -1.0], 160.0, [64, 48]);
            let device = renderer.converge(&view, &look, None, None).unwrap();
            let mirror = made.mirrored(&view, &look);
            let surface = matches!(mode, Mode::Iso(_));
            assert_alike(&format!("{low:e} {mode:?}"), &device.picture, &mirror.picture, surface);
        }
    }
}

#[test]
fn texture_units_come_near() {
    for encoding in [Encoding::Quantised8, Encoding::Lossless] {
        let made = make_u16(DIMS, Folding { encoding, ..Folding::default() }, blob(DIMS));
        let Some(mut renderer) = on_device(&made, Sampling::Hardware) else { return };
        for (name, look) in looks() {
            let view = perspective(&made, [0.3, -0.5, -1.0], 150.0, [96, 80]);
            let device = renderer.converge(&view, &look, None, None).unwrap();
            let found = compared(&device.picture, &made.mirrored(&view, &look).picture);
            println!("{encoding:?} {name}: {found:?}");
            assert!(found.reaches(45.0), "{encoding:?} {name}: {found:?}");
        }
    }
}

#[test]
fn a_ray_of_200_000_steps_is_not_cut_short() {
    // Values vary from voxel to voxel, so that no brick is uniform; extinction does not.
    let made =
        make_u16([64, 8, 8], Folding::default(), |[x, y, z]| ((x * 7 + y * 3 + z) % 90) as u16);
    let Some(mut renderer) = on_device(&made, Sampling::Manual) else { return };
    let constant = transfer(&[(0.0, [1.0; 3], 2.0 / 64.0)]);
    let look = Look {
        step_voxels: 64.0 / 200_000.0,
        filter: Filter::Trilinear,
        ..Look::new(constant, [0.0, 90.0])
    };
    let view = orthographic(&made, [-1.0, 0.0, 0.0], 4.0, [8, 8]);
    let device = renderer.converge(&view, &look, None, None).unwrap();
    for color in &device.picture.colors {
        let expected = -f32::exp_m1(-2.0);
        assert!((color[3] - expected).abs() < 2e-3, "{} {expected}", color[3]);
    }
}

#[test]
fn a_slab_on_the_device_leaves_exp_of_minus_its_depth() {
    let made =
        make_u16([64, 8, 8], Folding::default(), |[x, y, z]| ((x * 7 + y * 3 + z) % 90) as u16);
    let Some(mut renderer) = on_device(&made, Sampling::Manual) else { return };
    for depth in [1e-7, 1e-5, 1e-3, 0.1, 1.0, 5.0, 30.0, 1e3_f64] {
        let constant = transfer(&[(0.0, [0.5, 1.0, 0.25], depth / 64.0)]);
        let look = Look { filter: Filter::Trilinear, ..Look::new(constant, [0.0, 90.0]) };
        let view = orthographic(&made, [-1.0, 0.0, 0.0], 4.0, [8, 8]);
        let device = renderer.converge(&view, &look, None, None).unwrap();
        let expected = -f64::exp_m1(-depth);
        for color in &device.picture.colors {
            // A ray ends where less than 1e-4 of the light is left.
            let bound = if depth > 9.0 { 1.1e-4 } else { 1e-5 * expected };
            let alpha = f64::from(color[3]);
            assert!((alpha - expected).abs() <= bound, "{depth}: {alpha} {expected}");
        }
    }
}

#[test]
fn halving_the_step_divides_the_error_on_the_device_by_four() {
    let (made, view, look) = wave();
    if on_device(&made, Sampling::Manual).is_none() {
        return;
    }
    let errors = convergence(|step_voxels| {
        let look = Look { step_voxels, ..look.clone() };
        let mut renderer = on_device(&made, Sampling::Manual).unwrap();
        renderer.converge(&view, &look, None, None).unwrap().picture
    });
    println!("{errors:?}");
    assert_second_order(&errors);
}

#[test]
fn a_homogeneous_cube_looks_the_same_from_six_sides_on_the_device() {
    let made = make_u16([32; 3], Folding::default(), |[x, y, z]| ((x * 7 + y * 3 + z) % 90) as u16);
    let constant = transfer(&[(0.0, [0.5, 1.0, 0.25], 0.05)]);
    let look = Look { step_voxels: 0.3, ..Look::new(constant, [0.0, 90.0]) };
    for sampling in [Sampling::Manual, Sampling::Hardware] {
        let Some(mut renderer) = on_device(&made, sampling) else { return };
        let pictures = SIX_SIDES.map(|direction| {
            let view = orthographic(&made, direction, 30.0, [31, 31]);
            renderer.converge(&view, &look, None, None).unwrap().picture
        });
        for (picture, direction) in pictures.iter().zip(SIX_SIDES).skip(1) {
            let found = compared(&pictures[0], picture);
            assert!(found.max_abs_diff < 2e-6, "{sampling:?} {direction:?}: {found:?}");
        }
    }
}

#[test]
fn a_picture_does_not_depend_on_the_order_of_slots() {
    let made = make_u16([80; 3], Folding::default(), blob([80; 3]));
    let [(_, opaque), (_, transparent)] = looks();
    let last = perspective(&made, [0.5, -0.4, -1.0], 150.0, [96, 80]);
    for look in [opaque, transparent] {
        let Some(mut fresh) = on_device(&made, Sampling::Manual) else { return };
        let fresh = fresh.converge(&last, &look, None, None).unwrap().picture;
        for first in SIX_SIDES {
            // Each comes from elsewhere, so that bricks lie in other slots.
            let Some(mut renderer) = on_device(&made, Sampling::Manual) else { return };
            let view = perspective(&made, first, 90.0, [96, 80]);
            renderer.converge(&view, &look, None, None).unwrap();
            let came = renderer.converge(&last, &look, None, None).unwrap().picture;
            let found = compared(&fresh, &came);
            assert!(found.max_abs_diff < 1e-5, "{first:?}: {found:?}");
        }
    }
}

#[test]
fn rays_end_where_a_depth_image_says() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    let Some(mut renderer) = on_device(&made, Sampling::Manual) else { return };
    let [_, (_, look)] = looks();
    let view = perspective(&made, [0.0, 0.0, -1.0], 150.0, [40, 32]);
    let ends: Vec<f32> = (0..40 * 32).map(|i| if i % 2 == 0 { 150.0 } else { 10.0 }).collect();
    let device = renderer.converge(&view, &look, Some(&ends), None).unwrap().picture;
    let mut mirror = made.renderer(&RendererOptions::default());
    let mirror = mirror.converge(&view, &look, Some(&ends), None).unwrap().picture;
    assert_alike("ends", &device, &mirror, false);
    let whole = made.mirrored(&view, &look).picture;
    for i in 0..ends.len() {
        if i % 2 == 1 {
            assert_eq!(device.colors[i], [0.0; 4]);
        } else {
            assert!(device.colors[i][3] <= whole.colors[i][3] + 1e-5);
        }
    }
    let middle = 16 * 40 + 20;
    assert!(device.colors[middle][3] < 0.8 * whole.colors[middle][3]);
}

#[test]
fn an_adapter_that_is_not_there_is_said_to_be_so_with_what_to_install() {
    let made = make_u8([8; 3], Folding::default(), |_| 3);
    let store = Store::open(&made.path).unwrap();
    let choice = AdapterChoice { name: Some("no such adapter".to_owned()) };
    let (geometry, metadata) = (store.geometry(), store.metadata());
    let error = GpuBackend::new(&choice, Sampling::Manual, geometry, metadata, 9).unwrap_err();
    assert!(matches!(error, RenderError::NoAdapter { .. }));
    assert!(error.to_string().contains("mesa-vulkan-drivers"), "{error}");
    println!("{:?}", adapters());
}

/// Bytes of memory that this process has.
fn memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() << 10
}

/// Lit and unlit, on and on: a driver that compiled something for each frame kept 1.3 MB of each.
#[test]
fn frame_after_frame_takes_no_more_memory() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    let Some(mut renderer) = on_device(&made, Sampling::Hardware) else { return };
    for shading in [None, Some(Shading::default())] {
        let (_, look) = looks().into_iter().next().unwrap();
        let look = Look { shading, ..look };
        let mut draw = |frames: u8| {
            for frame in 0..frames {
                let from = [0.3, -0.5, -1.0 - f64::from(frame) / 100.0];
                let view = perspective(&made, from, 150.0, [24, 16]);
                renderer.converge(&view, &look, None, None).unwrap();
            }
        };
        draw(10);
        let before = memory();
        draw(60);
        let grown = memory().saturating_sub(before);
        assert!(grown < 16 << 20, "{grown} bytes more after 60 frames, {shading:?}");
    }
}
