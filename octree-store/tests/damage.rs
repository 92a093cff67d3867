//! A store that is damaged anywhere gives right samples, or an error that names the brick; it never panics, hangs, or
//! takes memory without bound, and `verify` tells.
//!
//! `OCTAVO_TEST_FLIPS` is the number of flipped bits in each kind of bytes (40), of which 1,000 and more take long.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test that cannot go on fails")]

use octree_store::{
    BrickScratch, Encoding, Geometry, Metadata, NodeKey, NodeRecord, Region, SampleType, Store,
    StoreError, StoreWriter, encode_samples, verify,
};
use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;
use std::time::Duration;

const PAGE: usize = 4096;

/// Numbers that look random and are the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % limit
    }
}

/// A store of 125 + 27 + 8 + 1 bricks of 8^3, and what it holds.
struct Made {
    _folder: tempfile::TempDir,
    path: PathBuf,
    bytes: Vec<u8>,
    truth: BTreeMap<NodeKey, (NodeRecord, Vec<u16>)>,
    region: Vec<u16>,
}

fn make(encoding: Encoding, sample: impl Fn(&mut Random, usize) -> u16) -> Made {
    // Where there is memory to be had as a folder, that is faster.
    let shared = Path::new("/dev/shm");
    let folder = if shared.is_dir() { tempfile::tempdir_in(shared) } else { tempfile::tempdir() };
    let folder = folder.unwrap();
    let path = folder.path().join("a.octavo");
    let geometry = Geometry::new([40, 40, 40], 8, 1).unwrap();
    let work = path.with_extension("work");
    let mut writer = StoreWriter::create(&path, &work, Vec::new()).unwrap();
    let mut random = Random(1);
    for level in geometry.levels() {
        for parent in geometry.parents_of(level) {
            let mut payloads = Vec::new();
            let children = parent.children().into_iter().filter(|key| geometry.contains(*key));
            let mut octet: Vec<_> = children
                .map(|key| {
                    let samples: Vec<u16> =
                        (0..geometry.brick_samples()).map(|i| sample(&mut random, i)).collect();
                    let (mut record, payload) = encode_samples(key, &samples, encoding);
                    record.child_mask = geometry.child_mask(key);
                    (record.subtree_min, record.subtree_max) = (0.0, 65535.0);
                    payloads.extend_from_slice(&payload);
                    record
                })
                .collect();
            writer.append(&mut octet, &payloads, Vec::new()).unwrap();
        }
    }
    writer.finish(Metadata::new(&geometry, SampleType::U16, encoding)).unwrap();
    let store = Store::open(&path).unwrap();
    let mut scratch = BrickScratch::default();
    let keys = geometry.levels().flat_map(|level| geometry.keys_at(level));
    let truth = keys
        .map(|key| {
            let mut brick = vec![0_u16; geometry.brick_samples()];
            (key, (store.read_brick(key, &mut scratch, &mut brick).unwrap(), brick))
        })
        .collect();
    let region = store.read_region(0, Region::whole([40, 40, 40])).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    Made { _folder: folder, path, bytes, truth, region }
}

/// Bytes of one kind, wherever they lie.
type Kinds = BTreeMap<&'static str, Vec<Range<usize>>>;

/// What every byte of a store is.
fn kinds(bytes: &[u8]) -> Kinds {
    let field = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let page_after = |byte: usize| byte.next_multiple_of(PAGE);
    let payloads = PAGE..PAGE + field(16);
    let records = field(24)..field(24) + field(32);
    let copy = page_after(records.end)..bytes.len();
    let metadata = page_after(payloads.end)..page_after(payloads.end) + copy.len();
    assert!(bytes[metadata.clone()] == bytes[copy.clone()]);
    let all = [
        ("first page, used", 0..48),
        ("first page, rest", 48..PAGE),
        ("padding", payloads.end..metadata.start),
        ("padding", metadata.end..records.start),
        ("padding", records.end..copy.start),
        ("payloads", payloads),
        ("metadata", metadata),
        ("node records", records),
        ("metadata again", copy),
    ];
    let mut kinds = Kinds::new();
    for (kind, range) in all {
        kinds.entry(kind).or_default().push(range);
    }
    kinds
}

