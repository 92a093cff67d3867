//! `repair` makes a store what it was; `salvage` saves what is whole, and says what is not.

use crate::support::Bench;
use octree_store::{BrickScratch, BrickState, Geometry, NodeKey, Region, Store};
use serde_json::{Value, json};
use std::fs::Permissions;
use std::os::unix::fs::{PermissionsExt, symlink};
use twox_hash::XxHash3_64;

const SOURCE: &str = "a_40x33x20_u16.raw";
const PAGE: usize = 4096;

/// A store of 75 + 18 + 4 + 1 bricks, made with these options.
fn bench(options: &str) -> (Bench, Vec<u8>) {
    let bench = Bench::new();
    bench.scan(SOURCE);
    bench.ok(&format!("convert {SOURCE} -o a.octavo --brick 8 {options}"));
    let bytes = std::fs::read(bench.path("a.octavo")).unwrap();
    (bench, bytes)
}

fn digest(bench: &Bench, store: &str) -> Value {
    bench.ok(&format!("info {store} --json")).json()["digest"].clone()
}

/// Where the payload of a brick lies in the file.
fn payload(bench: &Bench, level: u8, at: [u64; 3]) -> std::ops::Range<usize> {
    let store = Store::open(bench.path("a.octavo")).unwrap();
    let place = store.node(NodeKey::new(level, at)).unwrap().place;
    let begin = PAGE + place.offset as usize;
    begin..begin + place.length as usize
}

/// Where the records of a brick lie in the file: more than one where the index let go of some.
fn records(bytes: &[u8], level: u8, at: [u64; 3]) -> Vec<usize> {
    let key = NodeKey::new(level, at).to_u64().to_le_bytes();
    (0..bytes.len() - 120)
        .filter(|i| bytes[*i..*i + 8] == key && (1..5).contains(&bytes[*i + 8]))
        .collect()
}

const BRICKS: [(u8, [u64; 3]); 4] =
    [(0, [2, 1, 1]), (0, [4, 4, 2]), (1, [1, 1, 0]), (3, [0, 0, 0])];

fn listed(bricks: &[(u8, [u64; 3])], what: &str) -> Value {
    let one = |&(level, [x, y, z]): &(u8, [u64; 3])| json!({"level": level, "x": x, "y": y, "z": z, "what": what});
    bricks.iter().map(one).collect()
}

#[test]
fn damaged_payloads_are_put_right_in_place() {
    for options in [
        "--encoding u8",
        "--encoding lossless",
        "--encoding max-error=9 --overlap-at-rest assembled --effort small",
    ] {
        let (bench, bytes) = bench(options);
        let mut damaged = bytes.clone();
        for (level, at) in BRICKS {
            let place = payload(&bench, level, at);
            damaged[place.start + 5..place.start + 9].fill(0xa5);
        }
        bench.write("a.octavo", &damaged);
        assert_eq!(bench.run("verify a.octavo").code, 1);
        let said = bench.ok(&format!("repair a.octavo --against {SOURCE} --json")).json();
        let expected = listed(&BRICKS, "its payload fails its checksum");
        assert_eq!((&said["repaired"], &said["in_place"]), (&expected, &json!(true)), "{said}");
        assert_eq!(said["store"], Value::Null);
        assert!(std::fs::read(bench.path("a.octavo")).unwrap() == bytes, "every byte is as it was");
        assert_eq!(bench.names(), ["a.octavo", SOURCE], "nothing else is left");
        let again = bench.ok(&format!("repair a.octavo --against {SOURCE}"));
        assert!(again.out.contains("nothing is wrong"), "{}", again.out);
    }
}

#[test]
fn a_record_that_lies_about_its_place_costs_no_other_brick() {
    let (bench, bytes) = bench("--encoding lossless");
    let whole = digest(&bench, "a.octavo");
    let other = payload(&bench, 0, [1, 1, 1]).start as u64 - PAGE as u64;
    // In the place of another's payload, and across two.
    for offset in [other, other + 5] {
        let mut damaged = bytes.clone();
        for record in records(&bytes, 0, [2, 1, 1]) {
            damaged[record + 16..record + 24].copy_from_slice(&offset.to_le_bytes());
            let checksum = XxHash3_64::oneshot(&damaged[record..record + 112]);
            damaged[record + 112..record + 120].copy_from_slice(&checksum.to_le_bytes());
        }
        bench.write("a.octavo", &damaged);
        let said = bench.ok(&format!("repair a.octavo --against {SOURCE} --json")).json();
        let expected = listed(&[(0, [2, 1, 1])], "its payload fails its checksum");
        assert_eq!((&said["repaired"], &said["in_place"]), (&expected, &json!(false)), "{said}");
        bench.ok("verify a.octavo");
        assert_eq!(digest(&bench, "a.octavo"), whole);
    }
}

