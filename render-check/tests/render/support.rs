//! Small stores made of a function, and pictures of them by every way there is.

use octree_store::loader::{Camera, CameraJson, ControlPoint, TransferFunction, View};
use octree_store::{
    Encoding, Geometry, Metadata, NodeKey, NodeRecord, Sample, SampleBuffer, SampleType, Store,
    StoreWriter, encode_samples,
};
use render_check::picture::{Comparison, Picture, compare};
use render_check::reference::{Interpolation, SourceVolume, draw};
use render_check::view::{Filter, Look};
use render_check::{CpuBackend, Rendered, Renderer, RendererOptions};
use std::collections::HashMap;
use std::path::PathBuf;

/// A store, and the volume that it was made of.
pub(crate) struct Made {
    pub(crate) path: PathBuf,
    pub(crate) source: SourceVolume,
    _folder: tempfile::TempDir,
}

/// How a volume is folded.
#[derive(Clone, Copy)]
pub(crate) struct Folding {
    pub(crate) core: u32,
    pub(crate) overlap: u32,
    pub(crate) encoding: Encoding,
    pub(crate) spacing_xyz: [f64; 3],
}

impl Default for Folding {
    fn default() -> Self {
        Self { core: 16, overlap: 2, encoding: Encoding::Lossless, spacing_xyz: [1.0; 3] }
    }
}

/// Makes a store of 16-bit samples; levels are means, rounded.
pub(crate) fn make_u16(dims: [u64; 3], folding: Folding, value: impl Fn([u64; 3]) -> u16) -> Made {
    make(
        dims,
        folding,
        SampleType::U16,
        value,
        |sum, n| (sum / n).round() as u16,
        SampleBuffer::U16,
    )
}

/// Makes a store of 8-bit samples.
pub(crate) fn make_u8(dims: [u64; 3], folding: Folding, value: impl Fn([u64; 3]) -> u8) -> Made {
    make(dims, folding, SampleType::U8, value, |sum, n| (sum / n).round() as u8, SampleBuffer::U8)
}

/// Makes a store of floats.
pub(crate) fn make_f32(dims: [u64; 3], folding: Folding, value: impl Fn([u64; 3]) -> f32) -> Made {
    make(dims, folding, SampleType::F32, value, |sum, n| (sum / n) as f32, SampleBuffer::F32)
}

fn at(dims: [u64; 3], [x, y, z]: [u64; 3]) -> usize {
    ((z * dims[1] + y) * dims[0] + x) as usize
}

