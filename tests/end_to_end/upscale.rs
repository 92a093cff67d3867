//! Enlarged volumes: as stores, as files, in the world, on a disk that is too small.

use crate::readers::python;
use crate::support::{Bench, Said, sample};
use serde_json::json;
use std::process::Command;

#[test]
fn an_enlarged_store_and_an_enlarged_file_hold_the_same_voxels() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    for flags in ["--kernel catmull-rom", "--detail 0.5 --seed 7", "--kernel mitchell --detail 2"] {
        for factor in [2, 3, 4, 8] {
            let convert = format!(
                "convert a_40x33x20_u16.raw -o a.octavo --force --encoding lossless --upscale {factor} {flags} --json"
            );
            let report = bench.ok(&convert).json();
            let dims = [40, 33, 20].map(|n| n * factor);
            assert_eq!(report["dims_xyz"], json!(dims));
            assert_eq!(report["options"]["upscale"], factor);
            assert_eq!(report["source"]["path"], "a_40x33x20_u16.raw");
            let written = bench
                .ok(&format!(
                    "upscale a_40x33x20_u16.raw -o a.nii --force --factor {factor} {flags} --json"
                ))
                .json();
            assert_eq!(written["dims_xyz"], json!(dims));
            assert_eq!(written["clamped_voxels"], report["clamped_voxels"]);
            bench.ok("compare a.nii a.octavo --max-amax 0");
            // The original is enlarged for the comparison, as the store says that it was made.
            bench.ok("compare a_40x33x20_u16.raw a.octavo --max-amax 0");
            bench.ok("verify a.octavo --against a_40x33x20_u16.raw");
        }
    }
    let info = bench.ok("info a.octavo --json").json();
    assert_eq!(
        info["options"],
        json!({"upscale": 8, "kernel": "mitchell", "detail": 2.0, "seed": 0})
    );
    assert_eq!(info["spacing_xyz"], json!([0.125, 0.125, 0.125]));
    // Other voxels than those it was made of are noticed.
    let mut other = std::fs::read(bench.path("a_40x33x20_u16.raw")).unwrap();
    other[20_001] ^= 0x40;
    bench.write("b_40x33x20_u16.raw", &other);
    assert_eq!(bench.run("verify a.octavo --against b_40x33x20_u16.raw").code, 1);
}

#[test]
fn world_positions_stay_by_nibabel() {
    let bench = Bench::new();
    let folder = bench.folder().to_str().unwrap().to_owned();
    python("make_oriented.py", &[&folder]);
    python("make_hot.py", &[&folder]);
    for factor in [2, 3, 4, 8] {
        bench.ok(&format!("upscale hot.nii.gz -o up{factor}.nii --factor {factor}"));
        bench.ok(&format!(
            "convert hot.nii.gz -o up.octavo --force --encoding lossless --upscale {factor}"
        ));
        bench.ok(&format!("extract up.octavo -o store{factor}.nii"));
        for name in [format!("up{factor}.nii"), format!("store{factor}.nii")] {
            let new = bench.path(&name);
            let source = bench.path("hot.nii.gz");
            let arguments = [source.to_str().unwrap(), new.to_str().unwrap()];
            let factor = factor.to_string();
            python("upscaled_world.py", &[arguments[0], arguments[1], &factor, "6,4,5"]);
        }
    }
}

#[test]
fn a_part_is_cut_out_before_it_is_enlarged() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    let roi = "--roi 4:20,2:30,6:19";
    let files = ["part.raw", "part.nii.gz", "part.nrrd", "part.tif"];
    for file in files {
        bench.ok(&format!("upscale a_40x33x20_u16.raw -o {file} --factor 2 {roi} --detail 0.5"));
    }
    bench.ok(&format!(
        "convert a_40x33x20_u16.raw -o part.octavo --encoding lossless --upscale 2 {roi} --detail 0.5"
    ));
    for file in files {
        bench.ok(&format!("compare part.octavo {file} --max-amax 0"));
    }
    bench.ok("verify part.octavo --against a_40x33x20_u16.raw");
}

#[test]
fn the_plan_says_time_size_scratch_and_whether_the_disk_has_room() {
    let bench = Bench::new();
    // A volume of 4 TB when enlarged, without a block on the disk.
    let file = std::fs::File::create(bench.path("a_4096x4096x1024_u16.raw")).unwrap();
    file.set_len(2 << 34).unwrap();
    let plan = "convert a_4096x4096x1024_u16.raw --upscale 4 --plan";
    let found = bench.ok(&format!("{plan} --json --memory 4GiB")).json();
    assert_eq!(found["dims_xyz"], json!([16_384, 16_384, 4096]));
    assert!(found["estimated_secs"].as_f64().unwrap() > 100.0);
    assert_eq!(found["fits"], false);
    let level_1 = 8192_u64 * 8192 * 2048 * 2;
    let scratch = found["scratch_bytes"].as_u64().unwrap();
    assert!(scratch < level_1 / 5, "{scratch} bytes for windows, not {level_1} for a level");
    let said = bench.ok(&format!("{plan} --memory 4GiB"));
    assert!(said.out.contains("time  ") && said.err.contains("free"), "{}{}", said.out, said.err);
    let small = bench.ok("convert a_4096x4096x1024_u16.raw --roi 0:9,0:9,0:9 --upscale 8 --plan");
    assert!(small.err.is_empty(), "{}", small.err);

    // What is written as it is has its size for certain, and is refused at once.
    let refused =
        bench.run("upscale a_4096x4096x1024_u16.raw -o big.raw --factor 8 --memory 100GiB");
    assert_eq!(refused.code, 3, "{}", refused.err);
    assert!(refused.err.contains("big.raw") && refused.err.contains("free"), "{}", refused.err);
    assert_eq!(bench.names(), ["a_4096x4096x1024_u16.raw"]);
}

