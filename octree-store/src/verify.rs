//! Whether a store is whole: every record, every payload, the tree's shape, the metadata's sums.

use crate::digest::Digest;
use crate::error::{Damage, StoreError};
use crate::key::NodeKey;
use crate::record::{BrickState, NodeRecord};
use crate::sample::Sample;
use crate::store::{BrickScratch, Store};
use crate::summary::Summary;
use crate::with_sample_type;

/// One damaged node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DamagedNode {
    /// The node.
    pub key: NodeKey,
    /// How it is damaged.
    pub damage: Damage,
}

/// What a verification found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// Nodes looked at: all that the geometry asks for.
    pub bricks_checked: u64,
    /// The damaged ones, in key order.
    pub damaged: Vec<DamagedNode>,
    /// What is wrong with the metadata.
    pub metadata: Option<String>,
}

impl Report {
    /// Whether nothing is wrong.
    pub fn is_ok(&self) -> bool {
        self.damaged.is_empty() && self.metadata.is_none()
    }
}

/// Checks every record and payload of a store; after each brick it calls `go_on`, and ends with
/// `None` where that says false.
///
/// # Errors
/// When the file cannot be read at all. Damage is no error: it stands in the report, and so does what the disk does not
/// give back.
pub fn verify(store: &Store, go_on: impl FnMut() -> bool) -> Result<Option<Report>, StoreError> {
    with_sample_type!(store.metadata().sample_type, T => verify_typed::<T>(store, go_on))
}

fn verify_typed<T: Sample>(
    store: &Store,
    mut go_on: impl FnMut() -> bool,
) -> Result<Option<Report>, StoreError> {
    let geometry = store.geometry();
    let mut samples = vec![T::default(); geometry.brick_samples()];
    let mut report = Report::default();
    let mut summary = Summary::new(geometry, store.metadata());
    let mut digest = Digest::default();
    let mut scratch = BrickScratch::default();
    for level in geometry.levels() {
        for key in geometry.keys_at(level) {
            report.bricks_checked += 1;
            match check_node(store, key, &mut scratch, &mut samples) {
                Ok(record) => {
                    summary.add(&record);
                    digest.add(&record);
                    if record.state == BrickState::Lost {
                        report.damaged.push(DamagedNode { key, damage: Damage::Lost });
                    }
                }
                Err(error) => report.damaged.push(DamagedNode { key, damage: damage_of(error)? }),
            }
            if !go_on() {
                return Ok(None);
            }
        }
    }
    // A lost brick's record says so, and counts.
    if report.damaged.iter().all(|node| node.damage == Damage::Lost) {
        let mut expected = store.metadata().clone();
        summary.write_into(&mut expected);
        if expected != *store.metadata() {
            report.metadata = Some("its sums over levels do not follow from the records".into());
        } else if digest.finish(store.metadata_json()).ok().as_ref()
            != Some(&store.metadata().digest)
        {
            report.metadata = Some("its digest does not follow from the records".into());
        } else if !store.metadata_are_there_twice()? {
            report.metadata = Some("one of its two metadata records is damaged".into());
        }
    }
    Ok(Some(report))
}

/// What an error says of a node: that it is damaged, or that the disk does not give it back.
fn damage_of(error: StoreError) -> Result<Damage, StoreError> {
    match error {
        StoreError::Damaged { damage, .. } => Ok(damage),
        StoreError::Unreadable { source, .. } => {
            Ok(Damage::Unreadable { what: source.to_string() })
        }
        other => Err(other),
    }
}

/// Reads a node, decodes its brick, and compares it with its children.
///
/// # Errors
/// [`StoreError::Damaged`] where anything is wrong but the brick being lost.
pub(crate) fn check_node<T: Sample>(
    store: &Store,
    key: NodeKey,
    scratch: &mut BrickScratch,
    samples: &mut [T],
) -> Result<NodeRecord, StoreError> {
    let record = store.node(key)?;
    check_place(store, &record)?;
    // Overlap that is assembled is looked at in the bricks it comes from.
    if record.state != BrickState::Lost {
        store.decode_brick_core(&record, scratch, samples)?;
    }
    Ok(record)
}

/// Holds a node's record against the geometry, itself, and those of its children that are whole.
///
/// # Errors
/// [`StoreError::Damaged`] where it contradicts them.
pub(crate) fn check_place(store: &Store, record: &NodeRecord) -> Result<(), StoreError> {
    let key = record.key;
    let wrong = |what| Err(store.damaged(key, Damage::Tree { what }));
    let error = record.error;
    let ranges = [record.brick_min, record.brick_max, record.subtree_min, record.subtree_max];
    let errors = [error.squares, error.amax, record.lod_rms_bound, record.lod_amax_bound];
    if !ranges.iter().all(|v| v.is_finite()) || !errors.iter().all(|v| v.is_finite() && *v >= 0.0) {
        return wrong("a range is not finite, or an error no number from 0 up");
    }
    if record.child_mask != store.geometry().child_mask(key) {
        return wrong("its child mask is not the geometry's");
    }
    if record.brick_min > record.brick_max || record.subtree_min > record.subtree_max {
        return wrong("a range is upside down");
    }
    if record.subtree_min > record.brick_min || record.subtree_max < record.brick_max {
        return wrong("its subtree's range does not hold its own");
    }
    // A stored brick of which one code says all has no payload.
    let has_payload = record.state == BrickState::Stored && record.bits > 0;
    if has_payload != (record.place.length > 0) {
        return wrong("its state and its payload's length disagree");
    }
    // A damaged child is reported in its own place.
    for child in store.whole_children(key)?.iter() {
        if record.subtree_min > child.subtree_min || record.subtree_max < child.subtree_max {
            return wrong("its subtree's range does not hold a child's");
        }
    }
    Ok(())
}
