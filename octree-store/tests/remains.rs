//! What is left of a store: a disk that does not give all of it back, and files made to keep its reader busy.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use octree_store::{
    BrickScratch, Damage, Disk, Encoding, Geometry, Mender, Metadata, NodeKey, Operation, Region,
    SampleType, Store, StoreError, StoreWriter, Watch, encode_samples, salvage, verify,
};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use twox_hash::XxHash3_64;

const PAGE: usize = 4096;

/// A store of 27 + 8 + 1 bricks of 8^3 without loss.
fn make(folder: &Path) -> PathBuf {
    make_with(folder, |_| (0.0, 65535.0))
}

/// The same, with records that say of the bricks beneath them what is told.
fn make_with(folder: &Path, subtree: impl Fn(NodeKey) -> (f64, f64)) -> PathBuf {
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
            (record.subtree_min, record.subtree_max) = subtree(key);
            payloads.extend_from_slice(&payload);
            octet.push(record);
        }
        writer.append(&mut octet, &payloads, Vec::new()).unwrap();
    }
    writer.finish(Metadata::new(&geometry, SampleType::U16, Encoding::Lossless)).unwrap();
    path
}

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
        let saved = folder.path().join(format!("{page}.octavo"));
        let writer = StoreWriter::create(&saved, &saved.with_extension("work"), vec![]).unwrap();
        let salvaged = salvage(&remains, writer, || true).unwrap().unwrap();
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

#[test]
fn what_contradicts_the_tree_is_lost_though_a_brick_beneath_it_is_lost_too() {
    let folder = tempfile::tempdir().unwrap();
    let liar = NodeKey::new(1, [0; 3]);
    let [gone, whole] = [NodeKey::new(0, [0; 3]), NodeKey::new(0, [1; 3])];
    // It holds the range of its own brick, and not those of the bricks beneath it.
    let path = make_with(folder.path(), |key| match key {
        key if key == liar => (0.0, 65534.0),
        _ => (0.0, 65535.0),
    });
    let mut bytes = std::fs::read(&path).unwrap();
    let index = u64::from_le_bytes(bytes[24..32].try_into().unwrap()) as usize;
    bytes[index + 60] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let remains = Store::open_remains(&path).unwrap();
    let saved = folder.path().join("saved.octavo");
    let writer = StoreWriter::create(&saved, &saved.with_extension("work"), vec![]).unwrap();
    let salvaged = salvage(&remains, writer, || true).unwrap().unwrap();
    let lost: Vec<NodeKey> = salvaged.lost.iter().map(|node| node.key).collect();
    assert_eq!(lost, [gone, liar]);
    let saved = Store::open(&saved).unwrap();
    let report = verify::verify(&saved, || true).unwrap().unwrap();
    let damaged: Vec<NodeKey> = report.damaged.iter().map(|node| node.key).collect();
    assert_eq!((damaged, report.metadata), (lost, None));
    // What is made up of a lost brick comes from what fits the tree.
    for key in [gone, liar, whole] {
        let record = saved.node(key).unwrap();
        assert_eq!((record.subtree_min, record.subtree_max), (0.0, 65535.0), "{key}");
    }
}

/// A metadata frame with a checksum that is right.
fn frame(json: &str) -> Vec<u8> {
    let checksum = XxHash3_64::oneshot_with_seed(1, json.as_bytes());
    [b"OCTV\x01\0\0\0", &checksum.to_le_bytes()[..], json.as_bytes()].concat()
}

/// The metadata of a whole store, as they stand in its file.
fn metadata_of(path: &Path) -> String {
    let bytes = std::fs::read(path).unwrap();
    let at = bytes.windows(4).rposition(|window| window == b"OCTV").unwrap();
    String::from_utf8(bytes[at + 16..].to_vec()).unwrap()
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
    bytes.splice(PAGE..PAGE, long);
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(Store::open_remains(&path).unwrap().metadata().dims_xyz, [24, 24, 24]);
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