fn make<T: Sample>(
    dims: [u64; 3],
    folding: Folding,
    sample_type: SampleType,
    value: impl Fn([u64; 3]) -> T,
    mean: impl Fn(f64, f64) -> T,
    buffer: impl Fn(Vec<T>) -> SampleBuffer,
) -> Made {
    let geometry = Geometry::new(dims, folding.core, folding.overlap).unwrap();
    let places = (0..dims[2])
        .flat_map(|z| (0..dims[1]).flat_map(move |y| (0..dims[0]).map(move |x| [x, y, z])));
    let mut levels: Vec<Vec<T>> = vec![places.map(value).collect()];
    for level in 1..=geometry.top_level() {
        let (below, here) = (geometry.dims_at(level - 1), geometry.dims_at(level));
        let fine = &levels[usize::from(level) - 1];
        let mut coarse = Vec::new();
        for z in 0..here[2] {
            for y in 0..here[1] {
                for x in 0..here[0] {
                    let (mut sum, mut count) = (0.0, 0.0);
                    for i in 0..8 {
                        let p = [2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2)];
                        if (0..3).all(|a| p[a] < below[a]) {
                            sum += fine[at(below, p)].to_f64();
                            count += 1.0;
                        }
                    }
                    coarse.push(mean(sum, count));
                }
            }
        }
        levels.push(coarse);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("made.octavo");
    let mut writer = StoreWriter::create(&path, &folder.path().join("work"), Vec::new()).unwrap();
    let mut records: HashMap<NodeKey, NodeRecord> = HashMap::new();
    for level in geometry.levels() {
        let here = geometry.dims_at(level);
        let [gx, gy, gz] = geometry.grid_at(level).map(|n| n.div_ceil(2));
        let mut parents: Vec<NodeKey> = (0..gx * gy * gz)
            .map(|i| NodeKey::new(level + 1, [i % gx, i / gx % gy, i / gx / gy]))
            .collect();
        parents.sort_unstable();
        for parent in parents {
            let (mut octet, mut payloads) = (Vec::new(), Vec::new());
            for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
                let origin = geometry.sample_origin(key);
                let side = geometry.brick_side() as i64;
                let samples: Vec<T> = (0..side.pow(3))
                    .map(|i| {
                        let p = [i % side, i / side % side, i / side / side];
                        let place = [0, 1, 2].map(|axis| {
                            (origin[axis] + p[axis]).clamp(0, here[axis] as i64 - 1) as u64
                        });
                        levels[usize::from(level)][at(here, place)]
                    })
                    .collect();
                let (mut record, payload) = encode_samples(key, &samples, folding.encoding);
                record.child_mask = geometry.child_mask(key);
                if level > 0 {
                    for child in key.children().iter().filter_map(|child| records.get(child)) {
                        record.subtree_min = record.subtree_min.min(child.subtree_min);
                        record.subtree_max = record.subtree_max.max(child.subtree_max);
                    }
                }
                payloads.extend_from_slice(&payload);
                octet.push(record);
            }
            writer.append(&mut octet, &payloads, Vec::new()).unwrap();
            records.extend(octet.into_iter().map(|record| (record.key, record)));
        }
    }
    let mut metadata = Metadata::new(&geometry, sample_type, folding.encoding);
    metadata.spacing_xyz = folding.spacing_xyz;
    let finite = levels[0].iter().map(|v| v.to_f64()).filter(|v| v.is_finite());
    let (least, greatest) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    (metadata.value_min, metadata.value_max) = (Some(least), Some(greatest));
    writer.finish(metadata).unwrap();
    let samples = buffer(levels.swap_remove(0));
    let source = SourceVolume { dims_xyz: dims, spacing_xyz: folding.spacing_xyz, samples };
    Made { path, source, _folder: folder }
}

impl Made {
    pub(crate) fn reference(&self, view: &View, look: &Look) -> Picture {
        draw(&self.source, view, look, Interpolation::Trilinear).unwrap()
    }

    pub(crate) fn renderer(&self, options: &RendererOptions) -> Renderer {
        let store = Store::open(&self.path).unwrap();
        let slots = options.slots_for(store.geometry());
        let spacing = store.metadata().spacing_xyz;
        let backend = Box::new(CpuBackend::new(store.geometry(), spacing, slots));
        Renderer::new(store, backend, options).unwrap()
    }

    /// The mirror's picture, all that was asked for loaded.
    pub(crate) fn mirrored(&self, view: &View, look: &Look) -> Rendered {
        let mut renderer = self.renderer(&RendererOptions::default());
        renderer.converge(view, look, None, None).unwrap()
    }
}

/// A perspective camera that looks at the middle of a box.
pub(crate) fn perspective(made: &Made, direction: [f64; 3], distance: f64, size: [u32; 2]) -> View {
    let SourceVolume { dims_xyz, spacing_xyz, .. } = &made.source;
    let target = [0, 1, 2].map(|i| dims_xyz[i] as f64 * spacing_xyz[i] / 2.0);
    let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
    let position = [0, 1, 2].map(|i| target[i] + direction[i] * distance / length);
    let up =
        if direction[0] == 0.0 && direction[2] == 0.0 { [0.0, 0.0, 1.0] } else { [0.0, -1.0, 0.0] };
    let camera = CameraJson::Perspective { position, target, up, fov_y_deg: 35.0 };
    View::new(Camera::new(camera).unwrap(), size).unwrap()
}

pub(crate) fn orthographic(made: &Made, direction: [f64; 3], height: f64, size: [u32; 2]) -> View {
    let SourceVolume { dims_xyz, spacing_xyz, .. } = &made.source;
    let target = [0, 1, 2].map(|i| dims_xyz[i] as f64 * spacing_xyz[i] / 2.0);
    let position = [0, 1, 2].map(|i| target[i] + direction[i] * 300.0);
    let up =
        if direction[0] == 0.0 && direction[2] == 0.0 { [0.0, 0.0, 1.0] } else { [0.0, -1.0, 0.0] };
    let camera = CameraJson::Orthographic { position, target, up, height };
    View::new(Camera::new(camera).unwrap(), size).unwrap()
}

