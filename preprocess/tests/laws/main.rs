//! Laws of a conversion, held against naive twins: whatever the size, the type, the bricks.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

mod encodings;
mod errors;
mod extremes;
mod filters;
mod invariance;
mod ranges;
mod resume;
mod samples;
mod support;
mod upscale;
mod upscale_detail;
mod upscale_stores;
mod values;
