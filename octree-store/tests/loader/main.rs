//! Laws of the adaptive loader, with a ray caster of a few lines as the renderer.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod abuse;
mod cut;
mod faults;
mod index;
mod loading;
mod seen;
mod support;
