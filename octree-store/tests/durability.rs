//! A commit makes payloads and the files that go with them durable before it says that they are.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use octree_store::{Encoding, NodeKey, StoreWriter, encode_samples};
use std::fs::File;
use std::os::fd::OwnedFd;

fn committed(synced: Vec<File>) -> (bool, bool) {
    let folder = tempfile::tempdir().unwrap();
    let [store, work] = ["a.octavo", "a.index"].map(|name| folder.path().join(name));
    let mut writer = StoreWriter::create(&store, &work, synced).unwrap();
    let key = NodeKey::new(0, [0, 0, 0]);
    let (record, payload) = encode_samples(key, &[7_u8, 9, 8, 1].repeat(16), Encoding::Lossless);
    writer.append(&mut [record], &payload, Vec::new()).unwrap();
    writer.commit(b"one", 1).unwrap();
    let waited = writer.wait().is_ok();
    let marked = writer.durable_mark().is_ok_and(|mark| mark == 1);
    assert_eq!(waited, marked);
    drop(writer);
    (waited, StoreWriter::resume(&store, &work, Vec::new()).unwrap().is_some())
}

#[test]
fn what_cannot_be_made_durable_is_not_committed() {
    let file = || tempfile::tempfile().unwrap();
    assert_eq!(committed(vec![]), (true, true));
    assert_eq!(committed(vec![file()]), (true, true));
    // The system refuses to sync a pipe, as a failing disk does a file.
    let (_reader, pipe) = std::io::pipe().unwrap();
    let pipe = File::from(OwnedFd::from(pipe));
    assert_eq!(committed(vec![file(), pipe]), (false, false), "nothing of it counts");
}