#[test]
fn what_was_not_written_there_is_saved_with_a_word_about_it() {
    let (bench, mut bytes) = bench("--encoding lossless");
    for record in records(&bytes, 0, [2, 1, 1]) {
        bytes[record + 28] ^= 1;
        let checksum = XxHash3_64::oneshot(&bytes[record..record + 112]);
        bytes[record + 112..record + 120].copy_from_slice(&checksum.to_le_bytes());
    }
    bench.ok("salvage a.octavo -o same.octavo");
    bench.write("a.octavo", &bytes);
    let said = bench.run("salvage a.octavo -o s.octavo --json");
    assert_eq!((said.code, &said.json()["ok"]), (1, &json!(false)), "{}", said.out);
    assert!(said.err.contains("does not give the digest"), "{}", said.err);
}

#[test]
fn any_page_that_is_lost_is_made_anew_to_the_same_digest() {
    let (bench, bytes) = bench("--encoding u8 --empty-below 2500");
    let whole = digest(&bench, "a.octavo");
    let mut anew = 0;
    for page in 0..bytes.len().div_ceil(PAGE) {
        let mut damaged = bytes.clone();
        let end = ((page + 1) * PAGE).min(bytes.len());
        damaged[page * PAGE..end].fill(0);
        bench.write("a.octavo", &damaged);
        let wrong = bench.run("verify a.octavo").code != 0;
        let said = bench.ok(&format!("repair a.octavo --against {SOURCE} --json")).json();
        assert_eq!(said["digest"], whole, "page {page}");
        assert!(!wrong || said["repaired"] != json!([]) || said["store"] != Value::Null, "{said}");
        bench.ok(&format!("verify a.octavo --against {SOURCE}"));
        anew += u32::from(said["in_place"] == false);
    }
    assert!(anew >= 5, "{anew}");
    assert_eq!(bench.names(), ["a.octavo", SOURCE]);
}

#[test]
fn sums_that_do_not_follow_from_the_records_are_made_anew() {
    let (bench, bytes) = bench("--encoding u8");
    let frames: Vec<usize> =
        (0..bytes.len() - 4).filter(|at| bytes[*at..].starts_with(b"OCTV")).collect();
    let json = std::str::from_utf8(&bytes[frames[1] + 16..]).unwrap();
    let lie = json.replace("\"dropped_voxels\":0", "\"dropped_voxels\":7");
    assert_ne!(lie, json);
    let checksum = XxHash3_64::oneshot_with_seed(1, lie.as_bytes()).to_le_bytes();
    let frame = [b"OCTV\x01\0\0\0", &checksum[..], lie.as_bytes()].concat();
    let mut damaged = bytes.clone();
    for at in frames {
        damaged[at..at + frame.len()].copy_from_slice(&frame);
    }
    bench.write("a.octavo", &damaged);
    assert_eq!(bench.run("verify a.octavo").code, 1);
    let said = bench.ok(&format!("repair a.octavo --against {SOURCE} --json")).json();
    assert!(said["store"].as_str().unwrap().contains("sums"), "{said}");
    assert!(std::fs::read(bench.path("a.octavo")).unwrap() == bytes, "every byte is as it was");
}

#[test]
fn a_store_that_is_written_anew_keeps_its_permissions_and_the_link_to_it() {
    let (bench, bytes) = bench("--encoding u8");
    let mut damaged = bytes.clone();
    for record in records(&bytes, 0, [2, 1, 1]) {
        damaged[record + 60] ^= 1;
    }
    bench.write("a.octavo", &damaged);
    let [store, link] = ["a.octavo", "link.octavo"].map(|name| bench.path(name));
    std::fs::set_permissions(&store, Permissions::from_mode(0o600)).unwrap();
    symlink("a.octavo", &link).unwrap();
    let said = bench.ok(&format!("repair link.octavo --against {SOURCE} --json")).json();
    assert_eq!(said["in_place"], false, "{said}");
    assert!(link.is_symlink(), "the link is no store of its own");
    assert!(std::fs::read(&store).unwrap() == bytes, "what it leads to is whole");
    assert_eq!(std::fs::metadata(&store).unwrap().permissions().mode() & 0o777, 0o600);
    assert_eq!(bench.names(), ["a.octavo", SOURCE, "link.octavo"]);
}

