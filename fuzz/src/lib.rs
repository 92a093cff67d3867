//! What must hold of any bytes whatever, one function a parser. libFuzzer drives each (`targets/`), and `tests/smoke.rs` runs them over the seeds and
//! over what once went wrong.
//!
//! A function returns when all is well, and panics when it is not: so does the program under test. Files are made in memory
//! (`/dev/shm`) where there is such a place.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    reason = "a panic is how something wrong is told here"
)]

mod files;
mod http;
mod scene;
mod seeds;
mod sources;
mod stores;

pub use http::http;
pub use scene::{camera, transfer};
pub use seeds::seeds;
pub use sources::{dicom, metaimage, nifti, nrrd, png_slices, raw_name, tiff};
pub use stores::{node_record, payload, store};

/// A parser's function.
pub type Oracle = fn(&[u8]);

/// All of them by name, as `targets/` and `seeds/` have them.
pub const ORACLES: [(&str, Oracle); 13] = [
    ("raw_name", raw_name),
    ("nifti", nifti),
    ("nrrd", nrrd),
    ("metaimage", metaimage),
    ("tiff", tiff),
    ("dicom", dicom),
    ("png_slices", png_slices),
    ("store", store),
    ("payload", payload),
    ("node_record", node_record),
    ("transfer", transfer),
    ("camera", camera),
    ("http", http),
];
