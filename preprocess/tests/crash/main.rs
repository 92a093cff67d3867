//! Every operation on a disk fails once, or is the last: a conversion leaves nothing under the store's name, or a
//! store that is whole; and it can be gone on with.
//!
//! `OCTAVO_TEST_ROUNDS` is how often every operation is tried (1): with other power cuts, and second stops.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test that cannot go on fails")]

mod disk;

use disk::{Fault, FaultyDisk, Left, Random};
use octree_store::verify::{self, DamagedNode};
use octree_store::{Damage, Disk, Encoding, Operation, Store, StoreError, Watch};
use preprocess::{
    Conversion, ConvertOptions, NoProgress, PreprocessError, Source, SourceOptions, Start, convert,
};
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const PAGE: u64 = 4096;

/// A small source, a folder for stores, and the digest of what comes of an undisturbed conversion.
struct Bench {
    _folder: tempfile::TempDir,
    source: Source,
    /// All that is in it lies on the disk that fails.
    stores: PathBuf,
    store: PathBuf,
    digest: String,
    /// Operations of an undisturbed conversion, and those that change something.
    operations: u64,
    changes: u64,
}

impl Bench {
    fn new() -> Self {
        // Where there is memory to be had as a folder, that is faster.
        let shared = Path::new("/dev/shm");
        let folder =
            if shared.is_dir() { tempfile::tempdir_in(shared) } else { tempfile::tempdir() };
        let folder = folder.unwrap();
        let path = folder.path().join("a_40x33x30_u16.raw");
        let mut random = Random(3);
        let voxels = (0..40 * 33 * 30_u32).map(|i| (i / 640) as u16 + random.below(900) as u16);
        fs::write(&path, voxels.flat_map(u16::to_le_bytes).collect::<Vec<_>>()).unwrap();
        let source = Source::open(&path, &SourceOptions::default()).unwrap();
        let stores = folder.path().join("stores");
        fs::create_dir(&stores).unwrap();
        let store = stores.join("a.octavo");
        let mut bench = Self {
            _folder: folder,
            source,
            stores,
            store,
            digest: String::new(),
            operations: 0,
            changes: 0,
        };
        let undisturbed = FaultyDisk::new(&bench.stores, None);
        bench.digest = bench.convert(undisturbed.disk(), Start::Fresh).unwrap().metadata.digest;
        bench.operations = undisturbed.chances(Fault::Fails);
        bench.changes = undisturbed.chances(Fault::Stops);
        bench.clear();
        bench
    }

    fn clear(&self) {
        for entry in fs::read_dir(&self.stores).unwrap() {
            fs::remove_file(entry.unwrap().path()).unwrap();
        }
    }

    fn names(&self) -> Vec<String> {
        let names = fs::read_dir(&self.stores).unwrap();
        names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    fn convert(&self, disk: Disk, start: Start) -> Result<Conversion, PreprocessError> {
        let options = ConvertOptions {
            brick_core: 8,
            brick_overlap: 1,
            encoding: Encoding::Lossless,
            threads: 1,
            // A commit for every few octets.
            commit_source_bytes: 12 << 10,
            start,
            disk,
            ..ConvertOptions::default()
        };
        convert(&self.source, &self.store, &options, &NoProgress)
    }

    /// What can be opened, under whatever name, is whole and right.
    fn assert_nothing_is_wrong(&self, what: &str) {
        for name in self.names() {
            match Store::open(self.stores.join(&name)) {
                Ok(store) => {
                    let report = verify::verify(&store, || true).unwrap().unwrap();
                    assert!(report.is_ok(), "{what}: {name}: {report:?}");
                    assert_eq!(store.metadata().digest, self.digest, "{what}: {name}");
                }
                Err(error) => assert!(name != "a.octavo", "{what}: {error}"),
            }
        }
    }

    /// Goes on with what is left to the end, and says what that was.
    fn go_on(&self, what: &str) -> &'static str {
        let outcome = match self.convert(Disk::default(), Start::Resume) {
            Ok(done) => {
                assert_eq!(done.metadata.digest, self.digest, "{what}");
                if done.resumed_bricks > 0 { "resumed" } else { "begun anew" }
            }
            Err(PreprocessError::Exists { .. }) => "complete",
            Err(error) => {
                println!("{what}: refused: {error}");
                let done = self.convert(Disk::default(), Start::Replace).unwrap();
                assert_eq!(done.metadata.digest, self.digest, "{what}");
                "refused to go on"
            }
        };
        self.assert_nothing_is_wrong(what);
        assert_eq!(self.names(), ["a.octavo"], "{what}");
        outcome
    }

