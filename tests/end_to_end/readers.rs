//! Runs the checks in Python of `tests/readers`; `tests/run.sh` installs what they need.

use std::path::Path;
use std::process::Command;

/// Runs a check, which must succeed.
pub(crate) fn python(script: &str, arguments: &[&str]) {
    python_of("OCTAVO_TEST_PYTHON", "tests/readers", script, arguments);
}

/// Runs a check of a folder with the interpreter that a variable names.
pub(crate) fn python_of(variable: &str, folder: &str, script: &str, arguments: &[&str]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let python = std::env::var(variable).unwrap_or_else(|_| "python3".into());
    let output = Command::new(python).arg(folder.join(script)).args(arguments).output().unwrap();
    assert!(
        output.status.success(),
        "{script} (run by 'bash tests/run.sh', which installs its readers): {}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}
