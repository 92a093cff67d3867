//! Laws of the asynchronous loader without visibility: everything in view counts as seen.

use crate::support::{Made, Show, Watched, foam, make, make_as, opaque_above, perspective, scene};
use octree_store::loader::{
    Appearance, BrickFormat, Frame, LeafKind, LoaderError, LoaderOptions, NodeData, Scene,
    StoreNodes, View, ViewSet, select_cut,
};
use octree_store::{BrickScratch, BrickState, Encoding, NodeKey};
use std::collections::{BTreeSet, HashSet};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

const DIMS: [u64; 3] = [90, 64, 75];

fn volume() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| make(DIMS, foam(DIMS)))
}

fn options() -> LoaderOptions {
    LoaderOptions { visibility: false, ..LoaderOptions::default() }
}

fn near() -> View {
    perspective([45.0, 30.0, -40.0], [45.0, 32.0, 37.0], 60.0, [60, 60])
}

fn leaves(frame: &Frame) -> BTreeSet<NodeKey> {
    frame.index.leaves().map(|leaf| leaf.0).collect()
}

fn set(scene: &Scene) -> ViewSet {
    let metadata = volume().store.metadata();
    ViewSet::new(scene.views, scene.clip, volume().store.geometry(), metadata.spacing_xyz)
}

fn in_view(views: &ViewSet, key: NodeKey) -> bool {
    views.voxel_size(key.level(), key.brick_xyz().map(|c| c as u32)).is_some()
}

/// The leaves with the brick that each shows.
fn check_resident(frame: &Frame, scene: &Scene) {
    let views = set(scene);
    for (key, node) in frame.index.leaves() {
        let record = &volume().records[&key];
        let empty = scene.appearance.is_empty(record.subtree_min, record.subtree_max);
        match node.data {
            NodeData::Slot(_) if in_view(&views, key) => assert_eq!(node.data_level, node.level),
            NodeData::Slot(_) => {}
            NodeData::Empty => assert!(empty),
            NodeData::Uniform => assert_eq!(record.state, BrickState::Uniform),
            NodeData::Missing | NodeData::Absent => panic!("{key} has nothing to show"),
        }
    }
}

#[test]
fn the_converged_cut_is_the_one_chosen_at_once_and_every_leaf_in_view_is_resident() {
    let appearance = opaque_above(100.0, 1.0);
    let inside = perspective([45.0, 32.0, 30.0], [80.0, 40.0, 70.0], 50.0, [90, 60]);
    for views in [vec![near()], vec![inside.clone()], vec![near(), inside]] {
        let scene = scene(&views, &appearance);
        let source = Watched::new(volume());
        let (frame, count) = Show::new(source.clone(), options()).converge(&scene);
        let cut = select_cut(&mut StoreNodes::new(&volume().store), &scene, usize::MAX);
        let chosen: BTreeSet<NodeKey> = cut.leaves.iter().map(|leaf| leaf.key).collect();
        assert!(leaves(&frame) == chosen, "{} and {}", frame.index.leaves().count(), chosen.len());
        check_resident(&frame, &scene);
        // Bricks of the leaves and of those above them, each once, and nothing else.
        let read = source.read();
        let once: HashSet<NodeKey> = read.iter().copied().collect();
        assert_eq!(once.len(), read.len(), "nothing is read twice");
        assert!(cut.bricks() > 100);
        for leaf in cut.leaves.iter().filter(|leaf| leaf.kind == LeafKind::Brick) {
            assert!(once.contains(&leaf.key));
        }
        assert!(count < 60, "{count} frames");
    }
}

#[test]
fn nothing_empty_or_out_of_view_is_asked_for() {
    let appearance = opaque_above(140.0, 1.0);
    let views = [perspective([45.0, 30.0, 10.0], [90.0, 32.0, 37.0], 30.0, [160, 90])];
    let scene = scene(&views, &appearance);
    let source = Watched::new(volume());
    Show::new(source.clone(), options()).converge(&scene);
    let (views, root) = (set(&scene), volume().store.geometry().root());
    for key in source.read() {
        let record = &volume().records[&key];
        assert!(!appearance.is_empty(record.subtree_min, record.subtree_max), "{key} is empty");
        assert!(key == root || in_view(&views, key), "{key} is out of view");
        assert_eq!(record.state, BrickState::Stored);
    }
}

