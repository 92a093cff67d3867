//! Every refusal and failure as `application/problem+json` (RFC 9457).
//!
//! Messages name the dataset and the brick, never a path of the serving machine.

use axum::response::{IntoResponse, Response};
use http::{HeaderValue, StatusCode, header};
use octree_store::{NodeKey, StoreError};
use serde_json::json;

/// What went wrong, as the client is told.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    status: StatusCode,
    title: &'static str,
    detail: String,
    key: Option<NodeKey>,
    content_range: Option<u64>,
}

/// Seconds after which a client that was refused for lack of room may try again.
const RETRY_AFTER_SECS: u64 = 1;

impl Problem {
    pub(crate) fn new(status: StatusCode, title: &'static str, detail: impl Into<String>) -> Self {
        Self { status, title, detail: detail.into(), key: None, content_range: None }
    }

    /// Nothing is there, and nothing will be.
    pub(crate) fn absent(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "absent", detail)
    }

    /// The request makes no sense.
    pub(crate) fn malformed(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "malformed request", detail)
    }

    /// The request asks for more than one request may.
    pub(crate) fn too_large(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "request too large", detail)
    }

    /// There is no room for it now.
    pub(crate) fn busy(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail)
    }

    /// A fault of the server's own.
    pub(crate) fn internal(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal error", detail)
    }

    /// A range that lies outside an answer of `length` bytes.
    pub(crate) fn unsatisfiable(length: u64) -> Self {
        let detail = format!("the range lies outside the {length} bytes that are there");
        let mut problem = Self::new(StatusCode::RANGE_NOT_SATISFIABLE, "no such range", detail);
        problem.content_range = Some(length);
        problem
    }

    /// What a store's error is to a client.
    pub(crate) fn of_store(error: &StoreError) -> Self {
        match error {
            StoreError::Absent { key, .. } => Self::absent(format!("the dataset has no {key}")),
            StoreError::Region { .. } => Self::absent("the region leaves the level"),
            StoreError::Damaged { key, damage, .. } => Self {
                key: Some(*key),
                ..Self::new(
                    StatusCode::INTERNAL_SERVER_ERROR,
                    "damaged",
                    format!("{key} is damaged: {damage}"),
                )
            },
            StoreError::Unreadable { key, source, .. } => Self {
                key: Some(*key),
                ..Self::new(
                    StatusCode::INTERNAL_SERVER_ERROR,
                    "unreadable",
                    format!("{key} cannot be read: {}", source.kind()),
                )
            },
            StoreError::Io { source, .. } => Self::new(
                StatusCode::INTERNAL_SERVER_ERROR,
                "unreadable",
                format!("the dataset cannot be read: {}", source.kind()),
            ),
            StoreError::MetadataDamaged { what, .. } => Self::new(
                StatusCode::INTERNAL_SERVER_ERROR,
                "damaged",
                format!("the dataset's metadata is damaged: {what}"),
            ),
            StoreError::Incomplete { .. } => {
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "incomplete", "it is still being made")
            }
            _ => Self::new(
                StatusCode::INTERNAL_SERVER_ERROR,
                "unreadable",
                "the dataset cannot be opened; 'octavo info' on the serving machine says why",
            ),
        }
    }

    pub(crate) fn status(&self) -> StatusCode {
        self.status
    }

    pub(crate) fn detail(&self) -> &str {
        &self.detail
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut body = json!({
            "type": "about:blank",
            "title": self.title,
            "status": self.status.as_u16(),
            "detail": self.detail,
        });
        if let Some(key) = self.key {
            let [x, y, z] = key.brick_xyz();
            body["key"] = json!([u64::from(key.level()), x, y, z]);
        }
        let mut response = (self.status, body.to_string()).into_response();
        let headers = response.headers_mut();
        let plain = HeaderValue::from_static;
        headers.insert(header::CONTENT_TYPE, plain("application/problem+json"));
        headers.insert(header::CACHE_CONTROL, plain("no-store"));
        if let Some(length) = self.content_range
            && let Ok(value) = HeaderValue::from_str(&format!("bytes */{length}"))
        {
            headers.insert(header::CONTENT_RANGE, value);
        }
        if matches!(self.status, StatusCode::SERVICE_UNAVAILABLE | StatusCode::TOO_MANY_REQUESTS) {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(RETRY_AFTER_SECS));
        }
        if self.status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, plain("Bearer realm=\"octavo\""));
        }
        response
    }
}

impl From<axum::extract::rejection::QueryRejection> for Problem {
    fn from(rejection: axum::extract::rejection::QueryRejection) -> Self {
        Self::malformed(rejection.body_text())
    }
}

impl From<axum::extract::rejection::PathRejection> for Problem {
    fn from(rejection: axum::extract::rejection::PathRejection) -> Self {
        Self::absent(rejection.body_text())
    }
}
