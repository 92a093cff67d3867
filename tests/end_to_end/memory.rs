//! The memory bound, enforced from outside: the system refuses what is above it.

use crate::support::{Bench, Said};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::process::Command;

/// What the limit counts beyond own memory: stacks as far as they might grow, and the allocator's
/// reserves.
const RESERVED_KIB: u64 = 40 << 10;

/// Converts under a limit on the process's data: `RLIMIT_DATA` counts private writable memory, whether
/// it is used or not.
fn limited(bench: &Bench, memory_mib: u64, arguments: &str) -> Said {
    let limit = (memory_mib << 10) + RESERVED_KIB;
    let script = format!(
        "ulimit -d {limit}; exec \"$0\" convert {arguments} --memory {memory_mib}MiB --threads 2 --json"
    );
    let mut command = Command::new("bash");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_octavo")]).current_dir(bench.folder());
    Said::of(&command.output().unwrap())
}

fn assert_within(said: &Said, memory_mib: u64) {
    assert_eq!(said.code, 0, "{}", said.err);
    let report = said.json();
    let [peak, predicted] =
        ["peak_memory_bytes", "predicted_memory_bytes"].map(|key| report[key].as_u64().unwrap());
    assert!(peak <= predicted && predicted <= memory_mib << 20, "{peak}, {predicted} predicted");
}

#[test]
fn a_volume_of_ten_times_the_budget_is_converted_within_it() {
    let bench = Bench::new();
    bench.noise("a_640x640x420_u16.raw", 640 * 640 * 420 * 2);
    assert_within(&limited(&bench, 32, "a_640x640x420_u16.raw -o a.octavo"), 32);
    assert_eq!(bench.run("verify a.octavo").code, 0);
}

#[test]
fn compressed_slices_larger_than_the_budget_are_converted_within_it() {
    let bench = Bench::new();
    // Slices of 8192 x 8192 of u16, 134 MB each; the 352 bytes of a header, and zeros for the rest
    // but for a word here and there.
    let mut header = [0_u8; 352];
    header[0..4].copy_from_slice(&348_i32.to_le_bytes());
    for (at, value) in [(40, 3_i16), (42, 8192), (44, 8192), (46, 3), (70, 512), (72, 16)] {
        header[at..at + 2].copy_from_slice(&value.to_le_bytes());
    }
    for at in [80, 84, 88] {
        header[at..at + 4].copy_from_slice(&1_f32.to_le_bytes());
    }
    header[108..112].copy_from_slice(&352_f32.to_le_bytes());
    header[344..348].copy_from_slice(b"n+1\0");
    let file = std::fs::File::create(bench.path("a.nii.gz")).unwrap();
    let mut file = GzEncoder::new(file, Compression::fast());
    file.write_all(&header).unwrap();
    let mut row = vec![0_u8; 2 * 8192];
    for y in 0..3 * 8192_u32 {
        row[(y % 16_384) as usize] = y as u8;
        file.write_all(&row).unwrap();
    }
    file.finish().unwrap();
    assert_within(&limited(&bench, 96, "a.nii.gz -o a.octavo"), 96);
}

#[test]
fn too_small_a_budget_names_the_least_that_works() {
    let bench = Bench::new();
    bench.noise("a_200x200x200_u8.raw", 8_000_000);
    let refused = bench.run("convert a_200x200x200_u8.raw -o a.octavo --memory 1MiB");
    assert_eq!(refused.code, 2);
    let least = refused.err.split("--memory ").last().unwrap().trim();
    assert!(least.ends_with("MiB"), "{}", refused.err);
    bench.ok(&format!("convert a_200x200x200_u8.raw -o a.octavo --memory {least}"));
}
