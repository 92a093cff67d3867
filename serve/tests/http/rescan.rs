//! Stores come, go and are replaced while the server runs.

use crate::support::{Running, Volume, noise, options};
use octree_store::{Encoding, NodeKey, to_le_bytes};
use std::time::{Duration, Instant};

/// Waits until a claim holds, for as long as a rescan may take on a machine that is busy.
fn eventually(what: &str, claim: impl Fn() -> bool) {
    let began = Instant::now();
    while !claim() {
        assert!(began.elapsed() < Duration::from_secs(30), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn stores_are_added_replaced_and_removed_without_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let aside = tempfile::tempdir_in(folder.path()).unwrap();
    let server = Running::over(folder.path());
    assert_eq!(server.get("/v1/datasets").json(), serde_json::json!([]));
    server.get("/v1/v/info").assert_problem(404);

    let first = Volume::<u16>::new([20, 9, 9], 8, noise);
    let second = Volume::<u16>::new([20, 9, 9], 8, |place| 65_535.0 - noise(place));
    let put = |volume: &Volume<u16>| {
        let made = aside.path().join("v.octavo");
        volume.write(&made, Encoding::Lossless);
        std::fs::rename(&made, folder.path().join("v.octavo")).unwrap();
    };
    let brick = "/v1/v/bricks/0/1/0/0";
    let is = |volume: &Volume<u16>| {
        server.get(brick).body == to_le_bytes(&volume.brick(NodeKey::new(0, [1, 0, 0])))
    };
    put(&first);
    eventually("it was added", || is(&first));
    let tag = server.get(brick).header("etag").to_owned();
    let pinned = server.get("/v1/datasets").json()[0]["pinned_name"].as_str().unwrap().to_owned();
    put(&second);
    eventually("it was replaced", || is(&second));
    // What a client kept of the first is not taken for the second's.
    assert_eq!(server.get_with(brick, &[("if-none-match", &tag)]).status, 200);
    server.get(&format!("/v1/{pinned}/info")).assert_problem(404);
    std::fs::remove_file(folder.path().join("v.octavo")).unwrap();
    eventually("it was removed", || server.get(brick).status == 404);
}

#[test]
fn links_and_other_files_of_a_folder_are_not_served() {
    let (folder, outside) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let secret = outside.path().join("secret.octavo");
    Volume::<u8>::new([20, 9, 9], 8, noise).write(&secret, Encoding::Lossless);
    std::os::unix::fs::symlink(&secret, folder.path().join("link.octavo")).unwrap();
    std::fs::write(folder.path().join("notes.txt"), b"private").unwrap();
    let server = Running::over(folder.path());
    assert_eq!(server.get("/v1/datasets").json(), serde_json::json!([]));
    for name in ["link", "notes", "notes.txt", "..", "%2e%2e", "..%2Fsecret", "secret"] {
        assert_eq!(server.get(&format!("/v1/{name}/info")).status, 404, "{name}");
    }
    // One who names the link itself means what it points to.
    let named = Running::new(options(&folder.path().join("link.octavo")));
    assert_eq!(named.get("/v1/link/info").status, 200);
}