#[test]
fn a_store_is_not_repaired_from_another_source() {
    let (bench, bytes) = bench("--encoding lossless");
    let mut other = std::fs::read(bench.path(SOURCE)).unwrap();
    let source = "other_40x33x20_u16.raw";
    // Two voxels of brick 2,1,1 change places: its range and its errors stay what they were.
    let voxel = |x: usize, y: usize, z: usize| 2 * ((z * 33 + y) * 40 + x);
    for byte in 0..2 {
        other.swap(voxel(17, 10, 9) + byte, voxel(18, 12, 11) + byte);
    }
    bench.write(source, &other);
    // Once that brick's payload is damaged, once its record, once the record of another brick.
    let mut payload_gone = bytes.clone();
    payload_gone[payload(&bench, 0, [2, 1, 1]).start + 3] ^= 1;
    let of = |level, at| {
        let mut damaged = bytes.clone();
        for record in records(&bytes, level, at) {
            damaged[record + 60] ^= 1;
        }
        damaged
    };
    for damaged in [payload_gone.clone(), of(0, [2, 1, 1]), of(0, [4, 4, 2])] {
        bench.write("a.octavo", &damaged);
        let said = bench.run(&format!("repair a.octavo --against {source}"));
        assert_eq!(said.code, 2, "{}{}", said.out, said.err);
        assert!(said.err.contains("not made from this source"), "{}", said.err);
        assert!(std::fs::read(bench.path("a.octavo")).unwrap() == damaged, "it is as it was");
        assert_eq!(bench.names(), ["a.octavo", SOURCE, source]);
        // From its own source it is.
        bench.ok(&format!("repair a.octavo --against {SOURCE}"));
        bench.ok("verify a.octavo");
    }
    // Voxels of one cell change places, so that all levels above stay what they were; or one is greater than any was.
    let own = std::fs::read(bench.path(SOURCE)).unwrap();
    let mut swapped = own.clone();
    for byte in 0..2 {
        swapped.swap(voxel(18, 10, 10) + byte, voxel(19, 11, 11) + byte);
    }
    assert_ne!(swapped, own);
    let mut greater = own.clone();
    greater[voxel(19, 11, 11)..][..2].fill(0xff);
    // Or they lie further apart, and have the mean that they had.
    let mut apart = own;
    for (at, change) in [(voxel(18, 10, 10), -9), (voxel(19, 11, 11), 9)] {
        let value = i16::from_le_bytes(apart[at..at + 2].try_into().unwrap()) + change;
        apart[at..at + 2].copy_from_slice(&value.to_le_bytes());
    }
    for (other, damaged, what) in [
        (&swapped, &payload_gone, "what was made anew does not give the digest that it had"),
        (&swapped, &of(0, [4, 4, 2]), "level 0 brick 2,1,1: it does not match the source"),
        (
            &greater,
            &payload_gone,
            "brick 2,1,1: it does not match the source: its range is not that of the source's voxels",
        ),
        (&apart, &of(0, [2, 1, 1]), "what it says of the bricks beneath it is not so"),
    ] {
        bench.write(source, other);
        bench.write("a.octavo", damaged);
        let said = bench.run(&format!("repair a.octavo --against {source}"));
        assert_eq!(said.code, 2, "{}{}", said.out, said.err);
        assert!(said.err.contains(what), "{}", said.err);
        assert!(std::fs::read(bench.path("a.octavo")).unwrap() == *damaged, "it is as it was");
    }
    bench.write("a.octavo", &bytes);
    bench.write("small_8x8x8_u16.raw", &[0; 1024]);
    assert_eq!(bench.run("repair a.octavo --against small_8x8x8_u16.raw").code, 2);
    // What other work has left is not touched unasked.
    bench.write("a.octavo.partial", b"half");
    let said = bench.run(&format!("repair a.octavo --against {SOURCE}"));
    assert_eq!(said.code, 2);
    assert!(said.err.contains("a.octavo.partial") && said.err.contains("--force"), "{}", said.err);
    bench.ok(&format!("repair a.octavo --against {SOURCE} --force"));
    assert!(!bench.path("a.octavo.partial").exists());
}

