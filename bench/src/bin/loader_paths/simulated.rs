//! A volume of any size that is a formula: its node records are made up when they are asked for, and it has no payload.
//!
//! A ball of walls (a gyroid) with a dense middle. The formula never changes by more than a known rate, so its
//! value in the middle of a brick bounds what the brick can hold. Records are of bricks with noise, none uniform: nothing is
//! saved that a scan would not save.

use octree_store::loader::{
    Brick, BrickFormat, BrickSource, Child, Lookup, NodeSource, NodeSummary, Siblings,
};
use octree_store::{
    BrickScratch, BrickState, Encoding, Geometry, Metadata, NodeKey, NodeRecord, SampleType,
    StoreError, encode_samples,
};
use std::sync::Arc;

const NOISE: f64 = 400.0;
/// Bytes that a brick of 36^3 codes of noise has in a store.
pub(crate) const PAYLOAD_BYTES: u32 = 46_656;

#[derive(Clone)]
pub(crate) struct Simulated {
    metadata: Metadata,
    geometry: Geometry,
    blank: NodeRecord,
}

impl Simulated {
    pub(crate) fn new(side: u64) -> anyhow::Result<Self> {
        let geometry = Geometry::new([side; 3], 32, 2)?;
        let metadata = Metadata::new(&geometry, SampleType::U16, Encoding::Quantised8);
        let (mut blank, _) = encode_samples(geometry.root(), &[0_u16, 1], Encoding::Quantised8);
        blank.place.length = PAYLOAD_BYTES;
        Ok(Self { metadata, geometry, blank })
    }

    fn record(&self, key: NodeKey) -> NodeRecord {
        let side = self.geometry.dims_xyz()[0] as f64;
        let brick = f64::from(32_u32 << key.level()) / side;
        let middle = key.brick_xyz().map(|c| (c as f64 + 0.5) * brick);
        // The overlap belongs to the brick.
        let reach = 3_f64.sqrt() / 2.0 * brick * 36.0 / 32.0;
        let (low, high) = bounds(middle, reach);
        let voxel = f64::from(1_u32 << key.level()) / side;
        let amax = (RATE * voxel * 3_f64.sqrt()).min(high - low);
        NodeRecord {
            key,
            child_mask: self.geometry.child_mask(key),
            brick_min: low,
            brick_max: high,
            subtree_min: low,
            subtree_max: high,
            lod_rms_bound: if key.level() == 0 { 0.0 } else { NOISE + amax / 2.0 },
            lod_amax_bound: if key.level() == 0 { 0.0 } else { 4.0 * NOISE + amax },
            ..self.blank
        }
    }
}

/// Most that the value changes, over a distance of the volume's side.
const RATE: f64 = 45_000.0 / 0.01;

/// Signed distance to the bodies, at most, in sides of the volume; `p` in the unit cube.
fn distance(p: [f64; 3]) -> f64 {
    let c = p.map(|v| v - 0.5);
    let r = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt();
    let k = 50.0;
    let q = p.map(|v| k * v);
    let gyroid = q[0].sin() * q[1].cos() + q[1].sin() * q[2].cos() + q[2].sin() * q[0].cos();
    // The gyroid's gradient is at most sqrt(3) k; its walls are where it is near 0.
    let walls = (gyroid.abs() - 0.25) / (3_f64.sqrt() * k);
    let shell = (r - 0.44).abs() - 0.015;
    walls.max(r - 0.44).min(shell).min(r - 0.17)
}

/// The value at a point of the unit cube, without noise.
pub(crate) fn value(p: [f64; 3]) -> f64 {
    2000.0 + 45_000.0 * (0.5 - distance(p) / 0.01).clamp(0.0, 1.0)
}

/// Least and greatest value within `reach` of a point.
fn bounds(middle: [f64; 3], reach: f64) -> (f64, f64) {
    let at = distance(middle);
    let value = |d: f64| 2000.0 + 45_000.0 * (0.5 - d / 0.01).clamp(0.0, 1.0);
    ((value(at + reach) - 3.0 * NOISE).round(), (value(at - reach) + 3.0 * NOISE).round())
}

impl BrickSource for Simulated {
    fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    fn records(&self, parent: NodeKey) -> [Option<Result<NodeRecord, StoreError>>; 8] {
        if parent.level() == 0 {
            return [const { None }; 8];
        }
        parent.children().map(|key| self.geometry.contains(key).then(|| Ok(self.record(key))))
    }

    fn brick(&self, record: &NodeRecord, _: &mut BrickScratch) -> Result<Brick, StoreError> {
        let texel_range = [record.brick_min, record.brick_max];
        Ok(Brick { format: BrickFormat::R8, texels: Vec::new(), texel_range })
    }
}

impl NodeSource for Simulated {
    fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    fn spacing_xyz(&self) -> [f64; 3] {
        self.metadata.spacing_xyz
    }

    fn root(&mut self) -> Lookup<Child> {
        let record = self.record(self.geometry.root());
        Lookup::Ready(Child::Known(NodeSummary::of(&record, &self.metadata)))
    }

    fn children(&mut self, parent: NodeKey) -> Lookup<Arc<Siblings>> {
        let records = BrickSource::records(self, parent);
        Lookup::Ready(Arc::new(records.map(|record| match record {
            Some(Ok(record)) => {
                debug_assert!(record.state == BrickState::Stored);
                Child::Known(NodeSummary::of(&record, &self.metadata))
            }
            _ => Child::Absent,
        })))
    }
}
