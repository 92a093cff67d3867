//! A store is read by several processes and threads at once, and while another is written.

use crate::support::{Bench, Said, octavo};
use octree_store::{BrickScratch, NodeKey, Region, Store, StoreError, verify};
use std::os::unix::fs::FileExt;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

const SCAN: &str = "a_40x33x20_u16.raw";
/// A source whose conversion takes a while.
const LARGE: &str = "b_400x400x300_u16.raw";
const LARGE_BYTES: u64 = 400 * 400 * 300 * 2;

/// Begins a command that goes on beside the test.
fn begin(bench: &Bench, arguments: &str) -> Child {
    let mut command = octavo();
    command.args(arguments.split(' ')).current_dir(bench.folder());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn end(child: Child) -> Said {
    Said::of(&child.wait_with_output().unwrap())
}

/// Waits until so many bytes of a conversion are there.
fn wait_for_work(bench: &Bench, child: &mut Child, bytes: u64) {
    let partial = bench.path("a.octavo.partial");
    while !std::fs::metadata(&partial).is_ok_and(|file| file.len() > bytes) {
        assert!(child.try_wait().unwrap().is_none(), "it ended too soon");
        sleep(Duration::from_millis(1));
    }
}

#[test]
fn several_processes_read_one_store_at_once() {
    let bench = Bench::new();
    bench.scan(SCAN);
    bench.ok(&format!("convert {SCAN} -o a.octavo --brick 8"));
    let here = Store::open(bench.path("a.octavo")).unwrap();
    let readers: Vec<_> = (0..4).map(|_| begin(&bench, "verify a.octavo")).collect();
    for reader in readers {
        assert_eq!(end(reader).code, 0);
    }
    assert!(here.node(NodeKey::new(0, [0; 3])).is_ok());
}

#[test]
fn threads_share_a_store() {
    let bench = Bench::new();
    bench.scan(SCAN);
    bench.ok(&format!("convert {SCAN} -o a.octavo --brick 8"));
    let store = Store::open(bench.path("a.octavo")).unwrap();
    let region = Region::whole([40, 33, 20]);
    let expected = store.read_region::<u16>(0, region).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| assert_eq!(store.read_region::<u16>(0, region).unwrap(), expected));
        }
    });
    let samples = store.geometry().brick_samples();
    let mut wrong = vec![0_i16; samples];
    let key = NodeKey::new(0, [0; 3]);
    assert!(
        store.read_brick(key, &mut BrickScratch::default(), &mut wrong).is_err(),
        "another type"
    );
}

#[test]
fn a_conversion_that_goes_on_is_not_taken_for_a_store() {
    let bench = Bench::new();
    bench.noise(LARGE, LARGE_BYTES);
    let mut child = begin(&bench, &format!("convert {LARGE} -o a.octavo --threads 1"));
    wait_for_work(&bench, &mut child, 1 << 20);
    let said = bench.run("info a.octavo.partial");
    assert_eq!(said.code, 2, "{}", said.out);
    assert!(said.err.contains("not finished"), "{}", said.err);
    let mut refused = 0;
    while child.try_wait().unwrap().is_none() {
        match Store::open(bench.path("a.octavo.partial")) {
            Err(StoreError::Incomplete { .. }) => refused += 1,
            // It has its name already, or is whole and about to get it.
            Err(StoreError::Io { .. }) => {}
            other => assert!(other.unwrap().metadata().complete),
        }
        if let Ok(store) = Store::open(bench.path("a.octavo")) {
            assert!(store.metadata().complete);
        }
        sleep(Duration::from_millis(1));
    }
    assert!(refused > 20, "{refused}");
    assert_eq!(end(child).code, 0);
    bench.ok("verify a.octavo");
}

/// While a store is replaced again and again, whoever opens it has the old one or the new one, and keeps it.
#[test]
fn readers_have_the_old_store_or_the_new_one_and_never_both() {
    let bench = Bench::new();
    let first = bench.scan(SCAN);
    let second: Vec<u8> = first.iter().rev().copied().collect();
    bench.write("second_40x33x20_u16.raw", &second);
    bench.ok(&format!("convert {SCAN} -o a.octavo --brick 8 --encoding lossless"));
    let path = bench.path("a.octavo");
    let region = Region::whole([40, 33, 20]);
    let volume = |bytes: &[u8]| -> Vec<u16> {
        bytes.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect()
    };
    let (first, second) = (volume(&first), volume(&second));
    let kept = Store::open(&path).unwrap();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let read = || {
            let mut seen = [0; 2];
            while !done.load(Ordering::Relaxed) {
                let store = Store::open(&path).unwrap();
                let found = store.read_region::<u16>(0, region).unwrap();
                assert!(found == first || found == second, "neither the one nor the other");
                seen[usize::from(found == second)] += 1;
            }
            seen
        };
        let readers: Vec<_> = (0..3).map(|_| scope.spawn(read)).collect();
        for source in ["second_40x33x20_u16.raw", SCAN].repeat(5) {
            let command = format!("convert {source} -o a.octavo --brick 8 --encoding lossless");
            bench.ok(&format!("{command} --force"));
        }
        done.store(true, Ordering::Relaxed);
        let seen: Vec<_> = readers.into_iter().map(|reader| reader.join().unwrap()).collect();
        assert!(seen.iter().any(|[a, b]| *a > 0 && *b > 0), "{seen:?}");
    });
    assert!(kept.read_region::<u16>(0, region).unwrap() == first, "what was opened stays");
}

