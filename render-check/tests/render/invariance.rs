//! What a picture does not depend on, and cameras and volumes at the extremes.

use crate::support::*;
use octree_store::loader::{Camera, CameraJson, ClipBox, View};
use render_check::view::{Filter, Look, Mode, Shading};
use render_check::{RenderError, RendererOptions};

const DIMS: [u64; 3] = [50, 43, 39];

fn camera(position: [f64; 3], target: [f64; 3], fov_y_deg: f64, size: [u32; 2]) -> View {
    let camera = CameraJson::Perspective { position, target, up: [0.0, -1.0, 0.0], fov_y_deg };
    View::new(Camera::new(camera).unwrap(), size).unwrap()
}

#[test]
fn a_picture_does_not_depend_on_the_size_of_bricks() {
    let view_of = |made: &Made| perspective(made, [0.5, -0.4, -1.0], 120.0, [64, 48]);
    for (name, look) in looks() {
        let mut pictures = Vec::new();
        for (core, overlap) in [(8, 2), (16, 1), (32, 4), (64, 2)] {
            let made = make_u16(DIMS, Folding { core, overlap, ..Folding::default() }, blob(DIMS));
            let look = Look { accuracy: 0.5, ..look.clone() };
            pictures.push(made.mirrored(&view_of(&made), &look).picture);
        }
        for picture in &pictures[1..] {
            let found = compared(&pictures[0], picture);
            assert!(found.max_abs_diff < 2e-4, "{name}: {found:?}");
        }
    }
}

#[test]
fn a_picture_does_not_depend_on_where_the_camera_came_from() {
    let made = make_u16([80; 3], Folding::default(), blob([80; 3]));
    let (_, look) = &looks()[0];
    let last = perspective(&made, [0.5, -0.4, -1.0], 150.0, [64, 48]);
    let fresh = made.mirrored(&last, look).picture;
    // With so few slots that bricks come and go.
    let options = RendererOptions { slots: 150, ..RendererOptions::default() };
    let mut renderer = made.renderer(&options);
    for direction in [[-1.0, 0.3, 0.2], [0.1, 0.9, 0.4], [0.3, -0.2, 1.0]] {
        for distance in [60.0, 300.0] {
            let view = perspective(&made, direction, distance, [64, 48]);
            renderer.converge(&view, look, None, None).unwrap();
        }
    }
    let came = renderer.converge(&last, look, None, None).unwrap();
    let found = compared(&fresh, &came.picture);
    assert!(came.limited || found.max_abs_diff < 1e-5, "{found:?}");
    let mut plenty = made.renderer(&RendererOptions::default());
    for direction in [[-1.0, 0.3, 0.2], [0.1, 0.9, 0.4]] {
        let view = perspective(&made, direction, 60.0, [64, 48]);
        plenty.converge(&view, look, None, None).unwrap();
    }
    let came = plenty.converge(&last, look, None, None).unwrap().picture;
    assert!(compared(&fresh, &came).max_abs_diff < 1e-5);
}

#[test]
fn eyes_inside_on_faces_and_on_corners_see_what_is_there() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    for (name, look) in looks() {
        for mode in [Mode::Dvr, Mode::Iso(420.0), Mode::Mip] {
            let look =
                Look { mode, accuracy: 0.05, shading: Some(Shading::default()), ..look.clone() };
            for position in [[25.0, 21.5, 19.5], [0.0, 21.5, 19.5], [0.0; 3], [16.0, 16.0, 16.0]] {
                let view = camera(position, [30.0, 25.0, 22.0], 60.0, [48, 40]);
                let found =
                    compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
                assert!(found.reaches(60.0), "{name} {mode:?} {position:?}: {found:?}");
            }
        }
    }
}

#[test]
fn rays_along_axes_faces_and_edges_of_bricks_are_right() {
    let made = make_u16([64, 48, 32], Folding::default(), blob([64, 48, 32]));
    let (_, look) = &looks()[1];
    let look = Look { accuracy: 0.2, ..look.clone() };
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut direction = [0.0; 3];
            direction[axis] = sign;
            // An odd size puts the middle ray on an edge between bricks.
            let view = orthographic(&made, direction, 33.0, [33, 33]);
            let found =
                compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
            assert!(found.reaches(60.0), "{direction:?}: {found:?}");
        }
    }
}

