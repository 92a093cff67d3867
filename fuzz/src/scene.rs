//! Transfer functions and cameras as JSON: what is taken can be used, and means the same when it is written and read again.

use crate::files::noise_store;
use octree_store::Store;
use octree_store::loader::{Camera, ControlPoint, Projection, TransferFunction, View};
use render_check::transfer::TransferFile;
use render_check::view::Look;
use render_check::{CpuBackend, RenderError, Renderer, RendererOptions};
use std::path::PathBuf;
use std::sync::OnceLock;
use tempfile::TempDir;

/// A transfer function, plain or with a colour map.
pub fn transfer(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(Ok(function)) = TransferFile::parse(text) else { return };
    let points = function.points();
    assert!(!points.is_empty());
    assert!(points.windows(2).all(|pair| pair[0].value <= pair[1].value));
    for value in
        points.iter().flat_map(|p| [p.value, p.value.next_up(), p.value / 2.0]).chain([0.0])
    {
        let (color, extinction) = function.at(value);
        assert!(color.iter().all(|c| (0.0..=1.0).contains(c)), "{value}: {color:?}");
        assert!(extinction >= 0.0 && extinction.is_finite(), "{value}: {extinction}");
    }
    let again = serde_json::to_string(&function).unwrap();
    assert_eq!(serde_json::from_str::<TransferFunction>(&again).unwrap(), function);
}

/// A camera.
pub fn camera(bytes: &[u8]) {
    let Ok(camera) = serde_json::from_slice::<Camera>(bytes) else { return };
    let again = serde_json::to_string(&camera).unwrap();
    assert_eq!(serde_json::from_str::<Camera>(&again).unwrap(), camera);
    let view = View::new(camera, [64, 48]).unwrap();
    let fan = Projection::new(&view).fan();
    let numbers = [fan.origin, fan.direction, fan.origin_across, fan.direction_across].concat();
    // A camera so far away that an f64 cannot hold a pixel may overflow; it must not be taken for one that sees something.
    if numbers.iter().all(|n| n.is_finite()) {
        assert!(fan.direction.iter().any(|c| *c != 0.0) || fan.parallel, "{view:?}");
    }
    draw(&View { size: [16, 12], ..view });
}

/// Draws a small store, or says why not.
fn draw(view: &View) {
    static STORE: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = STORE.get_or_init(noise_store);
    let store = Store::open(path).unwrap();
    let options = RendererOptions { threads: 1, ..RendererOptions::default() };
    let slots = options.slots_for(store.geometry());
    let backend = CpuBackend::new(store.geometry(), store.metadata().spacing_xyz, slots);
    let points = [(0.0, 0.0), (65_535.0, 0.2)].map(|(value, extinction)| ControlPoint {
        value,
        color: [1.0; 3],
        extinction,
    });
    let look = Look::new(TransferFunction::new(points.to_vec()).unwrap(), [0.0, 65_535.0]);
    let mut renderer = Renderer::new(store, Box::new(backend), &options).unwrap();
    match renderer.converge(view, &look, None, None) {
        Ok(drawn) => assert!(drawn.converged && drawn.problems.is_empty(), "{view:?}"),
        Err(RenderError::OutOfScale) => {}
        Err(error) => panic!("{view:?}: {error}"),
    }
}
