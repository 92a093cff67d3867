//! Stores of which all checksums are right and something else is wrong: opening or `verify` says what.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod noise;

use noise::{PAGE, change_record, frame, index_offset, make, metadata_of};
use octree_store::verify::{DamagedNode, verify};
use octree_store::{BrickState, Damage, NodeKey, NodeRecord, Store, StoreError};

#[test]
fn a_file_that_was_added_to_says_how_long_it_should_be() {
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    let whole = std::fs::read(&path).unwrap();
    for added in [1, PAGE] {
        std::fs::write(&path, [whole.clone(), vec![b' '; added]].concat()).unwrap();
        match Store::open(&path) {
            Err(StoreError::Length { expected, found, .. }) => {
                assert_eq!((expected, found), (whole.len() as u64, (whole.len() + added) as u64));
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn metadata_of_other_bricks_than_the_index_holds_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = make(folder.path());
    let other = frame(&metadata_of(&path).replace("[24,24,24]", "[24,24,16]"));
    let mut bytes = std::fs::read(&path).unwrap();
    let index = index_offset(&bytes);
    let first = bytes[..index].windows(4).rposition(|window| window == b"OCTV").unwrap();
    let copy = bytes.len() - other.len();
    for at in [first, copy] {
        bytes[at..at + other.len()].copy_from_slice(&other);
    }
    std::fs::write(&path, bytes).unwrap();
    let refused = Store::open(&path);
    let Err(StoreError::MetadataDamaged { what, .. }) = refused else { panic!("{refused:?}") };
    assert_eq!(what, "it speaks of other bricks than the index holds");
}

type Change = fn(&mut NodeRecord);

#[test]
fn a_record_that_contradicts_the_tree_is_named_with_what_is_wrong() {
    let leaf = NodeKey::new(0, [1, 0, 2]);
    let parent = NodeKey::new(1, [0, 0, 1]);
    let upside_down = "a range is upside down";
    let not_its_own = "its subtree's range does not hold its own";
    let not_a_childs = "its subtree's range does not hold a child's";
    let not_finite = "a range is not finite, or an error no number from 0 up";
    let no_payload = "its state and its payload's length disagree";
    // Which record is changed and how, which one is called damaged, and why.
    let cases: &[(NodeKey, Change, NodeKey, &'static str)] = &[
        (leaf, |r| r.child_mask = 1, leaf, "its child mask is not the geometry's"),
        (parent, |r| r.child_mask ^= 1, parent, "its child mask is not the geometry's"),
        (leaf, |r| r.brick_min = r.brick_max + 1.0, leaf, upside_down),
        (
            leaf,
            |r| (r.subtree_min, r.subtree_max) = (r.brick_max + 1.0, r.brick_min - 1.0),
            leaf,
            upside_down,
        ),
        (leaf, |r| r.subtree_min = r.brick_min + 1.0, leaf, not_its_own),
        (leaf, |r| r.subtree_max = r.brick_max - 1.0, leaf, not_its_own),
        (leaf, |r| r.subtree_max = 65536.0, parent, not_a_childs),
        (leaf, |r| r.subtree_min = -1.0, parent, not_a_childs),
        (leaf, |r| r.brick_min = f64::NAN, leaf, not_finite),
        (leaf, |r| r.subtree_max = f64::NAN, leaf, not_finite),
        (leaf, |r| r.error.squares = f64::NAN, leaf, not_finite),
        (leaf, |r| r.error.amax = f64::INFINITY, leaf, not_finite),
        (parent, |r| r.lod_amax_bound = f64::INFINITY, parent, not_finite),
        (parent, |r| r.lod_rms_bound = -1.0, parent, not_finite),
        (leaf, |r| r.state = BrickState::Uniform, leaf, no_payload),
        (leaf, |r| r.state = BrickState::Empty, leaf, no_payload),
        (leaf, |r| r.state = BrickState::Lost, leaf, no_payload),
        (leaf, |r| r.place.length = 0, leaf, no_payload),
        (leaf, |r| r.place.length = u32::MAX, leaf, "its payload's length"),
    ];
    for (number, (changed, change, named, what)) in cases.iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        let path = make(folder.path());
        change_record(&path, *changed, change);
        let report = verify(&Store::open(&path).unwrap(), || true).unwrap().unwrap();
        let expected = DamagedNode { key: *named, damage: Damage::Tree { what } };
        assert_eq!(report.damaged, [expected], "{number}");
    }
    for (stream, offset) in [(1, 0), (0, u64::MAX), (0, 1 << 40)] {
        let folder = tempfile::tempdir().unwrap();
        let path = make(folder.path());
        change_record(&path, leaf, |record| {
            (record.place.stream, record.place.offset) = (stream, offset);
        });
        let report = verify(&Store::open(&path).unwrap(), || true).unwrap().unwrap();
        let damage = Damage::PayloadMissing { stream, offset };
        assert_eq!(report.damaged, [DamagedNode { key: leaf, damage }]);
    }
}

#[test]
fn metadata_that_do_not_follow_from_the_records_are_found() {
    let root = NodeKey::new(2, [0; 3]);
    let sums = "its sums over levels do not follow from the records";
    let digest = "its digest does not follow from the records";
    let cases: &[(Change, &str)] = &[
        (|r| r.error.squares += 1.0, sums),
        (|r| r.error.amax += 1.0, sums),
        (|r| r.error.voxels -= 1, digest),
        (|r| r.lod_rms_bound += 1.0, sums),
        (|r| r.lod_amax_bound += 1.0, sums),
        (|r| r.subtree_max += 1.0, digest),
        (|r| r.subtree_min -= 1.0, digest),
    ];
    for (number, (change, what)) in cases.iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        let path = make(folder.path());
        change_record(&path, root, change);
        let report = verify(&Store::open(&path).unwrap(), || true).unwrap().unwrap();
        assert_eq!((report.damaged, report.metadata.as_deref()), (vec![], Some(*what)), "{number}");
    }
}
