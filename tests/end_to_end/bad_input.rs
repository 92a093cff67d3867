//! Bad input gets a message that says what is wrong and what to do, its exit code, and leaves
//! nothing behind.

use crate::support::{Bench, Said, octavo, sample};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::Command;

/// Runs a conversion that must be refused with this code and these words, and leave nothing.
fn refused(bench: &Bench, arguments: &str, code: i32, words: &[&str]) -> Said {
    let before = bench.names();
    let said = bench.run(arguments);
    assert_eq!(said.code, code, "octavo {arguments}: {}{}", said.out, said.err);
    for word in words {
        assert!(said.err.contains(word), "octavo {arguments}: no '{word}' in: {}", said.err);
    }
    assert!(!said.err.contains("panicked"), "{}", said.err);
    assert_eq!(bench.names(), before, "octavo {arguments} left something");
    said
}

#[test]
fn sizes_that_do_not_fit_name_both_numbers() {
    let bench = Bench::new();
    bench.write("a_10x10x10_u16.raw", &[0; 1998]);
    refused(&bench, "convert a_10x10x10_u16.raw", 2, &["a_10x10x10_u16.raw", "2000", "1998"]);
    bench.write("b_10x10x10_u16.raw", &[0; 2200]);
    refused(&bench, "convert b_10x10x10_u16.raw", 2, &["2000", "2200", "10 x 10 x 11 would fit"]);
    bench.write("c.raw", &[0; 100]);
    refused(&bench, "convert c.raw --dims 5,5,2 --dtype u16 --skip 1", 2, &["101", "100"]);
    refused(&bench, "convert c.raw", 2, &["--dims", "c.raw"]);
    refused(&bench, "convert c.raw --dims 5,5,2", 2, &["--dtype"]);
}

#[test]
fn impossible_dimensions_and_types_are_refused() {
    let bench = Bench::new();
    bench.write("a.raw", &[0; 8]);
    refused(&bench, "convert a.raw --dims 0,1,1 --dtype u8", 2, &["at least 1"]);
    refused(
        &bench,
        "convert a.raw --dims 4294967296,4294967296,4294967296 --dtype u8",
        2,
        &["too large"],
    );
    refused(&bench, "convert a.raw --dims 18446744073709551615,1,1 --dtype f64", 2, &["too large"]);
    refused(&bench, "convert a.raw --dims 99999999999999999999,1,1 --dtype u8", 2, &["X,Y,Z"]);
    refused(&bench, "convert a.raw --dims 2,2,2 --dtype u12", 2, &["u12", "u16"]);
    refused(&bench, "convert a.raw --dims 2,2,2 --dtype u8 --brick 31", 2, &["even", "8 to 128"]);
    refused(&bench, "convert a.raw --dims 2,2,2 --dtype u8 --overlap 5", 2, &["0 to 4"]);
    refused(
        &bench,
        "convert a.raw --dims 2,2,2 --dtype u8 --roi 0:3,0:1,0:1",
        2,
        &["0:3", "2 x 2 x 2"],
    );
    refused(&bench, "convert a.raw --dims 2,2,2 --dtype u8 --memory 1MB", 2, &["--memory", "MiB"]);
    refused(
        &bench,
        "convert a.raw --dims 2,2,2 --dtype u8 --empty-below nan",
        2,
        &["--empty-below"],
    );
    refused(&bench, "convert a.raw --dims 2,2,2 --dtype u8 --wrong", 2, &["--wrong"]);
    refused(&bench, "conver a.raw", 2, &["convert"]);
}

