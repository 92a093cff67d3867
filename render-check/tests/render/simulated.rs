//! A volume 2^20 voxels wide that is made up as it is read.

use crate::support::{compared, transfer};
use octree_store::loader::{Brick, BrickFormat, BrickSource, Camera, CameraJson, View};
use octree_store::{
    BrickScratch, BrickState, Encoding, Geometry, Metadata, NodeKey, NodeRecord, SampleType,
    StoreError, encode_samples,
};
use render_check::view::{Filter, Look, Mode};
use render_check::{CpuBackend, Renderer, RendererOptions};

const PERIOD: u64 = 64;
const WIDTH: u64 = 1 << 20;

struct Wide {
    metadata: Metadata,
    geometry: Geometry,
}

impl Wide {
    fn new() -> Self {
        let geometry = Geometry::new([WIDTH, 64, 64], 32, 2).unwrap();
        let metadata = Metadata::new(&geometry, SampleType::U8, Encoding::Quantised8);
        Self { metadata, geometry }
    }

    /// Repeats every 64 voxels along x.
    fn samples(&self, key: NodeKey) -> Vec<u8> {
        let (origin, side) = (self.geometry.sample_origin(key), self.geometry.brick_side() as i64);
        let dims = self.geometry.dims_at(key.level());
        (0..side.pow(3))
            .map(|i| {
                let p = [i % side, i / side % side, i / side / side];
                let [x, y, z] = [0, 1, 2].map(|a| {
                    let cell = (origin[a] + p[a]).clamp(0, dims[a] as i64 - 1) as u64;
                    (cell << key.level()) % PERIOD
                });
                let wave =
                    |v: u64, n: f64| (v as f64 / PERIOD as f64 * n * std::f64::consts::TAU).sin();
                (127.0 + 60.0 * wave(x, 3.0) + 40.0 * wave(y, 1.0) + 27.0 * wave(z, 2.0)) as u8
            })
            .collect()
    }
}

impl BrickSource for Wide {
    fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    fn records(&self, parent: NodeKey) -> [Option<Result<NodeRecord, StoreError>>; 8] {
        let root = self.geometry.root();
        let record = |key: NodeKey| {
            let (mut record, _) = encode_samples(key, &self.samples(key), Encoding::Quantised8);
            record.child_mask = self.geometry.child_mask(key);
            (record.subtree_min, record.subtree_max) = (0.0, 255.0);
            Some(Ok(record))
        };
        if parent == root.parent() {
            let mut found = [const { None }; 8];
            found[0] = record(root);
            return found;
        }
        parent.children().map(|key| if self.geometry.contains(key) { record(key) } else { None })
    }

    fn brick(&self, record: &NodeRecord, _: &mut BrickScratch) -> Result<Brick, StoreError> {
        assert_eq!(record.state, BrickState::Stored);
        let range = [record.brick_min, record.brick_max];
        let width = (range[1] - range[0]).max(1.0);
        let texel = |v: u8| ((f64::from(v) - range[0]) * 255.0 / width).round() as u8;
        let texels = self.samples(record.key).into_iter().map(texel).collect();
        Ok(Brick { format: BrickFormat::R8, texels, texel_range: range })
    }
}

fn picture(x: f64, look: &Look, oblique: bool) -> render_check::picture::Picture {
    let wide = Wide::new();
    let options = RendererOptions::default();
    let slots = options.slots_for(&wide.geometry);
    let backend = Box::new(CpuBackend::new(&wide.geometry, [1.0; 3], slots));
    let mut renderer = Renderer::new(wide, backend, &options).unwrap();
    // From inside, so that samples begin at the eye and not where the far ends of the volume would have them begin.
    let shift = if oblique { 20.0 } else { 0.0 };
    let camera = CameraJson::Perspective {
        position: [x + shift, 20.0, 3.0],
        target: [x, 32.0, 32.0],
        up: [0.0, -1.0, 0.0],
        fov_y_deg: 50.0,
    };
    let view = View::new(Camera::new(camera).unwrap(), [60, 40]).unwrap();
    renderer.converge(&view, look, None, None).unwrap().picture
}

#[test]
fn the_far_end_of_a_volume_2_20_voxels_wide_looks_like_its_near_end() {
    let cloud = transfer(&[(60.0, [0.1, 0.3, 0.9], 0.0), (250.0, [1.0, 0.8, 0.2], 0.06)]);
    for mode in [Mode::Dvr, Mode::Iso(150.0), Mode::Mip] {
        let look =
            Look { mode, filter: Filter::Trilinear, ..Look::new(cloud.clone(), [0.0, 255.0]) };
        for oblique in [false, true] {
            let near = picture((4 * PERIOD) as f64, &look, oblique);
            let far = picture((WIDTH - 4 * PERIOD) as f64, &look, oblique);
            assert!(near.colors.iter().any(|c| c[3] > 0.2), "nothing is seen");
            let found = compared(&near, &far);
            println!("{mode:?} {found:?}");
            assert!(found.max_abs_diff < 1e-4, "{mode:?} oblique {oblique}: {found:?}");
        }
    }
}
