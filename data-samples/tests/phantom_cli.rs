//! The program `phantom`: names, bytes, messages and exit codes.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use data_samples::{Kind, Phantom};

fn phantom(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_phantom"))
        .args(arguments.split(' '))
        .current_dir(folder)
        .output()
        .unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn the_file_has_the_librarys_bytes_under_a_name_that_says_how_to_read_it() {
    let folder = tempfile::tempdir().unwrap();
    let output = phantom(folder.path(), "micro-ct --dims 50,40,30 --seed 9 --noise 100");
    assert!(output.status.success(), "{output:?}");
    assert_eq!(names(folder.path()), ["micro-ct_50x40x30_u16.raw"]);
    let kind = Kind::MicroCt { seed: 9, noise_sigma: 100.0 };
    let expected = Phantom::new(kind, [50, 40, 30]).unwrap().volume::<u16>();
    let bytes = fs::read(folder.path().join("micro-ct_50x40x30_u16.raw")).unwrap();
    assert!(expected.into_iter().flat_map(u16::to_le_bytes).eq(bytes));
}

#[test]
fn every_kind_takes_its_flags() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, size, first) in [
        ("ramp --dims 4,3,2 --slope=-1,20,300 --dtype f32 --big-endian -o a", 96, &[0, 0, 0, 0]),
        ("sphere --dims 9,9,9 --radius 20 --inside 258 --big-endian -o a", 1458, &[1, 2, 1, 2]),
        (
            "hot-voxel --dims 4,4,4 --at 1,0,0 --hot 7 --background 5 --dtype u8 -o a",
            64,
            &[5, 7, 5, 5],
        ),
        ("constant --dims 3,3,3 --value 513 -o a", 54, &[1, 2, 1, 2]),
    ] {
        let output = phantom(folder.path(), arguments);
        assert!(output.status.success(), "{arguments}: {output:?}");
        let bytes = fs::read(folder.path().join("a")).unwrap();
        assert_eq!((bytes.len(), &bytes[..4]), (size, &first[..]), "{arguments}");
    }
}

#[test]
fn wrong_usage_exits_with_2_and_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, said) in [
        ("micro-ct", "--dims"),
        ("micro-ct --dims 4,4", "three numbers"),
        ("micro-ct --dims 4,x,4", "'x'"),
        ("micro-ct --dims 4,0,4", "at least one voxel"),
        ("micro-ct --dims 4,4,4 --noise -1", "-1"),
        ("micro-ct --dims 4,4,4 --dtype i64", "i64"),
        ("constant --dims 4,4,4 --value 300 --dtype u8", "does not fit in u8"),
        ("hot-voxel --dims 4,4,4 --at 4,0,0", "outside the volume"),
        ("sphere --dims 4,4,4 --radius nan", "finite"),
        ("cube --dims 4,4,4", "cube"),
    ] {
        let output = phantom(folder.path(), arguments);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {stderr}");
        assert!(stderr.contains(said), "{arguments}: {stderr}");
        assert!(names(folder.path()).is_empty(), "{arguments}");
    }
}

#[test]
fn a_place_that_cannot_be_written_exits_with_3() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("taken")).unwrap();
    for (arguments, said) in [
        ("constant --dims 4,4,4 -o missing/a.raw", "does the folder exist"),
        ("constant --dims 4,4,4 -o taken", "not a plain file"),
    ] {
        let output = phantom(folder.path(), arguments);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(3), "{arguments}: {stderr}");
        assert!(stderr.contains(said), "{arguments}: {stderr}");
        assert_eq!(names(folder.path()), ["taken"], "{arguments}");
    }
}

/// A limit on the size of files stands in for a full disk.
#[cfg(unix)]
#[test]
fn a_file_cut_short_exits_with_3_and_leaves_the_older_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.raw");
    fs::write(&path, "an older file").unwrap();
    let program = env!("CARGO_BIN_EXE_phantom");
    let script =
        format!("trap '' XFSZ; ulimit -f 64; exec '{program}' constant --dims 500,500,10 -o a.raw");
    let output =
        Command::new("sh").args(["-c", &script]).current_dir(folder.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    assert_eq!(fs::read(&path).unwrap(), b"an older file");
    assert_eq!(names(folder.path()), ["a.raw"], "something is left behind");
}
