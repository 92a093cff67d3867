//! Node records of a level, a range at a time.

use super::asked::{Path, Query};
use crate::answer::{Answer, Conditions};
use crate::app::App;
use crate::problem::Problem;
use crate::records::records;
use axum::extract::State;
use axum::response::Response;
use octree_store::{Geometry, NodeKey, NodeRecord, Store, StoreError};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Format {
    #[default]
    Binary,
    Json,
}

impl Format {
    /// Records of one answer, at most.
    fn limit(self) -> u64 {
        match self {
            Self::Binary => 65_536,
            Self::Json => 4096,
        }
    }
}

/// Which records are wanted: `count` from the `first` of the level on, in key order.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    level: u8,
    #[serde(default)]
    first: u64,
    count: Option<u64>,
    #[serde(default)]
    format: Format,
}

pub(super) async fn nodes(
    State(app): State<Arc<App>>,
    Path(name): Path<String>,
    Query(wanted): Query<Wanted>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let geometry = named.dataset.geometry;
    if !geometry.levels().contains(&wanted.level) {
        return Err(Problem::absent(format!("the dataset has no level {}", wanted.level)));
    }
    let all = geometry.bricks_at(wanted.level);
    let limit = wanted.format.limit();
    if wanted.count.is_some_and(|count| count > limit) {
        return Err(Problem::too_large(format!("at most {limit} records in one answer")));
    }
    let count = wanted.count.unwrap_or(limit).min(all.saturating_sub(wanted.first));
    let Wanted { level, first, format, .. } = wanted;
    let asked = conditions.clone();
    let read = move |store: &Store| {
        let keys = keys_from(&geometry, level, first).take(count as usize);
        let (mut list, mut bytes, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        for (key, record) in records(store, keys) {
            match format {
                Format::Json => list.push(to_json(key, &record)),
                Format::Binary => bytes.extend_from_slice(&to_bytes(key, &record)),
            }
            errors.extend(record.err());
        }
        let answer = match format {
            Format::Json => Answer::json(&list),
            Format::Binary => Ok(Answer::document(bytes, "application/octet-stream")),
        };
        // Packing megabytes takes long enough to be work for the pool.
        (answer.map(|answer| answer.packed(&asked)), errors)
    };
    let (answer, errors) = app.read(&named.dataset, read).await?;
    for error in &errors {
        app.report(&named.dataset, error);
    }
    let answer = answer?.with("x-octavo-nodes", &all.to_string());
    Ok(answer.lasting(named.lifetime()).to(&conditions))
}

/// The keys of a level in key order, without the first `skip`: whole subtrees are passed over at once.
fn keys_from(geometry: &Geometry, level: u8, mut skip: u64) -> impl Iterator<Item = NodeKey> {
    let (geometry, grid) = (*geometry, geometry.grid_at(level));
    let mut pending = vec![geometry.root()];
    std::iter::from_fn(move || {
        while let Some(key) = pending.pop() {
            let down = key.level() - level;
            let beneath: u64 = (0..3)
                .map(|axis| {
                    let at = key.brick_xyz()[axis];
                    ((at + 1) << down).min(grid[axis]).saturating_sub(at << down)
                })
                .product();
            if beneath <= skip {
                skip -= beneath;
            } else if down == 0 {
                return Some(key);
            } else {
                let children = key.children().into_iter().rev();
                pending.extend(children.filter(|child| geometry.contains(*child)));
            }
        }
        None
    })
}

/// A record's bytes; of one that cannot be read its key, the state 255, and zeros.
fn to_bytes(key: NodeKey, record: &Result<NodeRecord, StoreError>) -> [u8; NodeRecord::BYTES] {
    if let Ok(record) = record {
        return record.to_bytes();
    }
    let mut bytes = [0; NodeRecord::BYTES];
    bytes[..8].copy_from_slice(&key.to_u64().to_le_bytes());
    bytes[8] = 255;
    bytes
}

fn to_json(key: NodeKey, record: &Result<NodeRecord, StoreError>) -> Value {
    let [x, y, z] = key.brick_xyz();
    let key = [u64::from(key.level()), x, y, z];
    match record {
        Err(error) => {
            json!({"key": key, "state": "damaged", "what": Problem::of_store(error).detail()})
        }
        Ok(record) => json!({
            "key": key,
            "state": record.state.name(),
            "child_mask": record.child_mask,
            "brick_min": record.brick_min,
            "brick_max": record.brick_max,
            "subtree_min": record.subtree_min,
            "subtree_max": record.subtree_max,
            "rms": record.error.rms(),
            "amax": record.error.amax,
            "lod_rms_bound": record.lod_rms_bound,
            "lod_amax_bound": record.lod_amax_bound,
            "bits": record.bits,
            "payload_bytes": record.place.length,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_a_level_are_the_level_in_key_order() {
        let geometry = Geometry::new([100, 41, 70], 8, 1).unwrap();
        for level in geometry.levels() {
            let [nx, ny, nz] = geometry.grid_at(level);
            let mut keys: Vec<NodeKey> = (0..nx * ny * nz)
                .map(|i| NodeKey::new(level, [i % nx, i / nx % ny, i / nx / ny]))
                .collect();
            keys.sort_unstable();
            for first in (0..=keys.len() as u64 + 1).step_by(7) {
                let from = keys.get(first as usize..).unwrap_or_default();
                assert!(keys_from(&geometry, level, first).eq(from.iter().copied()), "{first}");
            }
        }
    }
}
