//! What is whole of a damaged store, copied into a new one; the rest is marked as lost.
//!
//! A lost brick's record is kept where it is whole. Where it is not, its ranges are those of the nearest
//! ancestor whose record is and fits the tree, or of the volume: they hold where that record and the metadata
//! tell the truth, so that a renderer's emptiness tests stay right.

use crate::encoding::{Coding, Compression, Filter};
use crate::error::{Damage, StoreError};
use crate::error_sum::ErrorSum;
use crate::key::NodeKey;
use crate::metadata::Metadata;
use crate::record::{BrickState, NodeRecord, PayloadPlace};
use crate::sample::Sample;
use crate::store::{BrickScratch, Store, StoreWriter};
use crate::verify::{DamagedNode, check_node, check_place};
use crate::with_sample_type;

/// The metadata's option that holds the digest of the store of which a store with lost bricks was salvaged.
pub const SALVAGED_OF: &str = "salvaged_of";

/// Payload after which what was copied is committed, so that its records do not wait in memory.
const COMMIT_BYTES: u64 = 64 << 20;
/// Octets after which it is too.
const COMMIT_OCTETS: u64 = 1 << 16;

/// What was saved.
#[derive(Debug, Clone, PartialEq)]
pub struct Salvaged {
    /// The new store's metadata.
    pub metadata: Metadata,
    /// The bricks that are lost, in key order, and what was wrong with them.
    pub lost: Vec<DamagedNode>,
}

/// Copies all whole bricks of a store into a new one; after each brick it calls `go_on`, and ends with `None`
/// where that says false. The store is best opened by [`Store::open_remains`]: then what the disk does not give back is
/// lost, and the rest is saved.
///
/// # Errors
/// When a file cannot be read or written. Damage is no error.
pub fn salvage(
    store: &Store,
    mut writer: StoreWriter,
    mut go_on: impl FnMut() -> bool,
) -> Result<Option<Salvaged>, StoreError> {
    let geometry = store.geometry();
    let mut lost = Vec::new();
    let mut scratch = BrickScratch::default();
    let (mut records, mut payloads, mut octets) = (Vec::new(), Vec::new(), 0);
    for level in geometry.levels() {
        for parent in geometry.parents_of(level) {
            records.clear();
            payloads.clear();
            for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
                let saved = with_sample_type!(store.metadata().sample_type, T => {
                    check::<T>(store, key, &mut scratch)
                });
                let saved = saved.and_then(|record| {
                    if record.state != BrickState::Lost {
                        payloads.extend_from_slice(store.read_payload(&record, &mut scratch)?);
                    }
                    Ok(record)
                });
                match saved {
                    Ok(record) => {
                        if record.state == BrickState::Lost {
                            lost.push(DamagedNode { key, damage: Damage::Lost });
                        }
                        records.push(record);
                    }
                    Err(StoreError::Damaged { damage, .. }) => {
                        records.push(lost_record(store, key, &damage)?);
                        lost.push(DamagedNode { key, damage });
                    }
                    Err(other) => return Err(other),
                }
                if !go_on() {
                    return Ok(None);
                }
            }
            writer.append(&mut records, &payloads, Vec::new())?;
            octets += 1;
            if writer.uncommitted_bytes() >= COMMIT_BYTES || octets % COMMIT_OCTETS == 0 {
                writer.commit(&[], octets)?;
            }
        }
    }
    let mut metadata = store.metadata().clone();
    if !lost.is_empty() {
        let whole = metadata.digest.clone().into();
        metadata.options.entry(SALVAGED_OF.into()).or_insert(whole);
    }
    let metadata = writer.finish(metadata)?;
    Ok(Some(Salvaged { metadata, lost }))
}

/// Checks a brick, all of it.
fn check<T: Sample>(
    store: &Store,
    key: NodeKey,
    scratch: &mut BrickScratch,
) -> Result<NodeRecord, StoreError> {
    let mut samples = vec![T::default(); store.geometry().brick_samples()];
    check_node(store, key, scratch, &mut samples)
}

/// The record of a brick that is lost.
fn lost_record(store: &Store, key: NodeKey, damage: &Damage) -> Result<NodeRecord, StoreError> {
    let known = match store.node(key) {
        // What contradicts the tree is not believed.
        Ok(record) if !matches!(damage, Damage::Tree { .. }) => record,
        Ok(_) | Err(StoreError::Damaged { .. }) => unknown(store, key)?,
        Err(other) => return Err(other),
    };
    Ok(NodeRecord {
        state: BrickState::Lost,
        bits: 0,
        filter: Filter::NONE,
        compression: Compression::Raw,
        child_mask: store.geometry().child_mask(key),
        place: PayloadPlace::default(),
        payload_checksum: 0,
        error: ErrorSum::default(),
        ..known
    })
}

/// What holds for a brick of which nothing is known.
fn unknown(store: &Store, key: NodeKey) -> Result<NodeRecord, StoreError> {
    let (min, max) = range_above(store, key)?;
    let lod_bound = if key.level() > 0 { (max - min).min(f64::MAX) } else { 0.0 };
    Ok(NodeRecord {
        key,
        state: BrickState::Lost,
        coding: Coding::Lossless,
        bits: 0,
        filter: Filter::NONE,
        compression: Compression::Raw,
        child_mask: 0,
        place: PayloadPlace::default(),
        payload_checksum: 0,
        brick_min: min,
        brick_max: max,
        subtree_min: min,
        subtree_max: max,
        error: ErrorSum::default(),
        lod_rms_bound: lod_bound,
        lod_amax_bound: lod_bound,
    })
}

/// The range of the nearest ancestor whose record is whole and fits the tree, or of the volume.
fn range_above(store: &Store, mut key: NodeKey) -> Result<(f64, f64), StoreError> {
    while key != store.geometry().root() {
        key = key.parent();
        let known = store.node(key).and_then(|record| check_place(store, &record).map(|()| record));
        match known {
            Ok(record) => return Ok((record.subtree_min, record.subtree_max)),
            Err(StoreError::Damaged { .. }) => {}
            Err(other) => return Err(other),
        }
    }
    let metadata = store.metadata();
    let replaced = metadata.options.get("nan_value").and_then(serde_json::Value::as_f64);
    let empty = metadata.empty_below.map(|_| metadata.empty_value);
    // A brick without a number has the range 0..0.
    let nothing = (metadata.nan_count + metadata.inf_count > 0).then_some(0.0);
    let values = [metadata.value_min, metadata.value_max, replaced, empty, nothing];
    let range = values.into_iter().flatten().fold(None, |range, v| match range {
        None => Some((v, v)),
        Some((min, max)) => Some((f64::min(min, v), f64::max(max, v))),
    });
    Ok(range.unwrap_or_default())
}
