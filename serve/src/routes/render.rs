//! A picture drawn by the server, where it has a renderer.

use super::read_json;
use crate::app::App;
use crate::problem::Problem;
use crate::render::RenderRequest;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::response::{IntoResponse, Response};
use http::{StatusCode, header};
use octree_store::loader::{Camera, TransferFunction};
use serde::Deserialize;
use std::sync::Arc;

/// Pixels of a picture's side, at most.
const SIDE_LIMIT: u32 = 4096;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    camera: Camera,
    size: [u32; 2],
    transfer: TransferFunction,
    #[serde(default = "one")]
    accuracy: f64,
}

fn one() -> f64 {
    1.0
}

pub(super) async fn render(
    State(app): State<Arc<App>>,
    Path(name): Path<String>,
    body: Body,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let wanted: Wanted = read_json(body, app.options.limits.body_bytes).await?;
    let Some(renderer) = app.renderer.clone() else {
        let detail = "this server draws no pictures";
        return Err(Problem::new(StatusCode::NOT_IMPLEMENTED, "no renderer", detail));
    };
    let Wanted { camera, size, transfer, accuracy } = wanted;
    if size.iter().any(|side| !(1..=SIDE_LIMIT).contains(side)) {
        return Err(Problem::malformed(format!("each side must be 1 to {SIDE_LIMIT} pixels")));
    }
    if !accuracy.is_finite() || accuracy <= 0.0 {
        return Err(Problem::malformed("accuracy, in pixels a voxel, must be above 0"));
    }
    let request = RenderRequest { camera, size, transfer, accuracy };
    let dataset = Arc::clone(&named.dataset);
    let drawn = app.decoders.run(move |_| renderer.render(&dataset.store, &request)).await?;
    let picture = drawn.map_err(|error| Problem::internal(error.to_string()))?;
    let headers =
        [(header::CONTENT_TYPE, picture.content_type), (header::CACHE_CONTROL, "no-store")];
    Ok((headers, picture.bytes).into_response())
}
