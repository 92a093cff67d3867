//! The program as its users meet it: arguments, files, JSON, exit codes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

mod bad_input;
mod batch;
mod commands;
mod damage;
mod encodings;
mod export;
mod format;
mod headers;
mod help;
mod instruction_sets;
mod memory;
mod mend;
mod nibabel;
mod plan;
mod readers;
mod render;
mod resume;
mod samples;
mod serve;
mod sharing;
mod strange;
mod support;
mod tiff;
mod tradeoff;
mod upscale;
mod view;
