//! The bundled volumes convert, and come back.

use crate::support::{Bench, sample};
use serde_json::json;

#[test]
fn the_tooth_converts_verifies_and_comes_back() {
    let bench = Bench::new();
    let tooth = sample("tooth.nii.gz");
    let report = bench.ok(&format!("convert {tooth} -o t.octavo --json")).json();
    assert_eq!(report["dims_xyz"], json!([103, 94, 161]));
    assert_eq!(
        (&report["sample_type"], &report["value_min"], &report["value_max"]),
        (&json!("u16"), &json!(0), &json!(1300))
    );
    bench.ok(&format!("verify t.octavo --against {tooth}"));
    bench.ok(&format!("convert {tooth} -o l.octavo --encoding lossless"));
    bench.ok(&format!("compare {tooth} l.octavo --max-amax 0"));
    bench.ok("extract l.octavo -o back.nii.gz");
    bench.ok(&format!("compare {tooth} back.nii.gz --max-amax 0"));
}

#[test]
fn nifti_of_every_scalar_type_is_read() {
    let bench = Bench::new();
    for (file, sample_type) in [
        ("uint8", "u8"),
        ("int8", "i8"),
        ("uint16", "u16"),
        ("int16", "i16"),
        ("uint32", "u32"),
        ("int32", "i32"),
        ("float32", "f32"),
        ("float64", "f64"),
    ] {
        let path = sample(&format!("nifti-suite/27/{file}.nii"));
        let report =
            bench.ok(&format!("convert {path} -o {file}.octavo --json --encoding lossless")).json();
        assert_eq!(report["sample_type"], sample_type);
        bench.ok(&format!("verify {file}.octavo --against {path}"));
        bench.ok(&format!("compare {path} {file}.octavo --max-amax 0"));
    }
}

#[test]
fn headers_and_images_in_two_files_are_read_by_either_name() {
    let bench = Bench::new();
    for name in ["minimal.hdr", "minimal.img"] {
        std::fs::copy(sample(&format!("nifti-suite/{name}")), bench.path(name)).unwrap();
    }
    let whole = sample("nifti-suite/minimal.nii");
    for half in ["minimal.hdr", "minimal.img"] {
        bench.ok(&format!("compare {whole} {half} --max-amax 0"));
    }
}
