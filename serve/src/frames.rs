//! Many bricks in one answer: the framed stream (docs/HTTP.md, "Framed stream").
//!
//! A head of 16 bytes, then frames of a 32-byte head and a body. Each frame is made when the client has room
//! for it, so that a stream takes the memory of a few bricks however long it is.

use crate::app::{App, key_of};
use crate::dataset::Dataset;
use crate::problem::Problem;
use crate::product::{Product, Shape};
use axum::body::Body;
use axum::response::Response;
use bytes::Bytes;
use futures_util::StreamExt;
use futures_util::stream;
use http::{HeaderValue, header};
use octree_store::{BrickState, NodeKey, UploadFormat};
use std::convert::Infallible;
use std::sync::Arc;

/// The content type of framed streams.
pub(crate) const CONTENT_TYPE: &str = "application/vnd.octavo.frames";

const MAGIC: [u8; 4] = *b"OCTF";
const VERSION: u32 = 1;

/// Bytes of a frame's head.
pub(crate) const HEAD_BYTES: usize = 32;

/// Bricks of one stream that are made at once, ahead of the client.
const AHEAD: usize = 2;

/// What a frame says of its node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Kind {
    Stored = 1,
    Uniform = 2,
    Empty = 3,
    Absent = 4,
    Damaged = 5,
    /// The list of a cut's leaves.
    Leaves = 16,
}

/// One frame: its head and its body.
pub(crate) fn frame(kind: Kind, name: u64, numbers: [f64; 2], format: u8, body: &[u8]) -> Bytes {
    let mut bytes = Vec::with_capacity(HEAD_BYTES + body.len());
    bytes.extend_from_slice(&name.to_le_bytes());
    bytes.extend_from_slice(&[kind as u8, format, 0, 0]);
    bytes.extend_from_slice(&(body.len() as u32).to_le_bytes());
    bytes.extend(numbers.into_iter().flat_map(f64::to_le_bytes));
    bytes.extend_from_slice(body);
    bytes.into()
}

/// What a frame's numbers are: the value of texel 0 and the step, or a uniform brick's value twice.
fn frame_of(dataset: &Dataset, key: NodeKey, shape: Shape, product: &Product) -> Bytes {
    let record = &product.record;
    let kind = match record.state {
        BrickState::Stored => Kind::Stored,
        BrickState::Uniform => Kind::Uniform,
        BrickState::Empty => Kind::Empty,
        BrickState::Lost => Kind::Damaged,
    };
    let numbers = match (record.state, product.map) {
        (BrickState::Uniform, _) => [record.brick_min; 2],
        (BrickState::Empty, _) => [dataset.metadata.empty_value; 2],
        (BrickState::Stored, Some(map)) => [map.offset, map.scale],
        // To read a lost brick is an error, so that none comes here.
        (BrickState::Stored | BrickState::Lost, _) => [record.brick_min, record.brick_max],
    };
    let format = match product.map.map(|map| map.format) {
        None => 0,
        Some(UploadFormat::R8) => 1,
        Some(UploadFormat::R16) => 2,
        Some(UploadFormat::R32Float) => 3,
    };
    // One value says all of these; a client fills in as many samples as it needs.
    if record.state != BrickState::Stored {
        return frame(kind, key.to_u64(), numbers, format, &[]);
    }
    if shape == Shape::Stored {
        // The payload alone cannot be decoded.
        let body = [&record.to_bytes()[..], &product.bytes].concat();
        return frame(kind, key.to_u64(), numbers, format, &body);
    }
    frame(kind, key.to_u64(), numbers, format, &product.bytes)
}

/// The answer that carries these nodes in the order of the list, after `first` frames that are there already.
pub(crate) fn stream_of(
    app: &Arc<App>,
    dataset: &Arc<Dataset>,
    first: Vec<Bytes>,
    nodes: Vec<Option<NodeKey>>,
    shape: Shape,
) -> Result<Response, Problem> {
    let permit = app.decoders.stream().inspect_err(|_| app.answers.call_in())?;
    let count = (first.len() + nodes.len()) as u64;
    let mut head = Vec::from(MAGIC);
    head.extend_from_slice(&VERSION.to_le_bytes());
    head.extend_from_slice(&count.to_le_bytes());
    let begun = std::iter::once(Bytes::from(head)).chain(first).map(Ok::<_, Infallible>);
    let (app_of, dataset_of) = (Arc::clone(app), Arc::clone(dataset));
    let bricks = stream::iter(nodes)
        .map(move |node| {
            let (app, dataset) = (Arc::clone(&app_of), Arc::clone(&dataset_of));
            async move { brick_frame(&app, &dataset, node, shape).await }
        })
        .buffered(AHEAD)
        .map(Ok::<_, Infallible>);
    let deadline = tokio::time::Instant::now() + app.options.limits.stream_time;
    // The stream holds its permit; a client that does not take it in time gets no more of it.
    let all = stream::iter(begun)
        .chain(bricks)
        .map(move |item| {
            let _held = &permit;
            item
        })
        .take_while(move |_| std::future::ready(tokio::time::Instant::now() < deadline));
    let mut response = Response::new(Body::from_stream(all));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(CONTENT_TYPE));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    Ok(response)
}

async fn brick_frame(
    app: &Arc<App>,
    dataset: &Arc<Dataset>,
    node: Option<NodeKey>,
    shape: Shape,
) -> Bytes {
    // Coordinates of no node may not fit a key: they are told apart by their place in the list.
    let Some(key) = node else { return frame(Kind::Absent, u64::MAX, [0.0; 2], 0, &[]) };
    match app.product_in_turn(dataset, key, shape).await {
        Ok(product) => frame_of(dataset, key, shape, &product),
        Err(problem) => {
            frame(Kind::Damaged, key.to_u64(), [0.0; 2], 0, problem.detail().as_bytes())
        }
    }
}

/// Keys as clients write them; none for those that the dataset has not.
pub(crate) fn nodes_of(
    app: &App,
    dataset: &Dataset,
    keys: &[[u64; 4]],
) -> Result<Vec<Option<NodeKey>>, Problem> {
    let limit = app.options.limits.list_keys;
    if keys.len() > limit {
        let detail = format!("{} keys in a list: at most {limit} can be asked for", keys.len());
        return Err(Problem::too_large(detail));
    }
    Ok(keys.iter().map(|key| key_of(dataset, *key)).collect())
}
