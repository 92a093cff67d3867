//! Work that is ended anywhere is gone on with, and ends in the same store.

use crate::support::{bits, scan, small_bricks};
use flate2::Compression;
use flate2::write::GzEncoder;
use octree_store::{Encoding, Store, to_le_bytes, verify};
use preprocess::source::nifti_header::{NiftiDatatype, NiftiHeader, NiftiUnit};
use preprocess::{
    Conversion, ConvertOptions, NoProgress, PreprocessError, Progress, Source, SourceOptions,
    Start, convert,
};
use std::fs::{self, File};
use std::io::Write;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use tempfile::TempDir;

/// Long in z, so that slots are used again and again.
const DIMS: [u64; 3] = [20, 23, 331];

/// Ends the work after so many octets.
struct EndAfter {
    octets: AtomicU64,
    /// As a kill would, without a last commit; else as one who asks to stop.
    killed: bool,
}

impl EndAfter {
    fn octets(octets: u64, killed: bool) -> Self {
        Self { octets: AtomicU64::new(octets), killed }
    }
}

impl Progress for EndAfter {
    fn bricks_done(&self, _: u64) {}

    fn should_stop(&self) -> bool {
        let ended =
            self.octets.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1));
        match ended {
            Ok(_) => false,
            // Past the hook that would print it: the walk's thread is gone without a word.
            Err(_) if self.killed => resume_unwind(Box::new("killed")),
            Err(_) => true,
        }
    }
}

/// A folder with a source.
struct Bench {
    folder: TempDir,
    source: PathBuf,
}

impl Bench {
    fn raw() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("a_20x23x331_u16.raw");
        fs::write(&source, to_le_bytes(&scan::<u16>(DIMS, 3))).unwrap();
        Self { folder, source }
    }

    fn gzip() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("a.nii.gz");
        let unit = NiftiUnit::Millimetre;
        let header =
            NiftiHeader::for_volume(DIMS, NiftiDatatype::U16, [1.0; 3], unit, None).unwrap();
        let mut file = GzEncoder::new(File::create(&source).unwrap(), Compression::fast());
        file.write_all(&header.to_bytes()).unwrap();
        file.write_all(&to_le_bytes(&scan::<u16>(DIMS, 3))).unwrap();
        file.finish().unwrap();
        Self { folder, source }
    }

    fn output(&self) -> PathBuf {
        self.folder.path().join("a.octavo")
    }

    fn convert(
        &self,
        options: &ConvertOptions,
        progress: &dyn Progress,
    ) -> Result<Conversion, PreprocessError> {
        let source = Source::open(&self.source, &SourceOptions::default()).unwrap();
        convert(&source, &self.output(), options, progress)
    }

    fn left(&self) -> Vec<String> {
        let names =
            fs::read_dir(self.folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<_> = names.map(|name| name.to_string_lossy().into_owned()).collect();
        names.retain(|name| name.starts_with("a.octavo"));
        names.sort();
        names
    }
}

/// A commit after every octet.
fn options(start: Start) -> ConvertOptions {
    ConvertOptions {
        commit_source_bytes: 1,
        start,
        threads: 2,
        ..small_bricks(Encoding::Quantised8)
    }
}

const RESUME: Start = Start::Resume;

fn undisturbed(bench: &Bench) -> Conversion {
    let done = bench.convert(&options(Start::Fresh), &NoProgress).unwrap();
    assert_eq!((done.resumed_bricks, bench.left()), (0, vec!["a.octavo".to_owned()]));
    fs::remove_file(bench.output()).unwrap();
    done
}

/// Octets of a conversion, counted by the octets after which it can no longer be ended.
fn octets(bench: &Bench) -> u64 {
    let count = EndAfter::octets(u64::MAX, false);
    bench.convert(&options(Start::Fresh), &count).unwrap();
    fs::remove_file(bench.output()).unwrap();
    u64::MAX - count.octets.into_inner()
}

fn ended_anywhere_it_goes_on(bench: &Bench, step: usize) {
    let expected = undisturbed(bench).metadata;
    let octets = octets(bench);
    assert!(octets > 100, "{octets}");
    for killed in [true, false] {
        for first in (1..octets).step_by(step) {
            let ended = bench.convert(&options(RESUME), &EndAfter::octets(first, killed));
            assert!(matches!(
                ended,
                Err(PreprocessError::Kept { .. } | PreprocessError::Panic { .. })
            ));
            // Ended once more on the way.
            let again = bits(first, [1, 2, 3]) % octets;
            let twice = bench.convert(&options(RESUME), &EndAfter::octets(again, killed));
            let last = twice.or_else(|_| bench.convert(&options(RESUME), &NoProgress)).unwrap();
            assert_eq!(last.metadata.digest, expected.digest, "ended after {first}, {again}");
            assert_eq!(last.metadata.levels, expected.levels);
            assert_eq!(bench.left(), ["a.octavo"]);
            // What stopped by itself was committed to the last octet; a kill loses what was on its way.
            if !killed {
                assert!(last.resumed_bricks >= first, "{} after {first}", last.resumed_bricks);
            }
            let store = Store::open(bench.output()).unwrap();
            assert!(verify::verify(&store, || true).unwrap().unwrap().is_ok());
            fs::remove_file(bench.output()).unwrap();
        }
    }
}