#[test]
fn what_is_whole_is_saved_and_what_is_lost_is_known_to_be() {
    let (bench, bytes) = bench("--encoding lossless");
    let whole = Store::open(bench.path("a.octavo")).unwrap();
    let before = digest(&bench, "a.octavo");
    let mut damaged = bytes.clone();
    let (payloads, gone) = BRICKS.split_at(2);
    for (level, at) in payloads {
        damaged[payload(&bench, *level, *at).start + 5] ^= 4;
    }
    // One record of level 1, and that of the root.
    for (level, at) in gone {
        for record in records(&bytes, *level, *at) {
            damaged[record + 70] ^= 4;
        }
    }
    bench.write("d.octavo", &damaged);
    let said = bench.run("salvage d.octavo -o s.octavo --json");
    assert_eq!(said.code, 1, "{}", said.err);
    let said = said.json();
    let all = |first: &str, then: &str| {
        let mut all = listed(payloads, first);
        all.as_array_mut().unwrap().extend(listed(gone, then).as_array().unwrap().clone());
        all
    };
    let expected = all("its payload fails its checksum", "its record is missing");
    let lost = json!({"ok": false, "bricks": 98, "lost": expected});
    for key in ["ok", "bricks"] {
        assert_eq!(said[key], lost[key], "{said}");
    }
    let keys = |list: &Value| -> Vec<Value> {
        let at = |node: &Value| json!([node["level"], node["x"], node["y"], node["z"]]);
        list.as_array().unwrap().iter().map(at).collect()
    };
    assert_eq!(keys(&said["lost"]), keys(&lost["lost"]));

    // The new store says so, and is otherwise consistent.
    let said = bench.run("verify s.octavo --json");
    assert_eq!(said.code, 1);
    let lost = "it was lost before this store was salvaged from a damaged one";
    assert_eq!((&said.json()["damaged"], &said.json()["store"]), (&all(lost, lost), &Value::Null));
    assert_eq!(bench.ok("brick s.octavo --level 0 --at 2,1,1 --json").json()["state"], "lost");
    assert!(bench.ok("info s.octavo").out.contains("LOST         4 bricks"));
    for command in ["extract s.octavo -o e.raw", "brick s.octavo --level 0 --at 2,1,1 -o b.raw"] {
        let said = bench.run(command);
        assert_eq!(said.code, 2, "{command}");
        assert!(
            said.err.contains("level 0 brick 2,1,1") && said.err.contains("lost"),
            "{}",
            said.err
        );
    }
    let saved = Store::open(bench.path("s.octavo")).unwrap();
    let geometry = *whole.geometry();
    let mut scratch = BrickScratch::default();
    let [mut a, mut b] = [(); 2].map(|()| vec![0_u16; geometry.brick_samples()]);
    let mut lost = 0;
    for key in geometry.levels().flat_map(|level| geometry.keys_at(level)) {
        let right = whole.read_brick(key, &mut scratch, &mut a).unwrap();
        let record = saved.node(key).unwrap();
        assert!(record.subtree_min <= right.subtree_min && right.subtree_max <= record.subtree_max);
        assert!(right.lod_amax_bound <= record.lod_amax_bound);
        if record.state == BrickState::Lost {
            lost += 1;
            let error = saved.read_brick(key, &mut scratch, &mut b).unwrap_err().to_string();
            assert!(error.contains(&key.to_string()), "{error}");
            assert!(saved.read_payload(&record, &mut scratch).is_err());
            assert!(saved.read_upload(&record, &mut scratch).is_err());
        } else {
            saved.read_brick(key, &mut scratch, &mut b).unwrap();
            assert_eq!(a, b);
        }
    }
    assert_eq!(lost, 4);

    // With the source it is whole again.
    let said = bench.ok(&format!("repair s.octavo --against {SOURCE} --json")).json();
    assert_eq!((&said["digest"], &said["digest_before"]), (&before, &before));
    bench.ok(&format!("verify s.octavo --against {SOURCE}"));
    let (mended, whole) = (Store::open(bench.path("s.octavo")).unwrap(), whole.metadata());
    assert_eq!(mended.metadata().options, whole.options);
}

