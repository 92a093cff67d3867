//! Every command does what its documentation says.

use crate::support::{Bench, sample};
use serde_json::json;

fn bench() -> Bench {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --brick 16 --spacing 0.5,1,2 --unit um");
    bench
}

#[test]
fn convert_names_its_output_after_the_input_and_prints_a_summary() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    let said = bench.ok("convert a_40x33x20_u16.raw");
    assert!(said.out.contains("40 x 33 x 20 u16 voxels"), "{}", said.out);
    assert!(said.out.contains("RMS") && said.out.contains("PSNR"), "{}", said.out);
    assert_eq!(bench.names(), ["a_40x33x20_u16.octavo", "a_40x33x20_u16.raw"]);
}

#[test]
fn info_tells_everything_that_scripts_rely_on() {
    let bench = bench();
    let info = bench.ok("info a.octavo --json").json();
    for (key, value) in [
        ("schema", json!("octavo.info/1")),
        ("format_version", json!(1)),
        ("complete", json!(true)),
        ("dims_xyz", json!([40, 33, 20])),
        ("spacing_xyz", json!([0.5, 1.0, 2.0])),
        ("unit", json!("um")),
        ("affine", json!(null)),
        ("sample_type", json!("u16")),
        ("encoding", json!("u8")),
        ("brick_core", json!(16)),
        ("brick_overlap", json!(2)),
        ("downsample", json!("mean")),
        ("value_min", json!(2000)),
        ("nan_count", json!(0)),
        ("inf_count", json!(0)),
        ("dropped_voxels", json!(0)),
        ("created_by", json!("octavo 0.1.0")),
        ("options", json!({})),
    ] {
        assert_eq!(info[key], value, "{key}");
    }
    assert_eq!(info["source"]["path"], "a_40x33x20_u16.raw");
    assert_eq!(info["source"]["bytes"], 40 * 33 * 20 * 2);
    assert_eq!(info["source"]["sample_type"], "u16");
    assert_eq!(info["digest"].as_str().unwrap().len(), 64);
    assert_eq!(info["file_bytes"], std::fs::metadata(bench.path("a.octavo")).unwrap().len());
    let levels = info["levels"].as_array().unwrap();
    assert_eq!(levels.len(), 3);
    assert_eq!(levels[0]["grid_xyz"], json!([3, 3, 2]));
    assert_eq!(levels[0]["stored"], 18);
    assert_eq!(levels[2]["dims_xyz"], json!([10, 9, 5]));
    assert_eq!(levels[0]["rms"], info["rms"]);
    assert_eq!(levels[0]["amax"], info["amax"]);
    assert!(info["rms"].as_f64().unwrap() > 0.0 && info["psnr_db"].as_f64().unwrap() > 40.0);
    assert_eq!(levels[0]["lod_amax_bound"], 0.0);
    assert!(levels[1]["lod_rms_bound"].as_f64() < levels[2]["lod_rms_bound"].as_f64());
    let payload: u64 = levels.iter().map(|level| level["payload_bytes"].as_u64().unwrap()).sum();
    assert_eq!(info["payload_bytes"], payload);
    assert!(bench.ok("info a.octavo").out.contains("40 x 33 x 20 u16 voxels"));
}

#[test]
fn a_report_is_the_info_and_how_it_went() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --report r.json --threads 2");
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(bench.path("r.json")).unwrap()).unwrap();
    let info = bench.ok("info a.octavo --json").json();
    for (key, value) in info.as_object().unwrap() {
        assert_eq!(&report[key], value, "{key}");
    }
    // A row of it has one octet, and work for one thread.
    assert_eq!((&report["threads"], &report["resumed_bricks"]), (&json!(1), &json!(0)));
    assert!(report["total_secs"].as_f64().unwrap() > 0.0);
    let [peak, predicted] =
        ["peak_memory_bytes", "predicted_memory_bytes"].map(|key| report[key].as_u64().unwrap());
    assert!(peak > 256 << 10 && peak <= predicted, "{peak} of {predicted}");
}

#[test]
fn a_plan_makes_nothing_and_bounds_what_is_made() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    let plan = bench.ok("convert a_40x33x20_u16.raw --plan --json --brick 16").json();
    assert_eq!(bench.names(), ["a_40x33x20_u16.raw"]);
    assert_eq!(plan["schema"], "octavo.plan/1");
    assert_eq!(plan["bricks"], 18 + 4 + 1);
    assert_eq!(plan["levels"][1]["dims_xyz"], json!([20, 17, 10]));
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --brick 16 --encoding lossless");
    let most =
        bench.ok("convert a_40x33x20_u16.raw --plan --json --brick 16 --encoding lossless").json();
    let file = std::fs::metadata(bench.path("a.octavo")).unwrap().len();
    assert!(file <= most["output_bytes_max"].as_u64().unwrap());
    assert!(bench.ok("convert a_40x33x20_u16.raw --plan").out.contains("level  0"));
}

