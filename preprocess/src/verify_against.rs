//! Verification against the source: every error in the store measured anew.
//!
//! The source is walked just as it was converted, but instead of being encoded each brick is
//! compared with what a reader of the store gets. Each record's error must come out the same.

use crate::again::Again;
use crate::convert::{ConvertOptions, ValueRules};
use crate::downsample::Core;
use crate::error::PreprocessError;
use crate::progress::Progress;
use crate::source::Source;
use crate::walk::{Octet, Sink, Visitor};
use octree_store::encoding::finite_range;
use octree_store::verify::DamagedNode;
use octree_store::{
    BrickScratch, BrickState, Damage, ErrorSum, ErrorTotal, Geometry, NodeKey, NodeRecord, Sample,
    Store, StoreError, with_sample_type,
};
use serde::Serialize;

/// What was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AgainstReport {
    /// RMS over the level-0 voxels of stored and uniform bricks.
    pub rms: f64,
    /// AMAX over the same.
    pub amax: f64,
    /// RMS over the voxels of dropped bricks.
    pub dropped_rms: f64,
    /// AMAX over the same.
    pub dropped_amax: f64,
    /// What overlap that is assembled on reading is worth; none where it is stored.
    pub overlap: Option<OverlapReport>,
    /// Bricks that do not match the source, or are damaged.
    #[serde(skip)]
    pub damaged: Vec<DamagedNode>,
}

/// Assembled overlap of level 0, measured: finite samples within the volume, of bricks that were kept.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OverlapReport {
    /// RMS of (what a reader gets - source).
    pub rms: f64,
    /// The largest of the same.
    pub amax: f64,
    /// RMS of (what a reader gets - what it would get if the brick stored its overlap in its own codes).
    pub extra_rms: f64,
    /// The largest of the same.
    pub extra_amax: f64,
}

/// Measures a store's errors anew from its source; of `how`, threads, memory and scratch are used.
///
/// # Errors
/// When the source cannot be read, or is not of the store's size and type.
pub fn verify_against(
    store: &Store,
    source: Source,
    how: &ConvertOptions,
    progress: &dyn Progress,
) -> Result<AgainstReport, PreprocessError> {
    let again = Again::new(store, source, how)?;
    let against = Against { store, rules: again.rules };
    let mut sums = Sums {
        progress,
        kept: ErrorTotal::default(),
        dropped: ErrorTotal::default(),
        overlap: ErrorTotal::default(),
        overlap_extra: ErrorTotal::default(),
        damaged: Vec::new(),
    };
    with_sample_type!(store.metadata().sample_type, T => {
        again.walk::<T, _>(&against, &mut sums)?;
    });
    let Sums { kept, dropped, overlap, overlap_extra, mut damaged, .. } = sums;
    damaged.sort_by_key(|node: &DamagedNode| node.key);
    let (kept, dropped) = (kept.total(), dropped.total());
    let (overlap, extra) = (overlap.total(), overlap_extra.total());
    Ok(AgainstReport {
        rms: kept.rms(),
        amax: kept.amax,
        dropped_rms: dropped.rms(),
        dropped_amax: dropped.amax,
        overlap: (!store.metadata().stored_overlap).then(|| OverlapReport {
            rms: overlap.rms(),
            amax: overlap.amax,
            extra_rms: extra.rms(),
            extra_amax: extra.amax,
        }),
        damaged,
    })
}

/// What all bricks add up to.
struct Sums<'a> {
    progress: &'a dyn Progress,
    kept: ErrorTotal,
    dropped: ErrorTotal,
    overlap: ErrorTotal,
    overlap_extra: ErrorTotal,
    damaged: Vec<DamagedNode>,
}

impl Sink<Measured> for Sums<'_> {
    fn take(&mut self, octet: Octet<Measured>) -> Result<(), PreprocessError> {
        for visited in octet.bricks {
            let Measured { error, empty, overlap, damage } = visited.output;
            if visited.key.level() == 0 {
                let total = if empty { &mut self.dropped } else { &mut self.kept };
                total.add(&error);
                self.overlap.add(&overlap.error);
                self.overlap_extra.add(&overlap.extra);
            }
            self.damaged.extend(damage.map(|damage| DamagedNode { key: visited.key, damage }));
            self.progress.bricks_done(1);
        }
        if self.progress.should_stop() { Err(PreprocessError::Cancelled) } else { Ok(()) }
    }

    fn wait_until_durable(&mut self, _: u64) -> Result<(), PreprocessError> {
        Ok(())
    }
}

