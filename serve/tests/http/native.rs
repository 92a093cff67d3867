//! The native addresses against the store itself.

use crate::support::{Reply, Running, Volume, frames, noise};
use octree_store::loader::{
    Appearance, Camera, ClipBox, CutLeaf, LeafKind, Quality, Scene, StoreNodes, TransferFunction,
    View, select_cut,
};
use octree_store::{Encoding, NodeKey, NodeRecord, Store, to_le_bytes};
use serde_json::json;
use std::collections::HashSet;

struct Served {
    volume: Volume<u16>,
    store: Store,
    server: Running,
    _folder: tempfile::TempDir,
}

/// Noise with a corner of one value.
fn serve(encoding: Encoding) -> Served {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<u16>::new([45, 37, 29], 8, |place| {
        if place.iter().all(|v| *v < 22) { 7.0 } else { noise(place) }
    });
    let path = folder.path().join("noise.octavo");
    volume.write(&path, encoding);
    let server = Running::over(folder.path());
    Served { volume, store: Store::open(&path).unwrap(), server, _folder: folder }
}

fn address(key: NodeKey) -> String {
    let [x, y, z] = key.brick_xyz();
    format!("/v1/noise/bricks/{}/{x}/{y}/{z}", key.level())
}

fn list(key: NodeKey) -> [u64; 4] {
    let [x, y, z] = key.brick_xyz();
    [u64::from(key.level()), x, y, z]
}

#[test]
fn every_brick_of_a_lossless_store_is_the_volume_s() {
    let Served { volume, server, _folder, .. } = serve(Encoding::Lossless);
    let mut states = HashSet::new();
    for key in volume.keys() {
        let reply = server.get(&address(key));
        assert_eq!(reply.status, 200);
        assert_eq!(reply.body, to_le_bytes(&volume.brick(key)), "{key}");
        states.insert(reply.header("x-octavo-state").to_owned());
    }
    assert!(states.contains("uniform") && states.contains("stored"), "{states:?}");
}

#[test]
fn stored_payloads_decode_with_the_record_beside_them() {
    let Served { volume, store, server, _folder } = serve(Encoding::Quantised8);
    for key in volume.keys() {
        let reply = server.get(&format!("{}?form=stored", address(key)));
        let record: Vec<u8> = (0..NodeRecord::BYTES)
            .map(|i| {
                u8::from_str_radix(&reply.header("x-octavo-record")[2 * i..][..2], 16).unwrap()
            })
            .collect();
        let record = NodeRecord::from_bytes(&record).unwrap();
        assert_eq!(record, store.node(key).unwrap());
        let mut scratch = octree_store::BrickScratch::default();
        assert_eq!(reply.body, store.read_payload(&record, &mut scratch).unwrap());
    }
}

#[test]
fn codes_and_their_map_give_the_samples() {
    let Served { volume, store, server, _folder } = serve(Encoding::Quantised8);
    let key = NodeKey::new(0, [5, 4, 3]);
    let reply = server.get(&format!("{}?form=codes", address(key)));
    let map = reply.header("x-octavo-value-map");
    let number = |name: &str| -> f64 {
        let (_, rest) = map.split_once(&format!("{name}=")).unwrap();
        rest.split(';').next().unwrap().parse().unwrap()
    };
    let (_, samples) = store.read_brick_samples(key).unwrap();
    assert_eq!(reply.body.len(), volume.geometry.brick_samples());
    for (i, code) in reply.body.iter().enumerate() {
        let value = number("scale") * f64::from(*code) + number("offset");
        assert!((value - samples.get_f64(i)).abs() <= 0.5 + 1e-6, "{value}");
    }
}

