//! Volumes that are written out again as NRRD and TIFF: other readers, and the program itself, find the
//! values, the type and the size and place of voxels that the source had.

use crate::readers::python;
use crate::support::Bench;
use serde_json::Value;

fn path(bench: &Bench, name: &str) -> String {
    bench.path(name).to_str().unwrap().to_owned()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        value => vec![value.as_f64().unwrap()],
    }
}

fn assert_near(found: &Value, expected: &Value, part: f64) {
    let (found, expected) = (numbers(found), numbers(expected));
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() <= part * expected.abs(), "{found} for {expected}");
    }
}

#[test]
fn other_readers_find_every_type_level_and_region_where_it_was() {
    let bench = Bench::new();
    python("same_export.py", &["make", &path(&bench, "")]);
    let mut list = String::new();
    for kind in ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"] {
        bench.ok(&format!("convert {kind}.nii -o a.octavo --force --encoding lossless"));
        for (level, roi) in [(0, "0:37,0:21,0:43"), (0, "3:20,1:2,5:42"), (1, "5:36,4:19,7:8")] {
            let names = ["nrrd", "tif"].map(|ending| format!("{kind}-{}.{ending}", list.len()));
            for name in &names {
                bench.ok(&format!("extract a.octavo -o {name} --level {level} --roi {roi}"));
            }
            list.extend([kind, ".nii|", &names.join("|"), "|", &level.to_string(), "|", roi, "\n"]);
        }
    }
    bench.write("list.txt", list.as_bytes());
    python("same_export.py", &["check", &path(&bench, "")]);
}

#[test]
fn what_is_written_is_read_back_as_it_was() {
    let bench = Bench::new();
    python("same_export.py", &["make", &path(&bench, "")]);
    for kind in ["u2", "i4", "f8"] {
        bench.ok(&format!("convert {kind}.nii -o a.octavo --force --encoding lossless"));
        let first = bench.ok("info a.octavo --json").json();
        for ending in ["nrrd", "tif", "tiff"] {
            let said = bench.ok(&format!("extract a.octavo -o b.{ending} --force"));
            assert_eq!(said.err.contains("spacing alone"), ending != "nrrd", "{}", said.err);
            bench.ok(&format!("convert b.{ending} -o b.octavo --force --encoding lossless"));
            bench.ok(&format!("verify b.octavo --against {kind}.nii"));
            let again = bench.ok("info b.octavo --json").json();
            for key in ["sample_type", "unit", "dims_xyz", "value_min", "nan_count", "inf_count"] {
                assert_eq!(again[key], first[key], "{key} of {kind} by {ending}");
            }
            // The lengths of an affine's axes, which NIfTI keeps in 32 bits, are NRRD's spacing.
            let part = if ending == "nrrd" { 1e-6 } else { 1e-12 };
            assert_near(&again["spacing_xyz"], &first["spacing_xyz"], part);
            if ending == "nrrd" {
                assert_eq!(again["affine"], first["affine"]);
            }
        }
    }
    // Without an affine none is made up.
    bench.scan("s_40x33x20_u16.raw");
    bench.ok("convert s_40x33x20_u16.raw -o s.octavo --spacing 0.7,0.3,1e-7 --unit nm");
    bench.ok("extract s.octavo -o s.nrrd");
    bench.ok("convert s.nrrd -o t.octavo");
    let again = bench.ok("info t.octavo --json").json();
    assert_eq!(numbers(&again["spacing_xyz"]), [0.7, 0.3, 1e-7]);
    assert_eq!((&again["affine"], &again["unit"]), (&Value::Null, &Value::from("nm")));
    bench.ok("extract s.octavo -o s.tif");
    bench.ok("convert s.tif -o u.octavo");
    let again = bench.ok("info u.octavo --json").json();
    assert_eq!(numbers(&again["spacing_xyz"]), [0.7, 0.3, 1e-7]);
}

#[test]
fn what_a_format_cannot_hold_is_refused_and_leaves_nothing() {
    let bench = Bench::new();
    bench.scan("s_40x33x20_u16.raw");
    bench.ok("convert s_40x33x20_u16.raw -o s.octavo --spacing 1e-11,1,1");
    let refused = bench.run("extract s.octavo -o s.tif");
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(refused.err.contains("s.tif") && refused.err.contains(".nrrd"), "{}", refused.err);
    let refused = bench.run("extract s.octavo -o s.jpg");
    assert_eq!(refused.code, 2);
    assert!(refused.err.contains(".tif") && refused.err.contains(".nrrd"), "{}", refused.err);
    assert_eq!(bench.names(), ["s.octavo", "s_40x33x20_u16.raw"]);
}
