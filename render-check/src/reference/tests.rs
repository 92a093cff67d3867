//! Laws of the reference: what is known in closed form.

use super::*;
use crate::view::Shading;
use octree_store::loader::{Camera, CameraJson, ControlPoint, TransferFunction};

fn volume(dims_xyz: [u64; 3], value: impl Fn([u64; 3]) -> f64) -> SourceVolume {
    let [nx, ny, nz] = dims_xyz;
    let values = (0..nz)
        .flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
        .map(value)
        .collect();
    SourceVolume { dims_xyz, spacing_xyz: [1.0; 3], samples: SampleBuffer::F64(values) }
}

fn along(direction: [f64; 3], middle: [f64; 3], up: [f64; 3]) -> View {
    let position = [0, 1, 2].map(|i| middle[i] - 100.0 * direction[i]);
    let camera = CameraJson::Orthographic { position, target: middle, up, height: 4.0 };
    View::new(Camera::new(camera).unwrap(), [3, 3]).unwrap()
}

fn constant(extinction: f64) -> TransferFunction {
    let point = ControlPoint { value: 0.0, color: [0.5, 1.0, 0.25], extinction };
    TransferFunction::new(vec![point]).unwrap()
}

fn smooth() -> TransferFunction {
    let point = |value, color, extinction| ControlPoint { value, color, extinction };
    TransferFunction::new(vec![
        point(0.0, [0.9, 0.1, 0.1], 0.02),
        point(0.5, [0.1, 0.8, 0.2], 0.3),
        point(1.0, [0.2, 0.3, 1.0], 0.05),
    ])
    .unwrap()
}

#[test]
fn a_slab_of_constant_extinction_leaves_exp_of_minus_its_depth() {
    // Values vary, extinction does not; the slab is 8 long.
    let slab = volume([8, 8, 8], |[x, y, z]| ((x * 7 + y * 3 + z * 5) % 11) as f64);
    for depth in [1e-7, 1e-5, 1e-3, 0.1, 1.0, 5.0, 30.0, 1e3] {
        let look = Look { step_voxels: 0.37, ..Look::new(constant(depth / 8.0), [0.0, 10.0]) };
        let view = along([0.0, 0.0, 1.0], [4.0; 3], [0.0, -1.0, 0.0]);
        let tracer = Tracer::new(&slab, &view, &look, Interpolation::Trilinear);
        let Traced { color: [r, g, _, alpha], .. } = tracer.pixel([1, 1]);
        let expected = -f64::exp_m1(-depth);
        assert!((alpha - expected).abs() <= 1e-12 * expected.max(1e-7), "{depth}: {alpha}");
        assert!((r - 0.5 * expected).abs() < 1e-12 && (g - expected).abs() < 1e-12);
    }
}

#[test]
fn halving_the_step_divides_the_error_by_four() {
    // A long wave, so that rays see a smooth function of their length; values between voxels are linear, so steps are compared
    // that are whole fractions of a voxel from the middle of one to the next.
    let wave = volume([64, 8, 8], |[x, _, _]| 0.5 + 0.5 * (x as f64 * 0.7).sin());
    let picture = |step: f64| {
        let look = Look { step_voxels: step, ..Look::new(smooth(), [0.0, 1.0]) };
        let view = along([1.0, 0.0, 0.0], [32.0, 4.0, 4.0], [0.0, -1.0, 0.0]);
        Tracer::new(&wave, &view, &look, Interpolation::Tricubic).pixel([1, 1]).color
    };
    let truth = picture(1.0 / 256.0);
    let error = |step: f64| {
        let found = picture(step);
        (0..4).map(|c| (found[c] - truth[c]).abs()).fold(0.0, f64::max)
    };
    let errors = [0.5, 0.25, 0.125].map(error);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.6..2.6).contains(&order), "{errors:?}");
    }
}

#[test]
fn a_homogeneous_cube_looks_the_same_from_six_sides() {
    let cube = volume([16; 3], |_| 0.4);
    let look = Look {
        shading: Some(Shading::default()),
        step_voxels: 0.3,
        ..Look::new(smooth(), [0.0, 1.0])
    };
    let mut colors = Vec::new();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut direction = [0.0; 3];
            direction[axis] = sign;
            let mut up = [0.0; 3];
            up[(axis + 1) % 3] = 1.0;
            let view = along(direction, [8.0; 3], up);
            let tracer = Tracer::new(&cube, &view, &look, Interpolation::Trilinear);
            colors.push(tracer.pixel([1, 1]).color);
        }
    }
    for color in &colors[1..] {
        assert!((0..4).all(|c| (color[c] - colors[0][c]).abs() < 1e-12), "{colors:?}");
    }
}

#[test]
fn a_surface_is_found_where_it_is_and_lit_by_its_slope() {
    // A plane at x = 20, met from its low side.
    let ramp = volume([40, 8, 8], |[x, _, _]| x as f64 + 0.5);
    let look = Look {
        mode: Mode::Iso(20.0),
        shading: Some(Shading { specular: 0.0, ..Shading::default() }),
        ..Look::new(smooth(), [0.0, 40.0])
    };
    let view = along([1.0, 0.0, 0.0], [20.0, 4.0, 4.0], [0.0, -1.0, 0.0]);
    let found = Tracer::new(&ramp, &view, &look, Interpolation::Trilinear).pixel([1, 1]);
    assert!((found.depth - 100.0).abs() < 1e-9, "{found:?}");
    assert_eq!(found.color[3], 1.0);
    // The slope is 1/40 of the window a voxel; so much of it is believed.
    let trust = (1.0_f64 / 40.0).powi(2) / ((1.0_f64 / 40.0).powi(2) + 1e-4);
    let expected = look.surface_color[0] * (1.0 + (0.3 + 0.7 - 1.0) * trust);
    assert!((found.color[0] - expected).abs() < 1e-9, "{found:?} {expected}");
}

#[test]
fn the_greatest_value_on_a_ray_is_found() {
    let peak = volume([16; 3], |[x, y, z]| if [x, y, z] == [8, 8, 8] { 3.0 } else { 1.0 });
    let look = Look { mode: Mode::Mip, step_voxels: 0.25, ..Look::new(smooth(), [0.0, 4.0]) };
    let look = Look { window: [0.0, 4.0], ..look };
    let view = along([0.0, 0.0, 1.0], [8.5, 8.5, 8.0], [0.0, -1.0, 0.0]);
    let found = Tracer::new(&peak, &view, &look, Interpolation::Trilinear).pixel([1, 1]);
    assert!((found.color[0] - 0.75).abs() < 1e-12, "{found:?}");
}
