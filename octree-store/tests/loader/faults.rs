//! Damage, bugs and the end of a loader.

use crate::support::{Made, Show, Watched, foam, make, opaque_above, perspective, scene};
use octree_store::loader::{Event, Frame, LoaderOptions, NodeData, Scene, View};
use octree_store::{NodeKey, Store};
use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

const DIMS: [u64; 3] = [64, 64, 64];

fn volume() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| make(DIMS, foam(DIMS)))
}

fn options() -> LoaderOptions {
    LoaderOptions { visibility: false, ..LoaderOptions::default() }
}

fn views() -> [View; 1] {
    [perspective([32.0, 30.0, -40.0], [32.0, 32.0, 32.0], 60.0, [70, 70])]
}

/// What each leaf shows: the level of its data, and whether it is a slot.
fn shown(frame: &Frame) -> BTreeMap<NodeKey, (u8, bool)> {
    frame
        .index
        .leaves()
        .map(|(key, node)| (key, (node.data_level, matches!(node.data, NodeData::Slot(_)))))
        .collect()
}

/// Frames until nothing is left to do, and the nodes reported as damaged.
fn converge(show: &mut Show, scene: &Scene) -> (Frame, Vec<NodeKey>) {
    let mut damaged = Vec::new();
    for _ in 0..1000 {
        let mut frame = show.frame(scene);
        for event in std::mem::take(&mut frame.events) {
            match event {
                Event::Damaged { key, error } => {
                    assert!(error.to_string().contains(&key.to_string()), "{error}");
                    damaged.push(key);
                }
                Event::ThreadsLost { .. } => panic!("no thread was to be lost"),
            }
        }
        if frame.converged {
            return (frame, damaged);
        }
        show.loader.wait(Duration::from_millis(20));
    }
    panic!("not converged")
}

#[test]
fn a_damaged_brick_harms_only_itself() {
    let appearance = opaque_above(100.0, 1.0);
    let views = views();
    let scene = scene(&views, &appearance);
    let whole = shown(&converge(&mut Show::new(Watched::new(volume()), options()), &scene).0);
    let leaf = *whole.iter().find(|(key, data)| key.level() == 0 && data.1).unwrap().0;
    let inner = leaf.parent();
    for broken in [leaf, inner] {
        let source = Watched::new(volume());
        source.broken.lock().unwrap().insert(broken);
        let mut show = Show::new(source.clone(), options());
        let (frame, damaged) = converge(&mut show, &scene);
        assert_eq!(damaged, [broken], "reported once");
        let mut found = shown(&frame);
        if broken == leaf {
            assert_eq!(found.insert(leaf, whole[&leaf]), Some((1, true)), "its parent is shown");
        }
        assert_eq!(found, whole, "all others as if nothing were damaged");
        let tries = source.read().iter().filter(|key| **key == broken).count();
        assert_eq!(tries, 1, "it is not asked for again");

        // Until it is said to be whole again.
        source.broken.lock().unwrap().clear();
        show.loader.retry_damaged();
        let (frame, damaged) = converge(&mut show, &scene);
        assert_eq!((shown(&frame), damaged.len()), (whole.clone(), 0));
    }
}

/// With feedback too: nothing is shown in the root's place, but what lies beneath it is whole.
#[test]
fn a_damaged_root_does_not_keep_what_lies_beneath_from_being_drawn() {
    let appearance = opaque_above(100.0, 1.0);
    let views = views();
    let scene = scene(&views, &appearance);
    let options = LoaderOptions { visibility: true, ..options() };
    let whole = shown(&converge(&mut Show::new(Watched::new(volume()), options), &scene).0);
    let source = Watched::new(volume());
    let root = volume().store.geometry().root();
    source.broken.lock().unwrap().insert(root);
    let (frame, damaged) = converge(&mut Show::new(source, options), &scene);
    assert_eq!(damaged, [root]);
    let missing = frame.index.leaves().filter(|(_, node)| node.data == NodeData::Missing);
    let missing: Vec<NodeKey> = missing.map(|(key, _)| key).collect();
    assert!(missing.iter().all(|key| whole[key].0 == root.level()), "{missing:?}");
    assert_eq!(shown(&frame).len(), whole.len());
    assert!(whole.len() > 100);
}