/// Runs a script with the program as `$0`.
fn script(bench: &Bench, script: &str) -> Said {
    let mut command = Command::new("bash");
    command.args(["-c", script, env!("CARGO_BIN_EXE_octavo")]).current_dir(bench.folder());
    Said::of(&command.output().unwrap())
}

#[test]
fn a_disk_that_fills_up_ends_the_work_cleanly_and_it_can_go_on() {
    let bench = Bench::new();
    let tooth = sample("tooth.nii.gz");
    let convert =
        format!("convert {tooth} -o t.octavo --upscale 4 --detail 0.5 --effort fast --json");
    // A limit on file size acts as a full disk does; the index and scratch are smaller than it.
    let full = script(&bench, &format!("trap '' XFSZ; ulimit -f 90000; exec \"$0\" {convert}"));
    assert_eq!(full.code, 3, "{}", full.err);
    assert!(full.err.contains("--resume"), "{}", full.err);
    let resumed = bench.ok(&format!("{convert} --resume")).json();
    assert!(resumed["resumed_bricks"].as_u64().unwrap() > 0);
    let whole = bench.ok(&format!("{convert} --force")).json();
    assert_eq!(whole["digest"], resumed["digest"]);
    assert_eq!(whole["clamped_voxels"], resumed["clamped_voxels"]);
    // An enlarged file is of no use in part: nothing of it stays.
    let upscale = format!("upscale {tooth} -o t.raw --detail 0.5");
    let full = script(&bench, &format!("trap '' XFSZ; ulimit -f 9000; exec \"$0\" {upscale}"));
    assert_eq!(full.code, 3, "{}", full.err);
    assert_eq!(bench.names(), ["t.octavo"]);
}

#[test]
fn enlarging_stays_within_its_memory() {
    let bench = Bench::new();
    bench.noise("a_300x280x60_u16.raw", 300 * 280 * 60 * 2);
    // What the limit counts beyond own memory: stacks as far as they might grow, and the allocator's
    // reserves.
    let limited = |arguments: &str| {
        let said =
            script(&bench, &format!("ulimit -d $(((64 + 40) << 10)); exec \"$0\" {arguments}"));
        assert_eq!(said.code, 0, "{arguments}: {}", said.err);
        said
    };
    let flags = "--memory 64MiB --threads 2 --json";
    let report = limited(&format!(
        "convert a_300x280x60_u16.raw -o a.octavo --upscale 4 --detail 1 --effort fast {flags}"
    ));
    let report = report.json();
    let [peak, predicted] =
        ["peak_memory_bytes", "predicted_memory_bytes"].map(|key| report[key].as_u64().unwrap());
    assert!(peak <= predicted && predicted <= 64 << 20, "{peak}, {predicted} predicted");
    limited(&format!("upscale a_300x280x60_u16.raw -o a.raw --detail 1 {flags}"));
    let refused = bench.run("upscale a_300x280x60_u16.raw -o b.raw --memory 1MiB");
    assert_eq!(refused.code, 2);
    assert!(refused.err.contains("--memory"), "{}", refused.err);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    for (arguments, word) in [
        ("convert a_40x33x20_u16.raw --detail 1", "--upscale"),
        ("convert a_40x33x20_u16.raw --kernel mitchell", "--upscale"),
        ("convert a_40x33x20_u16.raw --upscale 5", "2, 3, 4, 8"),
        ("convert a_40x33x20_u16.raw --upscale 4 --detail -1", "--detail"),
        ("convert a_40x33x20_u16.raw --upscale 4 --seed 1", "--detail"),
        ("convert a_40x33x20_u16.raw --upscale 4 --kernel sinc", "b-spline"),
        ("upscale a_40x33x20_u16.raw -o a.png", ".nii"),
        ("upscale a_40x33x20_u16.raw -o ./a_40x33x20_u16.raw --force", "another name"),
        ("upscale a_40x33x20_u16.raw -o a.raw --detail nan", "--detail"),
        ("upscale a_40x33x20_u16.raw -o none/a.raw", "no such folder"),
    ] {
        let refused = bench.run(arguments);
        assert_eq!(refused.code, 2, "{arguments}: {}", refused.err);
        assert!(refused.err.contains(word), "{arguments}: {}", refused.err);
    }
    assert_eq!(bench.names(), ["a_40x33x20_u16.raw"]);
}
