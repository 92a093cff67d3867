//! What is left of a store: a disk that does not give all of it back, and files made to keep its reader busy.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod noise;

use noise::{PAGE, change_record, frame, index_offset, make, make_with, metadata_of};
use octree_store::{
    BrickScratch, BrickState, Damage, Disk, Mender, Metadata, NodeKey, NodeRecord, Operation,
    Region, SALVAGED_OF, Salvaged, Store, StoreError, StoreWriter, Watch, salvage, verify,
};
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A disk on which some bytes of the store can no longer be read.
#[derive(Debug)]
struct BadBytes(Range<u64>);

impl Watch for BadBytes {
    fn before(&self, operation: Operation<'_>) -> io::Result<()> {
        match operation {
            Operation::Read { path, offset, bytes }
                if path.ends_with("a.octavo")
                    && offset < self.0.end
                    && self.0.start < offset + bytes as u64 =>
            {
                // EIO.
                Err(io::Error::from_raw_os_error(5))
            }
            _ => Ok(()),
        }
    }
}

#[test]
fn of_a_disk_with_a_bad_page_all_else_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    let whole = Store::open(&path).unwrap();
    let geometry = *whole.geometry();
    let keys: Vec<NodeKey> = geometry.levels().flat_map(|level| geometry.keys_at(level)).collect();
    let mut scratch = BrickScratch::default();
    let [mut right, mut read] = [(); 2].map(|()| vec![0_u16; geometry.brick_samples()]);
    let pages = std::fs::metadata(&path).unwrap().len().div_ceil(PAGE as u64);
    let (mut all_saved, mut unreadable) = (0, 0);
    for page in 0..pages {
        let bad = page * PAGE as u64..(page + 1) * PAGE as u64;
        let disk = Disk::watched(Arc::new(BadBytes(bad)));
        let remains = Store::open_remains_on(&disk, &path).unwrap();
        // What is damaged is found, and all else is read as it was.
        let report = verify::verify(&remains, || true).unwrap().unwrap();
        for key in &keys {
            let is_damaged = report.damaged.iter().any(|node| node.key == *key);
            match remains.read_brick(*key, &mut scratch, &mut read) {
                Ok(_) => {
                    whole.read_brick(*key, &mut scratch, &mut right).unwrap();
                    assert!(!is_damaged && read == right, "page {page}: {key}");
                }
                Err(StoreError::Damaged { key: named, .. }) => {
                    assert!(is_damaged && named == *key, "page {page}: {key}");
                }
                Err(error) => panic!("page {page}: {key}: {error}"),
            }
        }
        let (saved, salvaged) = save(&remains, folder.path());
        assert_all_else_is_whole(&saved);
        assert_eq!(salvaged.lost, report.damaged, "page {page}");
        // A page has parts of six payloads of 2,000 bytes at most, or of 35 records.
        assert!(salvaged.lost.len() <= 35, "page {page}: {}", salvaged.lost.len());
        unreadable += salvaged
            .lost
            .iter()
            .filter(|node| matches!(node.damage, Damage::Unreadable { .. }))
            .count();
        all_saved += u32::from(salvaged.lost.is_empty());
        let said = remains.fault_around_records();
        assert!(!salvaged.lost.is_empty() || said.is_some(), "page {page}: nothing is said");
    }
    assert_eq!(all_saved, 3, "the first page, and either copy of the metadata");
    assert!(unreadable >= keys.len(), "{unreadable}: every payload lies in a page or two");
    // Where nothing can be read, that is said, and not that it is no store.
    let disk = Disk::watched(Arc::new(BadBytes(0..u64::MAX)));
    let nothing = Store::open_remains_on(&disk, &path);
    assert!(matches!(nothing, Err(StoreError::Io { .. })), "{nothing:?}");
}

/// What is left of a store, saved beside it; and which bricks `verify` finds lost then.
fn save(remains: &Store, folder: &Path) -> (Store, Salvaged) {
    let path = folder.join("saved.octavo");
    let _ = std::fs::remove_file(&path);
    let work = path.with_extension("work");
    let _ = std::fs::remove_file(&work);
    let writer = StoreWriter::create(&path, &work, vec![]).unwrap();
    let salvaged = salvage(remains, writer, || true).unwrap().unwrap();
    let saved = Store::open(&path).unwrap();
    let report = verify::verify(&saved, || true).unwrap().unwrap();
    assert_eq!(report.metadata, None);
    assert_eq!(keys_of(&report.damaged), keys_of(&salvaged.lost));
    (saved, salvaged)
}

/// What is lost fits the tree as what is whole does.
fn assert_all_else_is_whole(saved: &Store) {
    let report = verify::verify(saved, || true).unwrap().unwrap();
    assert!(report.damaged.iter().all(|node| node.damage == Damage::Lost), "{report:?}");
}

