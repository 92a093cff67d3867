//! Runs the program, and makes the files that it is run on.

use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// The program.
pub(crate) fn octavo() -> Command {
    Command::new(env!("CARGO_BIN_EXE_octavo"))
}

/// A folder of its own for a test, and commands run in it.
pub(crate) struct Bench {
    folder: TempDir,
}

/// What a run said.
pub(crate) struct Said {
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Said {
    pub(crate) fn of(output: &Output) -> Self {
        Self {
            code: output.status.code().unwrap_or(-1),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// The JSON it printed.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.out)
            .unwrap_or_else(|e| panic!("{e} in '{}' {}", self.out, self.err))
    }
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Writes a file.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        std::fs::write(self.path(name), bytes).unwrap();
        self.path(name)
    }

    /// Runs the program in the folder; arguments are split at spaces.
    pub(crate) fn run(&self, arguments: &str) -> Said {
        let mut command = octavo();
        command.args(arguments.split(' ')).current_dir(self.folder.path());
        Said::of(&command.output().unwrap())
    }

    /// Runs the program, which must succeed.
    pub(crate) fn ok(&self, arguments: &str) -> Said {
        let said = self.run(arguments);
        assert_eq!(said.code, 0, "octavo {arguments}: {}{}", said.out, said.err);
        said
    }

    /// The names of the files in the folder, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Writes a raw file of so many bytes of noise, which no compression makes smaller.
    pub(crate) fn noise(&self, name: &str, bytes: u64) {
        let block: Vec<u8> =
            (0..1_u32 << 20).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        let mut file = std::fs::File::create(self.path(name)).unwrap();
        let mut rest = bytes;
        while rest > 0 {
            // Blocks of an odd length, so that no slice repeats the one before.
            let count = rest.min((1 << 20) - 333);
            file.write_all(&block[..count as usize]).unwrap();
            rest -= count;
        }
    }

    /// A 16-bit volume of 40 x 33 x 20 voxels with structure, as a raw file; its bytes.
    pub(crate) fn scan(&self, name: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        for z in 0..20_u32 {
            for y in 0..33_u32 {
                for x in 0..40_u32 {
                    let noise = (x * 7919 + y * 104_729 + z * 1_299_709) % 251;
                    let v = 2000 + 500 * (x / 7) + 300 * (y / 5) + 100 * z + noise;
                    bytes.extend_from_slice(&(v as u16).to_le_bytes());
                }
            }
        }
        self.write(name, &bytes);
        bytes
    }
}

/// A bundled file.
pub(crate) fn sample(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data-samples").join(name);
    path.canonicalize().unwrap_or_else(|e| panic!("{}: {e}", path.display())).display().to_string()
}
