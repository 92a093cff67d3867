//! Codes as zarr: with the map beside them they are the dequantised samples.

use crate::support::{Running, Volume, damage_record, noise, options, places};
use octree_store::{Encoding, MaxError, NodeKey, Sample, Store, UploadFormat};
use serde_json::{Value, json};
use serve::{Compressor, Options};

const DIMS: [u64; 3] = [45, 37, 29];
const CORE: u64 = 8;

/// Noise, a corner of one value, and one where few codes are enough.
fn terrain(place: [u64; 3]) -> f64 {
    if place.iter().all(|v| *v < 20) {
        7.0
    } else if place[0] >= 32 {
        1000.0 + noise(place) % 50.0
    } else {
        noise(place)
    }
}

fn numbers(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect()
}

/// The code words of a chunk, of as many bytes as the array's document says.
fn words(array: &Value, v3: bool, bytes: &[u8]) -> Vec<f64> {
    let narrow = if v3 { json!("uint8") } else { json!("|u1") };
    if array[if v3 { "data_type" } else { "dtype" }] == narrow {
        return bytes.iter().map(|code| f64::from(*code)).collect();
    }
    bytes.chunks_exact(2).map(|b| f64::from(u16::from_le_bytes(b.try_into().unwrap()))).collect()
}

/// Every chunk of every level, in both formats: as the map says they are what the store reads. Returns the
/// types of texels that were met.
fn codes_are_the_samples<T: Sample>(encoding: Encoding) -> Vec<UploadFormat> {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<T>::new(DIMS, CORE as u32, terrain);
    let path = folder.path().join("v.octavo");
    volume.write(&path, encoding);
    let (store, server) = (Store::open(&path).unwrap(), Running::over(folder.path()));
    let mut formats = Vec::new();
    for (root, v3) in [("/zarr2-codes/v", false), ("/zarr3-codes/v", true)] {
        let (file, prefix) = if v3 { ("zarr.json", "c/") } else { (".zarray", "") };
        for level in volume.geometry.levels() {
            let grid = volume.geometry.grid_at(level);
            let array = server.get(&format!("{root}/{level}/codes/{file}")).json();
            let map = server.get(&format!("{root}/{level}/map/{file}")).json();
            let zyx = |[x, y, z]: [u64; 3]| json!([z, y, x]);
            assert_eq!(array["shape"], zyx(volume.geometry.dims_at(level)));
            assert_eq!(map["shape"], json!([grid[2], grid[1], grid[0], 4]));
            let map = numbers(&server.get(&format!("{root}/{level}/map/{prefix}0/0/0/0")).body);
            assert_eq!(map.len() as u64, 4 * grid.iter().product::<u64>());
            for (brick, map) in places(grid).zip(map.chunks_exact(4)) {
                let [x, y, z] = brick;
                let reply = server.get(&format!("{root}/{level}/codes/{prefix}{z}/{y}/{x}"));
                assert_eq!(reply.status, 200);
                let codes = words(&array, v3, &reply.body);
                assert_eq!(codes.len() as u64, CORE.pow(3), "whole at the edges");
                let key = NodeKey::new(level, brick);
                let record = store.node(key).unwrap();
                let known = store.value_map(&record).unwrap();
                formats.push(known.format);
                let region = volume.geometry.core_region(key);
                let samples = store.read_region_samples(level, region).unwrap();
                let mut samples = (0..samples.len()).map(|i| samples.get_f64(i));
                for (at, code) in places([CORE; 3]).zip(codes) {
                    if (0..3).any(|axis| at[axis] >= region.dims_xyz()[axis]) {
                        assert_eq!(code, 0.0, "nothing outside the volume");
                        continue;
                    }
                    let expected = samples.next().unwrap();
                    let value = (map[1] + map[0] * code).clamp(map[2], map[3]);
                    if size_of::<T>() <= 2 && T::TYPE.is_integer() {
                        assert_eq!(value.round_ties_even(), expected, "{key} {at:?}");
                    } else {
                        assert!((value - expected).abs() <= known.max_difference, "{key} {at:?}");
                    }
                }
                assert!(samples.next().is_none());
            }
        }
    }
    formats
}

#[test]
fn codes_of_integers_give_the_samples_exactly() {
    let bounded = |error| Encoding::MaxError(MaxError::new(error).unwrap());
    for encoding in [Encoding::Quantised8, Encoding::Lossless, bounded(300.0)] {
        codes_are_the_samples::<u16>(encoding);
        codes_are_the_samples::<i16>(encoding);
    }
    let mixed = codes_are_the_samples::<u16>(bounded(3.0));
    assert!(mixed.contains(&UploadFormat::R8) && mixed.contains(&UploadFormat::R16), "{mixed:?}");
}

#[test]
fn codes_of_other_types_give_the_samples_within_rounding() {
    codes_are_the_samples::<f32>(Encoding::Quantised8);
    codes_are_the_samples::<f64>(Encoding::MaxError(MaxError::new(40.0).unwrap()));
    codes_are_the_samples::<u32>(Encoding::Quantised8);
}

