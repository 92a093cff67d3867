//! Where the real volumes lie: this crate's folder; `README.md` there says what they are.

use std::path::{Path, PathBuf};

/// The folder of the real samples, with their `MANIFEST.tsv`.
pub fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The path of a sample by its name in the manifest, such as `tooth.nii.gz`.
pub fn sample_path(name: &str) -> PathBuf {
    folder().join(name)
}