#[test]
fn thick_slices_are_drawn_as_they_are() {
    let folding = Folding { spacing_xyz: [1.0, 1.0, 100.0], ..Folding::default() };
    let made = make_u16([60, 60, 20], folding, blob([60, 60, 20]));
    let thin = transfer(&[
        (60.0, [0.1, 0.2, 0.9], 0.0),
        (500.0, [0.2, 0.9, 0.3], 0.01),
        (1000.0, [1.0, 0.3, 0.1], 0.05),
    ]);
    for shading in [None, Some(Shading::default())] {
        let look = Look { accuracy: 0.05, shading, ..Look::new(thin.clone(), [0.0, 1000.0]) };
        for direction in [[0.3, -0.2, -1.0], [1.0, 0.0, 0.05]] {
            let view = perspective(&made, direction, 4000.0, [64, 48]);
            let found =
                compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
            assert!(found.reaches(60.0), "{direction:?} {shading:?}: {found:?}");
        }
    }
}

#[test]
fn a_transfer_function_of_steps_looks_like_itself() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    let step = transfer(&[
        (0.0, [0.0; 3], 0.0),
        (400.0, [0.0; 3], 0.0),
        (400.0, [1.0, 0.5, 0.1], 0.3),
        (1000.0, [1.0, 0.5, 0.1], 0.3),
    ]);
    let look = Look { accuracy: 0.5, ..Look::new(step, [0.0, 1000.0]) };
    let view = perspective(&made, [0.5, -0.4, -1.0], 120.0, [64, 48]);
    let found = compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
    println!("{found:?}");
    assert!(found.reaches(60.0), "{found:?}");
}

#[test]
fn uniform_bricks_are_one_segment_and_look_like_the_source() {
    // Half of the volume is one value that is seen, the rest varies.
    let value = |[x, y, z]: [u64; 3]| {
        if x < 40 { 600 } else { 500 + ((x * 5 + y * 3 + z * 7) % 200) as u16 }
    };
    let made = make_u16([80, 40, 40], Folding::default(), value);
    for (name, look) in looks() {
        for mode in [Mode::Dvr, Mode::Mip, Mode::Iso(605.0)] {
            let look = Look { mode, accuracy: 0.2, filter: Filter::Trilinear, ..look.clone() };
            for direction in [[-1.0, 0.1, 0.2], [0.2, -0.3, -1.0]] {
                let view = perspective(&made, direction, 130.0, [64, 48]);
                let found =
                    compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
                assert!(found.reaches(60.0), "{name} {mode:?} {direction:?}: {found:?}");
            }
        }
    }
}

#[test]
fn a_clip_box_cuts_where_it_says() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    let (_, look) = &looks()[1];
    let clip = Some(ClipBox::new([10.3, 5.0, 7.7], [30.0, 39.9, 100.0]).unwrap());
    let look = Look { clip, accuracy: 0.5, ..look.clone() };
    let view = perspective(&made, [0.5, -0.4, -1.0], 120.0, [64, 48]);
    let found = compared(&made.mirrored(&view, &look).picture, &made.reference(&view, &look));
    assert!(found.reaches(60.0), "{found:?}");
}

#[test]
fn no_seam_shows_between_levels() {
    // A plane of constant slope is the same in all levels but at its ends; leaves of several levels are in sight.
    let made =
        make_f32([128, 128, 64], Folding::default(), |[x, y, z]| (x + 2 * y + 3 * z) as f32 + 0.5);
    let look = Look {
        mode: Mode::Dvr,
        ..Look::new(
            transfer(&[(0.0, [1.0, 0.0, 0.0], 0.002), (600.0, [0.0, 0.0, 1.0], 0.02)]),
            [0.0, 600.0],
        )
    };
    let view = camera([64.0, 64.0, -20.0], [110.0, 64.0, 64.0], 60.0, [96, 64]);
    let blended = made.mirrored(&view, &look).picture;
    let steps = |shown: &render_check::picture::Picture| {
        let shown = shown.over([0.0; 3]);
        let mut worst = 0.0_f32;
        for y in 0..64 {
            for x in 2..94 {
                let at = |dx: usize| shown.pixels[y * 96 + x + dx - 1][2];
                // Second differences: what an eye sees as an edge.
                worst = worst.max((at(0) - 2.0 * at(1) + at(2)).abs());
            }
        }
        worst
    };
    let truth = steps(&made.reference(&view, &look));
    let found = steps(&blended);
    println!("second differences: {found}, of the source {truth}");
    assert!(found < truth + 2.0 / 255.0, "{found} {truth}");
}