#[test]
fn a_still_camera_asks_for_nothing_more() {
    let appearance = opaque_above(100.0, 1.0);
    let views = [near()];
    let scene = scene(&views, &appearance);
    for slots in [30, 4096] {
        let source = Watched::new(volume());
        let mut show = Show::new(source.clone(), LoaderOptions { slots, ..options() });
        let (frame, _) = show.converge(&scene);
        let (before, serial) = (source.read().len(), frame.index.serial());
        for _ in 0..30 {
            let frame = show.frame(&scene);
            assert!(frame.converged && frame.uploads.is_empty() && frame.freed.is_empty());
            assert_eq!(frame.index.serial(), serial);
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(source.read().len(), before);
        assert_eq!(show.loader.statistics().limited, slots == 30);
    }
}

#[test]
fn more_slots_never_give_a_coarser_cut_and_are_never_exceeded() {
    let appearance = opaque_above(100.0, 1.0);
    let views = [near()];
    let scene = scene(&views, &appearance);
    let mut before: Option<BTreeSet<NodeKey>> = None;
    for slots in [9, 12, 20, 33, 60, 100, 250, 700] {
        let mut show = Show::new(Watched::new(volume()), LoaderOptions { slots, ..options() });
        let (frame, _) = show.converge(&scene);
        assert!(show.loader.statistics().slots_in_use <= slots);
        assert!(show.renderer.pool.keys().all(|slot| (*slot as usize) < slots));
        let fine = leaves(&frame);
        if let Some(coarse) = &before {
            let root = show.geometry.root();
            for leaf in &fine {
                let mut key = *leaf;
                while !coarse.contains(&key) && key != root {
                    key = key.parent();
                }
                assert!(coarse.contains(&key), "{leaf} is finer with fewer slots");
            }
        }
        before = Some(fine);
    }
    assert!(before.unwrap().len() > 300);
}

#[test]
fn a_short_budget_gives_the_same_cut_whatever_was_seen_before() {
    let appearance = opaque_above(100.0, 1.0);
    let (a, b) = ([near()], [perspective([150.0, 80.0, 30.0], [45.0, 32.0, 37.0], 30.0, [90, 90])]);
    let memory_bytes = 80 * volume().store.geometry().brick_samples();
    // Once the slots are short, once the memory.
    for options in [
        LoaderOptions { slots: 80, prefetch_frames: 0, ..options() },
        LoaderOptions { memory_bytes, uploads_per_frame: 10, ..options() },
    ] {
        let mut show = Show::new(Watched::new(volume()), options);
        let cold = leaves(&show.converge(&scene(&a, &appearance)).0);
        assert!(show.loader.statistics().limited);
        let mut show = Show::new(Watched::new(volume()), options);
        show.converge(&scene(&b, &appearance));
        assert_eq!(leaves(&show.converge(&scene(&a, &appearance)).0), cold);
    }
}

#[test]
fn a_cut_that_lacks_room_keeps_nothing_less_urgent_that_an_earlier_view_left() {
    let appearance = opaque_above(100.0, 1.0);
    let at = |angle: f64, distance: f64| {
        let position = [45.0 + distance * angle.sin(), 30.0, 37.0 - distance * angle.cos()];
        [perspective(position, [45.0, 32.0, 37.0], 50.0, [60, 60])]
    };
    // A few degrees on, the same bricks are in view, but others are the nearest.
    for slots in (12..160).step_by(8) {
        let options = LoaderOptions { slots, prefetch_frames: 0, ..options() };
        let mut moved = Show::new(Watched::new(volume()), options);
        for step in 0..4 {
            let views = at(0.15 * f64::from(step), 80.0 - 4.0 * f64::from(step));
            let scene = scene(&views, &appearance);
            let found = leaves(&moved.converge(&scene).0);
            let cold = Show::new(Watched::new(volume()), options).converge(&scene).0;
            assert!(found == leaves(&cold), "{slots} slots, step {step}");
        }
    }
}

#[test]
fn uploads_and_memory_keep_to_their_budgets_in_every_frame() {
    let appearance = opaque_above(100.0, 1.0);
    let brick_bytes = volume().store.geometry().brick_samples();
    let memory_bytes = 120 * brick_bytes;
    let options = LoaderOptions { uploads_per_frame: 8, memory_bytes, ..options() };
    let mut show = Show::new(Watched::new(volume()), options);
    for step in 0..200 {
        let at = f64::from(step) / 30.0;
        let views = [perspective(
            [45.0 + 90.0 * at.cos(), 30.0, 37.0 + 90.0 * at.sin()],
            [45.0, 32.0, 37.0],
            50.0,
            [60, 60],
        )];
        let frame = show.frame(&scene(&views, &appearance));
        assert!(frame.uploads.len() <= 8);
        let statistics = show.loader.statistics();
        assert!(statistics.memory.bytes <= memory_bytes);
        assert!(statistics.slots_in_use <= 90);
        show.loader.wait(Duration::from_millis(2));
    }
    assert!(show.loader.statistics().memory.evictions > 0);
}

#[test]
fn what_was_seen_before_comes_back_without_reading_or_uploading() {
    let appearance = opaque_above(100.0, 1.0);
    let source = Watched::new(volume());
    let mut show = Show::new(source.clone(), LoaderOptions { prefetch_frames: 0, ..options() });
    let away = [perspective([45.0, 30.0, -40.0], [45.0, 32.0, -90.0], 60.0, [60, 60])];
    let here = [near()];
    let (first, _) = show.converge(&scene(&here, &appearance));
    let (gone, _) = show.converge(&scene(&away, &appearance));
    assert_eq!(gone.index.leaves().count(), 1, "nothing in view, nothing refined");
    let (read, uploaded) = (source.read().len(), show.loader.statistics().bricks_uploaded);
    let (again, _) = show.converge(&scene(&here, &appearance));
    assert_eq!(leaves(&again), leaves(&first));
    assert_eq!(source.read().len(), read);
    assert_eq!(show.loader.statistics().bricks_uploaded, uploaded);
}

#[test]
fn a_frame_never_waits_for_the_disk() {
    let appearance = opaque_above(100.0, 1.0);
    let mut source = Watched::new(volume());
    source.delay = Duration::from_millis(100);
    let mut show = Show::new(source, options());
    let views = [near()];
    let scene = scene(&views, &appearance);
    let started = Instant::now();
    let mut frames = 0;
    while started.elapsed() < Duration::from_millis(400) {
        let before = Instant::now();
        show.loader.frame(&scene);
        // A frame that waited for anything would take what it waited for.
        assert!(before.elapsed() < Duration::from_millis(50));
        frames += 1;
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(frames > 20);
}

#[test]
fn what_the_view_has_left_is_not_read_any_more() {
    let appearance = opaque_above(100.0, 1.0);
    let mut source = Watched::new(volume());
    source.delay = Duration::from_millis(5);
    let options = LoaderOptions { threads: 1, prefetch_frames: 0, linger_frames: 0, ..options() };
    let mut show = Show::new(source.clone(), options);
    let (here, away) =
        ([near()], [perspective([45.0, 30.0, -40.0], [45.0, 32.0, -90.0], 60.0, [60, 60])]);
    while show.loader.statistics().queued < 5 {
        show.frame(&scene(&here, &appearance));
        show.loader.wait(Duration::from_millis(50));
    }
    show.frame(&scene(&away, &appearance));
    let read = source.read().len();
    show.converge(&scene(&away, &appearance));
    assert!(source.read().len() <= read + 8, "at most the group at hand");
}

#[test]
fn a_moving_cameras_next_needs_are_read_before_and_a_still_ones_are_not() {
    let appearance = opaque_above(100.0, 1.0);
    let read_at_turn = |prefetch_frames| {
        let source = Watched::new(volume());
        let mut show = Show::new(source.clone(), LoaderOptions { prefetch_frames, ..options() });
        let at = |step: f64| {
            [perspective([45.0, 30.0, -400.0 + step], [45.0, 32.0, 37.0], 30.0, [100, 100])]
        };
        for step in 0..40 {
            show.frame(&scene(&at(f64::from(step)), &appearance));
            show.loader.wait(Duration::from_millis(20));
        }
        let needed: usize = select_cut(
            &mut StoreNodes::new(&volume().store),
            &scene(&at(39.0), &appearance),
            usize::MAX,
        )
        .bricks();
        (source.read().len(), needed)
    };
    let (without, needed) = read_at_turn(0);
    let (with, _) = read_at_turn(16);
    assert!(with > without, "{with} {without} of {needed}");
}

#[test]
fn another_transfer_function_loads_what_it_shows_and_frees_what_it_hides() {
    let views = [near()];
    let source = Watched::new(volume());
    let mut show = Show::new(source.clone(), options());
    let (high, low) = (opaque_above(190.0, 1.0), opaque_above(60.0, 1.0));
    let (few, _) = show.converge(&scene(&views, &high));
    let in_few = show.loader.statistics().slots_in_use;
    let (many, _) = show.converge(&scene(&views, &low));
    check_resident(&many, &scene(&views, &low));
    assert!(show.loader.statistics().slots_in_use > in_few);
    let (again, _) = show.converge(&scene(&views, &high));
    assert_eq!(leaves(&again), leaves(&few));
    assert_eq!(show.loader.statistics().slots_in_use, in_few);
    let (surface, _) =
        show.converge(&Scene { appearance: &Appearance::Isovalue(119.5), ..scene(&views, &high) });
    assert!(surface.index.leaves().any(|(_, node)| matches!(node.data, NodeData::Slot(_))));
}

#[test]
fn options_that_cannot_work_are_refused() {
    for bad in [
        LoaderOptions { slots: 8, ..options() },
        LoaderOptions { memory_bytes: 1000, ..options() },
        LoaderOptions { requests: 7, ..options() },
        LoaderOptions { uploads_per_frame: 7, ..options() },
        LoaderOptions { threads: 0, ..options() },
    ] {
        let error = octree_store::loader::Loader::new(Watched::new(volume()), bad).unwrap_err();
        assert!(matches!(error, LoaderError::TooLittle { .. }), "{error}");
    }
}

#[test]
fn a_bricks_texels_are_the_samples_that_the_store_reads() {
    let dims = [20, 17, 9];
    let bounded = [0.0, 0.4, 3.0].map(|error| Encoding::max_error(error).unwrap());
    for encoding in [Encoding::Quantised8, Encoding::Lossless].into_iter().chain(bounded) {
        let made = make_as(dims, encoding, foam(dims));
        for record in made.records.values().filter(|record| record.state == BrickState::Stored) {
            let brick = made.store.upload_brick(record, &mut BrickScratch::default()).unwrap();
            let (_, samples) = made.store.read_brick_samples(record.key).unwrap();
            assert_eq!(brick.format, BrickFormat::R8);
            for i in 0..samples.len() {
                assert_eq!(brick.value(i).round(), samples.get_f64(i));
            }
        }
    }
}