/// The same with bytes of the file: each is changed in one brick, and the loader reads the store itself.
#[test]
fn a_flipped_bit_in_the_file_is_reported_and_its_parent_is_shown() {
    let appearance = opaque_above(100.0, 1.0);
    let views = views();
    let scene = scene(&views, &appearance);
    let whole = shown(&converge(&mut Show::new(Watched::new(volume()), options()), &scene).0);
    let leaf = *whole.iter().find(|(key, data)| key.level() == 0 && data.1).unwrap().0;
    let place = volume().records[&leaf].place;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flipped.octavo");
    let mut bytes = std::fs::read(&volume().path).unwrap();
    // Payloads begin behind the first page (FORMAT.md).
    bytes[4096 + place.offset as usize + place.length as usize / 2] ^= 4;
    std::fs::write(&path, bytes).unwrap();
    let (frame, damaged) = converge(&mut Show::new(Store::open(&path).unwrap(), options()), &scene);
    assert_eq!(damaged, [leaf]);
    let mut found = shown(&frame);
    assert_eq!(found.insert(leaf, whole[&leaf]), Some((1, true)), "its parent is shown");
    assert_eq!(found, whole);
}

#[test]
fn a_damaged_record_harms_only_what_lies_beneath_it() {
    let appearance = opaque_above(100.0, 1.0);
    let views = views();
    let scene = scene(&views, &appearance);
    let whole = shown(&converge(&mut Show::new(Watched::new(volume()), options()), &scene).0);
    let top = volume().store.geometry().top_level();
    let broken = NodeKey::new(top - 1, [0, 1, 0]);
    let source = Watched::new(volume());
    source.unreadable.lock().unwrap().insert(broken);
    let (frame, damaged) = converge(&mut Show::new(source, options()), &scene);
    assert_eq!(damaged, [broken]);
    let mut found = shown(&frame);
    assert_eq!(found.remove(&broken), Some((top, true)), "its parent is shown");
    let beyond = |key: NodeKey| {
        let up = top - 1 - key.level();
        key.brick_xyz().map(|c| c >> up) != broken.brick_xyz()
    };
    let expected: BTreeMap<_, _> = whole.into_iter().filter(|(key, _)| beyond(*key)).collect();
    assert_eq!(found, expected);
}

#[test]
fn a_root_that_cannot_be_read_is_reported_and_nothing_hangs() {
    let appearance = opaque_above(100.0, 1.0);
    let (views, root) = (views(), volume().store.geometry().root());
    let source = Watched::new(volume());
    source.unreadable.lock().unwrap().insert(root);
    let (frame, damaged) = converge(&mut Show::new(source, options()), &scene(&views, &appearance));
    assert_eq!(damaged, [root]);
    assert!(frame.index.leaves().all(|(_, node)| node.data == NodeData::Missing));

    let source = Watched::new(volume());
    source.broken.lock().unwrap().insert(root);
    let (frame, damaged) = converge(&mut Show::new(source, options()), &scene(&views, &appearance));
    assert_eq!(damaged, [root]);
    assert!(shown(&frame).values().any(|data| *data == (0, true)), "what lies beneath is whole");
}

/// Frames until nothing is left to do, and the threads that were lost on the way.
fn converge_with_losses(show: &mut Show, scene: &Scene) -> (Frame, usize) {
    let mut lost = 0;
    for _ in 0..1000 {
        let frame = show.frame(scene);
        for event in &frame.events {
            match event {
                Event::ThreadsLost { count } => lost += count,
                Event::Damaged { .. } => panic!("nothing is damaged"),
            }
        }
        if frame.converged {
            return (frame, lost);
        }
        show.loader.wait(Duration::from_millis(20));
    }
    panic!("not converged: {:?}", show.loader.statistics())
}