pub(crate) fn transfer(points: &[(f64, [f64; 3], f64)]) -> TransferFunction {
    let point = |&(value, color, extinction)| ControlPoint { value, color, extinction };
    TransferFunction::new(points.iter().map(point).collect()).unwrap()
}

/// Compares what displays show, over a background that is neither black nor white.
pub(crate) fn compared(a: &Picture, b: &Picture) -> Comparison {
    let background = [0.2, 0.3, 0.4];
    compare(&a.over(background), &b.over(background)).unwrap()
}

/// A smooth blob with ripples, 0 to 1000, and nothing outside it.
pub(crate) fn blob(dims: [u64; 3]) -> impl Fn([u64; 3]) -> u16 {
    move |p| {
        let [x, y, z] = [0, 1, 2].map(|i| (p[i] as f64 + 0.5) / dims[i] as f64 - 0.5);
        let r = (x * x + y * y + z * z).sqrt();
        let ripple = 1.0 + 0.15 * (17.0 * x).sin() * (13.0 * y).cos() * (11.0 * z).sin();
        (1000.0 * (1.0 - 2.1 * r).max(0.0) * ripple).min(1000.0) as u16
    }
}

/// Looks at the blob: opaque, transparent.
pub(crate) fn looks() -> [(&'static str, Look); 2] {
    let opaque = transfer(&[
        (150.0, [0.2, 0.1, 0.6], 0.0),
        (400.0, [0.9, 0.5, 0.2], 0.6),
        (1000.0, [1.0, 1.0, 0.9], 2.0),
    ]);
    let transparent = transfer(&[
        (60.0, [0.1, 0.2, 0.9], 0.0),
        (500.0, [0.2, 0.9, 0.3], 0.02),
        (1000.0, [1.0, 0.3, 0.1], 0.06),
    ]);
    [
        ("opaque", Look::new(opaque, [0.0, 1000.0])),
        ("transparent", Look::new(transparent, [0.0, 1000.0])),
    ]
}

/// Along every axis, both ways.
pub(crate) const SIX_SIDES: [[f64; 3]; 6] = [
    [-1.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [0.0, -1.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, -1.0],
    [0.0, 0.0, 1.0],
];

/// Mean differences of pictures with ever shorter steps to one of very short ones. The values are linear from voxel to voxel,
/// and the many rays meet their bends anywhere between two samples: each leaves an error of the second order.
pub(crate) fn convergence(picture: impl Fn(f64) -> Picture) -> [f32; 3] {
    let parts = |picture: Picture| picture.colors.into_flattened();
    let truth = parts(picture(1.0 / 64.0));
    [1.0, 0.5, 0.25].map(|step| {
        let found = parts(picture(step));
        let sum: f32 = found.iter().zip(&truth).map(|(a, b)| (a - b).abs()).sum();
        sum / found.len() as f32
    })
}

/// A long wave along x in one brick, and rays that meet it from all phases.
pub(crate) fn wave() -> (Made, View, Look) {
    let folding = Folding { core: 64, ..Folding::default() };
    let made = make_f32([64, 24, 24], folding, |[x, _, _]| 0.5 + 0.5 * (x as f32 * 0.2).sin());
    let smooth = transfer(&[
        (0.0, [0.9, 0.1, 0.1], 0.02),
        (0.5, [0.1, 0.8, 0.2], 0.3),
        (1.0, [0.2, 0.3, 1.0], 0.05),
    ]);
    let look = Look {
        table_entries: Look::TABLE_LIMIT,
        filter: Filter::Trilinear,
        ..Look::new(smooth, [0.0, 1.0])
    };
    let view = orthographic(&made, [-1.0, 0.11, 0.07], 20.0, [20, 20]);
    (made, view, look)
}

/// Whether halving the step divides the error by about four, and the error is more than rounding.
pub(crate) fn assert_second_order(errors: &[f32; 3]) {
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.6..2.6).contains(&order), "{errors:?}");
    }
    assert!(errors[2] > 1e-6, "{errors:?}");
}
