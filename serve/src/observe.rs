//! Every answer is counted and logged: one event of the target `octavo::access`.

use crate::app::App;
use crate::place::Work;
use axum::body::{Body, HttpBody};
use axum::extract::{MatchedPath, Request, State};
use axum::middleware::Next;
use axum::response::Response;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

/// Who asks, as the connection knows it.
#[derive(Debug, Clone)]
pub(crate) struct Caller {
    pub(crate) address: SocketAddr,
    /// Dropped when the answer was taken.
    pub(crate) work: Arc<Work>,
}

pub(crate) async fn observe(
    State(app): State<Arc<App>>,
    request: Request<Body>,
    next: Next,
) -> Response {
    let began = Instant::now();
    let method = request.method().clone();
    // Without the query: a token may stand there.
    let path = request.uri().path().to_owned();
    let version = request.version();
    let route = request.extensions().get::<MatchedPath>().cloned();
    let peer = request.extensions().get::<Caller>().map(|caller| caller.address);
    let response = next.run(request).await;
    let took = began.elapsed();
    let status = response.status().as_u16();
    let route = route.as_ref().map_or("unmatched", MatchedPath::as_str);
    app.metrics.answered(route, &method, status, took);
    let bytes = response.body().size_hint().exact();
    app.metrics.sent_bytes.inc_by(bytes.unwrap_or(0));
    tracing::info!(
        target: "octavo::access",
        peer = peer.map(|peer| peer.to_string()),
        method = method.as_str(),
        path,
        version = ?version,
        status,
        bytes,
        ms = took.as_secs_f64() * 1e3,
    );
    response
}