#[test]
fn what_is_no_number_is_drawn_as_the_least_value() {
    let smooth = blob(DIMS);
    let value = move |p: [u64; 3]| match (p[0] + 3 * p[1] + 5 * p[2]) % 97 {
        0 => f32::NAN,
        1 => f32::NEG_INFINITY,
        _ => f32::from(smooth(p)),
    };
    let made = make_f32(DIMS, Folding::default(), value);
    let (_, look) = &looks()[1];
    let look = Look { accuracy: 0.2, ..look.clone() };
    let view = perspective(&made, [0.5, -0.4, -1.0], 120.0, [64, 48]);
    let picture = made.mirrored(&view, &look).picture;
    assert!(picture.colors.iter().flatten().all(|c| c.is_finite()));
    let found = compared(&picture, &made.reference(&view, &look));
    assert!(found.reaches(60.0), "{found:?}");
}

#[test]
fn views_out_of_all_scale_are_refused_and_not_drawn_for_ever() {
    let orthographic = |height: f64| {
        let camera = CameraJson::Orthographic {
            position: [20.0, 16.0, -40.0],
            target: [20.0, 16.0, 10.0],
            up: [0.0, -1.0, 0.0],
            height,
        };
        View::new(Camera::new(camera).unwrap(), [16, 12]).unwrap()
    };
    let (_, look) = &looks()[0];
    let drawn = |spacing: f64, view: &View| {
        let folding = Folding { spacing_xyz: [spacing; 3], ..Folding::default() };
        let made = make_u16([24; 3], folding, blob([24; 3]));
        made.renderer(&RendererOptions::default()).converge(view, look, None, None).map(drop)
    };
    for height in [1e300, 1e-300] {
        let refused = drawn(1.0, &orthographic(height));
        assert!(matches!(refused, Err(RenderError::OutOfScale)), "{height}: {refused:?}");
    }
    for spacing in [1e-300, 1.7e308] {
        let refused = drawn(spacing, &orthographic(50.0));
        assert!(matches!(refused, Err(RenderError::OutOfScale)), "{spacing}: {refused:?}");
    }
    // Its rays have directions whose squares no f32 holds, until they are made shorter.
    let clip_from_world =
        [[1.0, 10.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [5.0, 0.0, 1.0, 0.0], [0.0, 0.0, 3e-22, 0.0]];
    let camera = Camera::new(CameraJson::Matrix { clip_from_world }).unwrap();
    for size in [[16, 12], [1, 1]] {
        drawn(1.0, &View::new(camera.clone(), size).unwrap()).unwrap();
    }
    for (spacing, height) in [(1.0, 1e9), (1.0, 1e-9), (1e-9, 50.0), (1e9, 50.0)] {
        drawn(spacing, &orthographic(height)).unwrap();
    }
}

#[test]
fn a_matrix_may_be_scaled_as_it_likes() {
    let made = make_u16(DIMS, Folding::default(), blob(DIMS));
    let [x, y, z] = DIMS.map(|n| n as f64);
    // From before the middle of a side, along z.
    let rows = [[2.0, 0.0, 0.0, -x], [0.0, 2.0, 0.0, -y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, z]];
    for (_, look) in &looks() {
        let picture = |exponent: i32| {
            let clip_from_world = rows.map(|row| row.map(|c: f64| c * 2_f64.powi(exponent)));
            let camera = Camera::new(CameraJson::Matrix { clip_from_world }).unwrap();
            made.mirrored(&View::new(camera, [16, 12]).unwrap(), look).picture
        };
        let right = picture(0);
        assert!(right.colors.iter().any(|color| color[3] > 0.1));
        for exponent in [-300, -70, -40, -1, 1, 40, 70, 300] {
            assert!(picture(exponent).colors == right.colors, "2^{exponent}");
        }
    }
}
