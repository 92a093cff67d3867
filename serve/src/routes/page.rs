//! The web page, its files, and the description of the addresses: all part of the program.

use super::asked::Path;
use crate::answer::{Answer, Conditions};
use crate::problem::Problem;
use axum::response::Response;

/// The page loads nothing from elsewhere, and nothing else may put it into a frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
    connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'";

fn page_file(text: &'static str, content_type: &'static str, conditions: &Conditions) -> Response {
    Answer::document(text.as_bytes(), content_type)
        .with("content-security-policy", POLICY)
        .with("x-content-type-options", "nosniff")
        .with("referrer-policy", "no-referrer")
        .to(conditions)
}

pub(super) async fn index(conditions: Conditions) -> Response {
    page_file(include_str!("../page/index.html"), "text/html; charset=utf-8", &conditions)
}

pub(super) async fn file(
    Path(file): Path<String>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let text = match file.as_str() {
        "style.css" => include_str!("../page/style.css"),
        "app.js" => include_str!("../page/app.js"),
        "slices.js" => include_str!("../page/slices.js"),
        "volume.js" => include_str!("../page/volume.js"),
        "histogram.js" => include_str!("../page/histogram.js"),
        _ => return Err(Problem::absent("the page has no such file")),
    };
    let style = file.ends_with("css");
    let content_type =
        if style { "text/css; charset=utf-8" } else { "text/javascript; charset=utf-8" };
    Ok(page_file(text, content_type, &conditions))
}

pub(super) async fn openapi(conditions: Conditions) -> Response {
    Answer::document(include_str!("../openapi.json").as_bytes(), "application/json").to(&conditions)
}
