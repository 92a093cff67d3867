//! Datasets as OME-Zarr: documents made on request, chunks of bricks without their overlap.

use super::asked::Path;
use super::bricks::brick_answer;
use crate::answer::{Answer, Conditions};
use crate::app::App;
use crate::dataset::Named;
use crate::problem::Problem;
use crate::product::Shape;
use crate::views::ome_zarr::{Flavour, Part};
use axum::extract::State;
use axum::response::Response;
use serde_json::json;
use std::sync::Arc;

pub(super) async fn zarr2(
    State(app): State<Arc<App>>,
    Path((name, path)): Path<(String, String)>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    zarr(&app, Flavour { zarr_format: 2, five_d: false }, &name, &path, &conditions).await
}

pub(super) async fn zarr2_5d(
    State(app): State<Arc<App>>,
    Path((name, path)): Path<(String, String)>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    zarr(&app, Flavour { zarr_format: 2, five_d: true }, &name, &path, &conditions).await
}

pub(super) async fn zarr3(
    State(app): State<Arc<App>>,
    Path((name, path)): Path<(String, String)>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    zarr(&app, Flavour { zarr_format: 3, five_d: false }, &name, &path, &conditions).await
}

pub(super) async fn zarr3_5d(
    State(app): State<Arc<App>>,
    Path((name, path)): Path<(String, String)>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    zarr(&app, Flavour { zarr_format: 3, five_d: true }, &name, &path, &conditions).await
}

/// A dataset by its name, which may end as a zarr's: some clients know one by that alone.
pub(super) fn find(app: &App, name: &str) -> Result<Named, Problem> {
    let bare = name.strip_suffix(".zarr").map(|stem| stem.strip_suffix(".ome").unwrap_or(stem));
    match (app.catalog.find(name), bare) {
        (Err(_), Some(bare)) => app.catalog.find(bare),
        (found, _) => found,
    }
}

pub(super) fn nothing() -> Problem {
    Problem::absent("the volume has no such document or chunk")
}

async fn zarr(
    app: &Arc<App>,
    flavour: Flavour,
    name: &str,
    path: &str,
    conditions: &Conditions,
) -> Result<Response, Problem> {
    let named = find(app, name)?;
    let geometry = &named.dataset.geometry;
    let part = flavour.part(path, geometry).ok_or_else(nothing)?;
    let compressor = app.options.compressor;
    let document = match part {
        Part::Chunk(key) => {
            let shape = Shape::Zarr(compressor);
            return brick_answer(app, &named, key, shape, conditions, |answer| answer).await;
        }
        Part::Group => json!({"zarr_format": 2}),
        Part::Array(level) => {
            let sample_type = named.dataset.metadata.sample_type;
            flavour.array(level, geometry, sample_type, compressor)
        }
        Part::Pyramid => {
            app.with_statistics(&named, move |dataset, statistics| {
                flavour.pyramid(&dataset.name, &dataset.metadata, statistics.window)
            })
            .await?
        }
    };
    Ok(Answer::json(&document)?.lasting(named.lifetime()).to(conditions))
}
