//! Laws of visibility: what the renderer saw decides what is refined.

use crate::support::{Made, Show, Watched, foam, make, opaque_above, perspective, scene};
use octree_store::NodeKey;
use octree_store::loader::{Feedback, Frame, LoaderOptions, NodeData, View};
use std::collections::BTreeSet;
use std::sync::OnceLock;
use std::time::Duration;

const SIDE: u64 = 64;

/// An opaque wall across x, from 16 to 32; detail on both sides of it.
fn walled() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| {
        make([SIDE; 3], |[x, y, z]| match x {
            16..32 => 250 - (y % 5) as u8,
            _ => 60 + ((x * 7919 + y * 104_729 + z * 1_299_709) % 37) as u8,
        })
    })
}

fn options() -> LoaderOptions {
    LoaderOptions { linger_frames: 2, prefetch_frames: 0, ..LoaderOptions::default() }
}

/// Before the wall, looking at it; everything is in view.
fn before() -> [View; 1] {
    [perspective([-70.0, 32.0, 33.0], [32.0, 32.0, 32.0], 60.0, [90, 90])]
}

fn behind() -> [View; 1] {
    [perspective([135.0, 32.0, 33.0], [32.0, 32.0, 32.0], 60.0, [90, 90])]
}

fn leaves(frame: &Frame) -> BTreeSet<NodeKey> {
    frame.index.leaves().map(|leaf| leaf.0).collect()
}

/// The first voxel of a brick along x.
fn first_x(key: NodeKey) -> u64 {
    (key.brick_xyz()[0] * 8) << key.level()
}

/// Thin where there is no wall, opaque in it.
fn appearance() -> octree_store::loader::Appearance {
    let point = |value, extinction| octree_store::loader::ControlPoint {
        value,
        color: [1.0; 3],
        extinction,
    };
    let points = vec![point(0.0, 0.0), point(50.0, 0.001), point(200.0, 0.002), point(240.0, 3.0)];
    octree_store::loader::Appearance::Transfer(
        octree_store::loader::TransferFunction::new(points).unwrap(),
    )
}

#[test]
fn occluded_data_is_never_loaded_behind_an_opaque_wall() {
    let (views, appearance) = (before(), appearance());
    let scene = scene(&views, &appearance);
    let (source, top) = (Watched::new(walled()), walled().store.geometry().top_level());
    let mut show = Show::new(source.clone(), options());
    let (frame, _) = show.converge(&scene);
    let read = source.read();
    assert!(read.iter().all(|key| *key == show.geometry.root() || first_x(*key) < 32), "{read:?}");
    assert!(frame.index.leaves().any(|(key, _)| key.level() == 0), "before the wall it is fine");
    assert_eq!(top, 3);

    // A renderer that tells whole nodes only: the wall's own siblings come with it, and nothing beneath them.
    let source = Watched::new(walled());
    let mut show = Show::new(source.clone(), options());
    show.octants = false;
    show.converge(&scene);
    let read = source.read();
    assert!(read.iter().all(|key| key.level() + 1 >= top || first_x(*key) < 32), "{read:?}");

    // And without feedback everything is loaded.
    let source = Watched::new(walled());
    let mut show = Show::new(source.clone(), LoaderOptions { visibility: false, ..options() });
    show.converge(&scene);
    assert!(source.read().iter().any(|key| key.level() == 0 && first_x(*key) >= 32));
    assert!(source.read().len() > 3 * read.len() / 2);
}

#[test]
fn nothing_hidden_is_read_ahead_of_a_moving_camera() {
    let appearance = appearance();
    let options = LoaderOptions { prefetch_frames: 16, ..options() };
    let source = Watched::new(walled());
    let mut show = Show::new(source.clone(), options);
    let mut ahead = false;
    // From where everything is coarse enough towards the wall.
    for step in 0..60 {
        let position = [-1500.0 + 15.0 * f64::from(step), 32.0, 33.0];
        let views = [perspective(position, [32.0, 32.0, 32.0], 20.0, [90, 90])];
        show.frame(&scene(&views, &appearance));
        show.loader.wait(Duration::from_millis(20));
        let statistics = show.loader.statistics();
        ahead |= statistics.bricks_read > statistics.bricks_uploaded + statistics.waiting as u64;
    }
    assert!(ahead, "something is read ahead");
    let read = source.read();
    assert!(read.iter().all(|key| *key == show.geometry.root() || first_x(*key) < 32), "{read:?}");
}

#[test]
fn what_was_seen_comes_back_with_the_view_before_any_new_feedback() {
    let (views, appearance) = (before(), appearance());
    let mut scene = scene(&views, &appearance);
    let mut show = Show::new(Watched::new(walled()), options());
    show.converge(&scene);
    let accuracy = scene.quality.accuracy;
    scene.quality.accuracy = 1e9;
    let mut coarse = show.loader.frame(&scene);
    for _ in 0..10 {
        coarse = show.loader.frame(&scene);
    }
    assert_eq!(coarse.index.leaves().count(), 1);
    scene.quality.accuracy = accuracy;
    let back = show.loader.frame(&scene);
    // The four children of the root before the wall, and of the others none.
    let own = |x| {
        let drawn = back
            .index
            .leaves()
            .filter(|(key, node)| first_x(*key) == x && key.level() == 2 && node.data_level == 2);
        drawn.count()
    };
    assert_eq!((own(0), own(32)), (4, 0));
}

