//! What the laws are tested with: small stores made of a function, a source that is watched, and a
//! renderer of a few lines.

use octree_store::loader::{
    Appearance, Brick, BrickSource, Camera, CameraJson, ControlPoint, Feedback, Frame, Loader,
    LoaderOptions, NodeData, Projection, Quality, Ray, Scene, SpatialIndex, TransferFunction, View,
};
use octree_store::{
    BrickScratch, BrickState, Encoding, Geometry, Metadata, NodeKey, NodeRecord, SampleType, Store,
    StoreError, StoreWriter, encode_samples,
};
use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A store of 8-bit samples in bricks of 8^3, each level the mean of the one below.
pub(crate) struct Made {
    pub(crate) store: Store,
    pub(crate) records: HashMap<NodeKey, NodeRecord>,
    pub(crate) path: std::path::PathBuf,
    _folder: tempfile::TempDir,
}

pub(crate) fn make(dims: [u64; 3], value: impl Fn([u64; 3]) -> u8) -> Made {
    make_as(dims, Encoding::Quantised8, value)
}

pub(crate) fn make_as(dims: [u64; 3], encoding: Encoding, value: impl Fn([u64; 3]) -> u8) -> Made {
    let geometry = Geometry::new(dims, 8, 1).unwrap();
    let mut levels: Vec<Vec<u8>> = vec![
        (0..dims[2])
            .flat_map(|z| (0..dims[1]).flat_map(move |y| (0..dims[0]).map(move |x| [x, y, z])))
            .map(&value)
            .collect(),
    ];
    for level in 1..=geometry.top_level() {
        let (below, at) = (geometry.dims_at(level - 1), geometry.dims_at(level));
        let fine = &levels[usize::from(level) - 1];
        let mut coarse = Vec::new();
        for z in 0..at[2] {
            for y in 0..at[1] {
                for x in 0..at[0] {
                    let (mut sum, mut count) = (0, 0);
                    for i in 0..8 {
                        let p = [2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2)];
                        if (0..3).all(|a| p[a] < below[a]) {
                            let place = (p[2] * below[1] + p[1]) * below[0] + p[0];
                            sum += u64::from(fine[place as usize]);
                            count += 1;
                        }
                    }
                    coarse.push((sum / count) as u8);
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
        let dims = geometry.dims_at(level);
        let grid = geometry.grid_at(level).map(|n| n.div_ceil(2));
        let mut parents: Vec<NodeKey> = (0..grid[0] * grid[1] * grid[2])
            .map(|i| {
                NodeKey::new(level + 1, [i % grid[0], i / grid[0] % grid[1], i / grid[0] / grid[1]])
            })
            .collect();
        parents.sort_unstable();
        for parent in parents {
            let (mut octet, mut payloads) = (Vec::new(), Vec::new());
            for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
                let origin = geometry.sample_origin(key);
                let side = geometry.brick_side() as i64;
                let samples: Vec<u8> = (0..side.pow(3))
                    .map(|i| {
                        let p = [i % side, i / side % side, i / side / side];
                        let [x, y, z] = [0, 1, 2].map(|axis| {
                            (origin[axis] + p[axis]).clamp(0, dims[axis] as i64 - 1) as u64
                        });
                        levels[usize::from(level)][((z * dims[1] + y) * dims[0] + x) as usize]
                    })
                    .collect();
                let (mut record, payload) = encode_samples(key, &samples, encoding);
                record.child_mask = geometry.child_mask(key);
                if level > 0 {
                    for child in key.children().iter().filter_map(|child| records.get(child)) {
                        record.subtree_min = record.subtree_min.min(child.subtree_min);
                        record.subtree_max = record.subtree_max.max(child.subtree_max);
                    }
                    let (amax, rms) = deviation(&geometry, &levels, key);
                    (record.lod_amax_bound, record.lod_rms_bound) = (amax, rms);
                }
                payloads.extend_from_slice(&payload);
                octet.push(record);
            }
            writer.append(&mut octet, &payloads, Vec::new()).unwrap();
            records.extend(octet.into_iter().map(|record| (record.key, record)));
        }
    }
    writer.finish(Metadata::new(&geometry, SampleType::U8, encoding)).unwrap();
    Made { store: Store::open(&path).unwrap(), records, path, _folder: folder }
}

/// Largest and root mean square deviation of a brick's cells from the voxels beneath them.
fn deviation(geometry: &Geometry, levels: &[Vec<u8>], key: NodeKey) -> (f64, f64) {
    let (level, core) = (key.level(), geometry.core_region(key));
    let (fine, coarse) = (geometry.dims_at(0), geometry.dims_at(level));
    let (mut largest, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
    for z in core.min[2] << level..(core.max[2] << level).min(fine[2]) {
        for y in core.min[1] << level..(core.max[1] << level).min(fine[1]) {
            for x in core.min[0] << level..(core.max[0] << level).min(fine[0]) {
                let voxel = levels[0][((z * fine[1] + y) * fine[0] + x) as usize];
                let cell = [x >> level, y >> level, z >> level];
                let at = (cell[2] * coarse[1] + cell[1]) * coarse[0] + cell[0];
                let d = f64::from(voxel) - f64::from(levels[usize::from(level)][at as usize]);
                largest = largest.max(d.abs());
                squares += d * d;
                count += 1.0;
            }
        }
    }
    (largest, f64::sqrt(squares / count))
}

/// A source that notes what is read of it, and can be slow or refuse.
#[derive(Clone)]
pub(crate) struct Watched {
    store: Arc<Store>,
    pub(crate) log: Arc<Mutex<Vec<NodeKey>>>,
    pub(crate) delay: Duration,
    /// Nodes whose bricks cannot be read, and nodes whose records cannot.
    pub(crate) broken: Arc<Mutex<HashSet<NodeKey>>>,
    pub(crate) unreadable: Arc<Mutex<HashSet<NodeKey>>>,
    /// A node whose brick makes the reading thread panic.
    pub(crate) bug: Option<NodeKey>,
    /// Bricks of nothing but 0 are said to have been dropped.
    pub(crate) dropped: bool,
}

impl Watched {
    pub(crate) fn new(made: &Made) -> Self {
        Self {
            store: Arc::new(Store::open(&made.path).unwrap()),
            log: Arc::default(),
            delay: Duration::ZERO,
            broken: Arc::default(),
            unreadable: Arc::default(),
            bug: None,
            dropped: false,
        }
    }

    fn damage(&self, key: NodeKey) -> StoreError {
        let path = self.store.path().to_owned();
        StoreError::Damaged { path, key, damage: octree_store::Damage::PayloadChecksum }
    }

    pub(crate) fn read(&self) -> Vec<NodeKey> {
        self.log.lock().unwrap().clone()
    }
}

impl BrickSource for Watched {
    fn metadata(&self) -> &Metadata {
        self.store.metadata()
    }

    fn geometry(&self) -> &Geometry {
        self.store.geometry()
    }

    fn records(&self, parent: NodeKey) -> [Option<Result<NodeRecord, StoreError>>; 8] {
        std::thread::sleep(self.delay);
        let mut records = BrickSource::records(&*self.store, parent);
        for record in records.iter_mut().flatten() {
            if let Ok(record) = record
                && self.dropped
                && record.state == BrickState::Uniform
                && record.brick_max == 0.0
            {
                record.state = BrickState::Empty;
            }
            if let Ok(NodeRecord { key, .. }) = record
                && self.unreadable.lock().unwrap().contains(key)
            {
                *record = Err(self.damage(*key));
            }
        }
        records
    }

    fn brick(&self, record: &NodeRecord, scratch: &mut BrickScratch) -> Result<Brick, StoreError> {
        std::thread::sleep(self.delay);
        self.log.lock().unwrap().push(record.key);
        assert_ne!(self.bug, Some(record.key), "the bug that was asked for");
        if self.broken.lock().unwrap().contains(&record.key) {
            return Err(self.damage(record.key));
        }
        self.store.upload_brick(record, scratch)
    }
}

/// A renderer: a pool of bricks, and rays.
#[derive(Default)]
pub(crate) struct Renderer {
    pub(crate) pool: HashMap<u32, (NodeKey, Arc<Brick>)>,
}

impl Renderer {
    pub(crate) fn take(&mut self, frame: &Frame) {
        for upload in &frame.uploads {
            self.pool.insert(upload.slot, (upload.key, Arc::clone(&upload.brick)));
        }
    }

    /// What is seen of an index: a byte a node, the octants that rays enter before they end.
    pub(crate) fn see(&self, geometry: &Geometry, index: &SpatialIndex, scene: &Scene) -> Vec<u8> {
        let mut seen = vec![0; index.nodes().len()];
        for view in scene.views {
            let projection = Projection::new(view);
            for y in 0..view.size[1] {
                for x in 0..view.size[0] {
                    let ray = projection.ray([f64::from(x) + 0.5, f64::from(y) + 0.5]);
                    self.cast(geometry, index, scene.appearance, &ray, &mut seen);
                }
            }
        }
        seen
    }

    fn cast(
        &self,
        geometry: &Geometry,
        index: &SpatialIndex,
        appearance: &Appearance,
        ray: &Ray,
        seen: &mut [u8],
    ) {
        let mut depth = 0.0;
        index.walk(geometry, ray, |mut step| {
            let node = &index.nodes()[step.node as usize];
            let mut at = step.enter;
            let spacing = f64::from(1_u32 << node.data_level) / 2.0;
            while at < step.leave && depth < 10.0 {
                let extinction = |value: f64| match appearance {
                    Appearance::Transfer(function) => function.at(value).1,
                    _ => 0.0,
                };
                depth += spacing
                    * match node.data {
                        NodeData::Slot(slot) => {
                            let key = index.keys()[step.node as usize];
                            extinction(self.sample(geometry, slot, key, node.data_level, ray, at))
                        }
                        NodeData::Uniform => extinction(node.texel_range[0]),
                        _ => 0.0,
                    };
                at += spacing;
            }
            step.leave = at.min(step.leave);
            seen[step.node as usize] |= index.octants(geometry, ray, step);
            depth < 10.0
        });
    }

    /// The sample nearest to a place on a ray; checks that the slot has the brick that the index says.
    fn sample(
        &self,
        geometry: &Geometry,
        slot: u32,
        leaf: NodeKey,
        data_level: u8,
        ray: &Ray,
        at: f64,
    ) -> f64 {
        let (key, brick) = &self.pool[&slot];
        let up = data_level - leaf.level();
        assert_eq!(*key, NodeKey::new(data_level, leaf.brick_xyz().map(|b| b >> up)));
        let (origin, side) = (geometry.sample_origin(*key), geometry.brick_side() as i64);
        let place = [0, 1, 2].map(|axis| {
            let p = ray.origin[axis] + at * ray.direction[axis];
            let p = (p / f64::from(1_u32 << data_level)).floor() as i64;
            (p - origin[axis]).clamp(0, side - 1)
        });
        brick.value(((place[2] * side + place[1]) * side + place[0]) as usize)
    }
}

/// A loader and its renderer.
pub(crate) struct Show {
    pub(crate) loader: Loader,
    pub(crate) renderer: Renderer,
    pub(crate) geometry: Geometry,
    pub(crate) octants: bool,
    options: LoaderOptions,
}

impl Show {
    pub(crate) fn new(source: impl BrickSource, options: LoaderOptions) -> Self {
        let geometry = *source.geometry();
        let loader = Loader::new(source, options).unwrap();
        Self { loader, renderer: Renderer::default(), geometry, octants: true, options }
    }

    /// One frame, drawn and seen; each law that holds for every frame is checked.
    pub(crate) fn frame(&mut self, scene: &Scene) -> Frame {
        let frame = self.loader.frame(scene);
        self.renderer.take(&frame);
        covers_once(&self.geometry, frame.index.leaves().map(|leaf| leaf.0), frame.index.nodes());
        let mut used = HashSet::new();
        for (key, node) in frame.index.keys().iter().zip(frame.index.nodes()) {
            if let NodeData::Slot(slot) = node.data {
                // The brick of the node itself, or of one above it, is in the slot that the index says.
                let (found, _) = &self.renderer.pool[&slot];
                let up = node.data_level - key.level();
                assert_eq!(*found, NodeKey::new(node.data_level, key.brick_xyz().map(|b| b >> up)));
                used.insert(slot);
            }
        }
        assert!(frame.freed.iter().all(|slot| !used.contains(slot)), "freed and drawn");
        let (statistics, limits) = (self.loader.statistics(), &self.options);
        assert!(frame.uploads.len() <= limits.uploads_per_frame);
        assert!(used.iter().all(|slot| (*slot as usize) < limits.slots));
        assert!(used.len() <= statistics.slots_in_use && statistics.slots_in_use <= limits.slots);
        assert!(statistics.memory.bytes <= limits.memory_bytes);
        assert_eq!(statistics.memory.misses, statistics.bricks_read);
        let seen = self.renderer.see(&self.geometry, &frame.index, scene);
        let feedback = if self.octants { Feedback::Octants(&seen) } else { Feedback::Nodes(&seen) };
        self.loader.feedback(frame.index.serial(), feedback);
        frame
    }

    /// Frames until nothing is left to do; how many it took.
    pub(crate) fn converge(&mut self, scene: &Scene) -> (Frame, usize) {
        let until = Instant::now() + Duration::from_secs(20);
        for count in 1.. {
            let frame = self.frame(scene);
            if frame.converged {
                return (frame, count);
            }
            assert!(Instant::now() < until, "not converged: {:?}", self.loader.statistics());
            self.loader.wait(Duration::from_millis(20));
        }
        unreachable!()
    }
}

/// The leaves' cores are disjoint and fill the volume.
pub(crate) fn covers_once(
    geometry: &Geometry,
    leaves: impl Iterator<Item = NodeKey>,
    nodes: &[octree_store::loader::IndexNode],
) {
    let leaves: BTreeSet<NodeKey> = leaves.collect();
    if nodes.is_empty() && leaves.is_empty() {
        return;
    }
    let voxels: u64 = leaves.iter().map(|key| geometry.voxels_beneath(*key)).sum();
    assert_eq!(voxels, geometry.dims_xyz().iter().product::<u64>(), "no gap");
    for leaf in &leaves {
        let mut above = *leaf;
        while above != geometry.root() {
            above = above.parent();
            assert!(!leaves.contains(&above), "{leaf} lies in {above}");
        }
    }
}

pub(crate) fn perspective(position: [f64; 3], target: [f64; 3], fov: f64, size: [u32; 2]) -> View {
    let up = [0.1, 1.0, 0.05];
    let fields = CameraJson::Perspective { position, target, up, fov_y_deg: fov };
    View::new(Camera::new(fields).unwrap(), size).unwrap()
}

/// Extinction 0 below `from`, `extinction` above it.
pub(crate) fn opaque_above(from: f64, extinction: f64) -> Appearance {
    let point = |value, extinction| ControlPoint { value, color: [1.0; 3], extinction };
    let points = vec![point(from - 1.0, 0.0), point(from, extinction)];
    Appearance::Transfer(TransferFunction::new(points).unwrap())
}

pub(crate) fn scene<'a>(views: &'a [View], appearance: &'a Appearance) -> Scene<'a> {
    Scene { views, clip: None, appearance, quality: Quality::default() }
}

/// A foam of walls in a ball; nothing outside it.
pub(crate) fn foam(dims: [u64; 3]) -> impl Fn([u64; 3]) -> u8 {
    move |p| {
        let c = [0, 1, 2].map(|axis| p[axis] as f64 - dims[axis] as f64 / 2.0);
        let r = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt();
        let wave =
            (p[0] as f64 / 5.0).sin() + (p[1] as f64 / 6.0).sin() + (p[2] as f64 / 7.0).sin();
        if r > dims[0] as f64 * 0.45 { 0 } else { (120.0 + 30.0 * wave) as u8 }
    }
}