    /// A conversion with a fault, one that goes on with it and is stopped too, and one that is left in peace.
    fn trial(
        &self,
        at: u64,
        round: u64,
        fault: Fault,
        left: Left,
        outcomes: &mut Outcomes,
    ) -> bool {
        let what = format!("{fault:?} at operation {at} in round {round}, leaving {left:?}");
        self.clear();
        let mut random = Random((round * 1_000_003 + at) * 31 + left as u64);
        let faulty = FaultyDisk::new(&self.stores, Some((at, fault)));
        let done = self.convert(faulty.disk(), Start::Fresh);
        if !faulty.was_reached() {
            done.unwrap();
            return false;
        }
        if fault == Fault::Stops {
            faulty.restart(left, &mut random);
        }
        self.assert_nothing_is_wrong(&what);
        let said = match done {
            Ok(_) => "it ended well",
            Err(error) => {
                assert!(error.is_environment(), "{what}: {error}");
                "it said so"
            }
        };
        if (at + round).is_multiple_of(2) {
            let again = 1 + random.below(self.changes);
            let faulty = FaultyDisk::new(&self.stores, Some((again, Fault::Stops)));
            let _ = self.convert(faulty.disk(), Start::Resume);
            if faulty.was_reached() {
                faulty.restart(left, &mut random);
            }
            self.assert_nothing_is_wrong(&format!("{what}, then stopped at {again}"));
        }
        let then = self.go_on(&what);
        *outcomes.entry((format!("{fault:?}, {left:?}"), said, then)).or_default() += 1;
        true
    }
}

type Outcomes = BTreeMap<(String, &'static str, &'static str), u32>;

/// Tries operations from the first to the last, and beyond it; says what came of each.
fn every_operation(faults: &[(Fault, Left)]) -> Outcomes {
    let bench = Bench::new();
    let rounds = std::env::var("OCTAVO_TEST_ROUNDS").map_or(1, |rounds| rounds.parse().unwrap());
    let mut outcomes = Outcomes::new();
    for round in 0..rounds {
        for &(fault, left) in faults {
            let mut at = 1;
            while bench.trial(at, round, fault, left, &mut outcomes) {
                at += 1;
            }
            let all = if fault == Fault::Fails { bench.operations } else { bench.changes };
            assert!(at > all / 2, "{at} of {all}");
        }
    }
    for ((fault, said, then), count) in &outcomes {
        println!("{fault}: {said}, {then}: {count}");
    }
    println!(
        "{} faults at operations of about {}, of which {} change something",
        outcomes.values().sum::<u32>(),
        bench.operations,
        bench.changes
    );
    outcomes
}

fn count(outcomes: &Outcomes, then: &str) -> u32 {
    outcomes.iter().filter(|((.., found), _)| *found == then).map(|(_, count)| count).sum()
}

#[test]
fn an_operation_that_fails_costs_nothing() {
    let outcomes = every_operation(&[(Fault::Fails, Left::All), (Fault::NoRoom, Left::All)]);
    assert_eq!(count(&outcomes, "refused to go on"), 0);
    assert!(count(&outcomes, "resumed") > 0);
}

#[test]
fn a_program_that_is_killed_at_any_operation_can_be_gone_on_with() {
    let outcomes = every_operation(&[(Fault::Stops, Left::All)]);
    assert_eq!(count(&outcomes, "refused to go on"), 0);
    assert!(count(&outcomes, "resumed") > 0 && count(&outcomes, "complete") > 0);
}

#[test]
fn a_power_cut_at_any_operation_loses_nothing_that_was_committed() {
    let outcomes = every_operation(&[(Fault::Stops, Left::Durable), (Fault::Stops, Left::Some)]);
    assert_eq!(count(&outcomes, "refused to go on"), 0);
    assert!(count(&outcomes, "resumed") > 0 && count(&outcomes, "complete") > 0);
}

