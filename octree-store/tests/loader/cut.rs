//! Laws of the cut itself, chosen at once, without a loader.

use crate::support::{Made, covers_once, foam, make, opaque_above, perspective, scene};
use octree_store::loader::{
    Appearance, Child, ClipBox, Criterion, Cut, Deviation, LeafKind, Lookup, NodeSource,
    NodeSummary, Scene, StoreNodes, View, ViewSet, select_cut,
};
use octree_store::{BrickState, NodeKey};
use proptest::prelude::*;
use std::collections::{BTreeSet, HashSet};
use std::sync::OnceLock;

const DIMS: [u64; 3] = [90, 64, 75];

fn volume() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| make(DIMS, foam(DIMS)))
}

fn select(scene: &Scene, budget: usize) -> Cut {
    let cut = select_cut(&mut StoreNodes::new(&volume().store), scene, budget);
    covers_once(volume().store.geometry(), cut.leaves.iter().map(|leaf| leaf.key), &[]);
    assert_eq!(cut.pending, 0);
    cut
}

/// The cut as its definition says it, by recursion.
fn naive(scene: &Scene) -> BTreeSet<(NodeKey, LeafKind)> {
    fn leaf(
        nodes: &mut StoreNodes,
        views: &ViewSet,
        scene: &Scene,
        (key, summary): (NodeKey, NodeSummary),
        out: &mut BTreeSet<(NodeKey, LeafKind)>,
    ) {
        let [low, high] = summary.subtree_range;
        let size = views.voxel_size(key.level(), key.brick_xyz().map(|c| c as u32));
        let empty = scene.appearance.is_empty(low, high);
        let constant = summary.state != BrickState::Stored && low == high;
        let coarse = size.is_some_and(|size| size > scene.quality.accuracy as f32);
        if coarse && !empty && !constant && key.level() > 0 {
            let Lookup::Ready(children) = nodes.children(key) else { panic!("at once") };
            for (child, child_key) in children.iter().zip(key.children()) {
                if let Child::Known(summary) = child {
                    leaf(nodes, views, scene, (child_key, *summary), out);
                }
            }
            return;
        }
        let kind = match (empty, size, summary.state) {
            (true, ..) => LeafKind::Empty,
            (_, None, _) => LeafKind::OutOfView,
            (_, _, BrickState::Stored) => LeafKind::Brick,
            _ => LeafKind::Uniform,
        };
        out.insert((key, kind));
    }
    let mut nodes = StoreNodes::new(&volume().store);
    let views = ViewSet::new(scene.views, scene.clip, nodes.geometry(), nodes.spacing_xyz());
    let Lookup::Ready(Child::Known(root)) = nodes.root() else { panic!("a root") };
    let (mut out, key) = (BTreeSet::new(), nodes.geometry().root());
    leaf(&mut nodes, &views, scene, (key, root), &mut out);
    out
}

fn some_views() -> impl Strategy<Value = Vec<View>> {
    let place = || [-120.0..200.0, -120.0..200.0, -120.0..200.0_f64];
    let view = (place(), [20.0..70.0, 20.0..60.0, 20.0..60.0_f64], 5.0..100.0_f64, 8_u32..200)
        .prop_map(|(position, target, fov, size)| perspective(position, target, fov, [size, size]));
    proptest::collection::vec(view, 1..3)
}