fn keys_of(damaged: &[verify::DamagedNode]) -> Vec<NodeKey> {
    damaged.iter().map(|node| node.key).collect()
}

/// Flips a bit of a record.
fn damage_record(path: &Path, key: NodeKey) {
    let rank = Store::open(path).unwrap().geometry().rank(key) as usize;
    let mut bytes = std::fs::read(path).unwrap();
    let index = index_offset(&bytes);
    bytes[index + rank * NodeRecord::BYTES + 60] ^= 1;
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn what_contradicts_the_tree_is_lost_though_a_brick_beneath_it_is_lost_too() {
    let folder = tempfile::tempdir().unwrap();
    let liar = NodeKey::new(1, [0; 3]);
    let [gone, whole] = [NodeKey::new(0, [0; 3]), NodeKey::new(0, [1; 3])];
    let path = make(folder.path());
    // It holds the range of its own brick, and not those of the bricks beneath it.
    change_record(&path, liar, |record| {
        (record.subtree_min, record.subtree_max) = (record.brick_min, record.brick_max - 1.0);
        record.brick_max -= 1.0;
    });
    damage_record(&path, gone);
    let (saved, salvaged) = save(&Store::open_remains(&path).unwrap(), folder.path());
    assert_eq!(keys_of(&salvaged.lost), [gone, liar]);
    assert_all_else_is_whole(&saved);
    // What is made up of a lost brick comes from what fits the tree.
    for key in [gone, liar, whole] {
        let record = saved.node(key).unwrap();
        assert_eq!((record.subtree_min, record.subtree_max), (0.0, 65535.0), "{key}");
    }
}

#[test]
fn of_a_brick_of_which_nothing_is_left_the_volume_says_what_holds() {
    type Change = fn(&mut Metadata);
    let cases: [(Change, (f64, f64)); 6] = [
        (|m| (m.value_min, m.value_max) = (None, None), (0.0, 0.0)),
        (|m| (m.value_min, m.value_max) = (Some(10.0), Some(20.0)), (10.0, 20.0)),
        // A brick of no number has the range 0..0.
        (|m| (m.value_min, m.value_max, m.nan_count) = (Some(10.0), Some(20.0), 3), (0.0, 20.0)),
        (|m| (m.value_min, m.value_max, m.inf_count) = (Some(-20.0), Some(-10.0), 1), (-20.0, 0.0)),
        (
            |m| {
                (m.value_min, m.value_max) = (Some(10.0), Some(20.0));
                m.options.insert("nan_value".into(), 500.into());
            },
            (10.0, 500.0),
        ),
        (
            |m| {
                (m.value_min, m.value_max) = (Some(10.0), Some(20.0));
                (m.empty_below, m.empty_value) = (Some(12.0), -7.0);
            },
            (-7.0, 20.0),
        ),
    ];
    for (change, (min, max)) in cases {
        let folder = tempfile::tempdir().unwrap();
        let path = make_with(folder.path(), change);
        let whole = Store::open(&path).unwrap();
        let geometry = *whole.geometry();
        let [root, corner] = [geometry.root(), NodeKey::new(0, [2; 3])];
        // Without what lies between a corner's brick and the root, both are known by the volume alone.
        for key in [root, NodeKey::new(1, [1; 3]), corner] {
            damage_record(&path, key);
        }
        let (saved, salvaged) = save(&Store::open_remains(&path).unwrap(), folder.path());
        assert_eq!(salvaged.metadata.options[SALVAGED_OF], whole.metadata().digest);
        for (key, bound) in [(root, max - min), (corner, 0.0)] {
            let record = saved.node(key).unwrap();
            assert_eq!(record.state, BrickState::Lost);
            assert_eq!((record.brick_min, record.brick_max), (min, max), "{key}");
            assert_eq!((record.subtree_min, record.subtree_max), (min, max), "{key}");
            assert_eq!((record.lod_rms_bound, record.lod_amax_bound), (bound, bound), "{key}");
        }
        // Saved once more, it is still that store's.
        let once_more = folder.path().join("once-more");
        std::fs::create_dir_all(&once_more).unwrap();
        let (_, again) = save(&saved, &once_more);
        assert_eq!(again.metadata.options[SALVAGED_OF], whole.metadata().digest);
    }
}

#[test]
fn a_file_that_speaks_of_more_bricks_than_it_has_bytes_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    let whole = std::fs::read(&path).unwrap();
    let json = metadata_of(&path);
    assert!(json.contains("[24,24,24]"));
    let claimed = frame(&json.replace("[24,24,24]", "[2097152,2097152,1048576]"));
    // Without a first page, and with one that is whole.
    let mut bytes = [[0; PAGE].to_vec(), claimed.clone()].concat();
    std::fs::write(&path, &bytes).unwrap();
    let refused = Store::open_remains(&path);
    assert!(matches!(refused, Err(StoreError::NothingLeft { .. })), "{refused:?}");
    bytes = whole.clone();
    let field = |at: usize| u64::from_le_bytes(whole[at..at + 8].try_into().unwrap()) as usize;
    let begin = (PAGE + field(16)).next_multiple_of(PAGE);
    bytes[begin..begin + claimed.len()].copy_from_slice(&claimed);
    bytes.truncate(field(24) + field(32));
    std::fs::write(&path, &bytes).unwrap();
    let refused = Store::open_remains(&path);
    assert!(matches!(refused, Err(StoreError::NothingLeft { .. })), "{refused:?}");
    // As it was, it is opened without its first page.
    bytes = whole;
    bytes[..PAGE].fill(0);
    std::fs::write(&path, &bytes).unwrap();
    let region = Region::whole([24, 24, 24]);
    Store::open_remains(&path).unwrap().read_region::<u16>(0, region).unwrap();
}