#[test]
fn node_records_come_by_range_as_bytes_and_as_json() {
    let Served { volume, store, server, _folder } = serve(Encoding::Lossless);
    for level in volume.geometry.levels() {
        let mut expected = Vec::new();
        store
            .visit_level(level, |record| {
                expected.push(*record);
                true
            })
            .unwrap();
        let all = server.get(&format!("/v1/noise/nodes?level={level}"));
        let bytes: Vec<u8> = expected.iter().flat_map(NodeRecord::to_bytes).collect();
        assert_eq!(all.body, bytes);
        assert_eq!(all.header("x-octavo-nodes"), expected.len().to_string());
        let part = server.get(&format!("/v1/noise/nodes?level={level}&first=3&count=5"));
        assert_eq!(part.header("x-octavo-nodes"), expected.len().to_string());
        let from = (3 * NodeRecord::BYTES).min(bytes.len());
        assert_eq!(part.body, bytes[from..(8 * NodeRecord::BYTES).min(bytes.len())]);
        let json = server.get(&format!("/v1/noise/nodes?level={level}&format=json")).json();
        assert_eq!(json.as_array().unwrap().len(), expected.len());
        for (json, record) in json.as_array().unwrap().iter().zip(&expected) {
            assert_eq!(json["key"], json!(list(record.key)));
            assert_eq!(json["brick_max"], record.brick_max);
            assert_eq!(json["state"], record.state.name());
        }
    }
}

#[test]
fn many_bricks_come_in_the_order_of_the_list() {
    let Served { volume, server, _folder, .. } = serve(Encoding::Lossless);
    let mut keys: Vec<[u64; 4]> = volume.keys().into_iter().map(list).collect();
    keys.reverse();
    keys.insert(2, [0, 99, 0, 0]);
    keys.push([77, u64::MAX, 0, 0]);
    // No level's number is taken for another's.
    keys.extend([[64, 0, 0, 0], [256, 0, 0, 0], [1 << 32, 0, 0, 0]]);
    let reply = server.post("/v1/noise/bricks", &json!({"keys": keys}).to_string());
    assert_eq!(reply.status, 200);
    let frames = frames(&reply.body);
    assert_eq!(frames.len(), keys.len());
    for (frame, [level, x, y, z]) in frames.iter().zip(&keys) {
        if *level > 9 || *x > 9 {
            assert_eq!((frame.kind, frame.body.len()), (4, 0));
            continue;
        }
        let key = NodeKey::new(*level as u8, [*x, *y, *z]);
        assert_eq!(frame.name, key.to_u64());
        let samples = volume.brick(key);
        match frame.kind {
            1 => assert_eq!(frame.body, to_le_bytes(&samples)),
            2 => assert!(samples.iter().all(|v| f64::from(*v) == frame.numbers[0])),
            other => panic!("kind {other}"),
        }
    }
}

const CAMERA: &str = r#"{"projection":"perspective","position":[11,18,-90],"target":[11,18,29],"up":[0,-1,0],"fov_y_deg":30}"#;
const TRANSFER: &str = r#"{"points":[{"value":0,"color":[0,0,0],"extinction":0},{"value":9,"color":[0,0,0],"extinction":0},{"value":60000,"color":[1,1,1],"extinction":1}]}"#;

fn cut_body(have: &[[u64; 4]]) -> String {
    let have = json!(have);
    format!(
        r#"{{"cameras":[{CAMERA}],"size":[90,60],"accuracy":1,"transfer":{TRANSFER},"budget_bricks":500,"have":{have}}}"#
    )
}

