//! A commit makes payloads and the files that go with them durable before it says that they are.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use octree_store::{
    DiskFile, Encoding, Geometry, Metadata, NodeKey, SampleType, StoreWriter, encode_samples,
};
use std::fs::File;
use std::os::fd::OwnedFd;

fn committed(synced: Vec<DiskFile>) -> (bool, bool) {
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
    let file = || DiskFile::from(tempfile::tempfile().unwrap());
    assert_eq!(committed(vec![]), (true, true));
    assert_eq!(committed(vec![file()]), (true, true));
    // The system refuses to sync a pipe, as a failing disk does a file.
    let (_reader, pipe) = std::io::pipe().unwrap();
    let pipe = DiskFile::from(File::from(OwnedFd::from(pipe)));
    assert_eq!(committed(vec![file(), pipe]), (false, false), "nothing of it counts");
}

/// A kill after the store was finished and before it got its name: the work index must still be what its
/// last commit said.
#[test]
fn finishing_adds_nothing_to_what_was_committed() {
    let folder = tempfile::tempdir().unwrap();
    let [store, work] = ["a.octavo", "a.index"].map(|name| folder.path().join(name));
    let geometry = Geometry::new([32, 8, 8], 8, 0).unwrap();
    let samples = |seed: u16| (0..512_u16).map(|i| i.wrapping_mul(seed)).collect::<Vec<_>>();
    let octet = |parent: NodeKey, writer: &mut StoreWriter| {
        let (mut records, mut payloads) = (Vec::new(), Vec::new());
        for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
            let seed = 3 + key.brick_xyz()[0] as u16 + u16::from(key.level());
            let (mut record, payload) = encode_samples(key, &samples(seed), Encoding::Lossless);
            record.child_mask = geometry.child_mask(key);
            records.push(record);
            payloads.extend(payload);
        }
        writer.append(&mut records, &payloads, vec![parent.level()]).unwrap();
    };
    let parents =
        [NodeKey::new(1, [0, 0, 0]), NodeKey::new(1, [1, 0, 0]), NodeKey::new(2, [0, 0, 0])];
    let all = |writer: &mut StoreWriter| parents.iter().for_each(|parent| octet(*parent, writer));
    let metadata = || Metadata::new(&geometry, SampleType::U16, Encoding::Lossless);

    let [plain, plain_work] = ["b.octavo", "b.index"].map(|name| folder.path().join(name));
    let mut writer = StoreWriter::create(&plain, &plain_work, vec![]).unwrap();
    all(&mut writer);
    octet(geometry.root().parent(), &mut writer);
    let expected = writer.finish(metadata()).unwrap();

    let mut writer = StoreWriter::create(&store, &work, vec![]).unwrap();
    octet(parents[0], &mut writer);
    writer.commit(b"after the first", 1).unwrap();
    writer.wait().unwrap();
    for parent in [parents[1], parents[2], geometry.root().parent()] {
        octet(parent, &mut writer);
    }
    assert_eq!(writer.finish(metadata()).unwrap().digest, expected.digest);

    let (mut writer, committed) = StoreWriter::resume(&store, &work, vec![]).unwrap().unwrap();
    assert_eq!(committed.state, b"after the first");
    assert_eq!(committed.progress, [(parents[0], vec![1])]);
    for parent in [parents[1], parents[2], geometry.root().parent()] {
        octet(parent, &mut writer);
    }
    assert_eq!(writer.finish(metadata()).unwrap().digest, expected.digest);
}

#[test]
fn a_damaged_work_index_is_not_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let [store, work] = ["a.octavo", "a.index"].map(|name| folder.path().join(name));
    let mut writer = StoreWriter::create(&store, &work, vec![]).unwrap();
    let key = NodeKey::new(0, [0, 0, 0]);
    let (record, payload) = encode_samples(key, &[7_u8, 9, 8, 1].repeat(16), Encoding::Lossless);
    writer.append(&mut [record], &payload, b"what is known of the parent".to_vec()).unwrap();
    writer.commit(b"a state that is told apart", 1).unwrap();
    writer.wait().unwrap();
    drop(writer);
    let whole = std::fs::read(&work).unwrap();
    for needle in [&b"what is known"[..], b"a state that"] {
        let at = whole.windows(needle.len()).position(|bytes| bytes == needle).unwrap();
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        std::fs::write(&work, bytes).unwrap();
        assert!(StoreWriter::resume(&store, &work, vec![]).is_err());
    }
    std::fs::write(&work, whole).unwrap();
    assert!(StoreWriter::resume(&store, &work, vec![]).unwrap().is_some());
}