#[test]
fn a_newly_exposed_region_is_drawn_at_once_and_fine_within_two_frames_a_level() {
    let appearance = appearance();
    // As if reading and uploading took no time: the frames alone count.
    let options = LoaderOptions { requests: 4096, uploads_per_frame: 4096, ..options() };
    let mut show = Show::new(Watched::new(walled()), options);
    show.converge(&scene(&before(), &appearance));
    let views = behind();
    let scene = scene(&views, &appearance);
    let mut frames = 0;
    loop {
        let frame = show.frame(&scene);
        frames += 1;
        // Whatever a leaf shows, it shows something.
        assert!(frame.index.leaves().all(|(_, node)| node.data != NodeData::Missing));
        let fine = |x: u64| {
            frame
                .index
                .leaves()
                .any(|(key, node)| key.level() == 0 && node.data_level == 0 && first_x(key) == x)
        };
        if fine(56) && fine(32) {
            break;
        }
        assert!(frames <= 2 * 3 + 1, "{frames} frames");
        // All that this frame asked for is there in the next.
        while show.loader.unread() > 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    // What lies before the wall is out of sight now, and is let go.
    let (frame, _) = show.converge(&scene);
    assert!(frame.index.leaves().all(|(key, _)| key.level() > 0 || first_x(key) >= 16));
}

#[test]
fn the_converged_cut_does_not_depend_on_where_the_camera_came_from() {
    let appearance = appearance();
    let cold = leaves(
        &Show::new(Watched::new(walled()), options()).converge(&scene(&before(), &appearance)).0,
    );
    for octants in [true, false] {
        let mut show = Show::new(Watched::new(walled()), options());
        show.octants = octants;
        show.converge(&scene(&behind(), &appearance));
        for step in 0..20 {
            let x = 135.0 - 10.0 * f64::from(step);
            let views = [perspective([x, 150.0, 33.0], [32.0, 32.0, 32.0], 60.0, [90, 90])];
            show.frame(&scene(&views, &appearance));
        }
        let (frame, count) = show.converge(&scene(&before(), &appearance));
        assert_eq!(leaves(&frame), cold);
        assert!(count < 60, "{count} frames");
    }
}

#[test]
fn a_trembling_camera_does_not_make_the_cut_flicker() {
    let appearance = opaque_above(100.0, 1.0);
    let dims = [64; 3];
    let made = make(dims, foam(dims));
    let views = |d: f64| [perspective([32.0, 32.0, -d], [32.0, 32.0, 32.0], 50.0, [120, 120])];
    // A distance at which a small step changes the cut.
    let count = |d: f64| {
        let mut show = Show::new(Watched::new(&made), options());
        show.converge(&scene(&views(d), &appearance)).0.index.leaves().count()
    };
    let (mut near, mut far) = (100.0, 500.0);
    assert!(count(near) > count(far));
    while far - near > 0.5 {
        let middle = f64::midpoint(near, far);
        if count(middle) == count(near) { near = middle } else { far = middle }
    }
    assert_ne!(count(near), count(far));
    let mut show = Show::new(Watched::new(&made), options());
    show.converge(&scene(&views(near), &appearance));
    let mut serials = BTreeSet::new();
    for step in 0..40 {
        let d = if step % 2 == 0 { far } else { near };
        let frame = show.frame(&scene(&views(d), &appearance));
        show.loader.wait(Duration::from_millis(5));
        if step > 10 {
            serials.insert(frame.index.serial());
        }
    }
    assert_eq!(serials.len(), 1, "the cut stays the finer one");
}

#[test]
fn late_feedback_leads_to_the_same_cut() {
    let (views, appearance) = (before(), appearance());
    let scene = scene(&views, &appearance);
    let at_once = leaves(&Show::new(Watched::new(walled()), options()).converge(&scene).0);
    let mut show = Show::new(Watched::new(walled()), options());
    let mut drawn = std::collections::VecDeque::new();
    for count in 0.. {
        let frame = show.loader.frame(&scene);
        show.renderer.take(&frame);
        if frame.converged {
            assert_eq!(leaves(&frame), at_once);
            break;
        }
        assert!(count < 500);
        let seen = show.renderer.see(&show.geometry, &frame.index, &scene);
        drawn.push_back((frame.index.serial(), seen));
        if drawn.len() > 2 {
            let (serial, seen) = drawn.pop_front().unwrap();
            show.loader.feedback(serial, Feedback::Octants(&seen));
        }
        show.loader.wait(Duration::from_millis(20));
    }
}

#[test]
fn without_feedback_nothing_is_refined_and_nonsense_does_no_harm() {
    let (views, appearance) = (before(), appearance());
    let scene = scene(&views, &appearance);
    let source = Watched::new(walled());
    let mut show = Show::new(source.clone(), options());
    for _ in 0..20 {
        let frame = show.loader.frame(&scene);
        show.loader.feedback(frame.index.serial() + 99, Feedback::Nodes(&[1; 4000]));
        show.loader.wait(Duration::from_millis(20));
    }
    assert_eq!(source.read(), [show.geometry.root()]);
    // Too few bytes, and too many.
    let frame = show.loader.frame(&scene);
    show.loader.feedback(frame.index.serial(), Feedback::Nodes(&[]));
    show.loader.feedback(frame.index.serial(), Feedback::Octants(&[255; 4000]));
    show.loader.frame(&scene);
}