#[test]
fn a_cut_is_the_loader_s_and_brings_what_the_client_lacks() {
    let Served { store, server, _folder, .. } = serve(Encoding::Quantised8);
    let camera: Camera = serde_json::from_str(CAMERA).unwrap();
    let transfer: TransferFunction = serde_json::from_str(TRANSFER).unwrap();
    let views = [View::new(camera, [90, 60]).unwrap()];
    let appearance = Appearance::Transfer(transfer);
    let scene =
        Scene { views: &views, clip: None, appearance: &appearance, quality: Quality::default() };
    let expected = select_cut(&mut StoreNodes::new(&store), &scene, 500);
    assert!(expected.bricks() > 20, "the view is worth the test");

    let reply = server.post("/v1/noise/cut", &cut_body(&[]));
    assert_eq!(reply.status, 200, "{}", String::from_utf8_lossy(&reply.body));
    let first = frames(&reply.body);
    let leaves = &first[0];
    assert_eq!(leaves.kind, 16);
    for (entry, leaf) in leaves.body.chunks_exact(16).zip(&expected.leaves) {
        assert_eq!(entry[..8], leaf.key.to_u64().to_le_bytes());
        let kind = match leaf.kind {
            LeafKind::Brick => 1,
            LeafKind::Uniform => 2,
            LeafKind::Empty => 3,
            LeafKind::OutOfView => 4,
            LeafKind::Damaged => 5,
        };
        assert_eq!(entry[8], kind);
    }
    assert_eq!(leaves.body.len(), 16 * expected.leaves.len());
    let bricks: Vec<u64> = first[1..].iter().map(|frame| frame.name).collect();
    let lacking: Vec<u64> =
        expected.lacking(&HashSet::new()).map(|leaf| leaf.key.to_u64()).collect();
    assert_eq!(bricks, lacking);
    // Coarse to fine.
    let levels: Vec<u64> = bricks.iter().map(|name| name >> 58).collect();
    assert!(levels.is_sorted_by(|a, b| a >= b), "{levels:?}");
    let payload: u64 = expected
        .leaves
        .iter()
        .filter(|leaf| leaf.kind == LeafKind::Brick)
        .map(|leaf| u64::from(leaf.payload_bytes))
        .sum();
    // Bricks of 12^3 codes are small beside their records of 120 bytes; those of 36^3 are not.
    assert!(reply.body.len() as f64 <= 1.15 * payload as f64, "{} {payload}", reply.body.len());

    let have: Vec<[u64; 4]> =
        bricks.iter().step_by(2).map(|name| list(NodeKey::from_u64(*name).unwrap())).collect();
    let second = frames(&server.post("/v1/noise/cut", &cut_body(&have)).body);
    let rest: Vec<u64> = bricks.iter().skip(1).step_by(2).copied().collect();
    assert_eq!(second[1..].iter().map(|frame| frame.name).collect::<Vec<_>>(), rest);
    assert_eq!(second[0].body.len(), leaves.body.len());
}

/// What a cut's first frame says: whether the budget made it coarser, and of each leaf key, kind, whether it is held, and
/// pixels of a voxel.
fn leaves(reply: &Reply) -> (bool, Vec<(u64, u8, u8, f32)>) {
    assert_eq!(reply.status, 200, "{}", String::from_utf8_lossy(&reply.body));
    let first = frames(&reply.body).swap_remove(0);
    let leaves: Vec<_> = first
        .body
        .chunks_exact(16)
        .map(|leaf| {
            let key = u64::from_le_bytes(leaf[..8].try_into().unwrap());
            (key, leaf[8], leaf[9], f32::from_le_bytes(leaf[12..].try_into().unwrap()))
        })
        .collect();
    assert_eq!(first.numbers[0], leaves.len() as f64);
    (first.numbers[1] != 0.0, leaves)
}

