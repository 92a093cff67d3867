//! Every parser on its seeds, on some thousands of files made from them by a fixed rule, and on what once went wrong; with a bound on
//! memory. `cargo fuzz` goes on where this ends (README.md).

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

use cap::Cap;
use std::alloc::System;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, usize::MAX);

/// What a parser may take beside what its input can expand to: tables of codecs, pools of a conversion, a server.
const OWN: usize = 96 << 20;
/// Deflate makes 1032 bytes of one.
const EXPANSION: usize = 1100;
/// Time for what is made from seeds, for each parser.
const TIME: Duration = Duration::from_secs(4);

/// A rule that makes other numbers of a number (xorshift).
struct Rule(u64);

impl Rule {
    fn next(&mut self) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize
    }

    fn below(&mut self, limit: usize) -> usize {
        self.next() % limit.max(1)
    }

    /// A file with some changes.
    fn change(&mut self, seed: &[u8], other: &[u8]) -> Vec<u8> {
        let mut bytes = seed.to_vec();
        for _ in 0..=self.below(4) {
            let at = self.below(bytes.len());
            match self.below(8) {
                _ if bytes.is_empty() => bytes.push(self.next() as u8),
                0 => bytes[at] ^= 1 << self.below(8),
                1 => bytes[at] = self.next() as u8,
                2 => bytes.truncate(at),
                3 => {
                    let from = self.below(other.len());
                    let length = self.below(other.len() - from).min(64);
                    bytes.splice(at..at, other[from..from + length].iter().copied());
                }
                4 => {
                    let end = (at + self.below(32)).min(bytes.len());
                    bytes.drain(at..end);
                }
                // Numbers at which arithmetic breaks, in both byte orders.
                kind => {
                    let number = [
                        0,
                        1,
                        0x7fff,
                        0x8000,
                        0xffff,
                        0x7fff_ffff,
                        0x8000_0000,
                        0xffff_ffff_u64,
                        1 << 62,
                        u64::MAX,
                    ][self.below(10)];
                    let width = [1, 2, 4, 8][self.below(4)].min(bytes.len() - at);
                    let little = number.to_le_bytes();
                    for i in 0..width {
                        bytes[at + i] = if kind == 5 { little[i] } else { little[width - 1 - i] };
                    }
                }
            }
        }
        bytes
    }
}

fn run(name: &str, oracle: fuzz::Oracle, bytes: &[u8], what: &str) {
    let before = MEMORY.allocated();
    MEMORY.set_limit(before + OWN + EXPANSION * bytes.len()).unwrap();
    let result = catch_unwind(AssertUnwindSafe(|| oracle(bytes)));
    MEMORY.set_limit(usize::MAX).unwrap();
    if result.is_err() {
        let kept = std::env::temp_dir().join(format!("octavo-smoke-{name}-{}", bytes.len()));
        std::fs::write(&kept, bytes).unwrap();
        panic!("{name}: {what}; the bytes are in {}", kept.display());
    }
}

/// One parser; nextest runs each in a process of its own.
fn smoke(name: &str) {
    let (_, oracle) = fuzz::ORACLES.into_iter().find(|(known, _)| *known == name).unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("regressions").join(name);
    for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
        run(
            name,
            oracle,
            &std::fs::read(entry.path()).unwrap(),
            &entry.path().display().to_string(),
        );
    }
    let seeds = fuzz::seeds(name, None);
    assert!(!seeds.is_empty(), "{name} has seeds");
    for (number, seed) in seeds.iter().enumerate() {
        run(name, oracle, seed, &format!("seed {number}"));
    }
    let mut rule = Rule(0x9e37_79b9_7f4a_7c15);
    let (started, mut count) = (Instant::now(), 0);
    while started.elapsed() < TIME && count < 20_000 {
        let seed = &seeds[rule.below(seeds.len())];
        let other = &seeds[rule.below(seeds.len())];
        let bytes = rule.change(seed, other);
        run(name, oracle, &bytes, &format!("made from a seed, number {count}"));
        count += 1;
    }
    println!("{name}: {} seeds, {count} made from them", seeds.len());
}

macro_rules! parsers {
    ($($name:ident),+) => {
        $(#[test] fn $name() { smoke(stringify!($name)); })+

        #[test]
        fn every_parser_is_here() {
            let here = [$(stringify!($name)),+];
            assert_eq!(here[..], fuzz::ORACLES.map(|(name, _)| name));
        }
    };
}

parsers!(
    raw_name,
    nifti,
    nrrd,
    metaimage,
    tiff,
    dicom,
    png_slices,
    store,
    payload,
    node_record,
    transfer,
    camera,
    http
);