#[test]
fn missing_folders_and_strange_files_are_named() {
    let bench = Bench::new();
    refused(&bench, "convert nowhere.nii", 2, &["nowhere.nii", "no such file"]);
    std::fs::create_dir(bench.path("folder")).unwrap();
    refused(&bench, "convert folder", 2, &["folder", "no slices in it"]);
    bench.write("a.xyz", b"what is this");
    refused(&bench, "convert a.xyz", 2, &["a.xyz", "--dims"]);
    bench.write("a.nii", b"");
    refused(&bench, "convert a.nii", 2, &["a.nii", "348"]);
    bench.write("b.nii", &[7; 400]);
    refused(&bench, "convert b.nii", 2, &["b.nii", "NIfTI"]);
    bench.write("c.hdr", &std::fs::read(sample("nifti-suite/minimal.hdr")).unwrap());
    refused(&bench, "convert c.hdr", 2, &["c.img"]);
    bench.write("d.nii.gz", b"not gzip at all");
    refused(&bench, "convert d.nii.gz", 2, &["d.nii.gz", "decompress"]);
    refused(&bench, "convert a_1x1x1_u8.nii --dims 1,1,1", 2, &["no such file"]);
}

#[test]
fn a_truncated_gzip_file_is_refused_wherever_it_ends() {
    let bench = Bench::new();
    let whole = std::fs::read(sample("tooth.nii.gz")).unwrap();
    for keep in [1, 12, 300, whole.len() / 3, whole.len() - 9, whole.len() - 1] {
        bench.write("t.nii.gz", &whole[..keep]);
        refused(&bench, "convert t.nii.gz", 2, &["t.nii.gz"]);
    }
    let mut damaged = whole.clone();
    let middle = damaged.len() / 2;
    damaged[middle..middle + 40].fill(0xff);
    bench.write("t.nii.gz", &damaged);
    refused(&bench, "convert t.nii.gz", 2, &["t.nii.gz"]);
    // A wrong checksum at the very end counts too.
    let mut damaged = whole;
    let crc = damaged.len() - 8;
    damaged[crc] ^= 1;
    bench.write("t.nii.gz", &damaged);
    refused(&bench, "convert t.nii.gz", 2, &["t.nii.gz"]);
}

#[test]
fn files_that_crashed_other_readers_end_in_a_clean_error() {
    let bench = Bench::new();
    let folder = sample("damaged");
    let mut tried = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // They are tried as all that they may pretend to be.
        for ending in [".nii", ".nii.gz", ".hdr", ".img.gz", "_7x5x3_u8.raw"] {
            let name = format!("crash{tried}{ending}");
            std::fs::copy(&path, bench.path(&name)).unwrap();
            refused(&bench, &format!("convert {name}"), 2, &[&format!("crash{tried}")]);
            tried += 1;
        }
    }
    assert!(tried >= 25, "{tried}");
}

#[test]
fn colour_and_complex_volumes_are_refused_by_name() {
    let bench = Bench::new();
    for (file, word) in [
        ("rgb/3D.nii", "RGB"),
        ("rgba/4D.nii", "RGB"),
        ("complex/complex32.nii", "omplex"),
        ("27/int64.nii", "64"),
    ] {
        let arguments = format!("convert {} -o x.octavo", sample(&format!("nifti-suite/{file}")));
        refused(&bench, &arguments, 2, &[word]);
    }
}

#[test]
fn an_output_that_exists_or_is_unfinished_is_kept() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.write("a.octavo", b"mine");
    refused(&bench, "convert a_40x33x20_u16.raw -o a.octavo", 2, &["a.octavo", "--force"]);
    assert_eq!(std::fs::read(bench.path("a.octavo")).unwrap(), b"mine");
    bench.write("a.octavo.json", b"a report of mine");
    bench.write("b.octavo.partial", b"half");
    refused(&bench, "convert a_40x33x20_u16.raw -o b.octavo", 2, &["b.octavo.partial", "--force"]);
    bench.ok("convert a_40x33x20_u16.raw -o b.octavo --force");
    assert!(!bench.path("b.octavo.partial").exists());
    refused(
        &bench,
        "convert a_40x33x20_u16.raw -o no/such/folder/c.octavo",
        2,
        &["folder/c.octavo"],
    );
}