#[test]
fn a_cut_heeds_all_that_is_asked() {
    let Served { store, server, _folder, .. } = serve(Encoding::Quantised8);
    let camera: Camera = serde_json::from_str(CAMERA).unwrap();
    let views = [View::new(camera, [90, 60]).unwrap()];
    let clip = ClipBox::new([1.0, 2.0, 3.0], [12.0, 30.0, 50.0]).unwrap();
    let everything = Appearance::Everything;
    let mut cuts = Vec::new();
    for (more, accuracy, appearance, clip, budget) in [
        (r#""accuracy":1"#, 1.0, everything.clone(), None, 4096),
        (r#""accuracy":9"#, 9.0, everything.clone(), None, 4096),
        (r#""isovalue":3"#, 1.0, Appearance::Isovalue(3.0), None, 4096),
        (r#""budget_bricks":20"#, 1.0, everything.clone(), None, 20),
        (r#""clip":{"min":[1,2,3],"max":[12,30,50]}"#, 1.0, everything.clone(), Some(clip), 4096),
    ] {
        let quality = Quality { accuracy, ..Quality::default() };
        let scene = Scene { views: &views, clip, appearance: &appearance, quality };
        let expected = select_cut(&mut StoreNodes::new(&store), &scene, budget);
        let kind = |leaf: LeafKind| match leaf {
            LeafKind::Brick => 1,
            LeafKind::Uniform => 2,
            LeafKind::Empty => 3,
            LeafKind::OutOfView => 4,
            LeafKind::Damaged => 5,
        };
        let body = format!(r#"{{"cameras":[{CAMERA}],"size":[90,60],{more}}}"#);
        let found = leaves(&server.post("/v1/noise/cut", &body));
        let told = |leaf: &CutLeaf| (leaf.key.to_u64(), kind(leaf.kind), 0, leaf.voxel_pixels);
        assert_eq!(found, (expected.limited, expected.leaves.iter().map(told).collect()), "{more}");
        assert!(!cuts.contains(&found), "{more} changes nothing here");
        cuts.push(found);
    }
    assert!(cuts[3].0 && !cuts[0].0, "only the budget limits");
    let held = json!([0, 1, 2, 3].map(|at| {
        list(
            NodeKey::from_u64(cuts[0].1.iter().filter(|leaf| leaf.1 == 1).nth(at).unwrap().0)
                .unwrap(),
        )
    }));
    let body = format!(r#"{{"cameras":[{CAMERA}],"size":[90,60],"have":{held}}}"#);
    let (_, again) = leaves(&server.post("/v1/noise/cut", &body));
    let mut counted = 0;
    for (before, after) in cuts[0].1.iter().zip(&again) {
        let key = json!(list(NodeKey::from_u64(after.0).unwrap()));
        let held = u8::from(held.as_array().unwrap().contains(&key));
        assert_eq!(*after, (before.0, before.1, held, before.3));
        counted += held;
    }
    assert_eq!(counted, 4);
}

#[test]
fn frames_of_codes_say_what_makes_values_of_them() {
    let Served { store, server, _folder, .. } = serve(Encoding::Quantised8);
    let reply = server.post("/v1/noise/bricks?form=codes", r#"{"keys":[[0,5,4,3],[0,0,0,0]]}"#);
    let [coded, uniform] = frames(&reply.body).try_into().unwrap();
    let map = store.value_map(&store.node(NodeKey::new(0, [5, 4, 3])).unwrap()).unwrap();
    assert_eq!((coded.kind, coded.numbers), (1, [map.offset, map.scale]));
    assert_eq!((uniform.kind, uniform.numbers, uniform.body.len()), (2, [7.0; 2], 0));
}

#[test]
fn slices_are_the_volume_s() {
    let Served { volume, server, _folder, .. } = serve(Encoding::Lossless);
    let mut tags = HashSet::new();
    for level in volume.geometry.levels() {
        let dims = volume.geometry.dims_at(level);
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let at = dims[axis] / 2;
            let reply = server.get(&format!("/v1/noise/slices/{name}/{at}?level={level}"));
            let expected: Vec<u16> = crate::support::places(dims)
                .filter(|place| place[axis] == at)
                .map(|place| volume.at(level, place))
                .collect();
            assert_eq!(reply.body, to_le_bytes(&expected));
            let sides: Vec<String> =
                (0..3).filter(|a| *a != axis).map(|a| dims[a].to_string()).collect();
            assert_eq!(reply.header("x-octavo-dims"), sides.join(","));
            assert!(tags.insert(reply.header("etag").to_owned()), "{name} {at} of level {level}");
        }
    }
    // One above another: the same place of two levels is not the same slice.
    let tag = server.get("/v1/noise/slices/x/1?level=0").header("etag").to_owned();
    let other = server.get_with("/v1/noise/slices/x/1?level=1", &[("if-none-match", &tag)]);
    assert_eq!(other.status, 200);
}

#[test]
fn the_list_and_the_metadata_are_the_store_s() {
    let Served { store, server, _folder, .. } = serve(Encoding::Lossless);
    let list = server.get("/v1/datasets").json();
    assert_eq!(list[0]["name"], "noise");
    assert_eq!(list[0]["dims_xyz"], json!([45, 37, 29]));
    let info = server.get("/v1/noise/info").json();
    assert_eq!(info["schema"], "octavo.info/1");
    assert_eq!(info["digest"], store.metadata().digest);
    let statistics = server.get("/v1/noise/statistics").json();
    let counts = statistics["counts"].as_array().unwrap();
    assert!(counts[0] != 0 && counts[255] != 0 && counts.len() == 256, "the ends are values");
    assert_eq!(counts.iter().map(|n| n.as_u64().unwrap()).sum::<u64>(), 45 * 37 * 29);
}
