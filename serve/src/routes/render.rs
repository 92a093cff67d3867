//! A picture drawn by the server, where it has a renderer.

use super::asked::Path;
use super::{CONVERGED, read_json};
use crate::app::App;
use crate::problem::Problem;
use crate::render::{RenderError, RenderRequest};
use axum::body::Body;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use http::{HeaderName, StatusCode, header};
use octree_store::loader::{Camera, TransferFunction, View};
use serde::Deserialize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Pixels of a picture, at most.
const PIXEL_LIMIT: u64 = 4 << 20;

/// The longest that a client may let a picture take, in seconds. Less than a request may take: it is to come as it is.
const SECONDS_LIMIT: f64 = 20.0;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    camera: Camera,
    size: [u32; 2],
    transfer: Option<TransferFunction>,
    #[serde(default = "one")]
    accuracy: f64,
    #[serde(default = "one")]
    step: f64,
    #[serde(default = "ten")]
    seconds: f64,
}

fn one() -> f64 {
    1.0
}

fn ten() -> f64 {
    10.0
}

impl Wanted {
    fn request(self) -> Result<RenderRequest, Problem> {
        let Self { camera, size, transfer, accuracy, step: step_voxels, seconds } = self;
        let pixels = size.iter().map(|side| u64::from(*side)).product::<u64>();
        if !(1..=PIXEL_LIMIT).contains(&pixels) {
            return Err(Problem::malformed(format!("size must be 1 to {PIXEL_LIMIT} pixels")));
        }
        for (name, value) in
            [("accuracy, in pixels a voxel,", accuracy), ("step, in voxels,", step_voxels)]
        {
            if !(0.1..=1e6).contains(&value) {
                return Err(Problem::malformed(format!("{name} must be 0.1 to 1000000")));
            }
        }
        if !(0.0..=SECONDS_LIMIT).contains(&seconds) {
            return Err(Problem::malformed(format!("seconds must be 0 to {SECONDS_LIMIT}")));
        }
        let view =
            View::new(camera, size).map_err(|error| Problem::malformed(error.to_string()))?;
        let at_most = Duration::from_secs_f64(seconds);
        let given_up = Arc::default();
        Ok(RenderRequest { view, transfer, accuracy, step_voxels, at_most, given_up })
    }
}

/// Someone who waits for a picture; gives it up when dropped.
struct Waiting(Arc<AtomicBool>);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

pub(super) async fn render(
    State(app): State<Arc<App>>,
    Path(name): Path<String>,
    body: Body,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let wanted: Wanted = read_json(&app, body).await?;
    let request = wanted.request()?;
    let Some(renderer) = app.renderer.clone() else {
        let detail = "this server draws no pictures";
        return Err(Problem::new(StatusCode::NOT_IMPLEMENTED, "no renderer", detail));
    };
    let permit = Arc::clone(&app.drawing).try_acquire_owned();
    let permit = permit.map_err(|_| Problem::busy("another picture is being drawn"))?;
    let opened = app.opened(&named.dataset);
    let _waiting = Waiting(Arc::clone(&request.given_up));
    let drawn = tokio::task::spawn_blocking(move || {
        // The permit goes with the work: a client that leaves does not make room for another picture.
        let _permit = permit;
        opened().map(|store| renderer.render(&store, &request))
    });
    let drawn = drawn
        .await
        .map_err(|_| Problem::internal("drawing failed for a reason of the program's own"))??;
    let picture = drawn.map_err(|error| match error {
        RenderError::Request(what) => Problem::malformed(what),
        RenderError::Failed(what) => Problem::internal(what),
    })?;
    let headers = [
        (header::CONTENT_TYPE, picture.content_type),
        (header::CACHE_CONTROL, "no-store"),
        (HeaderName::from_static(CONVERGED), if picture.converged { "true" } else { "false" }),
    ];
    Ok((headers, picture.bytes).into_response())
}
