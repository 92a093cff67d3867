//! The volume as OME-Zarr and precomputed: every voxel of every level, in its place.

use crate::support::{Running, Volume, noise, options, places};
use octree_store::{Encoding, Sample, SampleType};
use serde_json::{Value, json};
use serve::Compressor;

/// Reads a level through its chunks, by what its documents say of it.
fn read_zarr<T: Sample>(server: &Running, root: &str, level: usize) -> (Vec<u64>, Vec<T>) {
    let v3 = root.starts_with("/zarr3");
    let file = if v3 { "zarr.json" } else { ".zarray" };
    let array = server.get(&format!("{root}/{level}/{file}")).json();
    let list = |value: &Value| -> Vec<u64> {
        value.as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect()
    };
    let shape = list(&array["shape"]);
    let chunk = if v3 {
        list(&array["chunk_grid"]["configuration"]["chunk_shape"])
    } else {
        assert_eq!(array["dimension_separator"], "/");
        assert_eq!(array["order"], "C");
        list(&array["chunks"])
    };
    let mut out = vec![T::default(); shape.iter().product::<u64>() as usize];
    let grid: Vec<u64> = shape.iter().zip(&chunk).map(|(n, c)| n.div_ceil(*c)).collect();
    let zyx = |list: &[u64]| [list[list.len() - 1], list[list.len() - 2], list[list.len() - 3]];
    for place in places(zyx(&grid)) {
        let mut path: Vec<String> = place.iter().rev().map(u64::to_string).collect();
        if shape.len() == 5 {
            path.splice(0..0, ["0".to_owned(), "0".to_owned()]);
        }
        let prefix = if v3 { "c/" } else { "" };
        let reply = server.get(&format!("{root}/{level}/{prefix}{}", path.join("/")));
        assert_eq!(reply.status, 200);
        let (side, dims) = (zyx(&chunk), zyx(&shape));
        assert_eq!(reply.body.len() as u64, side.iter().product::<u64>() * size_of::<T>() as u64);
        for (inner, bytes) in places(side).zip(reply.body.chunks_exact(size_of::<T>())) {
            let at = [0, 1, 2].map(|axis| place[axis] * side[axis] + inner[axis]);
            if (0..3).all(|axis| at[axis] < dims[axis]) {
                out[crate::support::index(at, dims)] = T::from_le_slice(bytes);
            }
        }
    }
    (shape, out)
}

fn every_level_is_the_volume_s<T: Sample>(value: impl Fn([u64; 3]) -> f64) {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<T>::new([45, 37, 29], 16, value);
    volume.write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    for root in ["/zarr2/v", "/zarr2-5d/v", "/zarr3/v", "/zarr3-5d/v"] {
        for (level, expected) in volume.levels.iter().enumerate() {
            let (shape, read) = read_zarr::<T>(&server, root, level);
            let [x, y, z] = volume.geometry.dims_at(level as u8);
            let zyx = [z, y, x];
            assert_eq!(shape[shape.len() - 3..], zyx);
            assert!(shape.len() == if root.contains("5d") { 5 } else { 3 });
            assert!(read == *expected, "{root} level {level}");
        }
    }
    let info = server.get("/precomputed/v/info").json();
    let offset = info["octavo"]["value_offset"].as_i64().unwrap_or(0);
    for (level, scale) in info["scales"].as_array().unwrap().iter().enumerate() {
        let dims = volume.geometry.dims_at(level as u8);
        assert_eq!(scale["size"], json!(dims));
        for brick in places(volume.geometry.grid_at(level as u8)) {
            let key = octree_store::NodeKey::new(level as u8, brick);
            let region = volume.geometry.core_region(key);
            let spans = [0, 1, 2].map(|a| format!("{}-{}", region.min[a], region.max[a]));
            let key = scale["key"].as_str().unwrap();
            let reply = server.get(&format!("/precomputed/v/{key}/{}", spans.join("_")));
            assert_eq!(reply.status, 200);
            let samples = reply.body.chunks_exact(if T::TYPE == SampleType::F64 {
                4
            } else {
                size_of::<T>()
            });
            assert_eq!(samples.len() as u64, region.voxels());
            for (inner, bytes) in places(region.dims_xyz()).zip(samples) {
                let at = [0, 1, 2].map(|axis| region.min[axis] + inner[axis]);
                let expected = volume.at(level as u8, at).to_f64();
                let found = match T::TYPE {
                    SampleType::U8 | SampleType::I8 => f64::from(bytes[0]),
                    SampleType::U16 | SampleType::I16 => u16::from_le_slice(bytes).to_f64(),
                    SampleType::U32 | SampleType::I32 => u32::from_le_slice(bytes).to_f64(),
                    SampleType::F32 | SampleType::F64 => f32::from_le_slice(bytes).to_f64(),
                };
                let expected =
                    if T::TYPE == SampleType::F64 { f64::from(expected as f32) } else { expected };
                assert_eq!(found + offset as f64, expected, "{at:?}");
            }
        }
    }
}

