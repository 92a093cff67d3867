//! Datasets' codes as zarr, with what makes values of them beside them.

use super::asked::Path;
use super::bricks::brick_answer;
use super::zarr::{find, nothing};
use crate::answer::{Answer, Conditions};
use crate::app::App;
use crate::code_map::block_bytes;
use crate::dataset::Named;
use crate::problem::Problem;
use crate::product::{Shape, codes_type};
use crate::views::codes::{self as view, Part};
use axum::extract::State;
use axum::response::Response;
use octree_store::Store;
use serde_json::json;
use std::sync::Arc;

pub(super) async fn zarr2(
    State(app): State<Arc<App>>,
    Path((name, path)): Path<(String, String)>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    codes(&app, 2, &name, &path, &conditions).await
}

pub(super) async fn zarr3(
    State(app): State<Arc<App>>,
    Path((name, path)): Path<(String, String)>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    codes(&app, 3, &name, &path, &conditions).await
}

async fn codes(
    app: &Arc<App>,
    zarr_format: u8,
    name: &str,
    path: &str,
    conditions: &Conditions,
) -> Result<Response, Problem> {
    let named = find(app, name)?;
    let dataset = &named.dataset;
    let (geometry, metadata) = (&dataset.geometry, &dataset.metadata);
    let part = view::part(zarr_format, path, geometry).ok_or_else(nothing)?;
    let sample_type = codes_type(metadata).ok_or_else(|| {
        Problem::absent("bricks hold samples of more than 16 bits as they are, and no codes")
    })?;
    let compressor = app.options.compressor;
    let document = match part {
        Part::CodesChunk(key) => {
            let shape = Shape::ZarrCodes(compressor);
            return brick_answer(app, &named, key, shape, conditions, |answer| answer).await;
        }
        Part::MapChunk(block) => return map_answer(app, &named, block, conditions).await,
        Part::Group => view::group(zarr_format, &json!({})),
        Part::Root => view::root(zarr_format, &dataset.name, metadata),
        Part::Codes(level) => view::codes(zarr_format, level, geometry, sample_type, compressor),
        Part::Map(level) => view::map(zarr_format, level, geometry),
    };
    Ok(Answer::json(&document)?.lasting(named.lifetime()).to(conditions))
}

/// A chunk of a level's map.
async fn map_answer(
    app: &Arc<App>,
    named: &Named,
    block: view::Block,
    conditions: &Conditions,
) -> Result<Response, Problem> {
    let read = move |store: &Store| block_bytes(store, block);
    let (bytes, errors) = app.read(&named.dataset, read).await?;
    for error in &errors {
        app.report(&named.dataset, error);
    }
    let answer = Answer::document(bytes, "application/octet-stream");
    Ok(answer.lasting(named.lifetime()).to(conditions))
}
