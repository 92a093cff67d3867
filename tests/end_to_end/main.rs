//! The program as its users meet it: arguments, files, JSON, exit codes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

mod bad_input;
mod batch;
mod commands;
mod damage;
mod help;
mod memory;
mod nibabel;
mod resume;
mod readers;
mod samples;
mod sharing;
mod support;
mod tiff;
