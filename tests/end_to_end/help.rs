//! Help, completions and manual pages.

use crate::support::Bench;

const COMMANDS: [&str; 18] = [
    "convert",
    "info",
    "verify",
    "repair",
    "salvage",
    "histogram",
    "slice",
    "preview",
    "serve",
    "extract",
    "brick",
    "compare",
    "render",
    "render-check",
    "tradeoff",
    "upscale",
    "completions",
    "man",
];

#[test]
fn every_command_explains_itself_with_an_example() {
    let bench = Bench::new();
    for command in COMMANDS {
        let help = bench.ok(&format!("help {command}")).out;
        assert!(help.contains("Example"), "{command}: {help}");
        assert!(help.contains(&format!("octavo {command} ")), "{command}: {help}");
        assert_eq!(bench.ok(&format!("{command} --help")).out, help);
    }
}

#[test]
fn completions_and_manual_pages_know_every_command() {
    let bench = Bench::new();
    for shell in ["bash", "zsh", "fish"] {
        let script = bench.ok(&format!("completions {shell}")).out;
        for command in COMMANDS {
            assert!(script.contains(command), "{shell} {command}");
        }
    }
    assert!(bench.ok("man").out.contains(".TH octavo"));
    std::fs::create_dir(bench.path("man1")).unwrap();
    bench.ok("man -o man1");
    for command in COMMANDS {
        let page =
            std::fs::read_to_string(bench.path(&format!("man1/octavo-{command}.1"))).unwrap();
        assert!(page.contains(command), "{command}");
    }
}
