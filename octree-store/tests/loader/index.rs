//! Laws of the spatial index: its pointers lead every ray through exactly the leaves that are there.

use crate::support::{Show, Watched, foam, make, opaque_above, perspective, scene};
use octree_store::loader::{LoaderOptions, NO_NODE, NodeData, Quality, Ray, SpatialIndex};
use octree_store::{Geometry, NodeKey, SampleType};
use proptest::prelude::*;
use std::sync::{Arc, OnceLock};

/// An index of several levels side by side, of a volume that fills no whole bricks.
fn mixed() -> &'static (Geometry, Arc<SpatialIndex>) {
    static INDEX: OnceLock<(Geometry, Arc<SpatialIndex>)> = OnceLock::new();
    INDEX.get_or_init(|| {
        let dims = [60, 97, 71];
        let made = make(dims, foam(dims));
        let options = LoaderOptions { visibility: false, ..LoaderOptions::default() };
        let mut show = Show::new(Watched::new(&made), options);
        let views = [perspective([-9.0, -12.0, -7.0], [20.0, 40.0, 30.0], 70.0, [60, 40])];
        let appearance = opaque_above(100.0, 0.1);
        let mut scene = scene(&views, &appearance);
        scene.quality = Quality { accuracy: 2.0, ..Quality::default() };
        let (frame, _) = show.converge(&scene);
        let mut levels: Vec<u8> = frame.index.leaves().map(|(key, _)| key.level()).collect();
        levels.sort_unstable();
        levels.dedup();
        assert!(levels.len() >= 3, "the test wants a mixed cut: {levels:?}");
        (show.geometry, Arc::clone(&frame.index))
    })
}

/// Every leaf that a ray has a part in, found by asking all of them.
fn brute_force(geometry: &Geometry, index: &SpatialIndex, ray: &Ray) -> Vec<NodeKey> {
    let mut found = Vec::new();
    for (key, _) in index.leaves() {
        let side = u64::from(geometry.core()) << key.level();
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let low = key.brick_xyz()[axis] * side;
            let high = (low + side).min(geometry.dims_xyz()[axis]) as f64;
            let (low, o, d) = (low as f64, ray.origin[axis], ray.direction[axis]);
            if d == 0.0 {
                if o < low || o >= high {
                    leave = f64::NEG_INFINITY;
                }
            } else {
                let (a, b) = ((low - o) / d, (high - o) / d);
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            }
        }
        if enter < leave {
            found.push((enter, key));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().map(|leaf| leaf.1).collect()
}

fn check(ray: Ray) {
    let (geometry, index) = mixed();
    let (mut walked, mut last) = (Vec::new(), 0.0);
    index.walk(geometry, &ray, |step| {
        assert!(step.enter >= last && step.leave > step.enter);
        last = step.leave;
        walked.push(index.keys()[step.node as usize]);
        walked.len() < 10_000
    });
    assert_eq!(walked, brute_force(geometry, index, &ray), "{ray:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn pointers_lead_rays_through_exactly_the_leaves_on_their_way(
        origin in [-50.0..150.0, -50.0..150.0, -50.0..150.0_f64],
        direction in [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64],
    ) {
        check(Ray { origin, direction });
    }

    /// Origins on corners and edges of voxels and bricks, directions along axes, faces and diagonals: every tie there is.
    #[test]
    fn also_along_axes_faces_edges_and_through_corners(
        origin in [-4_i32..16, -4_i32..16, -4_i32..16], half in 0_u8..4,
        direction in [-2_i8..=2, -2_i8..=2, -2_i8..=2],
    ) {
        prop_assume!(direction != [0; 3]);
        // 4 is half a brick, 8 a brick: all planes of the tree are among the multiples.
        let unit = [8.0, 4.0, 1.0, 0.5][usize::from(half)];
        check(Ray { origin: origin.map(|c| f64::from(c) * unit), direction: direction.map(f64::from) });
    }
}

#[test]
fn neighbours_are_of_the_same_level_or_the_smallest_that_encloses() {
    let (geometry, index) = mixed();
    let place = |key: NodeKey| index.keys().iter().position(|k| *k == key);
    for (at, node) in index.nodes().iter().enumerate() {
        if node.data == NodeData::Absent {
            continue;
        }
        for (face, &found) in node.neighbours.iter().enumerate() {
            let mut xyz = index.keys()[at].brick_xyz().map(|c| c as i64);
            xyz[face / 2] += if face % 2 == 1 { 1 } else { -1 };
            let mut expected = None;
            let grid = geometry.grid_at(node.level);
            if (0..3).all(|axis| (0..grid[axis] as i64).contains(&xyz[axis])) {
                let mut key = NodeKey::new(node.level, xyz.map(|c| c as u64));
                // Up from the place beside it to the first that the index has.
                while expected.is_none() {
                    expected = place(key);
                    key = key.parent();
                }
            }
            assert_eq!((found != NO_NODE).then_some(found as usize), expected);
        }
    }
}

#[test]
fn the_narrow_and_the_wide_layout_say_what_the_index_says() {
    let (_, index) = mixed();
    let narrow = index.narrow(SampleType::U8).unwrap();
    let signed = index.narrow(SampleType::I16).unwrap();
    let wide = index.wide();
    assert_eq!((narrow.len(), wide.len()), (index.nodes().len(), index.nodes().len()));
    assert_eq!(size_of_val(&narrow[0]) * 8, 192);
    let short = |v: u32| if v == NO_NODE { 0xffff } else { v };
    for (i, node) in index.nodes().iter().enumerate() {
        let w = narrow[i];
        assert_eq!([w[0] & 0xffff, w[0] >> 16], [short(node.parent), short(node.first_child)]);
        let slot = match node.data {
            NodeData::Slot(slot) => [slot, slot],
            NodeData::Empty => [0x3f_ffff, 0xffff_ffff],
            NodeData::Uniform => [0x3f_fffe, 0xffff_fffe],
            NodeData::Missing => [0x3f_fffd, 0xffff_fffd],
            NodeData::Absent => [0x3f_fffc, 0xffff_fffc],
        };
        let levels = [u32::from(node.data_level), u32::from(node.level)];
        assert_eq!(
            [w[1] & 0x3f_ffff, w[1] >> 22 & 31, w[1] >> 27],
            [slot[0], levels[0], levels[1]]
        );
        assert_eq!([w[2] & 0xffff, w[2] >> 16].map(f64::from), node.texel_range);
        assert_eq!(signed[i][2] & 0xffff, node.texel_range[0] as u32 + 32768);
        let beyond =
            [w[3] & 0xffff, w[3] >> 16, w[4] & 0xffff, w[4] >> 16, w[5] & 0xffff, w[5] >> 16];
        assert_eq!(beyond, node.neighbours.map(short));
        let w = wide[i];
        assert_eq!([w[0], w[1], w[2]], [node.parent, node.first_child, slot[1]]);
        assert_eq!([w[3] >> 8, w[3] & 0xff], levels);
        assert_eq!(
            [f32::from_bits(w[4]), f32::from_bits(w[5])],
            node.texel_range.map(|v| v as f32)
        );
        assert_eq!(w[6..], node.neighbours);
    }
    assert_eq!(index.narrow(SampleType::F32), None);
    assert_eq!(index.narrow(SampleType::U32), None);
}