/// What came of one trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// The store is refused, or `verify` says that it is damaged.
    Detected,
    /// Nobody can tell a difference: the bytes are not used.
    Harmless,
}

/// Whether a failed read names the brick, or says that the file as such is at fault.
fn names_its_key(error: &StoreError, key: NodeKey) -> bool {
    match error {
        StoreError::Damaged { key: damaged, .. } => *damaged == key,
        _ => false,
    }
}

/// Reads all there is in all ways; what is read must be right, or an error.
fn read_all(made: &Made, store: &Store, what: &str) -> bool {
    let geometry = *store.geometry();
    let mut scratch = BrickScratch::default();
    let mut brick = vec![0_u16; geometry.brick_samples()];
    let mut all = true;
    for (key, (record, samples)) in &made.truth {
        match store.read_brick(*key, &mut scratch, &mut brick) {
            Ok(read) => assert!(read == *record && brick == *samples, "{what}: {key}"),
            Err(error) => {
                assert!(names_its_key(&error, *key), "{what}: {key}: {error}");
                all = false;
            }
        }
        if key.level() > 0 {
            match store.children(*key) {
                Ok(children) => children.iter().for_each(|child| {
                    assert_eq!(*child, made.truth[&child.key].0, "{what}");
                }),
                Err(_) => all = false,
            }
        }
    }
    for level in geometry.levels() {
        let visited = store.visit_level(level, |record| {
            assert_eq!(*record, made.truth[&record.key].0, "{what}");
            true
        });
        all &= visited.is_ok();
    }
    match store.read_region::<u16>(0, Region::whole([40, 40, 40])) {
        Ok(region) => assert!(region == made.region, "{what}"),
        Err(_) => all = false,
    }
    all
}

/// Opens, verifies and reads a store that may be damaged.
fn trial(made: &Made, path: &Path, what: &str) -> Outcome {
    // What is left of it is searched for as well: that must not fail otherwise, nor find what is not so.
    if let Ok(remains) = Store::open_remains(path) {
        read_all(made, &remains, what);
    }
    let store = match Store::open(path) {
        Ok(store) => store,
        Err(error) => {
            assert!(error.to_string().contains("a.octavo"), "{what}: {error}");
            return Outcome::Detected;
        }
    };
    let report = verify::verify(&store, || true).unwrap().unwrap();
    let all = read_all(made, &store, what);
    if report.is_ok() {
        assert!(all, "{what}: nothing is said to be wrong, and not all can be read");
        Outcome::Harmless
    } else {
        Outcome::Detected
    }
}

/// Damages a store in one way after another, and counts what came of it.
struct Trials<'a> {
    made: &'a Made,
    file: File,
    found: BTreeMap<String, [usize; 2]>,
    done: std::sync::mpsc::SyncSender<String>,
}

impl Trials<'_> {
    /// Writes bytes over the store's, tries, and puts back what was there.
    fn with(&mut self, kind: &str, what: &str, changes: &[(usize, Vec<u8>)]) {
        for (at, bytes) in changes {
            self.file.write_all_at(bytes, *at as u64).unwrap();
        }
        self.count(kind, what);
        for (at, bytes) in changes {
            let before = &self.made.bytes[*at..*at + bytes.len()];
            self.file.write_all_at(before, *at as u64).unwrap();
        }
    }

    fn count(&mut self, kind: &str, what: &str) {
        self.done.send(format!("{kind}: {what}")).unwrap();
        let outcome = trial(self.made, &self.made.path, &format!("{kind}: {what}"));
        let counts = self.found.entry(kind.to_owned()).or_default();
        counts[usize::from(outcome == Outcome::Harmless)] += 1;
    }
}

