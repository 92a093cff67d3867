//! One slice of a level, for the page: raw samples, windowed by who shows them.

use super::DIMS;
use super::asked::{Path, Query};
use crate::answer::{Answer, Conditions};
use crate::app::App;
use crate::problem::Problem;
use axum::extract::State;
use axum::response::Response;
use octree_store::{Region, Store};
use serde::Deserialize;
use std::sync::Arc;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Axis {
    X,
    Y,
    Z,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    #[serde(default)]
    level: u8,
}

pub(super) async fn slice(
    State(app): State<Arc<App>>,
    Path((name, axis, index)): Path<(String, Axis, u64)>,
    Query(Wanted { level }): Query<Wanted>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let geometry = &named.dataset.geometry;
    if !geometry.levels().contains(&level) {
        return Err(Problem::absent(format!("the dataset has no level {level}")));
    }
    let dims = geometry.dims_at(level);
    let axis = axis as usize;
    if index >= dims[axis] {
        return Err(Problem::absent(format!("the level has {} such slices", dims[axis])));
    }
    let mut region = Region::whole(dims);
    (region.min[axis], region.max[axis]) = (index, index + 1);
    if region.voxels() > app.options.limits.slice_samples {
        let detail = format!("{} samples: ask for a coarser level", region.voxels());
        return Err(Problem::too_large(detail));
    }
    let version = named.dataset.metadata.digest.get(..32).unwrap_or_default();
    let etag = format!("{version}-slice-{level}-{axis}-{index}");
    if conditions.has(&etag) {
        return Ok(Answer::binary(bytes::Bytes::new(), etag, named.lifetime()).not_modified());
    }
    let read = move |store: &Store| store.read_region_samples(level, region);
    let samples = app.read(&named.dataset, read).await?;
    let samples = samples.map_err(|error| app.report(&named.dataset, &error))?;
    let sides: Vec<u64> = (0..3).filter(|side| *side != axis).map(|side| dims[side]).collect();
    Ok(Answer::binary(samples.to_le_bytes().into(), etag, named.lifetime())
        .with(DIMS, &format!("{},{}", sides[0], sides[1]))
        .to(&conditions))
}
