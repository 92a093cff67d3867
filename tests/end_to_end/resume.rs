//! Conversions that are ended from outside, at any moment, and gone on with.

use crate::support::{Bench, octavo};
use serde_json::Value;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

const NAME: &str = "a_512x512x288_u16.raw";
const BYTES: u64 = 512 * 512 * 288 * 2;

/// A source, and the report of its undisturbed conversion.
fn bench() -> (Bench, Value) {
    let bench = Bench::new();
    bench.noise(NAME, BYTES);
    let whole = bench.ok(&format!("convert {NAME} -o whole.octavo --threads 1 --json")).json();
    std::fs::remove_file(bench.path("whole.octavo")).unwrap();
    (bench, whole)
}

fn begin(bench: &Bench, more: &str) -> Child {
    let mut command = octavo();
    command.args(["convert", NAME, "-o", "a.octavo", "--threads", "1"]).args(more.split(' '));
    command
        .current_dir(bench.folder())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits until so many bytes of its work are there; false if it ends before.
fn works_up_to(bench: &Bench, child: &mut Child, bytes: u64) -> bool {
    let partial = bench.path("a.octavo.partial");
    while !std::fs::metadata(&partial).is_ok_and(|file| file.len() >= bytes) {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        sleep(Duration::from_millis(1));
    }
    true
}

fn wait_for_work(bench: &Bench, child: &mut Child) {
    assert!(works_up_to(bench, child, 10 << 20), "it ended too soon");
}

fn signal(child: &Child, name: &str) {
    let kill = Command::new("kill").args(["-s", name, &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
}

/// Numbers between 0 and 1 that look random and are the same in every run.
fn moments(count: u32) -> impl Iterator<Item = f64> {
    (1..=count).map(|i| f64::from(i.wrapping_mul(2_654_435_761)) / f64::from(u32::MAX))
}

/// Killed as its file reaches random lengths, so that the speed of the machine does not matter; often enough that work that was durable is gone on with.
#[test]
fn a_killed_conversion_goes_on_to_the_same_store() {
    let (bench, whole) = bench();
    let kills = std::env::var("OCTAVO_TEST_KILLS").map_or(8, |kills| kills.parse().unwrap());
    let length = whole["payload_bytes"].as_u64().unwrap() as f64;
    let (mut killed, mut resumed) = (0, 0);
    for moment in moments(4 * kills) {
        if killed >= kills && resumed > 0 {
            break;
        }
        let mut child = begin(&bench, "--resume");
        works_up_to(&bench, &mut child, (length * moment) as u64);
        child.kill().unwrap();
        killed += u32::from(child.wait().unwrap().code().is_none());
        if bench.path("a.octavo").exists() {
            std::fs::remove_file(bench.path("a.octavo")).unwrap();
            continue;
        }
        // Half of them are killed again on their way, by the next round.
        if moment < 0.5 {
            continue;
        }
        let done = bench.ok(&format!("convert {NAME} -o a.octavo --resume --json")).json();
        assert_eq!(done["digest"], whole["digest"]);
        resumed += u32::from(done["resumed_bricks"].as_u64().unwrap() > 0);
        assert_eq!(bench.names(), ["a.octavo", NAME], "nothing else is left");
        bench.ok("verify a.octavo");
        std::fs::remove_file(bench.path("a.octavo")).unwrap();
    }
    assert!(killed >= kills && resumed > 0, "{killed} killed, {resumed} resumed");
}

#[test]
fn a_signal_commits_and_says_how_to_go_on() {
    let (bench, whole) = bench();
    for name in ["INT", "TERM"] {
        let mut child = begin(&bench, "--resume");
        wait_for_work(&bench, &mut child);
        let second = bench.run(&format!("convert {NAME} -o a.octavo --force"));
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{words}");
        assert!(words.contains("stopped") && words.contains("--resume"), "{words}");
        assert_eq!(second.code, 3, "a second conversion onto it: {}", second.err);
        assert!(second.err.contains("another conversion"), "{}", second.err);

        let refused = bench.run(&format!("convert {NAME} -o a.octavo"));
        assert_eq!(refused.code, 2);
        assert!(
            refused.err.contains("unfinished") && refused.err.contains("--resume"),
            "{}",
            refused.err
        );
        let done = bench.ok(&format!("convert {NAME} -o a.octavo --resume --json")).json();
        assert_eq!(done["digest"], whole["digest"]);
        assert!(done["resumed_bricks"].as_u64().unwrap() > 100, "{}", done["resumed_bricks"]);
        assert_eq!(bench.names(), ["a.octavo", NAME]);
        std::fs::remove_file(bench.path("a.octavo")).unwrap();
    }
}

#[test]
fn a_source_that_has_changed_is_refused_and_resume_without_work_begins() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    let first = bench.ok("convert a_40x33x20_u16.raw -o a.octavo --resume --json").json();
    assert_eq!(first["resumed_bricks"], 0);
    assert_eq!(bench.run("convert a_40x33x20_u16.raw -o a.octavo --resume").code, 2, "it is done");

    bench.noise(NAME, BYTES);
    let mut child = begin(&bench, "--force");
    wait_for_work(&bench, &mut child);
    signal(&child, "INT");
    child.wait_with_output().unwrap();
    bench.noise(NAME, BYTES);
    bench.ok(&format!("convert {NAME} -o b.octavo --resume"));
    std::fs::remove_file(bench.path("a.octavo")).unwrap();
    let refused = bench.run(&format!("convert {NAME} -o a.octavo --resume"));
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(refused.err.contains("modified") && refused.err.contains("--force"), "{}", refused.err);
    bench.ok(&format!("convert {NAME} -o a.octavo --force"));
}
