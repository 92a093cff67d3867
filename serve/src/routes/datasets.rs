//! What datasets there are, and what is known of one.

use super::asked::Path;
use crate::answer::{Answer, Conditions};
use crate::app::App;
use crate::problem::Problem;
use crate::views::info::listed;
use axum::extract::State;
use axum::response::Response;
use octree_store::info_json::InfoJson;
use serde_json::Value;
use std::sync::Arc;

pub(super) async fn list(
    State(app): State<Arc<App>>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let datasets = app.catalog.list();
    let datasets: Vec<Value> = datasets.iter().map(|(name, entry)| listed(name, entry)).collect();
    Ok(Answer::json(&datasets)?.to(&conditions))
}

pub(super) async fn info(
    State(app): State<Arc<App>>,
    Path(name): Path<String>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let dataset = &named.dataset;
    let info = InfoJson::new(&dataset.metadata, dataset.format_version, dataset.file_bytes);
    Ok(Answer::json(&info)?.lasting(named.lifetime()).to(&conditions))
}

pub(super) async fn statistics(
    State(app): State<Arc<App>>,
    Path(name): Path<String>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let answer = app.with_statistics(&named, |_, statistics| Answer::json(statistics)).await??;
    Ok(answer.lasting(named.lifetime()).to(&conditions))
}
