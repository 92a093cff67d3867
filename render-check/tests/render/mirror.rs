//! The mirror of the shader, over a store's bricks, against the reference over the source.

use crate::support::*;
use octree_store::Encoding;
use render_check::view::{Look, Mode, Shading};
use render_check::{RenderError, RendererOptions};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const DIMS: [u64; 3] = [70, 61, 55];

#[test]
fn a_lossless_store_looks_like_its_source() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    for (name, look) in looks() {
        for shading in [None, Some(Shading::default())] {
            for mode in [Mode::Dvr, Mode::Iso(420.0), Mode::Mip] {
                let look = Look { mode, shading, accuracy: 0.5, ..look.clone() };
                for direction in [[0.3, -0.5, -1.0], [1.0, 0.2, 0.3]] {
                    let view = perspective(&made, direction, 160.0, [96, 80]);
                    let rendered = made.mirrored(&view, &look);
                    assert!(rendered.problems.is_empty() && !rendered.limited);
                    let found = compared(&rendered.picture, &made.reference(&view, &look));
                    println!("{name} {mode:?} shaded {} {found:?}", shading.is_some());
                    assert!(
                        found.reaches(60.0),
                        "{name} {mode:?} {shading:?} {direction:?}: {found:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_picture_that_nobody_waits_for_is_given_up_and_the_next_is_drawn() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    let [(_, look), _] = looks();
    let view = perspective(&made, [0.3, -0.5, -1.0], 160.0, [96, 80]);
    for visibility in [true, false] {
        let options = RendererOptions { visibility, ..RendererOptions::default() };
        let mut renderer = made.renderer(&options);
        renderer.stop_on(Arc::new(AtomicBool::new(true)));
        let given_up = renderer.converge(&view, &look, None, None).map(drop);
        assert!(matches!(given_up, Err(RenderError::Stopped)), "{given_up:?}");
        renderer.stop_on(Arc::default());
        let drawn = renderer.converge(&view, &look, None, None).unwrap();
        assert!(drawn.converged && drawn.picture == made.mirrored(&view, &look).picture);
    }
}

#[test]
fn eight_bits_look_like_the_source_where_a_voxel_covers_a_pixel() {
    let folding = Folding { encoding: Encoding::Quantised8, ..Folding::default() };
    let made = make_u16(DIMS, folding, blob(DIMS));
    for (name, look) in looks() {
        let look = Look { accuracy: 0.5, ..look };
        let view = perspective(&made, [0.3, -0.5, -1.0], 120.0, [96, 80]);
        let found = compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
        assert!(found.reaches(45.0), "{name}: {found:?}");
    }
}

#[test]
fn visibility_changes_what_is_loaded_and_not_the_picture() {
    let made = make_u16([96; 3], Folding::default(), blob([96; 3]));
    for (name, look) in looks() {
        let view = perspective(&made, [0.6, -0.5, -1.0], 170.0, [120, 100]);
        let mut pictures = Vec::new();
        let mut loaded = Vec::new();
        for visibility in [true, false] {
            let mut renderer =
                made.renderer(&RendererOptions { visibility, ..RendererOptions::default() });
            pictures.push(renderer.converge(&view, &look, None, None).unwrap().picture);
            loaded.push(renderer.effort().bricks_loaded);
        }
        let found = compared(&pictures[0], &pictures[1]);
        println!("{name}: {loaded:?} {found:?}");
        assert!(found.max_abs_diff < 1.0 / 255.0, "{name}: {found:?}");
        assert!(loaded[0] <= loaded[1]);
    }
}

#[test]
fn halving_the_step_divides_the_error_of_the_mirror_by_four() {
    let (made, view, look) = wave();
    let errors = convergence(|step_voxels| {
        made.mirrored(&view, &Look { step_voxels, ..look.clone() }).picture
    });
    println!("{errors:?}");
    assert_second_order(&errors);
}

#[test]
fn a_homogeneous_cube_looks_the_same_from_six_sides() {
    // Not uniform in its bricks, and of one colour and extinction all the same.
    let made = make_u16([32; 3], Folding::default(), |[x, y, z]| ((x * 7 + y * 3 + z) % 90) as u16);
    let constant = transfer(&[(0.0, [0.5, 1.0, 0.25], 0.05)]);
    let look = Look { step_voxels: 0.3, ..Look::new(constant, [0.0, 90.0]) };
    let pictures = SIX_SIDES.map(|direction| {
        let view = orthographic(&made, direction, 30.0, [31, 31]);
        made.mirrored(&view, &look).picture
    });
    for (picture, direction) in pictures.iter().zip(SIX_SIDES).skip(1) {
        let found = compared(&pictures[0], picture);
        assert!(found.max_abs_diff < 2e-6, "{direction:?}: {found:?}");
    }
}

#[test]
fn floats_look_like_their_source_wherever_their_values_lie() {
    let shape = blob(DIMS);
    for [low, high] in [[0.0_f32, 1.0], [1e5, 1.01e5], [-3e38, 3e38], [1e33, 1.5e33], [0.0, 1e-37]]
    {
        let at = |t: f64| f64::from(low) + t * (f64::from(high) - f64::from(low));
        let made = make_f32(DIMS, Folding::default(), |p| at(f64::from(shape(p)) / 1000.0) as f32);
        let points = [(0.15, 0.0), (0.4, 0.1), (1.0, 0.5)];
        let color = [0.9, 0.5, 0.2];
        let transfer = transfer(&points.map(|(t, extinction)| (at(t), color, extinction)));
        let base = Look::new(transfer, [f64::from(low), f64::from(high)]);
        for mode in [Mode::Dvr, Mode::Iso(at(0.42)), Mode::Mip] {
            let look = Look { mode, accuracy: 0.2, ..base.clone() };
            let view = perspective(&made, [0.3, -0.5, -1.0], 160.0, [48, 40]);
            let found =
                compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
            assert!(found.reaches(60.0), "{low:e} {high:e} {mode:?}: {found:?}");
        }
    }
}
