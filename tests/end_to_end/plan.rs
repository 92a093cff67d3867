//! What `--plan` says of memory, held against what conversions use: never less than that, and at most a
//! quarter more.

use crate::readers::python;
use crate::support::{Bench, sample};

/// Below this much, what the system counts late and what the allocator rounds is more than a quarter.
const SMALL_BYTES: u64 = 8 << 20;
/// What a prediction may be above what a small conversion uses.
const SMALL_SLACK_BYTES: u64 = 2 << 20;

fn assert_predicted(bench: &Bench, arguments: &str) {
    for threads in [1, 2, 4] {
        let command = format!("convert {arguments} -o a.octavo --force --threads {threads} --json");
        let report = bench.ok(&command).json();
        let [peak, predicted] = ["peak_memory_bytes", "predicted_memory_bytes"]
            .map(|key| report[key].as_u64().unwrap());
        let plan = bench.ok(&format!("{command} --plan")).json();
        assert_eq!(plan["predicted_memory_bytes"], predicted, "{command}");
        assert!(peak <= predicted, "{command}: {peak} used, {predicted} predicted");
        let most = if predicted < SMALL_BYTES { peak + SMALL_SLACK_BYTES } else { peak / 4 * 5 };
        assert!(predicted <= most, "{command}: {peak} used, {predicted} predicted");
    }
}

#[test]
fn memory_of_raw_volumes_is_predicted() {
    let bench = Bench::new();
    for (name, dims, bytes) in [
        ("tiny_8x8x8_u16.raw", 8 * 8 * 8, 2),
        ("small_64x64x64_u16.raw", 64 * 64 * 64, 2),
        ("cube_256x256x256_u16.raw", 256 * 256 * 256, 2),
        ("rod_40x40x2000_u8.raw", 40 * 40 * 2000, 1),
        ("plate_900x900x40_u16.raw", 900 * 900 * 40, 2),
        ("wide_160x160x160_f64.raw", 160 * 160 * 160, 8),
    ] {
        bench.noise(name, dims * bytes);
        assert_predicted(&bench, name);
    }
}

#[test]
fn memory_is_predicted_whatever_the_encoding_the_effort_and_the_bricks() {
    let bench = Bench::new();
    bench.noise("cube_160x160x160_u16.raw", 160 * 160 * 160 * 2);
    bench.write("flat_160x160x160_u16.raw", &vec![7; 160 * 160 * 160 * 2]);
    bench.noise("wide_100x100x100_f64.raw", 100 * 100 * 100 * 8);
    for options in ["--effort small", "--effort fast", "--brick 64", "--brick 16 --overlap 1"] {
        assert_predicted(&bench, &format!("cube_160x160x160_u16.raw {options}"));
    }
    // So many bricks that their records take more than all else.
    assert_predicted(&bench, "cube_160x160x160_u16.raw --brick 8 --overlap 0");
    for options in ["", " --effort small"] {
        assert_predicted(&bench, &format!("cube_160x160x160_u16.raw --encoding lossless{options}"));
        assert_predicted(&bench, &format!("wide_100x100x100_f64.raw --encoding lossless{options}"));
        assert_predicted(&bench, &format!("flat_160x160x160_u16.raw --encoding lossless{options}"));
    }
}

#[test]
fn memory_of_sources_that_are_decoded_is_predicted() {
    let bench = Bench::new();
    for name in ["tooth.nii.gz", "bone.nii.gz", "tiff-slices"] {
        assert_predicted(&bench, &sample(name));
    }
}

#[test]
fn memory_of_packed_pages_and_of_few_slices_is_predicted() {
    let bench = Bench::new();
    python("packed.py", &[bench.folder().to_str().unwrap()]);
    let files = ["strips.tif", "whole.tif", "large.tif", "tiles.tif", "zstd", "small", "dicom"];
    for file in files {
        assert_predicted(&bench, file);
    }
}
