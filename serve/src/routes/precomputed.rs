//! Datasets as Neuroglancer's precomputed.

use super::asked::Path;
use super::bricks::brick_answer;
use crate::answer::{Answer, Conditions};
use crate::app::App;
use crate::problem::Problem;
use crate::product::Shape;
use crate::views::precomputed::{chunk, info};
use axum::extract::State;
use axum::response::Response;
use std::sync::Arc;

pub(super) async fn precomputed(
    State(app): State<Arc<App>>,
    Path((name, path)): Path<(String, String)>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let geometry = &named.dataset.geometry;
    if path == "info" {
        let document = info(&named.dataset.metadata, geometry);
        return Ok(Answer::json(&document)?.lasting(named.lifetime()).to(&conditions));
    }
    let key = chunk(&path, geometry);
    let key = key.ok_or_else(|| Problem::absent("the volume has no such document or chunk"))?;
    brick_answer(&app, &named, key, Shape::Precomputed, &conditions, |answer| answer).await
}
