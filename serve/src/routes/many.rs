//! Many bricks in one answer.

use super::asked::{Path, Query};
use super::bricks::Form;
use super::read_json;
use crate::app::App;
use crate::frames::{nodes_of, stream_of};
use crate::problem::Problem;
use axum::body::Body;
use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use std::sync::Arc;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    #[serde(default)]
    form: Form,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    keys: Vec<[u64; 4]>,
}

pub(super) async fn bricks(
    State(app): State<Arc<App>>,
    Path(name): Path<String>,
    Query(Wanted { form }): Query<Wanted>,
    body: Body,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let Keys { keys } = read_json(&app, body).await?;
    let nodes = nodes_of(&app, &named.dataset, &keys)?;
    stream_of(&app, &named.dataset, Vec::new(), nodes, form.into())
}
