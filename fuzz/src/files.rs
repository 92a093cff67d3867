//! Files of given bytes, in memory where the system has such a place.

use octree_store::Encoding;
use preprocess::{ConvertOptions, NoProgress, Source, SourceOptions, convert};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// A folder for one run.
pub(crate) fn folder() -> TempDir {
    static PLACE: OnceLock<PathBuf> = OnceLock::new();
    let place = PLACE.get_or_init(|| {
        let memory = Path::new("/dev/shm");
        if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() }
    });
    tempfile::Builder::new().prefix("octavo-fuzz-").tempdir_in(place).unwrap()
}

/// A folder that holds one file; the file's path.
pub(crate) fn file(name: &str, bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = folder();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// A folder that holds a small store, and the store's path.
pub(crate) fn noise_store() -> (TempDir, PathBuf) {
    let noise = (0..20 * 18 * 16_u32)
        .flat_map(|i| ((2_654_435_761_u32.wrapping_mul(i) >> 13) as u16).to_le_bytes());
    let (_raw, raw) = file("a_20x18x16_u16.raw", &noise.collect::<Vec<u8>>());
    let source = Source::open(&raw, &SourceOptions::default()).unwrap();
    let how =
        ConvertOptions { brick_core: 8, encoding: Encoding::Lossless, ..ConvertOptions::default() };
    let folder = folder();
    let path = folder.path().join("a.octavo");
    convert(&source, &path, &how, &NoProgress).unwrap();
    (folder, path)
}
