//! What Octavo writes, nibabel reads: an independent reader has the last word on NIfTI.

use crate::support::{Bench, sample};
use std::path::Path;
use std::process::Command;

/// Runs a Python check; `tests/run.sh` installs what it needs.
pub(crate) fn python(script: &str, arguments: &[&str]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/readers");
    let python = std::env::var("OCTAVO_TEST_PYTHON").unwrap_or_else(|_| "python3".into());
    let output = Command::new(python).arg(folder.join(script)).args(arguments).output().unwrap();
    assert!(
        output.status.success(),
        "{script} (run by 'bash tests/run.sh', which installs the readers): {}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn affine_spacing_and_voxels_survive_to_nibabel() {
    let bench = Bench::new();
    python("make_oriented.py", &[bench.folder().to_str().unwrap()]);
    for name in
        ["sform.nii.gz", "qform.nii", "scaled.nii", "big.nii", "nifti2.nii", "series.nii.gz"]
    {
        let extra = if name == "series.nii.gz" { " --time 2" } else { "" };
        bench.ok(&format!("convert {name} -o {name}.octavo --encoding lossless{extra}"));
        // Of a series, the store remembers which volume it was made from.
        bench.ok(&format!("verify {name}.octavo --against {name}"));
        for form in ["nii", "nii.gz"] {
            bench.ok(&format!("extract {name}.octavo -o {name}.back.{form}"));
            let back = bench.path(&format!("{name}.back.{form}"));
            python(
                "same_volume.py",
                &[bench.path(name).to_str().unwrap(), back.to_str().unwrap(), "2"],
            );
        }
    }
}

#[test]
fn world_positions_stay_at_every_level_and_in_every_part() {
    let bench = Bench::new();
    python("make_oriented.py", &[bench.folder().to_str().unwrap()]);
    bench.ok("convert sform.nii.gz -o s.octavo --encoding lossless --brick 8");
    for level in 0..3 {
        bench.ok(&format!("extract s.octavo --level {level} -o l{level}.nii"));
    }
    bench.ok("extract s.octavo --roi 4:20,2:9,6:11 -o part.nii");
    bench.ok("convert sform.nii.gz -o roi.octavo --encoding lossless --roi 4:20,2:9,6:11");
    bench.ok("extract roi.octavo -o roi.nii");
    python("same_world.py", &[bench.folder().to_str().unwrap()]);
}

#[test]
fn the_bundled_tooth_is_what_nibabel_says() {
    let bench = Bench::new();
    let tooth = sample("tooth.nii.gz");
    bench.ok(&format!("convert {tooth} -o t.octavo --encoding lossless"));
    bench.ok("extract t.octavo -o t.nii");
    python("same_volume.py", &[&tooth, bench.path("t.nii").to_str().unwrap(), "0"]);
}
