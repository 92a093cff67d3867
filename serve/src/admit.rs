//! Who may ask, how many at once, and for how long an answer may be worked on.

use crate::app::App;
use crate::problem::Problem;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use http::{HeaderMap, HeaderValue, StatusCode, Version, header};
use std::sync::Arc;

/// The cookie that may hold the token.
pub(crate) const COOKIE: &str = "octavo_token";

/// What is answered to everybody: nothing of it is anyone's data.
const OPEN: [&str; 2] = ["/healthz", "/readyz"];

pub(crate) async fn admit(
    State(app): State<Arc<App>>,
    request: Request<Body>,
    next: Next,
) -> Response {
    // Who stands between may have gone by another one than who answers (RFC 9112, 3.2).
    if request.version() == Version::HTTP_11
        && request.headers().get_all(header::HOST).iter().count() != 1
    {
        return Problem::malformed("a request of HTTP/1.1 has one Host").into_response();
    }
    let path = request.uri().path();
    // However busy: who runs the server must see that it lives.
    if OPEN.contains(&path) {
        return next.run(request).await;
    }
    if let Some(token) = &app.options.token
        && !shown(request.headers()).any(|text| token.is(text))
    {
        // A link with the token in it opens the page once; the browser keeps the cookie.
        if path == "/" && from_query(request.uri().query()).is_some_and(|text| token.is(text)) {
            return login(request.uri().query());
        }
        let detail =
            "show the token as 'Authorization: Bearer TOKEN', or open /?token=TOKEN in a browser";
        return Problem::new(StatusCode::UNAUTHORIZED, "token needed", detail).into_response();
    }
    let Ok(_working) = app.requests.try_acquire() else {
        return Problem::busy("too many requests are under way").into_response();
    };
    let limit = app.options.limits.request_time;
    let mut response = match tokio::time::timeout(limit, next.run(request)).await {
        Ok(response) => response,
        Err(_) => Problem::new(
            StatusCode::REQUEST_TIMEOUT,
            "timed out",
            format!("the request was not there, or not answered, within {} s", limit.as_secs()),
        )
        .into_response(),
    };
    if app.options.token.is_some()
        && let Some(caching) = response.headers_mut().get_mut(header::CACHE_CONTROL)
        && let Ok(text) = caching.to_str()
        && let Ok(private) = HeaderValue::from_str(&text.replace("public", "private"))
    {
        *caching = private;
    }
    response
}

/// The tokens that a request shows.
fn shown(headers: &HeaderMap) -> impl Iterator<Item = &[u8]> {
    let bearer = headers.get_all(header::AUTHORIZATION).iter().filter_map(|value| {
        let (scheme, rest) = value.as_bytes().split_at_checked(7)?;
        scheme.eq_ignore_ascii_case(b"bearer ").then_some(rest.trim_ascii())
    });
    let cookies = headers.get_all(header::COOKIE).iter().flat_map(|value| {
        value.as_bytes().split(|byte| *byte == b';').filter_map(|pair| {
            pair.trim_ascii().strip_prefix(COOKIE.as_bytes())?.strip_prefix(b"=")
        })
    });
    bearer.chain(cookies)
}

fn from_query(query: Option<&str>) -> Option<&[u8]> {
    query?.split('&').find_map(|pair| pair.strip_prefix("token=")).map(str::as_bytes)
}

fn login(query: Option<&str>) -> Response {
    let token = from_query(query).unwrap_or_default();
    let cookie =
        [COOKIE.as_bytes(), b"=", token, b"; Path=/; HttpOnly; SameSite=Strict; Max-Age=31536000"]
            .concat();
    let mut response = StatusCode::SEE_OTHER.into_response();
    let headers = response.headers_mut();
    headers.insert(header::LOCATION, HeaderValue::from_static("/"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if let Ok(cookie) = HeaderValue::from_bytes(&cookie) {
        headers.insert(header::SET_COOKIE, cookie);
    }
    response
}