#[test]
fn verify_finds_nothing_wrong_with_a_new_store_and_its_source() {
    let bench = bench();
    let plain = bench.ok("verify a.octavo --json").json();
    assert_eq!(plain["schema"], "octavo.verify/1");
    assert_eq!(
        (&plain["ok"], &plain["bricks_checked"], &plain["damaged"]),
        (&json!(true), &json!(23), &json!([]))
    );
    let info = bench.ok("info a.octavo --json").json();
    let against = bench.ok("verify a.octavo --against a_40x33x20_u16.raw --json").json();
    assert_eq!(against["against"]["rms"], info["rms"]);
    assert_eq!(against["against"]["amax"], info["amax"]);
    // A raw file without a telling name has the store's own dimensions and type.
    std::fs::copy(bench.path("a_40x33x20_u16.raw"), bench.path("b.raw")).unwrap();
    bench.ok("verify a.octavo --against b.raw");
}

#[test]
fn verify_against_another_volume_says_no() {
    let bench = bench();
    let mut other = std::fs::read(bench.path("a_40x33x20_u16.raw")).unwrap();
    other[1001] ^= 0x10;
    bench.write("b.raw", &other);
    let said = bench.run("verify a.octavo --against b.raw --json");
    assert_eq!(said.code, 1);
    let found = said.json();
    assert_eq!(found["ok"], false);
    assert!(!found["damaged"].as_array().unwrap().is_empty());
    bench.write("c_40x33x19_u16.raw", &other[..40 * 33 * 19 * 2]);
    assert_eq!(bench.run("verify a.octavo --against c_40x33x19_u16.raw").code, 2);
}