/// What a reader is told where the disk fails while it reads: that it cannot be read, or what is right.
#[test]
fn a_read_that_fails_is_an_error_and_no_damage() {
    let bench = Bench::new();
    bench.convert(Disk::default(), Start::Fresh).unwrap();
    let whole = Store::open(&bench.store).unwrap();
    let region = octree_store::Region::whole([40, 33, 30]);
    let right = whole.read_region::<u16>(0, region).unwrap();
    let (mut at, mut failed) = (1, 0);
    let (mut listed, mut named) = (Vec::new(), Vec::new());
    let is_unreadable = |node: &DamagedNode| matches!(node.damage, Damage::Unreadable { .. });
    loop {
        let faulty = FaultyDisk::new(&bench.stores, Some((at, Fault::Fails)));
        let disk = faulty.disk();
        let read = Store::open_on(&disk, &bench.store).and_then(|store| {
            let report = verify::verify(&store, || true)?.unwrap();
            assert!(report.damaged.iter().all(is_unreadable), "{at}: {report:?}");
            assert_eq!(report.metadata, None, "{at}");
            Ok((report.damaged, store.read_region::<u16>(0, region)?))
        });
        if !faulty.was_reached() {
            let (none, read) = read.unwrap();
            assert!(none.is_empty() && read == right);
            break;
        }
        match read {
            // It was opening then, or looking for the second metadata.
            Err(StoreError::Io { .. }) => {}
            Ok((unreadable, read)) => {
                assert!(unreadable.len() == 1 && read == right, "{at}: {unreadable:?}");
                listed.push(unreadable[0].key);
            }
            Err(StoreError::Unreadable { key, .. }) => named.push(key),
            other => panic!("{at}: {:?}", other.map(drop)),
        }
        failed += 1;
        at += 1 + at / 20;
    }
    let told = listed.len() + named.len();
    assert!(failed > 50 && failed - told < 10, "{failed}, {told} of a brick");
    listed.dedup();
    named.dedup();
    assert!(listed.len() > 20 && named.len() > 10, "{listed:?}, {named:?}");
}

/// A disk that never gives a page of the store back.
#[derive(Debug)]
struct BadPage {
    store: PathBuf,
    page: u64,
}

impl Watch for BadPage {
    fn before(&self, operation: Operation<'_>) -> io::Result<()> {
        match operation {
            Operation::Read { path, offset, bytes }
                if path == self.store
                    && offset < (self.page + 1) * PAGE
                    && self.page * PAGE < offset + bytes as u64 =>
            {
                // EIO.
                Err(io::Error::from_raw_os_error(5))
            }
            _ => Ok(()),
        }
    }
}

#[test]
fn what_a_disk_does_not_give_back_is_listed_and_repaired() {
    let bench = Bench::new();
    bench.convert(Disk::default(), Start::Fresh).unwrap();
    let whole = fs::read(&bench.store).unwrap();
    let mut listed = 0;
    for page in 0..(whole.len() as u64).div_ceil(PAGE) {
        let disk = Disk::watched(Arc::new(BadPage { store: bench.store.clone(), page }));
        let remains = Store::open_remains_on(&disk, &bench.store).unwrap();
        // A page has parts of a few payloads, or of 35 records.
        let unreadable = unreadable(&remains);
        assert!(unreadable <= 35, "page {page}: {unreadable}");
        // Who opens it as if it were whole is told the same.
        let opened = Store::open_on(&disk, &bench.store);
        if let Ok(store) = &opened {
            match verify::verify(store, || true) {
                Ok(report) => {
                    let report = report.unwrap();
                    let is_unreadable =
                        |node: &DamagedNode| matches!(node.damage, Damage::Unreadable { .. });
                    assert!(report.damaged.iter().all(is_unreadable), "page {page}: {report:?}");
                    // Records are read together with those of their siblings, and hold those of their parents.
                    assert!(report.damaged.len() >= unreadable, "page {page}: {report:?}");
                    listed += report.damaged.len();
                }
                // The second metadata.
                Err(error) => assert!(unreadable == 0, "page {page}: {error}"),
            }
        }
        let source = Source::open(bench.source.files[0].clone(), &SourceOptions::default());
        let how = ConvertOptions { threads: 1, ..ConvertOptions::default() };
        let repair = preprocess::repair(&remains, source.unwrap(), &how, &NoProgress).unwrap();
        assert_eq!((repair.repaired.len(), repair.in_place), (unreadable, false), "page {page}");
        assert!(unreadable > 0 || repair.around.is_some(), "page {page}");
        assert!(fs::read(&bench.store).unwrap() == whole, "page {page}: other bytes");
        assert_eq!(bench.names(), ["a.octavo"], "page {page}");
    }
    assert!(listed > 40, "{listed}");
}