/// Puts a folder where the store is to get its name.
struct Obstructed(PathBuf);

impl Progress for Obstructed {
    fn bricks_done(&self, _: u64) {
        fs::create_dir_all(&self.0).unwrap();
    }

    fn should_stop(&self) -> bool {
        false
    }
}

/// As by a kill between the store's end and its name: what was finished without a commit must not be
/// taken for done.
#[test]
fn a_store_that_could_not_get_its_name_is_gone_on_with() {
    let bench = Bench::raw();
    let expected = undisturbed(&bench).metadata;
    // From a commit after every octet to none but the first few.
    for commit_source_bytes in [1, 20_000, 50_000, 150_000, 250_000] {
        let options = |start| ConvertOptions { commit_source_bytes, ..options(start) };
        let ended = bench.convert(&options(Start::Fresh), &Obstructed(bench.output()));
        assert!(matches!(ended, Err(PreprocessError::Kept { .. })), "{ended:?}");
        fs::remove_dir(bench.output()).unwrap();
        let last = bench.convert(&options(RESUME), &NoProgress).unwrap();
        assert!(last.resumed_bricks > 0);
        assert_eq!(last.metadata.digest, expected.digest, "{commit_source_bytes}");
        let store = Store::open(bench.output()).unwrap();
        assert!(verify::verify(&store, || true).unwrap().unwrap().is_ok());
        fs::remove_file(bench.output()).unwrap();
        assert!(bench.left().is_empty());
    }
}

/// Of several that begin at once one gets the output, and no other harms it.
#[test]
fn of_conversions_begun_together_one_makes_the_store() {
    let bench = Bench::raw();
    let expected = undisturbed(&bench).metadata;
    for round in 0..20 {
        let starts = [Start::Fresh, Start::Replace, RESUME, Start::Fresh];
        let bench = &bench;
        let ended = std::thread::scope(|scope| {
            let begun = starts.map(|start| {
                scope.spawn(move || {
                    bench.convert(&options(start), &NoProgress).map(|done| done.metadata)
                })
            });
            begun.map(|one| one.join().unwrap())
        });
        let done: Vec<_> = ended.iter().filter_map(|one| one.as_ref().ok()).collect();
        assert!(!done.is_empty(), "round {round}: {ended:?}");
        assert!(done.iter().all(|metadata| metadata.digest == expected.digest));
        for refused in ended.iter().filter_map(|one| one.as_ref().err()) {
            assert!(
                matches!(
                    refused,
                    PreprocessError::Busy { .. }
                        | PreprocessError::Exists { .. }
                        | PreprocessError::Unfinished { .. }
                ),
                "round {round}: {refused:?}"
            );
        }
        assert_eq!(bench.left(), ["a.octavo"]);
        fs::remove_file(bench.output()).unwrap();
    }
}

#[test]
fn a_mapped_source_ended_anywhere_goes_on_to_the_same_store() {
    ended_anywhere_it_goes_on(&Bench::raw(), 7);
}

#[test]
fn a_stream_ended_anywhere_goes_on_to_the_same_store() {
    ended_anywhere_it_goes_on(&Bench::gzip(), 29);
}

#[test]
fn other_threads_and_another_budget_go_on_with_the_same_work() {
    let bench = Bench::gzip();
    let expected = undisturbed(&bench).metadata.digest;
    bench.convert(&options(Start::Fresh), &EndAfter::octets(60, false)).unwrap_err();
    let other = ConvertOptions { threads: 1, memory_bytes: 64 << 20, ..options(RESUME) };
    let done = bench.convert(&other, &NoProgress).unwrap();
    assert_eq!(done.metadata.digest, expected);
    assert!(done.resumed_bricks > 60);
}

#[test]
fn unfinished_work_is_refused_without_a_flag_and_goes_with_force() {
    let bench = Bench::raw();
    let expected = undisturbed(&bench).metadata.digest;
    let kept = bench.convert(&options(Start::Fresh), &EndAfter::octets(60, false)).unwrap_err();
    assert!(kept.is_environment() && kept.to_string().contains("--resume"), "{kept}");
    assert_eq!(bench.left(), ["a.octavo.index", "a.octavo.partial", "a.octavo.scratch"]);
    let refused = bench.convert(&options(Start::Fresh), &NoProgress);
    assert!(matches!(refused, Err(PreprocessError::Unfinished { .. })));
    let anew = bench.convert(&options(Start::Replace), &NoProgress).unwrap();
    assert_eq!((anew.resumed_bricks, anew.metadata.digest), (0, expected));
    assert_eq!(bench.left(), ["a.octavo"]);
}

fn refused(bench: &Bench, options: &ConvertOptions, what: &str) {
    let error = bench.convert(options, &NoProgress).unwrap_err();
    assert!(
        matches!(&error, PreprocessError::CannotResume { what: found, .. } if found.contains(what)),
        "{error} where {what} was expected"
    );
    assert_eq!(bench.left().len(), 3, "what is there stays there");
}