#[test]
fn a_file_full_of_beginnings_is_searched_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.octavo");
    let begins = Instant::now();
    for beginning in [&b"OCTV"[..], b"OCTV\x01\0\0\0", b"OCTV\x01\0\0\0        {\"a\":\""] {
        std::fs::write(&path, beginning.repeat((2 << 20) / beginning.len())).unwrap();
        let refused = Store::open_remains(&path);
        assert!(matches!(refused, Err(StoreError::NotAStore { .. })), "{refused:?}");
    }
    let longer = Duration::from_secs(30);
    assert!(begins.elapsed() < longer, "{:?} for 6 MB", begins.elapsed());
    // Metadata of any length are found.
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    let json = metadata_of(&path);
    let note = format!("{{\"note\":\"{}\",", "x".repeat(700_000));
    let long = frame(&json.replacen('{', &note, 1));
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[..PAGE].fill(0);
    while let Some(at) = bytes.windows(4).position(|window| window == b"OCTV") {
        bytes[at..at + 4].fill(0);
    }
    bytes.splice(PAGE..PAGE, long);
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(Store::open_remains(&path).unwrap().metadata().dims_xyz, [24, 24, 24]);
}

#[test]
fn a_record_that_is_not_the_one_that_was_found_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    assert_eq!(Store::open_remains(&path).unwrap().fault_around_records(), None);
    let whole = std::fs::read(&path).unwrap();
    let index = index_offset(&whole);
    // Another record of the second brick in the place of the first one's, which comes before its own.
    let [first, second] =
        [0, 1].map(|rank| index + rank * NodeRecord::BYTES..index + (rank + 1) * NodeRecord::BYTES);
    let mut record = NodeRecord::from_bytes(&whole[second]).unwrap();
    record.lod_amax_bound = 1.0;
    let mut bytes = whole;
    bytes[first].copy_from_slice(&record.to_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let told = Store::open_remains(&path).unwrap().fault_around_records();
    assert_eq!(told.as_deref(), Some("records have changed places"));
}

#[test]
fn no_payload_but_the_one_that_was_there_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    let whole = std::fs::read(&path).unwrap();
    let store = Store::open(&path).unwrap();
    let record = store.node(NodeKey::new(0, [1; 3])).unwrap();
    let mut scratch = BrickScratch::default();
    let payload = store.read_payload(&record, &mut scratch).unwrap();
    let at = PAGE + record.place.offset as usize;
    let mut damaged = whole.clone();
    damaged[at] ^= 1;
    std::fs::write(&path, &damaged).unwrap();
    let mender = Mender::open(&store).unwrap();
    let mut other = payload.to_vec();
    other[7] ^= 1;
    for wrong in [&other[..], &payload[1..], &[]] {
        assert!(!mender.write(&record, wrong).unwrap());
        assert!(std::fs::read(&path).unwrap() == damaged);
    }
    assert!(mender.write(&record, payload).unwrap());
    mender.finish().unwrap();
    assert!(std::fs::read(&path).unwrap() == whole);
}

#[test]
fn a_store_that_took_the_name_of_another_is_not_written_into() {
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    let store = Store::open(&path).unwrap();
    assert!(Mender::open(&store).is_ok());
    std::fs::copy(&path, folder.path().join("b.octavo")).unwrap();
    std::fs::rename(folder.path().join("b.octavo"), &path).unwrap();
    let refused = Mender::open(&store);
    assert!(matches!(refused, Err(StoreError::Io { .. })), "{refused:?}");
}
