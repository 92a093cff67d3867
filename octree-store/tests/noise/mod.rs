//! A small store of noise, and changes to it that its checksums do not show.

#![allow(dead_code, reason = "each test has its own part of it")]

use octree_store::{
    Encoding, Geometry, Metadata, NodeKey, NodeRecord, SampleType, Store, StoreWriter,
    encode_samples,
};
use std::path::{Path, PathBuf};
use twox_hash::XxHash3_64;

pub(crate) const PAGE: usize = 4096;

/// A store of 27 + 8 + 1 bricks of 8^3 without loss.
pub(crate) fn make(folder: &Path) -> PathBuf {
    make_with(folder, |_| {})
}

/// The same, with other metadata.
pub(crate) fn make_with(folder: &Path, change: impl Fn(&mut Metadata)) -> PathBuf {
    let path = folder.join("a.octavo");
    let geometry = Geometry::new([24, 24, 24], 8, 1).unwrap();
    let work = path.with_extension("work");
    let mut writer = StoreWriter::create(&path, &work, Vec::new()).unwrap();
    let mut next = 1_u32;
    for parent in geometry.levels().flat_map(|level| geometry.parents_of(level)) {
        let mut payloads = Vec::new();
        let mut octet = Vec::new();
        for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
            let samples: Vec<u16> = std::iter::repeat_with(|| {
                next = next.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (next >> 16) as u16
            })
            .take(geometry.brick_samples())
            .collect();
            let (mut record, payload) = encode_samples(key, &samples, Encoding::Lossless);
            record.child_mask = geometry.child_mask(key);
            (record.subtree_min, record.subtree_max) = (0.0, 65535.0);
            payloads.extend_from_slice(&payload);
            octet.push(record);
        }
        writer.append(&mut octet, &payloads, Vec::new()).unwrap();
    }
    let mut metadata = Metadata::new(&geometry, SampleType::U16, Encoding::Lossless);
    (metadata.value_min, metadata.value_max) = (Some(0.0), Some(65535.0));
    change(&mut metadata);
    writer.finish(metadata).unwrap();
    path
}

/// Where the index begins.
pub(crate) fn index_offset(store: &[u8]) -> usize {
    u64::from_le_bytes(store[24..32].try_into().unwrap()) as usize
}

/// Changes a record, and makes its checksum right.
pub(crate) fn change_record(path: &Path, key: NodeKey, change: impl FnOnce(&mut NodeRecord)) {
    let store = Store::open(path).unwrap();
    let mut record = store.node(key).unwrap();
    change(&mut record);
    let mut bytes = std::fs::read(path).unwrap();
    let at = index_offset(&bytes) + store.geometry().rank(key) as usize * NodeRecord::BYTES;
    bytes[at..at + NodeRecord::BYTES].copy_from_slice(&record.to_bytes());
    std::fs::write(path, bytes).unwrap();
}

/// A metadata frame with a checksum that is right.
pub(crate) fn frame(json: &str) -> Vec<u8> {
    let checksum = XxHash3_64::oneshot_with_seed(1, json.as_bytes());
    [b"OCTV\x01\0\0\0", &checksum.to_le_bytes()[..], json.as_bytes()].concat()
}

/// The metadata of a whole store, as they stand in its file.
pub(crate) fn metadata_of(path: &Path) -> String {
    let bytes = std::fs::read(path).unwrap();
    let at = bytes.windows(4).rposition(|window| window == b"OCTV").unwrap();
    String::from_utf8(bytes[at + 16..].to_vec()).unwrap()
}
