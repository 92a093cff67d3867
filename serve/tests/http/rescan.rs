//! Stores come, go and are replaced while the server runs; of many, few are open.

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
    eventually("its file is closed", || open_files(folder.path()) == 0);
}

#[test]
fn a_store_that_was_written_over_is_not_taken_for_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let aside = tempfile::tempdir().unwrap();
    let [path, other] = [folder.path(), aside.path()].map(|folder| folder.join("v.octavo"));
    let first = Volume::<u16>::new([20, 9, 9], 8, noise);
    let second = Volume::<u16>::new([20, 9, 9], 8, |[x, y, z]| noise([x + 100, y, z]));
    first.write(&path, Encoding::Quantised8);
    second.write(&other, Encoding::Quantised8);
    let bytes = std::fs::read(other).unwrap();
    let server = Running::over(folder.path());
    let digest = |server: &Running| server.get("/v1/v/info").json()["digest"].clone();
    let before = digest(&server);
    // The same file, and as long as it was.
    assert_eq!(std::fs::metadata(&path).unwrap().len(), bytes.len() as u64);
    std::fs::write(&path, bytes).unwrap();
    eventually("it was replaced", || {
        let reply = server.get("/v1/v/info");
        reply.status == 200 && reply.json()["digest"] != before
    });
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

/// Files of a folder that this process, and so the server in it, has open.
fn open_files(folder: &std::path::Path) -> usize {
    let descriptors = std::fs::read_dir("/proc/self/fd").unwrap();
    let targets = descriptors.filter_map(|entry| std::fs::read_link(entry.unwrap().path()).ok());
    targets.filter(|target| target.starts_with(folder)).count()
}

#[test]
fn of_many_stores_few_are_open_and_all_are_served() {
    let folder = tempfile::tempdir().unwrap();
    let volumes: Vec<Volume<u16>> = (0..20)
        .map(|i| Volume::new([20, 9, 9], 8, move |[x, y, z]| noise([x + 100 * i, y, z])))
        .collect();
    for (i, volume) in volumes.iter().enumerate() {
        volume.write(&folder.path().join(format!("v{i}.octavo")), Encoding::Lossless);
    }
    let mut options = options(folder.path());
    (options.limits.open_stores, options.limits.decodes) = (3, 2);
    options.cache_bytes = 0;
    let server = Running::new(options);
    assert_eq!(server.get("/v1/datasets").json().as_array().unwrap().len(), 20);
    for round in 0..3 {
        for (i, volume) in volumes.iter().enumerate() {
            let key = NodeKey::new(0, [round, 0, 0]);
            let reply = server.get(&format!("/v1/v{i}/bricks/0/{round}/0/0"));
            assert_eq!(reply.body, to_le_bytes(&volume.brick(key)), "v{i}");
            let nodes = server.get(&format!("/v1/v{i}/nodes?level=0"));
            assert_eq!(nodes.status, 200);
            // What a reply was made of is let go of a moment after the reply has gone.
            eventually("three files are open", || open_files(folder.path()) <= 3);
        }
    }
}

#[test]
fn a_store_that_was_replaced_while_it_was_closed_is_not_taken_for_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, volume: &Volume<u16>| {
        let made = folder.path().join("made");
        volume.write(&made, Encoding::Lossless);
        std::fs::rename(&made, folder.path().join(name)).unwrap();
    };
    let volume = Volume::<u16>::new([20, 9, 9], 8, noise);
    put("a.octavo", &volume);
    put("b.octavo", &volume);
    put("c.octavo", &volume);
    let mut options = options(folder.path());
    options.limits.open_stores = 1;
    options.rescan = Duration::from_hours(1);
    let server = Running::new(options);
    // One that is asked for closes the others.
    for _ in 0..3 {
        assert_eq!(server.get("/v1/c/bricks/0/0/0/0").status, 200);
    }
    put("a.octavo", &Volume::new([20, 9, 9], 8, |place| 65_535.0 - noise(place)));
    std::fs::remove_file(folder.path().join("b.octavo")).unwrap();
    for path in ["bricks/0/1/0/0", "nodes?level=0", "slices/z/3", "statistics"] {
        let replaced = server.get(&format!("/v1/a/{path}"));
        replaced.assert_problem(503);
        assert_eq!(replaced.header("retry-after"), "1");
        server.get(&format!("/v1/b/{path}")).assert_problem(404);
    }
    assert_eq!(server.get("/v1/c/bricks/0/1/0/0").status, 200);
}