#[test]
fn what_has_changed_meanwhile_is_not_mixed() {
    let bench = Bench::raw();
    let expected = undisturbed(&bench).metadata.digest;
    bench.convert(&options(Start::Fresh), &EndAfter::octets(60, false)).unwrap_err();
    let lossless = ConvertOptions { encoding: Encoding::Lossless, ..options(RESUME) };
    refused(&bench, &lossless, "other options");

    let before = fs::metadata(&bench.source).unwrap().modified().unwrap();
    let set_time =
        |time| File::options().write(true).open(&bench.source).unwrap().set_modified(time).unwrap();
    set_time(before + std::time::Duration::from_micros(1));
    refused(&bench, &options(RESUME), "modified");

    let voxels = fs::read(&bench.source).unwrap();
    let mut changed = voxels.clone();
    *changed.last_mut().unwrap() ^= 1;
    fs::write(&bench.source, &changed).unwrap();
    set_time(before);
    refused(&bench, &options(RESUME), "content");

    fs::write(&bench.source, &voxels).unwrap();
    set_time(before);
    let done = bench.convert(&options(RESUME), &NoProgress).unwrap();
    assert_eq!(done.metadata.digest, expected, "as it was, it goes on");
}

#[test]
fn damaged_work_is_not_gone_on_with() {
    let change = |path: &Path, change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = fs::read(path).unwrap();
        change(&mut bytes);
        fs::write(path, bytes).unwrap();
    };
    let bench = Bench::raw();
    let [scratch, partial] =
        ["scratch", "partial"].map(|end| bench.output().with_extension(format!("octavo.{end}")));
    bench.convert(&options(Start::Fresh), &EndAfter::octets(60, false)).unwrap_err();

    change(&scratch, &|bytes| bytes.iter_mut().for_each(|byte| *byte ^= 1));
    refused(&bench, &options(RESUME), "scratch");
    change(&scratch, &|bytes| bytes.push(0));
    refused(&bench, &options(RESUME), "another length");

    change(&scratch, &|bytes| bytes.truncate(bytes.len() - 1));
    change(&scratch, &|bytes| bytes.iter_mut().for_each(|byte| *byte ^= 1));
    let elsewhere = ConvertOptions { scratch: Some("/".into()), ..options(RESUME) };
    refused(&bench, &elsewhere, "--scratch");

    change(&partial, &|bytes| bytes.truncate(5000));
    refused(&bench, &options(RESUME), "cut short");
    assert_eq!(bench.left().len(), 3);
}

#[test]
fn work_that_was_ended_before_its_index_was_ready_begins_anew() {
    let bench = Bench::raw();
    let whole = undisturbed(&bench);
    let work = || {
        bench.convert(&options(Start::Fresh), &EndAfter::octets(9, false)).unwrap_err();
        let mut index = bench.output().into_os_string();
        index.push(".index");
        PathBuf::from(index)
    };
    // redb makes room first, and writes the bytes by which it knows its files last.
    for first in [&[0; 9][..], &[], &[0; 4096]] {
        let index = work();
        fs::write(&index, first).unwrap();
        let done = bench.convert(&options(Start::Resume), &NoProgress).unwrap();
        assert_eq!((done.resumed_bricks, &done.metadata.digest), (0, &whole.metadata.digest));
        assert_eq!(bench.left(), ["a.octavo"]);
        fs::remove_file(bench.output()).unwrap();
    }
}

#[test]
fn whichever_slot_is_damaged_it_is_noticed_or_no_longer_needed() {
    let bench = Bench::raw();
    let expected = undisturbed(&bench).metadata.digest;
    let work = ["partial", "index", "scratch"]
        .map(|end| bench.output().with_extension(format!("octavo.{end}")));
    let (mut refused, mut unneeded) = (0, 0);
    for ended in [31, 60, 87] {
        bench.convert(&options(Start::Fresh), &EndAfter::octets(ended, false)).unwrap_err();
        let left = work.each_ref().map(|file| fs::read(file).unwrap());
        // A slot is at least so long, and begins at a multiple of it.
        for slot in 0..left[2].len() / (1 << 16) {
            let mut scratch = left[2].clone();
            scratch[slot << 16..][..1 << 16].iter_mut().for_each(|byte| *byte ^= 0x15);
            fs::write(&work[0], &left[0]).unwrap();
            fs::write(&work[1], &left[1]).unwrap();
            fs::write(&work[2], &scratch).unwrap();
            match bench.convert(&options(RESUME), &NoProgress) {
                Ok(done) => {
                    assert_eq!(done.metadata.digest, expected, "slot {slot} after {ended}");
                    fs::remove_file(bench.output()).unwrap();
                    unneeded += 1;
                }
                Err(PreprocessError::CannotResume { .. }) => refused += 1,
                Err(error) => panic!("{error}"),
            }
        }
        for file in &work {
            drop(fs::remove_file(file));
        }
    }
    assert!(refused > 5 && unneeded > 0, "{refused} refused, {unneeded} unneeded");
}
