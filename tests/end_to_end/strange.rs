//! Files and folders as they come: names that are no text, links, pipes, folders under names of files, lists with
//! what is missing. Each is read, or refused by name with the code of its cause; nothing hangs and nothing is left.

use crate::support::{Bench, Said, octavo};
use std::ffi::OsStr;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Runs the program, which must end soon.
fn soon(bench: &Bench, arguments: &[&OsStr]) -> Said {
    let mut command = octavo();
    command.args(arguments).current_dir(bench.folder());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let started = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if started.elapsed() > Duration::from_secs(20) {
            child.kill().unwrap();
            panic!("{arguments:?} hangs");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut texts = [String::new(), String::new()];
    child.stdout.take().unwrap().read_to_string(&mut texts[0]).unwrap();
    child.stderr.take().unwrap().read_to_string(&mut texts[1]).unwrap();
    let [out, err] = texts;
    Said { code: child.wait().unwrap().code().unwrap_or(-1), out, err }
}

fn refused(bench: &Bench, arguments: &str, words: &[&str]) {
    let before = bench.names();
    let split: Vec<_> = arguments.split(' ').map(OsStr::new).collect();
    let said = soon(bench, &split);
    assert_eq!(said.code, 2, "octavo {arguments}: {}{}", said.out, said.err);
    for word in words {
        assert!(said.err.contains(word), "octavo {arguments}: no '{word}' in: {}", said.err);
    }
    assert_eq!(bench.names(), before, "octavo {arguments} left something");
}

#[test]
fn names_need_not_be_text() {
    let bench = Bench::new();
    let bytes = bench.scan("s_40x33x20_u16.raw");
    for name in [
        &b"with space_40x33x20_u16.raw"[..],
        b"new\nline_40x33x20_u16.raw",
        b"bad\xff\xfe_40x33x20_u16.raw",
        "\u{3bc}-ct_40x33x20_u16.raw".as_bytes(),
        b"-dash_40x33x20_u16.raw",
    ] {
        let name = OsStr::from_bytes(name);
        std::fs::write(bench.folder().join(name), &bytes).unwrap();
        let store = OsStr::from_bytes(b"o\xff \n.octavo");
        let [back, force] = [OsStr::from_bytes(b"b\xfe.nrrd"), OsStr::new("--force")];
        let word = OsStr::new;
        let done = soon(&bench, &[word("convert"), word("-o"), store, force, word("--"), name]);
        assert_eq!(done.code, 0, "{name:?}: {}", done.err);
        assert_eq!(soon(&bench, &[word("verify"), store]).code, 0);
        let done = soon(&bench, &[word("extract"), store, word("-o"), back, force]);
        assert_eq!(done.code, 0, "{}", done.err);
        assert!(bench.folder().join(back).exists());
        std::fs::remove_file(bench.folder().join(back)).unwrap();
        std::fs::remove_file(bench.folder().join(store)).unwrap();
        // As a line of a list, where it is one line.
        std::fs::create_dir(bench.path("out")).unwrap();
        if !name.as_bytes().contains(&b'\n') {
            std::fs::write(bench.path("list.txt"), name.as_bytes()).unwrap();
            bench.ok("convert --list list.txt -o out");
        }
        std::fs::remove_dir_all(bench.path("out")).unwrap();
    }
}

#[test]
fn pipes_and_devices_are_refused_and_not_waited_for() {
    let bench = Bench::new();
    bench.scan("s_40x33x20_u16.raw");
    bench.ok("convert s_40x33x20_u16.raw -o s.octavo");
    for name in
        ["f_40x33x20_u16.raw", "f.nii", "f.nii.gz", "f.tif", "f.nrrd", "f.dcm", "f", "f.octavo"]
    {
        assert!(Command::new("mkfifo").arg(bench.path(name)).status().unwrap().success());
        for command in ["convert", "compare s.octavo", "verify s.octavo --against"] {
            refused(&bench, &format!("{command} {name}"), &[name, "pipe"]);
        }
    }
    for command in ["info", "verify", "histogram"] {
        refused(&bench, &format!("{command} f.octavo"), &["f.octavo", "pipe"]);
    }
    refused(&bench, "convert /dev/zero --dims 2,2,2 --dtype u8", &["/dev/zero", "device"]);
    refused(&bench, "convert s_40x33x20_u16.raw -o f.octavo --force", &["f.octavo"]);
    refused(&bench, "extract s.octavo -o f.nii --force", &["f.nii"]);
    // Of a header's data file, too.
    let header = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: f\n";
    bench.write("h.nhdr", header.as_bytes());
    refused(&bench, "convert h.nhdr", &["f", "no regular file"]);
    // Beside slices a pipe is left out.
    std::fs::create_dir(bench.path("slices")).unwrap();
    bench.ok("extract s.octavo -o slices/a.tif");
    assert!(Command::new("mkfifo").arg(bench.path("slices/b.tif")).status().unwrap().success());
    std::fs::remove_file(bench.path("slices/a.tif")).unwrap();
    refused(&bench, "convert slices", &["slices", "no slices"]);
}

#[test]
fn links_are_followed_and_those_that_lead_nowhere_are_the_users_to_mend() {
    let bench = Bench::new();
    bench.scan("s_40x33x20_u16.raw");
    symlink("s_40x33x20_u16.raw", bench.path("l_40x33x20_u16.raw")).unwrap();
    bench.ok("convert l_40x33x20_u16.raw");
    assert!(bench.path("l_40x33x20_u16.octavo").exists(), "named after the link");
    symlink("nowhere", bench.path("d_2x2x2_u8.raw")).unwrap();
    refused(&bench, "convert d_2x2x2_u8.raw", &["d_2x2x2_u8.raw", "no such file"]);
    symlink("r_2x2x2_u8.raw", bench.path("r_2x2x2_u8.raw")).unwrap();
    refused(&bench, "convert r_2x2x2_u8.raw", &["r_2x2x2_u8.raw", "links"]);
    // A folder that holds itself.
    std::fs::create_dir(bench.path("round")).unwrap();
    symlink(".", bench.path("round/self")).unwrap();
    refused(&bench, "convert round", &["round", "no slices"]);
}

#[test]
fn folders_and_lists_that_hold_no_volume_say_what_was_expected() {
    let bench = Bench::new();
    bench.scan("s_40x33x20_u16.raw");
    for folder in ["empty", "x.raw", "text", "d_2x2x2_u8.raw", "s.octavo", "out"] {
        std::fs::create_dir(bench.path(folder)).unwrap();
    }
    bench.write("text/readme.txt", b"hello");
    refused(&bench, "convert empty", &["empty", ".tif", "DICOM", "0 other files"]);
    refused(&bench, "convert text", &["text", "1 other files"]);
    refused(&bench, "convert x.raw", &["x.raw", "no slices"]);
    refused(&bench, "convert d_2x2x2_u8.raw", &["d_2x2x2_u8.raw", "no slices"]);
    refused(&bench, "info s.octavo", &["s.octavo", "folder"]);
    refused(&bench, "convert s_40x33x20_u16.raw --jobs 0", &["--jobs", "1..=64"]);
    refused(&bench, "convert s_40x33x20_u16.raw --threads 0", &["--threads", "1..=1024"]);
    refused(&bench, "convert s_40x33x20_u16.raw -o none/a.octavo", &["none", "no such folder"]);
    refused(&bench, "convert no*.tif", &["no*.tif", "no file matches"]);
    bench.write("list.txt", b"s_40x33x20_u16.raw\nmissing.nii\n");
    let said = bench.run("convert --list list.txt -o out");
    assert_eq!(said.code, 1, "{}", said.err);
    assert!(said.err.contains("missing.nii: there is no such file"), "{}", said.err);
    assert!(bench.path("out/s_40x33x20_u16.octavo").exists());
    // Dimensions that no machine holds are claims of the file's.
    for (encoding, sizes) in [("raw", "60000 60000 60000"), ("gzip", "500000 500000 500000")] {
        let header = format!(
            "NRRD0004\ntype: float\nendian: little\ndimension: 3\nsizes: {sizes}\nencoding: {encoding}\n\nabcd"
        );
        bench.write("huge.nrrd", header.as_bytes());
        refused(&bench, "convert huge.nrrd", &["huge.nrrd"]);
    }
}