#[test]
fn what_is_no_store_is_told_from_a_damaged_a_newer_and_an_unfinished_one() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    refused(&bench, "info a_40x33x20_u16.raw", 2, &["not an Octavo store"]);
    bench.write("empty.octavo", b"");
    refused(&bench, "info empty.octavo", 2, &["empty file"]);
    refused(&bench, "info nowhere.octavo", 2, &["nowhere.octavo"]);
    std::fs::create_dir(bench.path("f.octavo")).unwrap();
    refused(&bench, "info f.octavo", 2, &["folder"]);
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo");
    // The metadata's frame: magic, then the version.
    let mut newer = std::fs::read(bench.path("a.octavo")).unwrap();
    let places: Vec<usize> =
        (0..newer.len() - 8).filter(|&i| newer[i..i + 8] == *b"OCTV\x01\0\0\0").collect();
    assert!(!places.is_empty());
    for place in places {
        newer[place + 4] = 200;
    }
    bench.write("newer.octavo", &newer);
    refused(&bench, "info newer.octavo", 2, &["version is 200", "newer octavo"]);
    let unfinished = octree_store::StoreWriter::create(
        &bench.path("u.octavo"),
        &bench.path("u.index"),
        Vec::new(),
    )
    .unwrap();
    drop(unfinished);
    refused(&bench, "info u.octavo", 2, &["u.octavo", "not finished"]);
}

#[test]
fn an_unreadable_file_is_named() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    let file = bench.path("a_40x33x20_u16.raw");
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o000)).unwrap();
    let program = bench.path("octavo");
    std::fs::copy(env!("CARGO_BIN_EXE_octavo"), &program).unwrap();
    std::fs::set_permissions(bench.folder(), std::fs::Permissions::from_mode(0o777)).unwrap();
    let mut command = Command::new(program);
    command.arg("convert").arg(&file).current_dir(bench.folder());
    // root may read everything, so root becomes nobody for this.
    if std::fs::read(&file).is_ok() {
        command.uid(65534);
    }
    let output = command.output().unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(words.contains("a_40x33x20_u16.raw") && words.contains("ermission"), "{words}");
}

#[test]
fn a_folder_that_cannot_be_written_to_is_not_called_full() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    std::fs::create_dir(bench.path("shut")).unwrap();
    std::fs::set_permissions(bench.path("shut"), std::fs::Permissions::from_mode(0o555)).unwrap();
    let program = bench.path("octavo");
    std::fs::copy(env!("CARGO_BIN_EXE_octavo"), &program).unwrap();
    std::fs::set_permissions(bench.folder(), std::fs::Permissions::from_mode(0o777)).unwrap();
    let mut command = Command::new(program);
    command.args(["convert", "a_40x33x20_u16.raw", "-o", "shut/a.octavo"]);
    command.current_dir(bench.folder());
    // root may write everywhere, so root becomes nobody for this.
    if std::fs::write(bench.path("shut/probe"), "").is_ok() {
        command.uid(65534);
    }
    let words = String::from_utf8_lossy(&command.output().unwrap().stderr).into_owned();
    assert!(words.contains("shut/a.octavo") && words.contains("ermission"), "{words}");
    assert!(!words.contains("free "), "{words}");
}

#[test]
fn a_full_disk_is_the_environments_fault_and_leaves_nothing() {
    let bench = Bench::new();
    let bytes: Vec<u8> =
        (0..128 * 128 * 64_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    bench.write("a_128x128x64_u8.raw", &bytes);
    // A limit on file size acts as a full disk does, but for the name of the error: ignored, the
    // signal becomes a failed write.
    let script = "trap '' XFSZ; ulimit -f 1000; exec \"$0\" convert a_128x128x64_u8.raw";
    let mut command = Command::new("bash");
    command.args(["-c", script, env!("CARGO_BIN_EXE_octavo")]).current_dir(bench.folder());
    let output = command.output().unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(words.contains("a_128x128x64_u8.octavo"), "{words}");
    assert_eq!(bench.names(), ["a_128x128x64_u8.raw"]);
}

#[test]
fn a_closed_pipe_is_no_error() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo");
    for words in ["histogram a.octavo --bins 65536 --csv", "preview a.octavo --width 400"] {
        let script = format!("\"$0\" {words} | head -n 1; exit ${{PIPESTATUS[0]}}");
        let mut command = Command::new("bash");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_octavo")]).current_dir(bench.folder());
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(octavo().output().unwrap().status.code() == Some(2), "no command is wrong usage");
}