/// Compares each brick of the source with what the store gives for it.
#[derive(Clone, Copy)]
pub(crate) struct Against<'a> {
    pub(crate) store: &'a Store,
    pub(crate) rules: ValueRules,
}

/// What came of one brick.
pub(crate) struct Measured {
    error: ErrorSum,
    empty: bool,
    overlap: Overlap,
    pub(crate) damage: Option<Damage>,
}

/// Errors of a brick's overlap within the volume.
#[derive(Default)]
struct Overlap {
    error: ErrorSum,
    /// From what the brick's own codes would keep.
    extra: ErrorSum,
}

/// Buffers that a thread keeps.
pub(crate) struct AgainstScratch<T> {
    decoded: Vec<T>,
    /// The source's samples as the brick's own codes would keep them.
    own: Vec<T>,
    brick: BrickScratch,
}

impl<T> Default for AgainstScratch<T> {
    fn default() -> Self {
        Self { decoded: Vec::new(), own: Vec::new(), brick: BrickScratch::default() }
    }
}

impl<T: Sample> Visitor<T> for Against<'_> {
    type Output = Measured;
    type Scratch = AgainstScratch<T>;

    fn visit(
        &self,
        key: NodeKey,
        core: &Core,
        samples: &mut [T],
        scratch: &mut AgainstScratch<T>,
        _: &mut Vec<u8>,
    ) -> Result<Measured, PreprocessError> {
        if key.level() == 0 {
            self.rules.apply(samples);
        }
        let mut measured = Measured {
            error: ErrorSum::default(),
            empty: self.rules.drops(samples),
            overlap: Overlap::default(),
            damage: None,
        };
        scratch.decoded.resize(samples.len(), T::default());
        let record = match self.store.read_brick_core(key, &mut scratch.brick, &mut scratch.decoded)
        {
            Ok(record) => record,
            Err(StoreError::Damaged { damage, .. }) => {
                measured.damage = Some(damage);
                return Ok(measured);
            }
            Err(other) => return Err(other.into()),
        };
        for row in core.rows() {
            measured.error.add_all(&samples[row.clone()], &scratch.decoded[row]);
        }
        let (min, max) = finite_range(samples).unwrap_or_default();
        let wrong = |what| Some(Damage::Source { what });
        if (record.brick_min, record.brick_max) != (min.to_f64(), max.to_f64()) {
            measured.damage = wrong("its range is not that of the source's voxels");
        } else if measured.empty != (record.state == BrickState::Empty) {
            measured.damage = wrong("the threshold keeps what was dropped, or drops what was kept");
        } else if record.error != measured.error {
            measured.damage = wrong("its error is not the one measured");
        }
        let assembled = !self.store.metadata().stored_overlap;
        if assembled && key.level() == 0 && record.state != BrickState::Empty {
            measured.overlap = self.overlap(&record, samples, scratch)?;
        }
        Ok(measured)
    }
}

impl Against<'_> {
    /// The errors of a brick's assembled overlap; of none where a neighbour is damaged, which its own place
    /// tells.
    fn overlap<T: Sample>(
        &self,
        record: &NodeRecord,
        samples: &[T],
        scratch: &mut AgainstScratch<T>,
    ) -> Result<Overlap, PreprocessError> {
        let AgainstScratch { decoded, own, brick } = scratch;
        match self.store.decode_brick(record, brick, decoded) {
            Err(StoreError::Damaged { .. }) => return Ok(Overlap::default()),
            other => other?,
        }
        own.clear();
        own.extend_from_slice(samples);
        self.store.recode(record, brick, own)?;
        let mut overlap = Overlap::default();
        for i in overlap_in_volume(self.store.geometry(), record.key) {
            if samples[i].is_finite() {
                let read = decoded[i].to_f64();
                overlap.error.add(read - samples[i].to_f64());
                overlap.extra.add(read - own[i].to_f64());
            }
        }
        Ok(overlap)
    }
}

/// Where a brick's samples are no core but lie in the volume.
fn overlap_in_volume(geometry: &Geometry, key: NodeKey) -> impl Iterator<Item = usize> {
    let (side, overlap) = (geometry.brick_side(), geometry.overlap() as usize);
    let (origin, dims) = (geometry.sample_origin(key), geometry.dims_at(key.level()));
    let core = overlap..side - overlap;
    (0..geometry.brick_samples()).filter(move |i| {
        let at = [i % side, i / side % side, i / side / side];
        let inside = |axis: usize| {
            let voxel = origin[axis] + at[axis] as i64;
            0 <= voxel && voxel < dims[axis] as i64
        };
        (0..3).all(inside) && !at.iter().all(|i| core.contains(i))
    })
}
