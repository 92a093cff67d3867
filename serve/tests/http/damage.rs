//! Damage is told, never hidden, and harms nothing else.

use crate::support::{Running, Volume, damage, damage_record, frames, noise};
use octree_store::{Encoding, NodeKey, NodeRecord, StoreWriter, to_le_bytes};
use serde_json::json;

#[test]
fn a_damaged_brick_is_an_error_in_every_shape_and_its_neighbours_are_whole() {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<u16>::new([40, 24, 24], 8, noise);
    let path = folder.path().join("v.octavo");
    volume.write(&path, Encoding::Lossless);
    let broken = NodeKey::new(0, [2, 1, 1]);
    damage(&path, broken);
    Volume::<u16>::new([20, 9, 9], 8, noise)
        .write(&folder.path().join("whole.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    for address in [
        "/v1/v/bricks/0/2/1/1",
        "/v1/v/bricks/0/2/1/1?form=stored",
        "/v1/v/bricks/0/2/1/1?form=codes",
        "/zarr2/v/0/1/1/2",
        "/zarr2-5d/v/0/0/0/1/1/2",
        "/zarr3/v/0/c/1/1/2",
        "/precomputed/v/0/16-24_8-16_8-16",
        "/v1/v/slices/z/9",
    ] {
        for _ in 0..2 {
            let reply = server.get(address);
            reply.assert_problem(500);
            assert_eq!(reply.json()["title"], "damaged");
            assert_eq!(reply.json()["key"], json!([0, 2, 1, 1]));
            assert!(!String::from_utf8_lossy(&reply.body).contains("octavo/"), "no path is told");
        }
        assert_eq!(server.send("HEAD", address, &[], None).status, 500);
    }
    for key in volume.keys().into_iter().filter(|key| *key != broken) {
        let [x, y, z] = key.brick_xyz();
        let reply = server.get(&format!("/v1/v/bricks/{}/{x}/{y}/{z}", key.level()));
        assert_eq!(reply.body, to_le_bytes(&volume.brick(key)));
    }
    let reply = server.post("/v1/v/bricks", r#"{"keys":[[0,1,1,1],[0,2,1,1],[0,3,1,1]]}"#);
    let kinds: Vec<u8> = frames(&reply.body).iter().map(|frame| frame.kind).collect();
    assert_eq!(kinds, [1, 5, 1]);
    // Pictures' windows are made of what is there, and say what is not.
    assert_eq!(server.get("/v1/v/statistics").json()["damaged"], 1);
    assert_eq!(server.get("/zarr2/v/.zattrs").status, 200);
    assert_eq!(server.get("/v1/whole/bricks/0/0/0/0").status, 200);
}

#[test]
fn damage_that_comes_while_the_store_is_served_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.octavo");
    Volume::<u16>::new([40, 24, 24], 8, noise).write(&path, Encoding::Lossless);
    let mut options = crate::support::options(folder.path());
    options.rescan = std::time::Duration::from_hours(1);
    let server = Running::new(options);
    assert_eq!(server.get("/v1/v/bricks/0/1/1/1").status, 200);
    damage(&path, NodeKey::new(0, [2, 1, 1]));
    server.get("/v1/v/bricks/0/2/1/1").assert_problem(500);
}

#[test]
fn a_store_that_cannot_be_opened_harms_only_itself() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([20, 9, 9], 8, noise)
        .write(&folder.path().join("whole.octavo"), Encoding::Lossless);
    std::fs::write(folder.path().join("junk.octavo"), b"no store at all").unwrap();
    let mut cut = std::fs::read(folder.path().join("whole.octavo")).unwrap();
    cut.truncate(cut.len() / 2);
    std::fs::write(folder.path().join("cut.octavo"), cut).unwrap();
    let server = Running::over(folder.path());
    let list = server.get("/v1/datasets").json();
    let names: Vec<&str> =
        list.as_array().unwrap().iter().map(|d| d["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["cut", "junk", "whole"]);
    assert!(list[0]["problem"].is_string() && list[1]["problem"].is_string());
    server.get("/v1/junk/info").assert_problem(500);
    server.get("/zarr2/cut/.zattrs").assert_problem(500);
    assert_eq!(server.get("/v1/whole/bricks/0/0/0/0").status, 200);
}

#[test]
fn a_record_that_cannot_be_read_is_marked_in_the_list_counted_and_harms_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.octavo");
    Volume::<u16>::new([40, 24, 24], 8, noise).write(&path, Encoding::Lossless);
    let address = "/v1/v/nodes?level=0";
    let before = Running::over(folder.path()).get(address).body;
    let broken = NodeKey::new(0, [2, 1, 1]);
    damage_record(&path, broken);
    let server = Running::over(folder.path());
    let after = server.get(address);
    let mut marked = [0; NodeRecord::BYTES];
    marked[..8].copy_from_slice(&broken.to_u64().to_le_bytes());
    marked[8] = 255;
    let records = |bytes: &[u8]| -> Vec<Vec<u8>> {
        bytes.chunks(NodeRecord::BYTES).map(<[u8]>::to_vec).collect()
    };
    let mut found = 0;
    for (before, after) in records(&before).iter().zip(records(&after.body)) {
        let is_broken = before[..8] == marked[..8];
        found += usize::from(is_broken);
        assert_eq!(after, if is_broken { marked.to_vec() } else { before.clone() });
    }
    assert_eq!((found, after.body.len()), (1, before.len()));
    let list = server.get(&format!("{address}&format=json")).json();
    let damaged: Vec<_> =
        list.as_array().unwrap().iter().filter(|node| node["state"] == "damaged").collect();
    assert_eq!(damaged.len(), 1);
    assert_eq!(damaged[0]["key"], json!([0, 2, 1, 1]));
    assert!(damaged[0]["what"].as_str().unwrap().contains("damaged"));
    let metrics = String::from_utf8(server.get("/metrics").body).unwrap();
    assert!(metrics.contains("octavo_failures_total 2\n"), "{metrics}");
}

#[test]
fn a_store_that_is_still_being_made_is_to_be_asked_for_again() {
    let folder = tempfile::tempdir().unwrap();
    let [path, work] = ["v.octavo", "v.work"].map(|name| folder.path().join(name));
    let _writer = StoreWriter::create(&path, &work, Vec::new()).unwrap();
    let server = Running::over(folder.path());
    let reply = server.get("/v1/v/info");
    reply.assert_problem(503);
    assert_eq!((reply.header("retry-after"), &reply.json()["title"]), ("1", &json!("incomplete")));
}
