//! The program as its users meet it: arguments, files, JSON, exit codes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

mod bad_input;
mod commands;
mod damage;
mod headers;
mod help;
mod nibabel;
mod samples;
mod sharing;
mod support;
