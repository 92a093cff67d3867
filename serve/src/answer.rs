//! Bytes as HTTP wants them: entity tags, conditions, ranges, HEAD, caching, and compression where it pays.

use crate::problem::Problem;
use axum::body::Body;
use axum::extract::FromRequestParts;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use http::request::Parts;
use http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use std::convert::Infallible;
use std::io::Write;

/// Documents below this stay plain: a packet carries them either way.
const COMPRESS_FROM_BYTES: usize = 1024;

/// What a client said of the answer that it wants.
#[derive(Debug, Clone)]
pub(crate) struct Conditions {
    method: Method,
    headers: HeaderMap,
}

impl<S: Send + Sync> FromRequestParts<S> for Conditions {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self { method: parts.method.clone(), headers: parts.headers.clone() })
    }
}

impl Conditions {
    fn text(&self, name: HeaderName) -> Option<&str> {
        self.headers.get(name)?.to_str().ok()
    }

    /// The items of a list, which may come in several lines.
    fn items(&self, name: HeaderName) -> impl Iterator<Item = &str> {
        let lines = self.headers.get_all(name).into_iter().filter_map(|line| line.to_str().ok());
        lines.flat_map(|line| line.split(',').map(str::trim))
    }

    /// Whether the client has the answer with this tag already, and says nothing that comes before that. A `*` does not
    /// count: it asks whether there is an answer, which only the work of making it can tell.
    pub(crate) fn has(&self, etag: &str) -> bool {
        !self.forbids(etag) && self.items(header::IF_NONE_MATCH).any(|item| names(item, etag))
    }

    fn has_any(&self) -> bool {
        self.text(header::IF_NONE_MATCH).is_some_and(|list| list.trim() == "*")
    }

    /// Whether `If-Match` forbids an answer with this tag.
    fn forbids(&self, etag: &str) -> bool {
        self.headers.contains_key(header::IF_MATCH)
            && !self.items(header::IF_MATCH).any(|item| item == quoted(etag) || item == "*")
    }

    /// The part that is asked for, of an answer of `length` bytes with this tag.
    fn range(&self, etag: &str, length: u64) -> Result<Option<(u64, u64)>, Problem> {
        let Some(text) = self.text(header::RANGE) else { return Ok(None) };
        if self.method != Method::GET {
            return Ok(None);
        }
        if self.text(header::IF_RANGE).is_some_and(|tag| tag.trim() != quoted(etag)) {
            return Ok(None);
        }
        // Several ranges, other units and what is malformed may be answered with the whole.
        let Some((first, last)) =
            text.trim().strip_prefix("bytes=").and_then(|range| range.split_once('-'))
        else {
            return Ok(None);
        };
        let range = match (first.trim().parse::<u64>(), last.trim()) {
            (Ok(first), "") => (first, length.saturating_sub(1)),
            (Ok(first), last) => match last.parse::<u64>() {
                Ok(last) if last >= first => (first, last.min(length.saturating_sub(1))),
                _ => return Ok(None),
            },
            (Err(_), last) if first.trim().is_empty() => match last.parse::<u64>() {
                Ok(0) => return Err(Problem::unsatisfiable(length)),
                Ok(count) => (length.saturating_sub(count), length.saturating_sub(1)),
                Err(_) => return Ok(None),
            },
            _ => return Ok(None),
        };
        if range.0 >= length { Err(Problem::unsatisfiable(length)) } else { Ok(Some(range)) }
    }

    /// The compression that the client takes and that pays.
    fn encoding(&self) -> Option<Packing> {
        if self.headers.contains_key(header::RANGE) {
            return None;
        }
        let refused = |weight: &str| {
            let (name, value) = weight.split_once('=').unwrap_or_default();
            name.eq_ignore_ascii_case("q") && value.parse() == Ok(0.0)
        };
        let takes = |name: &str| {
            self.items(header::ACCEPT_ENCODING).any(|item| {
                let mut parts = item.split(';').map(str::trim);
                parts.next().is_some_and(|n| n.eq_ignore_ascii_case(name)) && !parts.any(refused)
            })
        };
        [Packing::Zstd, Packing::Gzip].into_iter().find(|packing| takes(packing.name()))
    }
}

/// Whether an item of `If-None-Match` names this tag; weak tags compare as strong ones there.
fn names(item: &str, etag: &str) -> bool {
    item.strip_prefix("W/").unwrap_or(item) == quoted(etag)
}

fn quoted(etag: &str) -> String {
    format!("\"{etag}\"")
}

#[derive(Debug, Clone, Copy)]
enum Packing {
    Zstd,
    Gzip,
}

impl Packing {
    fn name(self) -> &'static str {
        match self {
            Self::Zstd => "zstd",
            Self::Gzip => "gzip",
        }
    }

    fn pack(self, bytes: &[u8]) -> std::io::Result<Vec<u8>> {
        match self {
            Self::Zstd => zstd::bulk::compress(bytes, 3),
            Self::Gzip => {
                let mut encoder =
                    flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
                encoder.write_all(bytes)?;
                encoder.finish()
            }
        }
    }
}

/// How long an answer stays true.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lifetime {
    /// For ever: its address names the content's digest.
    Immutable,
    /// Until the store is replaced: a client asks again, and mostly hears that nothing changed.
    Revalidate,
}