#[test]
fn a_histogram_counts_every_voxel_in_every_form() {
    let bench = bench();
    let json = bench.ok("histogram a.octavo --bins 16 --json").json();
    let counts: Vec<u64> =
        json["counts"].as_array().unwrap().iter().map(|c| c.as_u64().unwrap()).collect();
    assert_eq!((counts.len(), counts.iter().sum::<u64>()), (16, 40 * 33 * 20));
    assert_eq!(json["edges"].as_array().unwrap().len(), 17);
    let csv = bench.ok("histogram a.octavo --bins 16 --csv").out;
    let from_csv: Vec<u64> =
        csv.lines().skip(1).map(|line| line.rsplit(',').next().unwrap().parse().unwrap()).collect();
    assert_eq!(from_csv, counts);
    bench.ok("histogram a.octavo -o h.png");
    bench.ok("histogram a.octavo -o h.svg");
    let picture = image::load_png(&bench.path("h.png"));
    assert!(picture.distinct > 10, "a picture with bars, axes and letters");
    let svg = std::fs::read_to_string(bench.path("h.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.matches("<rect").count() > 100, "{}", svg.len());
    assert!(bench.ok("histogram a.octavo").out.contains("log10"));
    // Against a count of our own, from a lossless store.
    bench.ok("convert a_40x33x20_u16.raw -o b.octavo --encoding lossless");
    let json = bench.ok("histogram b.octavo --bins 10 --json").json();
    let source = std::fs::read(bench.path("a_40x33x20_u16.raw")).unwrap();
    let values: Vec<f64> =
        source.chunks(2).map(|b| f64::from(u16::from_le_bytes([b[0], b[1]]))).collect();
    let (low, high) = (json["value_min"].as_f64().unwrap(), json["value_max"].as_f64().unwrap());
    let mut own = vec![0_u64; 10];
    for v in &values {
        own[(((v - low) / ((high - low) / 10.0)) as usize).min(9)] += 1;
    }
    assert_eq!(json["counts"], json!(own));
}

/// Just enough of a PNG reader for the tests.
mod image {
    pub(super) struct Picture {
        pub(super) size: (u32, u32),
        pub(super) bytes: Vec<u8>,
        pub(super) distinct: usize,
    }

    pub(super) fn load_png(path: &std::path::Path) -> Picture {
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        bytes.truncate(info.buffer_size());
        let mut values = bytes.clone();
        values.sort_unstable();
        values.dedup();
        Picture { size: (info.width, info.height), bytes, distinct: values.len() }
    }
}

#[test]
fn slices_are_the_voxels_in_the_right_places() {
    let bench = Bench::new();
    let source = bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --encoding lossless");
    let voxel = |x: usize, y: usize, z: usize| {
        let at = 2 * ((z * 33 + y) * 40 + x);
        u16::from_le_bytes([source[at], source[at + 1]])
    };
    for (axis, index, size) in [("x", 39, (33, 20)), ("y", 0, (40, 20)), ("z", 7, (40, 33))] {
        bench.ok(&format!("slice a.octavo --axis {axis} --index {index} --bits 16 -o s{axis}.png"));
        let picture = image::load_png(&bench.path(&format!("s{axis}.png")));
        assert_eq!(picture.size, size);
        for (i, pixel) in picture.bytes.chunks(2).enumerate() {
            let (column, row) = (i % size.0 as usize, i / size.0 as usize);
            let expected = match axis {
                "x" => voxel(index, column, row),
                "y" => voxel(column, index, row),
                _ => voxel(column, row, index),
            };
            assert_eq!(u16::from_be_bytes([pixel[0], pixel[1]]), expected, "{axis} {column} {row}");
        }
    }
    // 8 bits through a window: black at its lower end, white at its upper.
    bench.ok("slice a.octavo --axis z --index 7 --window 3000,4000 -o w.png");
    let picture = image::load_png(&bench.path("w.png"));
    for (i, &pixel) in picture.bytes.iter().enumerate() {
        let share = (f64::from(voxel(i % 40, i / 40, 7)) - 3000.0) / 1000.0;
        assert_eq!(pixel, (share.clamp(0.0, 1.0) * 255.0).round() as u8);
    }
    assert_eq!(bench.run("slice a.octavo --axis z --index 20 -o n.png").code, 2);
    assert_eq!(bench.run("slice a.octavo --axis z --index 0 --level 9 -o n.png").code, 2);
    assert!(!bench.path("n.png").exists());
}

#[test]
fn a_preview_shows_three_slices_and_the_histogram() {
    let said = bench().ok("preview a.octavo --width 16");
    for line in ["x = ", "y = ", "z = ", "log10"] {
        assert!(said.out.contains(line), "{line}");
    }
    assert!(said.out.matches('\u{1b}').count() > 50, "the slices are drawn in colours");
}

#[test]
fn a_brick_is_shown_and_written_with_its_overlap() {
    let bench = Bench::new();
    let source = bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --brick 16 --encoding lossless");
    bench.ok("brick a.octavo --level 0 --at 1,0,0 -o b.raw");
    let brick = std::fs::read(bench.path("b.raw")).unwrap();
    assert_eq!(brick.len(), 20 * 20 * 20 * 2);
    for (i, sample) in brick.chunks(2).enumerate() {
        let at = [i % 20 + 14, (i / 20 % 20).saturating_sub(2), (i / 400).saturating_sub(2)];
        let from = 2 * ((at[2] * 33 + at[1]) * 40 + at[0]);
        assert_eq!(sample, &source[from..from + 2], "sample {i}");
    }
    let json = bench.ok("brick a.octavo --level 0 --at 1,0,0 --json").json();
    assert_eq!(
        (&json["state"], &json["bits"], &json["rms"]),
        (&json!("stored"), &json!(16), &json!(0.0))
    );
    for key in [
        "brick_min",
        "brick_max",
        "subtree_min",
        "subtree_max",
        "amax",
        "lod_rms_bound",
        "lod_amax_bound",
        "payload_bytes",
    ] {
        assert!(json[key].is_number(), "{key}");
    }
    let root = bench.ok("brick a.octavo --level 2 --at 0,0,0 --json").json();
    assert_eq!(root["subtree_min"], 2000, "the root's range is the volume's");
    let absent = bench.run("brick a.octavo --level 0 --at 9,0,0 --json");
    assert_eq!((absent.code, &absent.json()["state"]), (1, &json!("absent")));
    assert_eq!(bench.run("brick a.octavo --level 60 --at 99999999,0,0").code, 1);
}

#[test]
fn uniform_and_empty_bricks_say_so() {
    let bench = Bench::new();
    let mut bytes = vec![0; 64 * 16 * 16];
    for (i, v) in bytes.iter_mut().enumerate() {
        *v = match i % 64 {
            0..16 => 10,
            32..64 => (100 + i % 7) as u8,
            _ => (i % 5) as u8,
        };
    }
    bench.write("a_64x16x16_u8.raw", &bytes);
    bench.ok("convert a_64x16x16_u8.raw -o a.octavo --brick 16 --overlap 0 --empty-below 8");
    for (x, state) in [(0, "uniform"), (1, "empty"), (2, "stored")] {
        let json = bench.ok(&format!("brick a.octavo --level 0 --at {x},0,0 --json")).json();
        assert_eq!(json["state"], state);
        assert_eq!(json["payload_bytes"].as_u64().unwrap() > 0, state == "stored");
    }
}

#[test]
fn extracting_gives_the_voxels_back_in_every_form() {
    let bench = Bench::new();
    let source = bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --encoding lossless");
    bench.ok("extract a.octavo -o e.raw");
    assert_eq!(std::fs::read(bench.path("e.raw")).unwrap(), source);
    for name in ["e.nii", "e.nii.gz", "e.nrrd", "e.tif", "e.tiff"] {
        bench.ok(&format!("extract a.octavo -o {name}"));
        let found =
            bench.ok(&format!("compare a_40x33x20_u16.raw {name} --max-amax 0 --json")).json();
        assert_eq!((&found["different"], &found["voxels"]), (&json!(0), &json!(40 * 33 * 20)));
    }
    bench.ok("extract a.octavo -o part.raw --roi 3:10,4:33,19:20");
    let part = std::fs::read(bench.path("part.raw")).unwrap();
    let expected: Vec<u8> = (4..33)
        .flat_map(|y| source[2 * ((19 * 33 + y) * 40 + 3)..2 * ((19 * 33 + y) * 40 + 10)].to_vec())
        .collect();
    assert_eq!(part, expected);
    bench.ok("extract a.octavo -o half.nii --level 1");
    let converted = bench.ok("convert half.nii -o half.octavo --json").json();
    assert_eq!(converted["dims_xyz"], json!([20, 17, 10]));
    assert_eq!(converted["spacing_xyz"], json!([2.0, 2.0, 2.0]));
    for wrong in ["-o e.jpg", "-o f.raw --roi 0:41,0:1,0:1", "-o f.raw --level 7"] {
        assert_eq!(bench.run(&format!("extract a.octavo {wrong}")).code, 2, "{wrong}");
    }
    assert!(!bench.path("f.raw").exists());
}

#[test]
fn compare_answers_and_keeps_to_its_limits() {
    let bench = bench();
    let mut other = std::fs::read(bench.path("a_40x33x20_u16.raw")).unwrap();
    // Voxel (3, 0, 1) gets 256 more.
    other[2 * (33 * 40 + 3) + 1] += 1;
    bench.write("b.raw", &other);
    let said = bench.run("compare a_40x33x20_u16.raw b.raw --max-amax 255 --json");
    let found = said.json();
    assert_eq!(said.code, 1);
    assert_eq!((&found["amax"], &found["different"]), (&json!(256.0), &json!(1)));
    assert_eq!(found["worst_xyz"], json!([3, 0, 1]));
    let rms = (256.0_f64 * 256.0 / (40.0 * 33.0 * 20.0)).sqrt();
    assert!((found["rms"].as_f64().unwrap() - rms).abs() < 1e-12);
    assert_eq!(bench.run("compare a_40x33x20_u16.raw b.raw --max-amax 256").code, 0);
    assert_eq!(bench.run("compare a_40x33x20_u16.raw b.raw --min-psnr 200").code, 1);
    // A store against its source gives the errors that it reports.
    let info = bench.ok("info a.octavo --json").json();
    let found = bench.ok("compare a_40x33x20_u16.raw a.octavo --json").json();
    assert_eq!(found["amax"], info["amax"]);
    assert!((found["rms"].as_f64().unwrap() - info["rms"].as_f64().unwrap()).abs() < 1e-9);
    assert!(bench.ok("compare a.octavo a.octavo --max-amax 0").out.contains("AMAX 0"));
}

#[test]
fn an_earlier_store_is_replaced_only_when_asked() {
    let bench = bench();
    let before = std::fs::read(bench.path("a.octavo")).unwrap();
    assert_eq!(bench.run("convert a_40x33x20_u16.raw -o a.octavo").code, 2);
    assert_eq!(std::fs::read(bench.path("a.octavo")).unwrap(), before);
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --encoding lossless --force");
    assert_eq!(bench.ok("info a.octavo --json").json()["encoding"], "lossless");
}

#[test]
fn limits_hold_where_there_is_no_psnr() {
    let bench = Bench::new();
    bench.write("a_4x4x4_u8.raw", &[0; 64]);
    bench.write("b_4x4x4_u8.raw", &[255; 64]);
    assert_eq!(bench.run("compare a_4x4x4_u8.raw b_4x4x4_u8.raw --min-psnr 1").code, 1);
    assert_eq!(bench.run("compare a_4x4x4_u8.raw a_4x4x4_u8.raw --min-psnr 1").code, 0);
    let floats = |v: f32| v.to_le_bytes().repeat(64);
    bench.write("c_4x4x4_f32.raw", &floats(1.0));
    bench.write("d_4x4x4_f32.raw", &floats(f32::NAN));
    assert_eq!(bench.run("compare c_4x4x4_f32.raw d_4x4x4_f32.raw --min-psnr 1").code, 1);
    // What no volume could miss, or none could meet, is no limit.
    for bad in ["--max-amax nan", "--max-amax=-1", "--min-psnr nan", "--min-psnr inf"] {
        assert_eq!(
            bench.run(&format!("compare a_4x4x4_u8.raw b_4x4x4_u8.raw {bad}")).code,
            2,
            "{bad}"
        );
    }
}

#[test]
fn limits_hold_for_the_widest_values() {
    let bench = Bench::new();
    let of = |values: [f64; 2]| values.map(f64::to_le_bytes).concat().repeat(32);
    bench.write("a_4x4x4_f64.raw", &of([f64::MAX, f64::MIN]));
    bench.write("b_4x4x4_f64.raw", &of([f64::MIN, f64::MAX]));
    let said = bench.run("compare a_4x4x4_f64.raw b_4x4x4_f64.raw --min-psnr 10 --json");
    let found = said.json();
    assert_eq!((said.code, &found["amax"], &found["rms"]), (1, &f64::MAX.into(), &f64::MAX.into()));
    assert_eq!(found["psnr_db"], 0.0);
}

#[test]
fn a_given_spacing_moves_the_affine_with_it() {
    let bench = Bench::new();
    let file = sample("nifti-suite/27/uint8.nii");
    let own = bench.ok(&format!("convert {file} -o a.octavo --json")).json();
    let given = bench.ok(&format!("convert {file} -o b.octavo --json --spacing 10,20,30")).json();
    assert_eq!(given["spacing_xyz"], json!([10.0, 20.0, 30.0]));
    for row in 0..3 {
        for (axis, spacing) in [10.0, 20.0, 30.0].into_iter().enumerate() {
            let number = |info: &serde_json::Value| info["affine"][row][axis].as_f64().unwrap();
            let per_voxel = number(&own) / own["spacing_xyz"][axis].as_f64().unwrap();
            assert!((number(&given) - per_voxel * spacing).abs() < 1e-9);
        }
        assert_eq!(given["affine"][row][3], own["affine"][row][3]);
    }
}

#[test]
fn files_are_as_private_as_the_user_wants() {
    use std::os::unix::fs::PermissionsExt;
    let bench = bench();
    let script = "umask 077; \"$0\" extract a.octavo -o e.raw && \"$0\" histogram a.octavo -o h.svg && \
                  umask 022; \"$0\" extract a.octavo -o f.raw";
    let mut command = std::process::Command::new("bash");
    command.args(["-c", script, env!("CARGO_BIN_EXE_octavo")]).current_dir(bench.folder());
    assert!(command.status().unwrap().success());
    for (name, mode) in [("e.raw", 0o600), ("h.svg", 0o600), ("f.raw", 0o644)] {
        let permissions = std::fs::metadata(bench.path(name)).unwrap().permissions();
        assert_eq!(permissions.mode() & 0o777, mode, "{name}");
    }
}

#[test]
fn own_memory_keeps_to_the_least_budget_and_its_prediction() {
    let bench = Bench::new();
    let slice: Vec<u8> =
        (0..2048 * 2048_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 20) as u8).collect();
    bench.write("wide_2048x2048x40_u8.raw", &slice.repeat(40));
    let refused = bench.run("convert wide_2048x2048x40_u8.raw --memory 1MB");
    let least = refused.err.split("needs at least ").nth(1).unwrap().split(' ').next().unwrap();
    let report = bench
        .ok(&format!("convert wide_2048x2048x40_u8.raw --json --threads 1 --memory {least}"))
        .json();
    let [peak, predicted] =
        ["peak_memory_bytes", "predicted_memory_bytes"].map(|key| report[key].as_u64().unwrap());
    assert!(predicted <= least.parse().unwrap());
    assert!(peak <= predicted, "{peak} of {predicted}");
    assert_eq!(bench.names(), ["wide_2048x2048x40_u8.octavo", "wide_2048x2048x40_u8.raw"]);
}