#[test]
fn a_writer_that_is_killed_leaves_readers_alone() {
    let bench = Bench::new();
    bench.scan(SCAN);
    bench.noise(LARGE, LARGE_BYTES);
    bench.ok(&format!("convert {SCAN} -o a.octavo --brick 8"));
    let store = Store::open(bench.path("a.octavo")).unwrap();
    for bytes in [0, 4 << 20, 20 << 20] {
        let command = format!("convert {LARGE} -o a.octavo --threads 1 --force");
        let mut child = begin(&bench, &command);
        wait_for_work(&bench, &mut child, bytes);
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(verify::verify(&store, || true).unwrap().unwrap().is_ok());
        let again = Store::open(bench.path("a.octavo")).unwrap();
        assert_eq!(again.metadata().digest, store.metadata().digest);
        let unfinished = Store::open(bench.path("a.octavo.partial"));
        // A file without a first page is none yet.
        let incomplete =
            matches!(unfinished, Err(StoreError::Incomplete { .. } | StoreError::NotAStore { .. }));
        assert!(incomplete, "{unfinished:?}");
    }
    bench.ok(&format!("convert {LARGE} -o a.octavo --force"));
    assert_eq!(bench.names(), ["a.octavo", SCAN, LARGE]);
}

#[test]
fn of_many_writers_at_once_each_is_whole_or_refused() {
    let bench = Bench::new();
    bench.scan(SCAN);
    bench.noise(LARGE, LARGE_BYTES);
    let whole = bench.ok(&format!("convert {SCAN} -o a.octavo --brick 8 --json")).json();
    let command = format!("convert {SCAN} -o a.octavo --brick 8 --force");
    for _ in 0..5 {
        let writers: Vec<_> = (0..6).map(|_| begin(&bench, &command)).collect();
        let said: Vec<_> = writers.into_iter().map(end).collect();
        assert!(said.iter().any(|said| said.code == 0));
        for said in said.iter().filter(|said| said.code != 0) {
            assert_eq!(said.code, 3, "{}", said.err);
            assert!(said.err.contains("another conversion"), "{}", said.err);
        }
        bench.ok("verify a.octavo");
        assert_eq!(bench.ok("info a.octavo --json").json()["digest"], whole["digest"]);
        assert_eq!(bench.names(), ["a.octavo", SCAN, LARGE]);
    }
    // Nor is a store repaired while another is made in its place.
    let mut child = begin(&bench, &format!("convert {LARGE} -o a.octavo --threads 1 --force"));
    wait_for_work(&bench, &mut child, 1 << 20);
    let said = bench.run(&format!("repair a.octavo --against {SCAN} --force"));
    assert_eq!(said.code, 3, "{}{}", said.out, said.err);
    assert!(said.err.contains("another conversion or repair"), "{}", said.err);
    assert_eq!(end(child).code, 0);
}

/// Who reads while payloads are put right in place gets what is right, or is told of the damage.
#[test]
fn a_store_is_read_while_it_is_repaired() {
    let bench = Bench::new();
    let source = bench.scan(SCAN);
    bench.ok(&format!("convert {SCAN} -o a.octavo --brick 8 --encoding lossless"));
    let path = bench.path("a.octavo");
    let store = Store::open(&path).unwrap();
    let right: Vec<u16> =
        source.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect();
    let whole = std::fs::read(&path).unwrap();
    let mut places = Vec::new();
    store
        .visit_level(0, |record| {
            places.push(4096 + record.place.offset as usize + 9);
            true
        })
        .unwrap();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let region = Region::whole([40, 33, 20]);
            let (mut read, mut damaged) = (0, 0);
            while !done.load(Ordering::Relaxed) {
                match store.read_region::<u16>(0, region) {
                    Ok(found) => {
                        assert!(found == right);
                        read += 1;
                    }
                    Err(StoreError::Damaged { .. }) => damaged += 1,
                    Err(other) => panic!("{other}"),
                }
            }
            (read, damaged)
        });
        for _ in 0..3 {
            let mut bytes = whole.clone();
            places.iter().step_by(3).for_each(|place| bytes[*place] ^= 0x20);
            // In place: the reader has this very file open.
            let file = std::fs::File::options().write(true).open(&path).unwrap();
            file.write_all_at(&bytes, 0).unwrap();
            sleep(Duration::from_millis(20));
            bench.ok(&format!("repair a.octavo --against {SCAN}"));
            assert!(std::fs::read(&path).unwrap() == whole);
        }
        done.store(true, Ordering::Relaxed);
        let (read, damaged) = reader.join().unwrap();
        assert!(read > 0 && damaged > 0, "{read} read, {damaged} damaged");
    });
}
