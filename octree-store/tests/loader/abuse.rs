//! What a caller may do to a loader without harm: short budgets, odd volumes, wild cameras, numbers that are none.

use crate::support::{Made, Show, Watched, foam, make, opaque_above, perspective, scene};
use octree_store::loader::{
    Appearance, Camera, CameraJson, ClipBox, ControlPoint, Criterion, Deviation, Feedback,
    LoaderOptions, NodeData, Quality, Scene, TransferFunction, View, ViewSet, off_axis,
};
use proptest::prelude::*;
use std::collections::HashSet;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

const DIMS: [u64; 3] = [40, 33, 25];

fn volume() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| make(DIMS, foam(DIMS)))
}

fn brick_bytes() -> usize {
    volume().store.geometry().brick_samples()
}

/// The least of everything that a loader works with.
fn least() -> LoaderOptions {
    LoaderOptions {
        slots: 9,
        memory_bytes: 17 * brick_bytes(),
        requests: 8,
        uploads_per_frame: 8,
        linger_frames: 0,
        visibility: false,
        ..LoaderOptions::default()
    }
}

fn near() -> View {
    perspective([20.0, 15.0, -30.0], [20.0, 16.0, 12.0], 60.0, [60, 60])
}

fn odd_volumes() -> &'static [Made] {
    static MADE: OnceLock<Vec<Made>> = OnceLock::new();
    MADE.get_or_init(|| {
        let noise = |[x, y, z]: [u64; 3]| ((x * 7919 + y * 104_729 + z * 1_299_709) % 251) as u8;
        vec![
            make([1, 1, 1], |_| 200),
            make([1, 130, 1], noise),
            make([70, 1, 9], noise),
            make([40, 20, 30], |_| 77),
            make([40, 20, 30], |_| 0),
            make(DIMS, foam(DIMS)),
            make(DIMS, noise),
        ]
    })
}

fn any_view() -> impl Strategy<Value = View> {
    let face = || prop_oneof![Just(0.0), Just(8.0), Just(16.0), Just(20.0), Just(40.0)];
    let position = prop_oneof![
        [-90.0..130.0, -90.0..130.0, -90.0..130.0_f64],
        [face(), face(), face()],
        [-1e12..1e12_f64, -1e12..1e12_f64, -1e12..1e12_f64],
        [Just(1e300), Just(1e-300), Just(0.0)],
        [Just(0.0), Just(0.0), Just(-1e12)],
    ];
    let target = prop_oneof![
        4 => [0.0..40.0, 0.0..33.0, 0.0..25.0_f64],
        1 => [Just(-500.0), Just(1.0), Just(2.0)],
    ];
    (position, target, 1e-5..179.0_f64, 0_u8..3, [1_u32..24, 1_u32..24]).prop_filter_map(
        "no direction",
        |(position, target, angle, kind, size)| {
            let up = [0.1, 1.0, 0.05];
            let camera = match kind {
                0 => {
                    Camera::new(CameraJson::Perspective { position, target, up, fov_y_deg: angle })
                }
                1 => Camera::new(CameraJson::Orthographic { position, target, up, height: angle }),
                _ => off_axis(position, [-0.2, 1.3], [-0.9, 0.4]),
            };
            View::new(camera.ok()?, size).ok()
        },
    )
}

fn any_appearance() -> impl Strategy<Value = Appearance> {
    let point = |value, extinction| ControlPoint { value, color: [1.0; 3], extinction };
    let nothing = TransferFunction::new(vec![point(0.0, 0.0)]).unwrap();
    prop_oneof![
        (0.0..260.0_f64).prop_map(|from| opaque_above(from, 1.0)),
        (-50.0..350.0_f64).prop_map(Appearance::Isovalue),
        Just(Appearance::Everything),
        Just(Appearance::Transfer(nothing)),
        Just(Appearance::Isovalue(f64::NAN)),
    ]
}

fn any_quality() -> impl Strategy<Value = Quality> {
    let accuracy = prop_oneof![
        4 => 0.1..9.0_f64,
        1 => prop_oneof![Just(0.0), Just(-1.0), Just(f64::NAN), Just(f64::INFINITY)],
    ];
    let tolerance = prop_oneof![0.0..0.5_f64, Just(f64::NAN)];
    let criterion = prop_oneof![
        Just(Criterion::ProjectedSize),
        (tolerance, any::<bool>()).prop_map(|(tolerance, largest)| Criterion::MeasuredError {
            tolerance,
            deviation: if largest { Deviation::Largest } else { Deviation::RootMeanSquare },
        }),
    ];
    (accuracy, criterion).prop_map(|(accuracy, criterion)| Quality { accuracy, criterion })
}