#[test]
fn every_level_of_unsigned_integers_is_the_volume_s() {
    every_level_is_the_volume_s::<u8>(|place| noise(place) % 256.0);
    every_level_is_the_volume_s::<u16>(noise);
    every_level_is_the_volume_s::<u32>(|place| noise(place) * 65_537.0);
}

#[test]
fn every_level_of_signed_integers_is_the_volume_s() {
    every_level_is_the_volume_s::<i8>(|place| noise(place) % 256.0 - 128.0);
    every_level_is_the_volume_s::<i16>(|place| noise(place) - 32_768.0);
    every_level_is_the_volume_s::<i32>(|place| (noise(place) - 32_768.0) * 65_536.0);
}

#[test]
fn every_level_of_floats_is_the_volume_s() {
    every_level_is_the_volume_s::<f32>(|place| (noise(place) - 3000.0) / 7.0);
    every_level_is_the_volume_s::<f64>(|place| (noise(place) - 3000.0) / 7.0);
}

/// The scale and the translation of a level, x, y, z.
fn transform(attributes: &Value, level: usize) -> ([f64; 3], [f64; 3]) {
    let dataset = &attributes["multiscales"][0]["datasets"][level];
    assert_eq!(dataset["path"], level.to_string());
    let transforms = &dataset["coordinateTransformations"];
    assert_eq!(
        (&transforms[0]["type"], &transforms[1]["type"]),
        (&json!("scale"), &json!("translation"))
    );
    let last = |list: &Value| {
        let list = list.as_array().unwrap();
        let at = |back: usize| list[list.len() - back].as_f64().unwrap();
        [at(1), at(2), at(3)]
    };
    (last(&transforms[0]["scale"]), last(&transforms[1]["translation"]))
}