/// Whether every leaf of `fine` is a leaf of `coarse` or lies in one.
fn refines(fine: &Cut, coarse: &Cut) -> bool {
    let coarse: HashSet<NodeKey> = coarse.leaves.iter().map(|leaf| leaf.key).collect();
    let root = volume().store.geometry().root();
    fine.leaves.iter().all(|leaf| {
        let mut key = leaf.key;
        while !coarse.contains(&key) && key != root {
            key = key.parent();
        }
        coarse.contains(&key)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(120))]

    #[test]
    fn without_limits_it_is_the_naive_recursive_one(
        views in some_views(), from in 60.0..200.0, accuracy in 0.2..8.0, clip in any::<bool>(),
    ) {
        let appearance = opaque_above(from, 1.0);
        let mut scene = scene(&views, &appearance);
        scene.quality.accuracy = accuracy;
        scene.clip = clip.then(|| ClipBox::new([10.0, 0.0, 20.0], [50.0, 33.0, 60.0]).unwrap());
        let cut = select(&scene, usize::MAX);
        let found: BTreeSet<_> = cut.leaves.iter().map(|leaf| (leaf.key, leaf.kind)).collect();
        prop_assert_eq!(found, naive(&scene));
        prop_assert!(!cut.limited);
    }

    #[test]
    fn it_is_monotone_in_the_budget_and_keeps_it(
        views in some_views(), small in 1_usize..400, more in 0_usize..400,
    ) {
        let appearance = opaque_above(100.0, 1.0);
        let scene = scene(&views, &appearance);
        let (tight, wide) = (select(&scene, small), select(&scene, small + more));
        prop_assert!(tight.bricks() <= small && wide.bricks() <= small + more);
        prop_assert!(refines(&wide, &tight));
        if !tight.limited {
            prop_assert_eq!(tight, wide);
        }
    }

    #[test]
    fn it_is_monotone_in_accuracy(views in some_views(), a in 0.2..8.0, b in 0.2..8.0) {
        let appearance = opaque_above(100.0, 1.0);
        let mut scene = scene(&views, &appearance);
        let mut at = |accuracy| {
            scene.quality.accuracy = accuracy;
            select(&scene, usize::MAX)
        };
        prop_assert!(refines(&at(f64::min(a, b)), &at(f64::max(a, b))));
    }

    #[test]
    fn of_several_views_it_is_the_finest_that_any_asks_for(views in some_views(), other in some_views()) {
        let appearance = opaque_above(100.0, 1.0);
        let together: Vec<View> = views.iter().chain(&other).cloned().collect();
        let all = select(&scene(&together, &appearance), usize::MAX);
        let one = select(&scene(&views, &appearance), usize::MAX);
        let two = select(&scene(&other, &appearance), usize::MAX);
        prop_assert!(refines(&all, &one) && refines(&all, &two));
        // And no finer: every leaf's parent is refined in one of the two.
        let leaves: HashSet<NodeKey> = one.leaves.iter().chain(&two.leaves).map(|leaf| leaf.key).collect();
        prop_assert!(all.leaves.iter().all(|leaf| leaves.contains(&leaf.key)));
    }

    #[test]
    fn measured_error_only_saves_and_keeps_to_its_tolerance(views in some_views(), tolerance in 0.001..0.5_f64) {
        let appearance = opaque_above(100.0, 0.02);
        let mut scene = scene(&views, &appearance);
        let plain = select(&scene, usize::MAX);
        let deviation = Deviation::Largest;
        scene.quality.criterion = Criterion::MeasuredError { tolerance, deviation };
        let measured = select(&scene, usize::MAX);
        prop_assert!(refines(&plain, &measured));
        let Appearance::Transfer(function) = &appearance else { unreachable!() };
        for leaf in measured.leaves.iter().filter(|leaf| leaf.kind == LeafKind::Brick) {
            let record = &volume().records[&leaf.key];
            let steep = function.steepness(record.subtree_min, record.subtree_max);
            let length = f64::from(8 << leaf.key.level());
            let error = 1.0 - (-steep * record.lod_amax_bound * length).exp();
            prop_assert!(leaf.voxel_pixels <= 1.0 || error <= tolerance + 1e-6, "{}", leaf.key);
        }
    }
}

#[test]
fn measured_error_saves_much_where_little_differs() {
    // So faint that what coarse levels miss makes no difference through the whole volume.
    let views = [perspective([45.0, 30.0, -60.0], [45.0, 32.0, 37.0], 60.0, [256, 256])];
    let appearance = opaque_above(100.0, 1e-6);
    let mut scene = scene(&views, &appearance);
    let plain = select(&scene, usize::MAX).bricks();
    let (tolerance, deviation) = (1.0 / 255.0, Deviation::RootMeanSquare);
    scene.quality.criterion = Criterion::MeasuredError { tolerance, deviation };
    let measured = select(&scene, usize::MAX).bricks();
    assert!(measured * 2 < plain, "{measured} of {plain}");
}

#[test]
fn one_who_has_bricks_gets_only_the_others_coarse_to_fine() {
    let views = [perspective([45.0, 30.0, -60.0], [45.0, 32.0, 37.0], 60.0, [128, 128])];
    let appearance = opaque_above(100.0, 1.0);
    let cut = select(&scene(&views, &appearance), usize::MAX);
    let all: Vec<NodeKey> = cut.lacking(&HashSet::new()).map(|leaf| leaf.key).collect();
    assert_eq!(all.len(), cut.bricks());
    assert!(all.is_sorted_by(|a, b| a.level() >= b.level()));
    let have: HashSet<NodeKey> = all[..all.len() / 2].iter().copied().collect();
    let rest: Vec<NodeKey> = cut.lacking(&have).map(|leaf| leaf.key).collect();
    assert_eq!(rest, all[all.len() / 2..]);
}