fn any_clip() -> impl Strategy<Value = Option<ClipBox>> {
    prop_oneof![
        Just(None),
        Just(Some(ClipBox::new([900.0; 3], [901.0; 3]).unwrap())),
        Just(Some(ClipBox::new([7.0, -1e9, 8.0], [7.5, 1e9, 16.0]).unwrap())),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Whatever was shown before, and however little there is to show it with: every frame keeps its laws
    /// (`Show::frame` checks them), and a camera that stands still comes to an end.
    #[test]
    fn wild_scenes_within_the_least_budgets_keep_every_law_and_come_to_rest(
        which in 0_usize..7, visibility in any::<bool>(), dropped in any::<bool>(), octants in any::<bool>(),
        slots in 9_usize..40, bricks in 17_usize..60, uploads in 8_usize..20, linger_frames in 0_u32..4,
        scenes in proptest::collection::vec(
            (proptest::collection::vec(any_view(), 0..3), any_clip(), any_appearance(), any_quality(), 1_u8..6, 0_u8..12),
            1..12,
        ),
    ) {
        let made = &odd_volumes()[which];
        let options = LoaderOptions {
            slots, memory_bytes: bricks * brick_bytes(), uploads_per_frame: uploads, linger_frames, visibility, ..least()
        };
        let mut source = Watched::new(made);
        source.dropped = dropped;
        let mut show = Show::new(source.clone(), options);
        show.octants = octants;
        for (views, clip, appearance, quality, frames, what) in &scenes {
            let scene = Scene { views, clip: *clip, appearance, quality: *quality };
            match what {
                0 => source.broken.lock().unwrap().extend(made.records.keys().filter(|key| key.brick_xyz()[1] == 1)),
                1 => source.unreadable.lock().unwrap().extend(made.records.keys().filter(|key| key.brick_xyz()[2] == 1)),
                2 => { source.broken.lock().unwrap().clear(); source.unreadable.lock().unwrap().clear(); }
                3 => show.loader.retry_damaged(),
                _ => {}
            }
            for _ in 0..*frames {
                let serial = show.frame(&scene).index.serial();
                if what % 2 == 0 {
                    show.loader.feedback(serial.saturating_sub(2), Feedback::Nodes(&[1; 300]));
                }
                show.loader.wait(Duration::from_micros(u64::from(*frames) * 50));
            }
        }
        let (views, clip, appearance, quality, ..) = &scenes[0];
        let scene = Scene { views, clip: *clip, appearance, quality: *quality };
        let rests = (0..400).any(|_| {
            show.loader.wait(Duration::from_millis(5));
            show.frame(&scene).converged
        });
        prop_assert!(rests, "{:?}", show.loader.statistics());
    }
}

#[test]
fn a_memory_of_seventeen_bricks_reads_nothing_twice() {
    let appearance = opaque_above(100.0, 1.0);
    let views = [near()];
    for (slots, requests, threads) in [(9, 8, 1), (9, 256, 2), (40, 8, 2), (40, 8, 4), (40, 256, 4)]
    {
        let mut source = Watched::new(volume());
        source.delay = Duration::from_micros(300);
        let options = LoaderOptions { slots, requests, threads, ..least() };
        let mut show = Show::new(source.clone(), options);
        show.converge(&scene(&views, &appearance));
        let read = source.read();
        let once: HashSet<_> = read.iter().collect();
        assert_eq!(read.len(), once.len(), "{slots} slots, {requests} requests, {threads} threads");
    }
}

/// Seen as a whole, every group but the root's has eight bricks: as many as may be asked for.
#[test]
fn no_more_is_asked_for_or_read_at_once_than_requests_allow() {
    let made = make([64; 3], |[x, y, z]| 100 + ((x * 7919 + y * 104_729 + z * 31) % 97) as u8);
    let mut source = Watched::new(&made);
    source.delay = Duration::from_millis(1);
    let options =
        LoaderOptions { requests: 8, threads: 4, visibility: false, ..LoaderOptions::default() };
    let mut show = Show::new(source, options);
    let views = [perspective([32.0, 32.0, -90.0], [32.0, 32.0, 32.0], 60.0, [90, 90])];
    let appearance = opaque_above(50.0, 1.0);
    for _ in 0..60 {
        show.frame(&scene(&views, &appearance));
        let statistics = show.loader.statistics();
        assert!(statistics.queued + statistics.active <= 1, "{statistics:?}");
        show.loader.wait(Duration::from_millis(1));
    }
    assert!(show.loader.statistics().bricks_read > 20);
}

#[test]
fn what_is_asked_for_in_one_frame_is_read_the_largest_voxels_first() {
    let appearance = opaque_above(100.0, 1.0);
    let views = [near()];
    let scene = scene(&views, &appearance);
    let mut source = Watched::new(volume());
    source.delay = Duration::from_millis(1);
    let options = LoaderOptions {
        threads: 1,
        prefetch_frames: 0,
        visibility: false,
        ..LoaderOptions::default()
    };
    let mut show = Show::new(source.clone(), options);
    while show.loader.statistics().queued < 4 {
        show.loader.wait(Duration::from_millis(50));
        show.frame(&scene);
    }
    let before = source.read().len();
    while show.loader.unread() > 0 {
        std::thread::sleep(Duration::from_millis(1));
    }
    let metadata = volume().store.metadata();
    let views = ViewSet::new(&views, None, volume().store.geometry(), metadata.spacing_xyz);
    let read = source.read()[before..].iter().map(|key| key.parent()).collect::<Vec<_>>();
    let sizes =
        read.iter().map(|key| views.voxel_size(key.level(), key.brick_xyz().map(|c| c as u32)));
    assert!(sizes.is_sorted_by(|a, b| a >= b), "{read:?}");
    assert!(read.first() != read.last());
}

#[test]
fn numbers_that_are_none_show_nothing_finer_and_come_to_rest() {
    let views = [near()];
    let appearance = Appearance::Isovalue(f64::NAN);
    let mut show = Show::new(Watched::new(volume()), least());
    let (frame, _) = show.converge(&scene(&views, &appearance));
    assert_eq!(frame.index.leaves().map(|leaf| leaf.1.data).collect::<Vec<_>>(), [NodeData::Empty]);
    let appearance = opaque_above(100.0, 1.0);
    let mut scene = scene(&views, &appearance);
    let tolerance = f64::NAN;
    for quality in [
        Quality { accuracy: f64::NAN, ..Quality::default() },
        Quality {
            criterion: Criterion::MeasuredError { tolerance, deviation: Deviation::Largest },
            ..Quality::default()
        },
    ] {
        scene.quality = quality;
        assert_eq!(show.converge(&scene).0.index.leaves().count(), 1);
    }
}

#[test]
fn one_may_wait_for_ever_where_there_is_nothing_to_wait_for() {
    let appearance = opaque_above(100.0, 1.0);
    let views = [near()];
    let mut show = Show::new(Watched::new(volume()), least());
    show.loader.wait(Duration::MAX);
    while !show.frame(&scene(&views, &appearance)).converged {
        show.loader.wait(Duration::MAX);
    }
}

#[test]
fn what_was_dropped_is_of_one_value_and_is_not_refined_where_that_shows() {
    let made = make([64; 3], |[x, ..]| if x < 32 { 0 } else { 9 + (x % 7) as u8 });
    let views = [perspective([32.0, 32.0, -60.0], [32.0, 32.0, 32.0], 60.0, [70, 70])];
    let leaves = |dropped| {
        let mut source = Watched::new(&made);
        source.dropped = dropped;
        let options = LoaderOptions { visibility: false, ..LoaderOptions::default() };
        let frame = Show::new(source, options).converge(&scene(&views, &Appearance::Everything)).0;
        frame.index.leaves().map(|leaf| leaf.0).collect::<Vec<_>>()
    };
    assert_eq!(leaves(true), leaves(false));
}

#[test]
fn a_view_from_json_is_checked_as_any_other() {
    let view = serde_json::to_string(&near()).unwrap();
    assert_eq!(serde_json::from_str::<View>(&view).unwrap(), near());
    let nothing = serde_json::from_str::<View>(&view.replace("[60,60]", "[60,0]"));
    assert!(nothing.unwrap_err().to_string().contains("60 x 0"));
}

#[test]
fn a_loader_may_be_dropped_while_its_threads_read() {
    let appearance = opaque_above(100.0, 1.0);
    let views = [near()];
    let mut source = Watched::new(volume());
    source.delay = Duration::from_micros(200);
    for frames in 0..60 {
        let mut show = Show::new(source.clone(), LoaderOptions { threads: 3, ..least() });
        for _ in 0..frames % 12 {
            show.frame(&scene(&views, &appearance));
        }
        let started = Instant::now();
        drop(show);
        assert!(started.elapsed() < Duration::from_millis(100));
    }
}
