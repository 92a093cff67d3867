//! All addresses. `openapi.json` describes the same, and a test holds the two against each other.

mod asked;
mod bricks;
mod codes;
mod cut;
mod datasets;
mod health;
mod many;
mod nodes;
mod page;
mod precomputed;
mod render;
mod slices;
mod zarr;

use crate::admit::admit;
use crate::app::App;
use crate::observe::observe;
use crate::pace::pace;
use crate::problem::Problem;
use axum::Router;
use axum::body::Body;
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use bytes::Bytes;
use http::{HeaderName, Method, StatusCode, header};
use http_body_util::{BodyExt, Limited};
use serde::de::DeserializeOwned;
use std::sync::Arc;
use std::time::Duration;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::cors::{AllowHeaders, Any, CorsLayer};

/// Headers of answers that scripts of other origins may read.
const EXPOSED: [HeaderName; 10] = [
    header::ETAG,
    header::CONTENT_LENGTH,
    header::CONTENT_RANGE,
    header::ACCEPT_RANGES,
    header::RETRY_AFTER,
    HeaderName::from_static(STATE),
    HeaderName::from_static(RECORD),
    HeaderName::from_static(VALUE_MAP),
    HeaderName::from_static(DIMS),
    HeaderName::from_static(CONVERGED),
];

/// Stored, uniform or empty.
const STATE: &str = "x-octavo-state";
/// A node record, in hexadecimal digits.
const RECORD: &str = "x-octavo-record";
/// What codes mean: format, scale and offset.
const VALUE_MAP: &str = "x-octavo-value-map";
/// Samples along the axes of the body, fastest first.
const DIMS: &str = "x-octavo-dims";
/// Whether a picture is as fine as was asked for.
const CONVERGED: &str = "x-octavo-converged";

/// The server's routes with all that stands before them.
pub(crate) fn router(app: &Arc<App>) -> Router {
    let cors = CorsLayer::new()
        .allow_origin(Any)
        .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::OPTIONS])
        .allow_headers(AllowHeaders::mirror_request())
        .expose_headers(EXPOSED)
        .max_age(Duration::from_hours(24));
    Router::new()
        .route("/", get(page::index))
        .route("/page/{file}", get(page::file))
        .route("/openapi.json", get(page::openapi))
        .route("/healthz", get(health::alive))
        .route("/readyz", get(health::ready))
        .route("/metrics", get(health::metrics))
        .route("/v1/datasets", get(datasets::list))
        .route("/v1/{dataset}/info", get(datasets::info))
        .route("/v1/{dataset}/statistics", get(datasets::statistics))
        .route("/v1/{dataset}/nodes", get(nodes::nodes))
        .route("/v1/{dataset}/bricks/{level}/{x}/{y}/{z}", get(bricks::brick))
        .route("/v1/{dataset}/bricks", post(many::bricks))
        .route("/v1/{dataset}/cut", post(cut::cut))
        .route("/v1/{dataset}/slices/{axis}/{index}", get(slices::slice))
        .route("/v1/{dataset}/render", post(render::render))
        .route("/zarr2/{dataset}/{*path}", get(zarr::zarr2))
        .route("/zarr2-5d/{dataset}/{*path}", get(zarr::zarr2_5d))
        .route("/zarr3/{dataset}/{*path}", get(zarr::zarr3))
        .route("/zarr3-5d/{dataset}/{*path}", get(zarr::zarr3_5d))
        .route("/zarr2-codes/{dataset}/{*path}", get(codes::zarr2))
        .route("/zarr3-codes/{dataset}/{*path}", get(codes::zarr3))
        .route("/precomputed/{dataset}/{*path}", get(precomputed::precomputed))
        .fallback(nowhere)
        .method_not_allowed_fallback(other_method)
        .layer(from_fn_with_state(Arc::clone(app), pace))
        .layer(from_fn_with_state(Arc::clone(app), admit))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(cors)
        .layer(from_fn_with_state(Arc::clone(app), observe))
        .with_state(Arc::clone(app))
}

async fn nowhere() -> Problem {
    Problem::absent("nothing has this address; /openapi.json lists those that there are")
}

async fn other_method() -> Problem {
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "other method", "this address has other methods")
}

fn panicked(_: Box<dyn std::any::Any + Send + 'static>) -> Response {
    tracing::error!("answering a request failed for a reason of the program's own");
    Problem::internal("answering failed for a reason of the program's own").into_response()
}

/// A request's body, of at most so many bytes.
async fn read_body(body: Body, limit: usize) -> Result<Bytes, Problem> {
    let too_large = || Problem::too_large(format!("the body has more than {limit} bytes"));
    // Who announces more is refused before it comes.
    if http_body::Body::size_hint(&body).lower() > limit as u64 {
        return Err(too_large());
    }
    match Limited::new(body, limit).collect().await {
        Ok(collected) => Ok(collected.to_bytes()),
        Err(error) if error.is::<http_body_util::LengthLimitError>() => Err(too_large()),
        Err(_) => Err(Problem::malformed("the body ended before it was whole")),
    }
}

/// A request's JSON body.
async fn read_json<T: DeserializeOwned>(app: &App, body: Body) -> Result<T, Problem> {
    let bytes = read_body(body, app.options.limits.body_bytes).await?;
    serde_json::from_slice(&bytes).map_err(|error| Problem::malformed(format!("the body: {error}")))
}
