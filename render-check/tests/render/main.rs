//! Laws of rendering: stores against the source that they were made of, and the device against its mirror.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

#[cfg(feature = "gpu")]
mod gpu;
mod invariance;
mod mirror;
mod simulated;
mod support;
