//! The window, on a display without a screen.

use crate::readers::python;
use crate::support::{Bench, octavo, sample};

#[test]
fn a_window_shows_what_render_draws_and_does_what_keys_and_mouse_say() {
    let bench = Bench::new();
    bench.ok(&format!("convert {} -o tooth.octavo", sample("tooth.nii.gz")));
    let (program, folder) = (octavo(), bench.folder().display().to_string());
    let program = program.get_program().to_str().unwrap();
    python("window.py", &[program, "tooth.octavo", &folder]);
}
