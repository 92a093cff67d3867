//! A store is read by several processes and threads at once.

use crate::support::{Bench, octavo};
use octree_store::{BrickScratch, NodeKey, Region, Store};
use std::process::Stdio;

#[test]
fn several_processes_read_one_store_at_once() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --brick 8");
    let here = Store::open(bench.path("a.octavo")).unwrap();
    let readers: Vec<_> = (0..4)
        .map(|_| {
            let mut command = octavo();
            command.args(["verify", "a.octavo"]).current_dir(bench.folder()).stdout(Stdio::null());
            command.spawn().unwrap()
        })
        .collect();
    for mut reader in readers {
        assert!(reader.wait().unwrap().success());
    }
    assert!(here.node(NodeKey::new(0, [0; 3])).is_ok());
}

#[test]
fn threads_share_a_store() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --brick 8");
    let store = Store::open(bench.path("a.octavo")).unwrap();
    let region = Region::whole([40, 33, 20]);
    let expected = store.read_region::<u16>(0, region).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| assert_eq!(store.read_region::<u16>(0, region).unwrap(), expected));
        }
    });
    let samples = store.geometry().brick_samples();
    let mut wrong = vec![0_i16; samples];
    let key = NodeKey::new(0, [0; 3]);
    assert!(
        store.read_brick(key, &mut BrickScratch::default(), &mut wrong).is_err(),
        "another type"
    );
}