#[test]
fn the_root_says_what_the_numbers_are_and_pretends_to_be_no_picture() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new(DIMS, CORE as u32, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Quantised8);
    let server = Running::over(folder.path());
    let root = server.get("/zarr2-codes/v/.zattrs").json();
    assert_eq!(root["multiscales"], Value::Null, "codes are no values");
    assert_eq!(root["octavo"]["map"], json!(["scale", "offset", "min", "max"]));
    assert_eq!(root["octavo"]["sample_type"], "u16");
    let level = &root["octavo"]["levels"][1];
    assert_eq!((&level["codes"], &level["map"]), (&json!("1/codes"), &json!("1/map")));
    assert_eq!(level["scale_zyx"], json!([4.0, 2.0, 1.0]));
    assert_eq!(level["translation_zyx"], json!([1.0, 0.5, 0.25]));
    assert_eq!(server.get("/zarr3-codes/v/zarr.json").json()["attributes"], root);
    for (path, kind) in
        [("/zarr3-codes/v/0/zarr.json", "node_type"), ("/zarr2-codes/v/0/.zgroup", "zarr_format")]
    {
        assert!(!server.get(path).json()[kind].is_null(), "{path}");
    }
}

#[test]
fn a_store_of_wide_samples_has_no_codes_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<f32>::new([20, 9, 9], 8, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    for path in [
        "/zarr2-codes/v/.zattrs",
        "/zarr3-codes/v/0/codes/c/0/0/0",
        "/zarr3-codes/v/0/map/c/0/0/0/0",
    ] {
        let reply = server.get(path);
        reply.assert_problem(404);
        assert!(reply.json()["detail"].as_str().unwrap().contains("16 bits"));
    }
}

#[test]
fn a_record_that_cannot_be_read_is_nan_in_the_map_and_harms_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.octavo");
    Volume::<u16>::new([40, 24, 24], 8, noise).write(&path, Encoding::Quantised8);
    let whole = Running::over(folder.path());
    let address = "/zarr3-codes/v/0/map/c/0/0/0/0";
    let before = numbers(&whole.get(address).body);
    drop(whole);
    damage_record(&path, NodeKey::new(0, [2, 1, 1]));
    let server = Running::over(folder.path());
    let after = numbers(&server.get(address).body);
    // Bricks lie x fastest in a grid of 5 x 3 x 3.
    let at = 2 + 5 * (1 + 3);
    assert!(after[4 * at..4 * at + 4].iter().all(|number| number.is_nan()));
    for (i, (before, after)) in before.chunks(4).zip(after.chunks(4)).enumerate() {
        assert!(i == at || before == after, "brick {i}");
    }
    server.get("/zarr3-codes/v/0/codes/c/1/1/2").assert_problem(500);
    assert_eq!(server.get("/zarr3-codes/v/0/codes/c/1/1/1").status, 200);
}

#[test]
fn maps_of_many_bricks_come_in_blocks() {
    let folder = tempfile::tempdir().unwrap();
    // 19 x 2 x 1 bricks.
    let path = folder.path().join("v.octavo");
    Volume::<u16>::new([150, 12, 8], 8, noise).write(&path, Encoding::Quantised8);
    let (store, server) = (Store::open(&path).unwrap(), Running::over(folder.path()));
    let array = server.get("/zarr2-codes/v/0/map/.zarray").json();
    assert_eq!((&array["shape"], &array["chunks"]), (&json!([1, 2, 19, 4]), &json!([1, 2, 16, 4])));
    let map = numbers(&server.get("/zarr2-codes/v/0/map/0/0/1/0").body);
    for (brick, numbers) in places([16, 2, 1]).zip(map.chunks_exact(4)) {
        if brick[0] + 16 >= 19 {
            assert_eq!(numbers, [0.0; 4], "outside the volume");
            continue;
        }
        let record = store.node(NodeKey::new(0, [brick[0] + 16, brick[1], brick[2]])).unwrap();
        let map = store.value_map(&record).unwrap();
        assert_eq!(numbers, [map.scale, map.offset, record.brick_min, record.brick_max]);
    }
    server.get("/zarr2-codes/v/0/map/0/0/2/0").assert_problem(404);
}

#[test]
fn codes_are_packed_like_other_chunks() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([20, 9, 9], 8, |[x, ..]| 100.0 * x as f64)
        .write(&folder.path().join("v.octavo"), Encoding::Quantised8);
    let plain = Running::over(folder.path());
    let packed = Running::new(Options { compressor: Compressor::Zstd, ..options(folder.path()) });
    let array = packed.get("/zarr2-codes/v/0/codes/.zarray").json();
    assert_eq!(array["compressor"]["id"], "zstd");
    // Eight bits are enough for every brick.
    assert_eq!(array["dtype"], "|u1");
    let chunk = "/zarr2-codes/v/0/codes/1/1/2";
    let (a, b) = (plain.get(chunk), packed.get(chunk));
    assert_eq!(zstd::bulk::decompress(&b.body, 1 << 20).unwrap(), a.body);
    assert_ne!(a.header("etag"), b.header("etag"));
}
