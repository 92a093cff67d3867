//! Encodings and where the overlap rests, as a user chooses them; payloads read anew by a reader in Python
//! that knows FORMAT.md and nothing else.

use crate::readers::python;
use crate::support::Bench;

/// A volume with structure and noise: 40 x 33 x 20 of u16, and the same as f32.
fn volumes(bench: &Bench) {
    let (mut whole, mut floats) = (Vec::new(), Vec::new());
    for i in 0..40 * 33 * 20_u32 {
        let [x, y, z] = [i % 40, i / 40 % 33, i / (40 * 33)];
        let noise = i.wrapping_mul(2_654_435_761) >> 24;
        let v = 900 * (x / 20) + 70 * y + 11 * z + if y < 17 { noise } else { 0 };
        whole.extend((v as u16).to_le_bytes());
        floats.extend((v as f32 / 7.0).to_le_bytes());
    }
    bench.write("a_40x33x20_u16.raw", &whole);
    bench.write("b_40x33x20_f32.raw", &floats);
}

#[test]
fn every_encoding_is_what_the_format_says_of_it() {
    let bench = Bench::new();
    volumes(&bench);
    let mut seen = std::collections::BTreeSet::new();
    for (source, encodings) in [
        ("a_40x33x20_u16.raw", ["u8", "lossless", "max-error=0", "max-error=40"]),
        ("b_40x33x20_f32.raw", ["u8", "lossless", "max-error=0.05", "max-error=3.5"]),
    ] {
        for encoding in encodings {
            for effort in ["fast", "balanced", "small"] {
                for overlap in ["stored", "assembled"] {
                    bench.ok(&format!(
                        "convert {source} -o a.octavo --force --brick 16 --encoding {encoding} \
                         --effort {effort} --overlap-at-rest {overlap}"
                    ));
                    assert_eq!(
                        bench.ok(&format!("verify a.octavo --against {source} --json")).json()["ok"],
                        true
                    );
                    let info = bench.ok("info a.octavo --json");
                    assert_eq!(info.json()["encoding"], encoding);
                    assert_eq!(info.json()["stored_overlap"], overlap == "stored");
                    bench.write("info.json", info.out.as_bytes());
                    for (level, at) in [(0, "0,0,0"), (0, "2,1,0"), (0, "1,2,1"), (1, "1,0,0")] {
                        let brick = format!("brick a.octavo --level {level} --at {at}");
                        let said = bench.ok(&format!("{brick} --json -o brick.raw --force"));
                        bench.write("brick.json", said.out.as_bytes());
                        let said = said.json();
                        seen.insert((said["coding"].to_string(), said["filter"].to_string()));
                        let path = |name: &str| bench.path(name).to_str().unwrap().to_owned();
                        let files = ["a.octavo", "info.json", "brick.json", "brick.raw"].map(path);
                        python("decode_brick.py", &files.each_ref().map(String::as_str));
                    }
                }
            }
        }
    }
    assert!(seen.len() >= 8, "codings and filters: {seen:?}");
}

#[test]
fn bounds_hold_and_what_is_no_bound_is_refused() {
    let bench = Bench::new();
    volumes(&bench);
    for error in ["0", "3.5", "40", "1e9"] {
        bench.ok(&format!(
            "convert a_40x33x20_u16.raw -o e.octavo --force --encoding max-error={error}"
        ));
        bench.ok(&format!("compare a_40x33x20_u16.raw e.octavo --max-amax {error}"));
        let said = bench.ok("info e.octavo").out;
        assert!(said.contains("bits  ") && said.contains("bricks"), "{said}");
    }
    for bad in ["max-error=-1", "max-error=nan", "max-error=inf", "max-error=", "u9"] {
        let said = bench.run(&format!("convert a_40x33x20_u16.raw -o x.octavo --encoding {bad}"));
        assert_eq!(said.code, 2, "{bad}: {}", said.err);
        assert!(said.err.contains("max-error=E") || said.err.contains("0 or more"), "{}", said.err);
        assert!(!bench.path("x.octavo").exists());
    }
}
