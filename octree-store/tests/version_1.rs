//! Stores of version 1, made when it was frozen, still read as they did then: `version-1/README.md` says what they hold.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use octree_store::{BrickState, NodeKey, Region, Store, StoreError, verify};
use std::path::{Path, PathBuf};

/// The one store of which a brick is lost.
const LOST: &str = "lost-brick.octavo";

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/version-1")
}

fn open(name: &str) -> Store {
    Store::open(folder().join(name)).unwrap()
}

/// A line of the table: state, and digits of the samples' hash.
fn read(store: &Store, key: NodeKey) -> [String; 2] {
    let none = |what: &str| [what.to_owned(), "-".to_owned()];
    match store.read_brick_samples(key) {
        Ok((record, samples)) => {
            let state = match record.state {
                BrickState::Stored => "stored",
                BrickState::Uniform => "uniform",
                BrickState::Empty => "empty",
                BrickState::Lost => panic!("{key}: a lost brick was read"),
            };
            let hash = blake3::hash(&samples.to_le_bytes()).to_hex();
            [state.to_owned(), hash[..16].to_owned()]
        }
        Err(StoreError::Damaged { key: named, .. }) => {
            // It names the brick that is lost, which may be a neighbour.
            assert_eq!(store.node(named).unwrap().state, BrickState::Lost, "{key}: {named}");
            none(if named == key { "lost" } else { "needs-a-lost-neighbour" })
        }
        Err(error) => panic!("{key}: {error}"),
    }
}

#[test]
fn every_brick_reads_as_it_did() {
    let table = std::fs::read_to_string(folder().join("bricks.tsv")).unwrap();
    let mut lines = 0;
    let mut stores = std::collections::BTreeMap::new();
    for line in table.lines() {
        let fields: Vec<&str> = line.split('\t').collect();
        let [name, level, x, y, z, state, digits] = fields[..].try_into().unwrap();
        let (store, bricks) = stores.entry(name).or_insert_with(|| (open(name), 0));
        *bricks += 1;
        let key = NodeKey::new(level.parse().unwrap(), [x, y, z].map(|at| at.parse().unwrap()));
        assert_eq!(read(store, key), [state, digits], "{line}");
        lines += 1;
    }
    assert_eq!(lines, 130);
    assert_eq!(stores.len(), 6);
    for (name, (store, bricks)) in &stores {
        let geometry = store.geometry();
        let all: usize = geometry.levels().map(|level| geometry.keys_at(level).count()).sum();
        assert_eq!(*bricks, all, "{name}");
        let report = verify::verify(store, || true).unwrap().unwrap();
        assert_eq!(report.is_ok(), *name != LOST, "{name}: {report:?}");
    }
}

/// Not by hash: the formula of which the volumes were made.
#[test]
fn volumes_are_what_the_formula_says() {
    let value = |[x, y, z]: [i32; 3]| {
        if x < 10 && y < 10 && z < 10 {
            1000
        } else {
            50 * x + 20 * y + 10 * z + (7 * x + 11 * y + 13 * z) % 97
        }
    };
    let dims = [21, 18, 13];
    let voxels: Vec<i32> =
        (0..21 * 18 * 13).map(|at| value([at % 21, at / 21 % 18, at / (21 * 18)])).collect();
    let whole = Region::whole(dims);
    let lossless = open("lossless-small.octavo").read_region::<i16>(0, whole).unwrap();
    assert!(lossless.iter().zip(&voxels).all(|(read, voxel)| i32::from(*read) == voxel - 1000));
    let fast = open("f64-fast.octavo").read_region::<f64>(0, whole).unwrap();
    assert!(fast.iter().zip(&voxels).all(|(read, voxel)| *read == f64::from(*voxel) / 7.0));
    for (name, bound) in [("max-error-assembled.octavo", 5), ("u8.octavo", 2)] {
        let read = open(name).read_region::<u16>(0, whole).unwrap();
        let errors = read.iter().zip(&voxels).map(|(read, voxel)| (i32::from(*read) - voxel).abs());
        let worst = errors.max().unwrap();
        // Bricks of 8 bits span at most 8 x 80 + 97 + 20: a code is 3 apart from the next.
        assert!((1..=bound).contains(&worst), "{name}: {worst}");
    }
    let u8 = open("u8.octavo");
    assert_eq!(u8.metadata().spacing_xyz, [0.5, 0.5, 1.0]);
    assert_eq!(u8.metadata().value_min, Some(133.0));
}
