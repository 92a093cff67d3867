//! A store with a damaged byte gives right samples or an error; it never panics.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use octree_store::{
    BrickScratch, Encoding, Geometry, Metadata, NodeKey, SampleType, Store, StoreWriter,
    encode_samples, verify,
};
use std::path::Path;

/// A store of 27 + 8 + 1 bricks of 8^3 with noise, lossless.
fn make(path: &Path) -> Vec<NodeKey> {
    let geometry = Geometry::new([24, 24, 24], 8, 1).unwrap();
    let work = path.with_extension("work");
    let mut writer = StoreWriter::create(path, &work, Vec::new()).unwrap();
    let mut keys = Vec::new();
    let mut state = 1_u32;
    for level in geometry.levels() {
        let [nx, ny, nz] = geometry.grid_at(level).map(|n| n.div_ceil(2));
        let mut parents: Vec<NodeKey> = (0..nx * ny * nz)
            .map(|i| NodeKey::new(level + 1, [i % nx, i / nx % ny, i / nx / ny]))
            .collect();
        parents.sort_unstable();
        for parent in parents {
            let children = parent.children().into_iter().filter(|key| geometry.contains(*key));
            let mut payloads = Vec::new();
            let mut octet: Vec<_> = children
                .map(|key| {
                    let samples: Vec<u16> = (0..geometry.brick_samples())
                        .map(|_| {
                            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                            (state >> 16) as u16
                        })
                        .collect();
                    keys.push(key);
                    let (mut record, payload) = encode_samples(key, &samples, Encoding::Lossless);
                    record.child_mask = geometry.child_mask(key);
                    (record.subtree_min, record.subtree_max) = (0.0, 65535.0);
                    payloads.extend_from_slice(&payload);
                    record
                })
                .collect();
            writer.append(&mut octet, &payloads, Vec::new()).unwrap();
        }
    }
    writer.finish(Metadata::new(&geometry, SampleType::U16, Encoding::Lossless)).unwrap();
    keys
}

/// Every brick that can be read, or an empty list where the store cannot be opened.
fn read_all(path: &Path, keys: &[NodeKey]) -> Vec<Option<Vec<u16>>> {
    let Ok(store) = Store::open(path) else { return Vec::new() };
    let mut scratch = BrickScratch::default();
    // Walks, verification and single reads take different ways through the database.
    let _ = verify::verify(&store, || true);
    let _ = store.visit_level(0, |_| true);
    keys.iter()
        .map(|key| {
            let mut brick = vec![0_u16; store.geometry().brick_samples()];
            store.read_brick(*key, &mut scratch, &mut brick).ok().map(|_| brick)
        })
        .collect()
}

#[test]
fn a_damaged_byte_anywhere_gives_right_samples_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.octavo");
    let keys = make(&path);
    let bytes = std::fs::read(&path).unwrap();
    let whole = read_all(&path, &keys);
    assert!(whole.iter().all(Option::is_some) && whole.len() == 36);
    let other = folder.path().join("b.octavo");
    let (mut refused, mut harmless) = (0, 0);
    // The first bytes of every page are redb's own; of the others a sample.
    let places = (0..bytes.len()).filter(|at| at % 4096 < 40 || at % 997 == 0);
    for (trial, place) in places.enumerate() {
        let mut damaged = bytes.clone();
        damaged[place] ^= [0x01, 0x80, 0xff, 0x10][trial % 4];
        std::fs::write(&other, &damaged).unwrap();
        let read = read_all(&other, &keys);
        for (read, right) in read.iter().zip(&whole) {
            assert!(read.is_none() || read == right, "byte {place}");
        }
        if read == whole {
            harmless += 1;
        } else {
            refused += 1;
        }
    }
    assert!(refused > 100 && harmless > 0, "{refused} refused, {harmless} harmless");
}