#[test]
fn a_lost_neighbour_makes_overlap_an_error_and_no_guess() {
    let (bench, bytes) = bench("--encoding u8 --overlap-at-rest assembled");
    let mut damaged = bytes.clone();
    damaged[payload(&bench, 0, [2, 1, 1]).start + 5] ^= 4;
    bench.write("d.octavo", &damaged);
    assert_eq!(bench.run("salvage d.octavo -o s.octavo").code, 1);
    let saved = Store::open(bench.path("s.octavo")).unwrap();
    let mut scratch = BrickScratch::default();
    let mut samples = vec![0_u16; saved.geometry().brick_samples()];
    let neighbour = NodeKey::new(0, [1, 1, 1]);
    let error = saved.read_brick(neighbour, &mut scratch, &mut samples).unwrap_err().to_string();
    assert!(error.contains("level 0 brick 2,1,1"), "{error}");
    saved.read_brick_core(neighbour, &mut scratch, &mut samples).unwrap();
    let corner = Region { min: [0; 3], max: [8, 8, 8] };
    saved.read_region::<u16>(0, corner).unwrap();
    assert!(saved.read_region::<u16>(0, Region::whole([40, 33, 20])).is_err());
}

#[test]
fn whatever_page_is_lost_the_rest_is_saved() {
    let (bench, bytes) = bench("--encoding lossless");
    let whole = Store::open(bench.path("a.octavo")).unwrap();
    let before = whole.metadata().digest.clone();
    let geometry: Geometry = *whole.geometry();
    let region = Region::whole(geometry.dims_xyz());
    let all = whole.read_region::<u16>(0, region).unwrap();
    let mut untouched = 0;
    for page in 0..bytes.len().div_ceil(PAGE) {
        let mut damaged = bytes.clone();
        damaged[page * PAGE..((page + 1) * PAGE).min(bytes.len())].fill(0);
        bench.write("d.octavo", &damaged);
        let store = Store::open_remains(bench.path("d.octavo")).unwrap();
        let output = bench.path("s.octavo");
        let _ = std::fs::remove_file(&output);
        let start = preprocess::Start::Fresh;
        let saved = preprocess::salvage(&store, &output, start, &preprocess::NoProgress).unwrap();
        // A page of lossless payloads lies in at most three bricks of 2,000 bytes; one of records has parts of 36 at most.
        assert!(saved.lost.len() <= 36, "page {page}: {}", saved.lost.len());
        let read = Store::open(&output).unwrap();
        if saved.lost.is_empty() {
            untouched += 1;
            assert_eq!(saved.metadata.digest, before);
            assert_eq!(read.read_region::<u16>(0, region).unwrap(), all);
        } else {
            assert_eq!(read.metadata().options[octree_store::SALVAGED_OF], before);
        }
    }
    assert_eq!(untouched, 3, "the first page, and either copy of the metadata");
}

#[test]
fn where_the_index_is_cut_off_the_source_must_be_converted_again() {
    let (bench, bytes) = bench("--encoding lossless");
    bench.write("d.octavo", &bytes[..PAGE * 3]);
    for command in ["salvage d.octavo -o s.octavo", &format!("repair d.octavo --against {SOURCE}")]
    {
        let said = bench.run(command);
        assert_eq!(said.code, 2, "{}", said.out);
        assert!(said.err.contains("convert the source again"), "{}", said.err);
    }
    // Cut off within the index, what is there of records counts.
    let mut lost = Vec::new();
    let index = u64::from_le_bytes(bytes[24..32].try_into().unwrap()) as usize;
    for end in (index..bytes.len()).step_by(PAGE) {
        bench.write("d.octavo", &bytes[..end]);
        assert_eq!(bench.run("verify d.octavo").code, 1);
        let said = bench.run("salvage d.octavo -o s.octavo --force --json");
        lost.push(said.json()["lost"].as_array().unwrap().len());
        assert_eq!(said.code, i32::from(lost.last() > Some(&0)), "{}", said.err);
        bench.ok(&format!("repair d.octavo --against {SOURCE}"));
        assert_eq!(digest(&bench, "d.octavo"), digest(&bench, "a.octavo"));
    }
    assert!(lost[0] == 98 && lost.is_sorted_by(|a, b| a >= b), "{lost:?}");
    assert!(lost.iter().any(|lost| (1..98).contains(lost)), "{lost:?}");
    bench.write("n.octavo", b"not a store at all");
    assert_eq!(bench.run("salvage n.octavo -o t.octavo").code, 2);
    assert_eq!(bench.run("salvage nowhere.octavo -o t.octavo").code, 2);
}