/// A 2^k cube of hot voxels, on its own place of the grid of level k, is one hot voxel there. Its middle
/// lies in the same place of the world at all levels, in all formats: half a voxel off would show.
#[test]
fn a_hot_voxel_lies_in_one_place_of_the_world_at_all_levels_in_all_formats() {
    let spacing = [0.5, 1.0, 2.0];
    let (first, side) = ([16_u64, 8, 24], 8);
    let folder = tempfile::tempdir().unwrap();
    let hot = |p: [u64; 3]| (0..3).all(|a| (first[a]..first[a] + side).contains(&p[a]));
    let volume = Volume::<u16>::new([45, 37, 39], 8, |p| if hot(p) { 40_000.0 } else { 0.0 });
    volume.write(&folder.path().join("hot.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    // In world units from the volume's corner: the middle of the cube.
    let middle = [0, 1, 2].map(|a| (first[a] as f64 + side as f64 / 2.0) * spacing[a]);
    let mut checked = 0;
    for level in 0..=3_usize {
        let dims = volume.geometry.dims_at(level as u8);
        let centroid = |read: &[u16]| {
            let hot: Vec<[u64; 3]> =
                places(dims).zip(read).filter(|(_, v)| **v == 40_000).map(|(p, _)| p).collect();
            assert_eq!(hot.len() as u64, (side >> level).pow(3));
            [0, 1, 2].map(|a| hot.iter().map(|p| p[a] as f64).sum::<f64>() / hot.len() as f64)
        };
        for root in ["/zarr2/hot", "/zarr2-5d/hot", "/zarr3/hot", "/zarr3-5d/hot"] {
            let attributes = if root.starts_with("/zarr3") {
                server.get(&format!("{root}/zarr.json")).json()["attributes"]["ome"].clone()
            } else {
                server.get(&format!("{root}/.zattrs")).json()
            };
            let (scale, translation) = transform(&attributes, level);
            let (_, read) = read_zarr::<u16>(&server, root, level);
            let index = centroid(&read);
            // OME-Zarr's zero is the centre of level 0's first voxel; the corner is half a voxel before it.
            let world = [0, 1, 2].map(|a| index[a] * scale[a] + translation[a] + spacing[a] / 2.0);
            assert_eq!(world, middle, "{root} level {level}");
            checked += 1;
        }
        let info = server.get("/precomputed/hot/info").json();
        let scale = &info["scales"][level];
        let index = centroid(&volume.levels[level]);
        for axis in 0..3 {
            // Precomputed puts the corner of voxel 0 at the voxel offset; nanometres.
            let offset = scale["voxel_offset"][axis].as_f64().unwrap();
            let resolution = scale["resolution"][axis].as_f64().unwrap();
            assert_eq!((index[axis] + 0.5 + offset) * resolution, middle[axis] * 1e6);
            checked += 1;
        }
    }
    assert_eq!(checked, 4 * (4 + 3));
}

#[test]
fn a_name_may_end_as_a_zarr_s() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u8>::new([20, 9, 9], 8, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    let pinned = server.get("/v1/datasets").json()[0]["pinned_name"].as_str().unwrap().to_owned();
    let expected = server.get("/zarr3/v/0/c/0/0/1").body;
    for name in ["v.zarr".to_owned(), "v.ome.zarr".to_owned(), format!("{pinned}.zarr")] {
        let reply = server.get(&format!("/zarr3/{name}/0/c/0/0/1"));
        assert_eq!((reply.status, reply.body), (200, expected.clone()), "{name}");
    }
    for name in ["v.ome", "v.zar", "w.zarr", ".zarr"] {
        server.get(&format!("/zarr3/{name}/zarr.json")).assert_problem(404);
    }
}

#[test]
fn what_is_not_there_is_a_clean_404() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u8>::new([20, 9, 9], 8, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    for path in [
        "/zarr2/v/.zarray",
        "/zarr2/v/zarr.json",
        "/zarr2/v/0/9/0/0",
        "/zarr2/v/0/.zattrs",
        "/zarr2/w/.zattrs",
        "/zarr2/v/.zmetadata",
        "/zarr3/v/.zgroup",
        "/zarr3/v/0/c/0/0/3",
        "/precomputed/v/0/0-9_0-8_0-8",
        "/zarr2/v",
        "/zarr2/v/../v/.zattrs",
        "/zarr2/..%2f..%2fetc/passwd",
        "/v1/v/bricks/0/3/0/0",
        "/v1/v/bricks/-1/0/0/0",
        "/v1/v/bricks/9/0/0/0",
        "/v1/v/bricks/0/99999999999999999999/0/0",
        "/v1/v/nodes?level=9",
        "/nothing",
        "/v1/v/slices/x/20",
        "/v1/%ff%fe/info",
        "/zarr3/%ff/zarr.json",
        "/zarr2/v/%ff",
        "/precomputed/%ff/info",
        "/page/%ff",
        "/page/..%2fapp.js",
    ] {
        server.get(path).assert_problem(404);
    }
}

#[test]
fn compressed_chunks_unpack_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([20, 9, 9], 8, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let plain = Running::over(folder.path());
    let packed =
        Running::new(serve::Options { compressor: Compressor::Zstd, ..options(folder.path()) });
    for (root, file) in [("/zarr2/v/0", ".zarray"), ("/zarr3/v/0", "zarr.json")] {
        let array = packed.get(&format!("{root}/{file}")).json();
        assert!(array.to_string().contains("zstd"));
        let chunk = if root.contains("zarr3") { "c/1/1/2" } else { "1/1/2" };
        let (a, b) =
            (plain.get(&format!("{root}/{chunk}")), packed.get(&format!("{root}/{chunk}")));
        assert_ne!(a.header("etag"), b.header("etag"));
        assert_eq!(zstd::bulk::decompress(&b.body, 1 << 20).unwrap(), a.body);
    }
}

#[test]
fn windows_are_robust_and_units_spelled_out() {
    let folder = tempfile::tempdir().unwrap();
    // One hot voxel among 23,000 must not stretch the window.
    let value = |[x, y, z]: [u64; 3]| match [x, y, z] {
        [1, 1, 1] => 60_000.0,
        [2, 1, 1] => 3.0,
        _ => 100.0 + (x % 11) as f64,
    };
    Volume::<u16>::new([40, 24, 24], 8, value)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    let attributes = server.get("/zarr2/v/.zattrs").json();
    let window = &attributes["omero"]["channels"][0]["window"];
    assert_eq!(*window, json!({"min": 3.0, "max": 60000.0, "start": 100.0, "end": 110.0}));
    assert_eq!(
        attributes["multiscales"][0]["axes"][0],
        json!({"name": "z", "type": "space", "unit": "millimeter"})
    );
    assert_eq!(attributes["multiscales"][0]["version"], "0.4");
    // One value everywhere still has a window, and ends that hold it.
    for (value, ends) in [(777.0, [777.0, 778.0]), (65_535.0, [32_767.5, 65_535.0])] {
        let volume = Volume::<u16>::new([9, 9, 9], 8, |_| value);
        let folder = tempfile::tempdir().unwrap();
        volume.write(&folder.path().join("flat.octavo"), Encoding::Lossless);
        let attributes = Running::over(folder.path()).get("/zarr2/flat/.zattrs").json();
        let [low, high] = ends;
        assert_eq!(
            attributes["omero"]["channels"][0]["window"],
            json!({"min": low, "max": high, "start": low, "end": high})
        );
    }
    let group = server.get("/zarr3-5d/v/zarr.json").json();
    let ome = &group["attributes"]["ome"];
    assert_eq!(ome["version"], "0.5");
    for (level, dataset) in (0_i32..).zip(ome["multiscales"][0]["datasets"].as_array().unwrap()) {
        let transforms = &dataset["coordinateTransformations"];
        let [scale, shift] = [2_f64.powi(level), (2_f64.powi(level) - 1.0) / 2.0];
        let zyx = |times: f64| [2.0 * times, times, 0.5 * times];
        let [z, y, x] = zyx(scale);
        assert_eq!(transforms[0]["scale"], json!([1.0, 1.0, z, y, x]));
        let [z, y, x] = zyx(shift);
        assert_eq!(transforms[1]["translation"], json!([0.0, 0.0, z, y, x]));
    }
    let names: Vec<&str> = ome["multiscales"][0]["axes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|a| a["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["t", "c", "z", "y", "x"]);
}

#[test]
fn the_range_that_a_link_shows_is_that_of_the_samples_that_come() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<i16>::new([20, 9, 9], 8, |[x, ..]| x as f64 - 5.0)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let options = serve::Options { bind: ([127, 0, 0, 1], 0).into(), ..options(folder.path()) };
    let server = runtime.block_on(serve::Server::bind(options, None)).unwrap();
    assert_eq!(server.datasets(), [("v".to_owned(), Ok([32_763.0, 32_782.0]))]);
}

#[test]
fn large_volumes_are_summed_up_at_a_level_that_is_small() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u8>::new([128, 128, 66], 32, |place| noise(place) % 256.0)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let statistics = Running::over(folder.path()).get("/v1/v/statistics").json();
    assert_eq!(statistics["level"], 1);
    let counts = statistics["counts"].as_array().unwrap();
    assert_eq!(counts.iter().map(|n| n.as_u64().unwrap()).sum::<u64>(), 64 * 64 * 33);
}