#[test]
fn a_panic_in_a_thread_is_reported_and_harms_only_the_siblings_that_it_read() {
    let appearance = opaque_above(100.0, 1.0);
    let views = views();
    let scene = scene(&views, &appearance);
    let whole = shown(&converge(&mut Show::new(Watched::new(volume()), options()), &scene).0);
    let bug = *whole.iter().find(|(key, data)| key.level() == 0 && data.1).unwrap().0;
    let mut source = Watched::new(volume());
    source.bug = Some(bug);
    let (frame, lost) = converge_with_losses(&mut Show::new(source, options()), &scene);
    assert_eq!(lost, 1);
    let mut found = shown(&frame);
    assert_eq!(found[&bug], (1, true), "its parent is shown");
    found.retain(|key, _| key.parent() != bug.parent());
    let others = whole.into_iter().filter(|(key, _)| key.parent() != bug.parent()).collect();
    assert_eq!(found, others);
}

#[test]
fn when_all_threads_are_lost_the_view_comes_to_rest_with_what_is_there() {
    let appearance = opaque_above(100.0, 1.0);
    let (views, root) = (views(), volume().store.geometry().root());
    for bug in [root, root.children()[3]] {
        let mut source = Watched::new(volume());
        source.bug = Some(bug);
        let options = LoaderOptions { threads: 1, ..options() };
        let mut show = Show::new(source, options);
        let (frame, lost) = converge_with_losses(&mut show, &scene(&views, &appearance));
        assert_eq!(lost, 1);
        assert_eq!(
            frame.index.leaves().any(|(_, node)| node.data == NodeData::Missing),
            bug == root
        );
        assert_eq!(show.loader.unread(), 0);
    }
}

#[test]
fn records_that_were_damaged_are_tried_again_when_the_disk_is_said_to_be_back() {
    let appearance = opaque_above(100.0, 1.0);
    let views = views();
    let scene = scene(&views, &appearance);
    let whole = shown(&converge(&mut Show::new(Watched::new(volume()), options()), &scene).0);
    let root = volume().store.geometry().root();
    for broken in [root, root.children()[2], root.children()[5].children()[1]] {
        let source = Watched::new(volume());
        source.unreadable.lock().unwrap().insert(broken);
        let mut show = Show::new(source.clone(), options());
        assert_eq!(converge(&mut show, &scene).1, [broken]);
        // Still broken: it is reported again, and nothing else changes.
        show.loader.retry_damaged();
        assert_eq!(converge(&mut show, &scene).1, [broken]);
        source.unreadable.lock().unwrap().clear();
        show.loader.retry_damaged();
        let (frame, damaged) = converge(&mut show, &scene);
        assert_eq!((shown(&frame), damaged.len()), (whole.clone(), 0), "{broken}");
    }
}

#[test]
fn dropping_the_loader_stops_its_threads_at_once() {
    let appearance = opaque_above(100.0, 1.0);
    let views = views();
    let mut source = Watched::new(volume());
    source.delay = Duration::from_millis(20);
    let mut show = Show::new(source.clone(), LoaderOptions { threads: 3, ..options() });
    while show.loader.statistics().queued < 4 {
        show.frame(&scene(&views, &appearance));
        show.loader.wait(Duration::from_millis(50));
    }
    let waiting = show.loader.statistics().queued;
    let started = Instant::now();
    drop(show);
    // A group takes eight bricks and as many records; what is at hand is one of them.
    assert!(started.elapsed() < Duration::from_millis(150), "{waiting} groups were waiting");
    let read = source.read().len();
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(source.read().len(), read, "no thread is left");
    assert_eq!(std::sync::Arc::strong_count(&source.log), 1, "and none holds the source");
}
