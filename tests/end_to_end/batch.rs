//! Several inputs in one go.

use crate::support::Bench;
use serde_json::Value;

fn lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn bench() -> Bench {
    let bench = Bench::new();
    for name in ["a_40x33x20_u16.raw", "b_40x33x20_u16.raw", "c_40x33x20_u16.raw"] {
        bench.scan(name);
    }
    std::fs::create_dir(bench.path("stores")).unwrap();
    bench
}

const THREE: &str = "a_40x33x20_u16.raw b_40x33x20_u16.raw c_40x33x20_u16.raw";

#[test]
fn one_bad_scan_does_not_stop_the_others() {
    let bench = bench();
    bench.write("b_40x33x20_u16.raw", b"cut short");
    for jobs in [1, 3] {
        let said = bench.run(&format!("convert {THREE} -o stores --force --jobs {jobs} --json"));
        assert_eq!(said.code, 1, "{}", said.err);
        let lines = lines(&said.out);
        assert_eq!(lines.len(), 3);
        for (line, (name, ok)) in lines.iter().zip([("a", true), ("b", false), ("c", true)]) {
            assert_eq!(line["schema"], "octavo.batch/1");
            assert!(line["input"].as_str().unwrap().starts_with(name));
            assert_eq!(line["ok"], ok);
            assert_eq!(line["exit_code"], if ok { 0 } else { 2 });
            assert_eq!(line["report"].is_object(), ok);
            assert_eq!(line["error"].is_string(), !ok);
        }
        assert_eq!(lines[0]["report"]["digest"], lines[2]["report"]["digest"]);
        assert!(said.err.contains("2 of 3 done") && said.err.contains("FAILED"), "{}", said.err);
    }
    bench.ok("verify stores/a_40x33x20_u16.octavo");
    bench.ok("verify stores/c_40x33x20_u16.octavo");
    assert!(!bench.path("stores/b_40x33x20_u16.octavo").exists());
}

#[test]
fn a_list_names_inputs_and_a_report_gets_a_line_for_each() {
    let bench = bench();
    bench.write("list.txt", b"# tonight\na_40x33x20_u16.raw\n\n  b_40x33x20_u16.raw  \n");
    let said = bench.ok("convert --list list.txt -o stores --report report.jsonl");
    assert!(said.out.contains("2 of 2 done"), "{}", said.out);
    let report = std::fs::read_to_string(bench.path("report.jsonl")).unwrap();
    let lines = lines(&report);
    assert_eq!(lines.len(), 2);
    assert!(lines.iter().all(|line| line["report"]["resumed_bricks"] == 0));

    let one = bench.ok("convert c_40x33x20_u16.raw -o stores --json").json();
    assert_eq!(one["digest"], lines[0]["report"]["digest"], "one input into a folder");
    assert!(bench.path("stores/c_40x33x20_u16.octavo").exists());
    bench.write("empty.txt", b"# nothing\n");
    assert_eq!(bench.run("convert --list empty.txt -o stores").code, 2);
    assert_eq!(bench.run("convert --list none.txt -o stores").code, 2);
}

#[test]
fn outputs_that_would_be_one_are_refused_before_anything_is_done() {
    let bench = bench();
    std::fs::create_dir(bench.path("other")).unwrap();
    std::fs::copy(bench.path("a_40x33x20_u16.raw"), bench.path("other/a_40x33x20_u16.raw"))
        .unwrap();
    let same = bench.run("convert a_40x33x20_u16.raw other/a_40x33x20_u16.raw -o stores");
    assert_eq!(same.code, 2);
    assert!(same.err.contains("other/a_40x33x20_u16.raw"), "{}", same.err);
    let no_folder = bench.run(&format!("convert {THREE} -o none"));
    assert_eq!(no_folder.code, 2);
    assert!(no_folder.err.contains("no such folder"), "{}", no_folder.err);
    assert_eq!(std::fs::read_dir(bench.path("stores")).unwrap().count(), 0);
}

#[test]
fn a_plan_of_several_prints_each() {
    let bench = bench();
    let said = bench.ok(&format!("convert {THREE} -o stores --plan --json --jobs 2"));
    let lines = lines(&said.out);
    assert_eq!(lines.len(), 3);
    assert!(lines.iter().all(|line| line["memory_budget_bytes"] == 256 << 20));
    assert_eq!(std::fs::read_dir(bench.path("stores")).unwrap().count(), 0);
}
