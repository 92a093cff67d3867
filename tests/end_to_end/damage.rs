//! A damaged store says so; it never gives wrong samples without a word.

use crate::support::Bench;
use octree_store::{BrickScratch, Store};

fn bench() -> (Bench, Vec<u8>) {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --brick 8 --encoding lossless");
    let bytes = std::fs::read(bench.path("a.octavo")).unwrap();
    (bench, bytes)
}

#[test]
fn a_flipped_payload_bit_is_reported_not_returned() {
    let (bench, bytes) = bench();
    let store = Store::open(bench.path("a.octavo")).unwrap();
    let mut scratch = BrickScratch::default();
    let mut payloads = Vec::new();
    store
        .visit_level(0, |record| {
            payloads.push((record.key, store.read_payload(record, &mut scratch).unwrap().to_vec()));
            true
        })
        .unwrap();
    let (key, payload) = &payloads[40];
    let piece = &payload[100..160];
    let place = bytes.windows(piece.len()).position(|window| window == piece).unwrap();
    let mut damaged = bytes.clone();
    damaged[place + 30] ^= 4;
    bench.write("d.octavo", &damaged);
    let said = bench.run("verify d.octavo --json");
    assert_eq!(said.code, 1);
    let found = said.json();
    let [x, y, z] = key.brick_xyz();
    let expected = serde_json::json!([{"level": 0, "x": x, "y": y, "z": z, "what": "its payload fails its checksum"}]);
    assert_eq!((&found["ok"], &found["damaged"]), (&serde_json::json!(false), &expected));
    let said = bench.run(&format!("brick d.octavo --level 0 --at {x},{y},{z} -o b.raw"));
    assert_eq!(said.code, 2);
    assert!(said.err.contains(&format!("level 0 brick {x},{y},{z}")), "{}", said.err);
    assert!(!bench.path("b.raw").exists());
    // Its neighbours are whole.
    bench.ok("brick d.octavo --level 0 --at 0,0,0 -o c.raw");
}

#[test]
fn flips_anywhere_are_found_or_harmless() {
    let (bench, bytes) = bench();
    let digest = bench.ok("info a.octavo --json").json()["digest"].clone();
    let source = std::fs::read(bench.path("a_40x33x20_u16.raw")).unwrap();
    let mut found = 0;
    for trial in 0..60_usize {
        let mut damaged = bytes.clone();
        let place = (trial * 7_919 + 13) * 104_729 % bytes.len();
        damaged[place] ^= 1 << (trial % 8);
        bench.write("d.octavo", &damaged);
        let said = bench.run("verify d.octavo --json");
        assert!([1, 2].contains(&said.code) || said.json()["ok"] == true, "{}", said.err);
        assert!(!said.err.contains("panicked"), "{}", said.err);
        if said.code == 0 {
            // Then the bit lay in unused space, and all is as it was.
            assert_eq!(bench.ok("info d.octavo --json").json()["digest"], digest);
            bench.ok("extract d.octavo -o e.raw --force");
            assert_eq!(std::fs::read(bench.path("e.raw")).unwrap(), source, "byte {place}");
        } else {
            found += 1;
        }
    }
    assert!(found > 10, "{found} of 60");
}

#[test]
fn truncations_are_found() {
    let (bench, bytes) = bench();
    for keep in [100, 4096, 8192, bytes.len() / 2, bytes.len() - 4096, bytes.len() - 1] {
        bench.write("d.octavo", &bytes[..keep]);
        let said = bench.run("verify d.octavo");
        assert!([1, 2].contains(&said.code), "{keep}: {}", said.out);
        assert!(!said.err.contains("panicked"), "{}", said.err);
        assert!(said.err.contains("d.octavo") || said.out.contains("d.octavo"), "{keep}");
    }
}