/// How a store is damaged before it is repaired.
#[derive(Debug, Clone, Copy)]
enum Harm {
    /// In two payloads: they are put right in place.
    Payloads,
    /// In records too: the store is written anew.
    Records,
}

impl Harm {
    fn done_to(self, whole: &[u8]) -> Vec<u8> {
        let mut bytes = whole.to_vec();
        let field = |at: usize| u64::from_le_bytes(whole[at..at + 8].try_into().unwrap()) as usize;
        let (payload_bytes, index_offset) = (field(16), field(24));
        for at in [4096 + payload_bytes / 3, 4096 + payload_bytes / 3 * 2] {
            bytes[at] ^= 4;
        }
        if let Self::Records = self {
            bytes[index_offset + 120 * 7 + 50] ^= 1;
        }
        bytes
    }
}

/// Bricks that cannot be read.
fn unreadable(store: &Store) -> usize {
    verify::verify(store, || true).unwrap().unwrap().damaged.len()
}

/// A repair that is stopped anywhere leaves no more damaged than there was, and another one ends it.
#[test]
fn a_repair_that_stops_at_any_operation_harms_nothing_and_can_be_done_again() {
    let bench = Bench::new();
    bench.convert(Disk::default(), Start::Fresh).unwrap();
    let whole = fs::read(&bench.store).unwrap();
    let repair = |disk: &Disk, start: Start| {
        let how = ConvertOptions { threads: 1, start, ..ConvertOptions::default() };
        let store = Store::open_remains_on(disk, &bench.store).map_err(PreprocessError::Store)?;
        let source = Source::open(bench.source.files[0].clone(), &SourceOptions::default())?;
        preprocess::repair(&store, source, &how, &NoProgress)
    };
    let mut trials = 0;
    for harm in [Harm::Payloads, Harm::Records] {
        let damaged = harm.done_to(&whole);
        let faults = [
            (Fault::Fails, Left::All),
            (Fault::NoRoom, Left::All),
            (Fault::Stops, Left::All),
            (Fault::Stops, Left::Durable),
            (Fault::Stops, Left::Some),
        ];
        for (fault, left) in faults {
            // Most reads are alike: of those that fail, a few.
            let step = if fault == Fault::Fails { 1 + bench.operations as usize / 60 } else { 1 };
            for at in (1..).step_by(step) {
                let what = format!("{harm:?}, {fault:?} at operation {at}, leaving {left:?}");
                bench.clear();
                fs::write(&bench.store, &damaged).unwrap();
                let before = unreadable(&Store::open_remains(&bench.store).unwrap());
                assert!((2..=3).contains(&before), "{before}");
                let mut random = Random(at * 31 + left as u64);
                let faulty = FaultyDisk::new(&bench.stores, Some((at, fault)));
                let done = repair(&faulty.disk(), Start::Fresh);
                if !faulty.was_reached() {
                    assert_eq!(done.unwrap().digest, bench.digest);
                    assert!(at > 1, "{what}");
                    // What is said to be done stays done.
                    faulty.restart(Left::Durable, &mut random);
                    assert!(fs::read(&bench.store).unwrap() == whole, "{what}: not durable");
                    break;
                }
                if fault == Fault::Stops {
                    faulty.restart(left, &mut random);
                }
                // The bytes that were right are right still, whatever else was written.
                let remains = Store::open_remains(&bench.store).unwrap();
                assert!(unreadable(&remains) <= before, "{what}");
                drop(remains);
                let again = repair(&Disk::default(), Start::Fresh).or_else(|error| {
                    // Work that was stopped is not gone on with: it is done anew, when that is said.
                    assert!(matches!(error, PreprocessError::Unfinished { .. }), "{what}: {error}");
                    repair(&Disk::default(), Start::Replace)
                });
                assert_eq!(again.unwrap().digest, bench.digest, "{what}");
                bench.assert_nothing_is_wrong(&what);
                assert_eq!(bench.names(), ["a.octavo"], "{what}");
                assert!(fs::read(&bench.store).unwrap() == whole, "{what}: other bytes");
                trials += 1;
            }
        }
    }
    println!("{trials} faults of repairs");
}