/// An answer in the making.
#[derive(Debug)]
pub(crate) struct Answer {
    bytes: Bytes,
    content_type: &'static str,
    etag: String,
    lifetime: Lifetime,
    /// Whether it may still be compressed.
    compressible: bool,
    /// Whether what comes depends on what the client takes.
    varies: bool,
    headers: Vec<(HeaderName, HeaderValue)>,
}

impl Answer {
    /// Bytes that compression gains little on, or that must come as they are, with the tag of their content.
    pub(crate) fn binary(bytes: Bytes, etag: String, lifetime: Lifetime) -> Self {
        let content_type = "application/octet-stream";
        Self {
            bytes,
            content_type,
            etag,
            lifetime,
            compressible: false,
            varies: false,
            headers: Vec::new(),
        }
    }

    /// A document: its tag is the hash of its bytes.
    pub(crate) fn document(bytes: impl Into<Bytes>, content_type: &'static str) -> Self {
        let bytes = bytes.into();
        let etag = blake3::hash(&bytes).to_hex()[..32].to_owned();
        let lifetime = Lifetime::Revalidate;
        Self {
            bytes,
            content_type,
            etag,
            lifetime,
            compressible: true,
            varies: true,
            headers: Vec::new(),
        }
    }

    /// A JSON document.
    pub(crate) fn json(value: &impl serde::Serialize) -> Result<Self, Problem> {
        let text = serde_json::to_vec(value).map_err(|e| Problem::internal(e.to_string()))?;
        Ok(Self::document(text, "application/json"))
    }

    #[must_use]
    pub(crate) fn lasting(mut self, lifetime: Lifetime) -> Self {
        self.lifetime = lifetime;
        self
    }

    #[must_use]
    pub(crate) fn with(mut self, name: &'static str, value: &str) -> Self {
        if let Ok(value) = HeaderValue::from_str(value) {
            self.headers.push((HeaderName::from_static(name), value));
        }
        self
    }

    /// Compressed, where its client takes that and it pays. [`Answer::to`] does it too; this is for who wants it done on
    /// another thread.
    #[must_use]
    pub(crate) fn packed(mut self, conditions: &Conditions) -> Self {
        if self.compressible
            && self.bytes.len() >= COMPRESS_FROM_BYTES
            && let Some(packing) = conditions.encoding()
            && let Ok(packed) = packing.pack(&self.bytes)
            && packed.len() < self.bytes.len()
        {
            self.bytes = packed.into();
            // Another representation has another tag.
            self.etag = format!("{}-{}", self.etag, packing.name());
            let name = HeaderValue::from_static(packing.name());
            self.headers.push((header::CONTENT_ENCODING, name));
        }
        self.compressible = false;
        self
    }

    /// The response to one who stated these conditions.
    pub(crate) fn to(self, conditions: &Conditions) -> Response {
        let mut this = self.packed(conditions);
        if conditions.forbids(&this.etag) {
            let detail = "the content is not the one that If-Match names";
            return Problem::new(StatusCode::PRECONDITION_FAILED, "precondition failed", detail)
                .into_response();
        }
        if conditions.has(&this.etag) || conditions.has_any() {
            return this.not_modified();
        }
        let length = this.bytes.len() as u64;
        let (status, body) = match conditions.range(&this.etag, length) {
            Err(problem) => return problem.into_response(),
            Ok(None) => (StatusCode::OK, this.bytes.clone()),
            Ok(Some((first, last))) => {
                let text = format!("bytes {first}-{last}/{length}");
                if let Ok(value) = HeaderValue::from_str(&text) {
                    this.headers.push((header::CONTENT_RANGE, value));
                }
                (StatusCode::PARTIAL_CONTENT, this.bytes.slice(first as usize..=last as usize))
            }
        };
        let length = body.len();
        let mut response = Response::new(Body::from(body));
        *response.status_mut() = status;
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(this.content_type));
        headers.insert(header::CONTENT_LENGTH, HeaderValue::from(length));
        headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        this.add_headers(headers);
        response
    }

    /// The answer to one who has it already.
    pub(crate) fn not_modified(self) -> Response {
        let mut response = Response::new(Body::empty());
        *response.status_mut() = StatusCode::NOT_MODIFIED;
        self.add_headers(response.headers_mut());
        response
    }

    fn add_headers(self, headers: &mut HeaderMap) {
        if let Ok(etag) = HeaderValue::from_str(&quoted(&self.etag)) {
            headers.insert(header::ETAG, etag);
        }
        let caching = match self.lifetime {
            Lifetime::Immutable => "public, max-age=31536000, immutable",
            Lifetime::Revalidate => "public, no-cache",
        };
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(caching));
        if self.varies {
            headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
        }
        headers.extend(self.headers);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_packing_would_make_larger_stays_as_it_is() {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT_ENCODING, HeaderValue::from_static("gzip, zstd"));
        let conditions = Conditions { method: Method::GET, headers };
        let mut noise = vec![0; 4096];
        blake3::Hasher::new().finalize_xof().fill(&mut noise);
        for (bytes, packs) in [(vec![0; 4096], true), (noise, false)] {
            let answer = Answer::document(bytes.clone(), "text/plain").packed(&conditions);
            assert_eq!(answer.bytes == bytes, !packs);
            assert_eq!(answer.headers.is_empty(), !packs);
        }
    }
}