fn all_damage(
    made: &Made,
    flips: usize,
    done: std::sync::mpsc::SyncSender<String>,
) -> BTreeMap<String, [usize; 2]> {
    let file = File::options().write(true).open(&made.path).unwrap();
    let kinds = kinds(&made.bytes);
    let mut trials = Trials { made, file, found: BTreeMap::new(), done };
    let mut random = Random(7);
    let bytes = &made.bytes;
    for (kind, ranges) in kinds {
        let total: usize = ranges.iter().map(Range::len).sum();
        // Where there are fewer bits than trials, each of them once.
        let few = total * 8 <= flips;
        for flip in 0..flips.min(total * 8) {
            let bit = if few { flip } else { random.below(total * 8) };
            let mut rest = bit / 8;
            let range = ranges.iter().find(|range| {
                let here = rest < range.len();
                rest -= if here { 0 } else { range.len() };
                here
            });
            let at = range.unwrap().start + rest;
            let flipped = bytes[at] ^ 1 << (bit % 8);
            trials.with(
                &format!("bits of {kind}"),
                &format!("bit {} of byte {at}", bit % 8),
                &[(at, vec![flipped])],
            );
        }
    }
    let pages = bytes.len().div_ceil(PAGE);
    let page = |number: usize| number * PAGE..((number + 1) * PAGE).min(bytes.len());
    let every = (pages / flips.max(1)).max(1);
    for number in (0..pages).step_by(every) {
        trials.with(
            "pages zeroed",
            &format!("page {number}"),
            &[(page(number).start, vec![0; page(number).len()])],
        );
    }
    for _ in 0..flips {
        // Half of them among records and metadata, where pages have the same form.
        let payloads = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize / PAGE;
        let first = if random.below(2) == 0 { 0 } else { payloads };
        let (a, b) = (first + random.below(pages - first), first + random.below(pages - first));
        if a == b || page(a).len() != page(b).len() {
            continue;
        }
        let changes =
            [(page(a).start, bytes[page(b)].to_vec()), (page(b).start, bytes[page(a)].to_vec())];
        trials.with("pages swapped", &format!("pages {a} and {b}"), &changes);
    }
    for number in (0..pages).step_by(every) {
        trials.file.set_len((number * PAGE) as u64).unwrap();
        trials.count("files cut off", &format!("before page {number}"));
        trials.file.write_all_at(&bytes[number * PAGE..], (number * PAGE) as u64).unwrap();
    }
    trials.found
}

/// The most memory that this process has had, in bytes.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() << 10
}

/// Damages a store in every way, watched by a thread that notices where one takes for ever.
fn damaged_everywhere(made: &Made) -> BTreeMap<String, [usize; 2]> {
    let flips = std::env::var("OCTAVO_TEST_FLIPS").map_or(40, |flips| flips.parse().unwrap());
    assert_eq!(trial(made, &made.path, "whole"), Outcome::Harmless);
    let before = peak_memory();
    let (done, begun) = sync_channel(0);
    let found = std::thread::scope(|scope| {
        let trials = scope.spawn(|| all_damage(made, flips, done));
        let mut last = String::new();
        loop {
            match begun.recv_timeout(Duration::from_mins(2)) {
                Ok(what) => last = what,
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => break,
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {
                    // A thread that hangs cannot be joined.
                    println!("{last}: it hangs");
                    std::process::abort();
                }
            }
        }
        trials.join().unwrap()
    });
    let grown = peak_memory() - before;
    assert!(grown < 64 << 20, "{grown} bytes more");
    let mut sums = [0; 2];
    for (kind, [detected, harmless]) in &found {
        println!("{kind}: {} tried, {detected} detected, {harmless} harmless", detected + harmless);
        sums = [sums[0] + detected, sums[1] + harmless];
    }
    println!(
        "{} tried, {} detected, {} harmless, {} MB of memory more",
        sums[0] + sums[1],
        sums[0],
        sums[1],
        grown >> 20
    );
    // What is used has no bit that does not matter, and of pages there is one that is: no more.
    for kind in ["first page, used", "payloads", "metadata", "node records", "metadata again"] {
        let [detected, harmless] = found[&format!("bits of {kind}")];
        assert!(detected > 0 && harmless == 0, "{kind}: {harmless} harmless");
    }
    assert_eq!(found["bits of first page, rest"][0], 0);
    assert_eq!(found["pages zeroed"][1], 0);
    assert_eq!(found["files cut off"][1], 0);
    found
}

#[test]
fn noise_without_loss_damaged_everywhere() {
    damaged_everywhere(&make(Encoding::Lossless, |random, _| random.below(65536) as u16));
}

#[test]
fn compressed_codes_damaged_everywhere() {
    let sample = |random: &mut Random, i: usize| (i / 97 * 1500 + random.below(3)) as u16;
    damaged_everywhere(&make(Encoding::Quantised8, sample));
}
