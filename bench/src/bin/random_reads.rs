//! How many random bricks or regions a second a store gives, read and decoded, from a warm cache.
//!
//! `cargo run --release -p bench --bin random_reads -- STORE [--reads N] [--threads T] [--rounds R] [--region SIDE]`

#[path = "../rates.rs"]
mod rates;

use clap::Parser;
use octree_store::{
    BrickScratch, NodeKey, Region, Sample, SampleType, Store, StoreError, with_sample_type,
};
use std::path::PathBuf;

/// Read random level-0 bricks and print bricks a second, the median of the rounds
#[derive(Debug, Parser)]
struct Arguments {
    /// The store
    store: PathBuf,
    /// Bricks that each thread reads in a round
    #[arg(long, default_value_t = 20_000)]
    reads: u64,
    /// Threads
    #[arg(long, default_value_t = 1)]
    threads: u64,
    /// Read cubes of so many voxels a side at random places instead of bricks
    #[arg(long, value_name = "SIDE")]
    region: Option<u64>,
    /// Rounds, after one to warm up
    #[arg(long, default_value_t = 5)]
    rounds: usize,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let store = Store::open(&arguments.store)?;
    let sample_type: SampleType = store.metadata().sample_type;
    let Arguments { threads, reads, rounds, region, .. } = arguments;
    let what = if region.is_some() { "regions" } else { "bricks" };
    rates::print_rate(what, [threads, reads], rounds, |seed| {
        with_sample_type!(sample_type, T => match region {
            Some(side) => read_regions::<T>(&store, seed, reads, side),
            None => read::<T>(&store, seed, reads),
        })
    })
}

/// Reads and decodes bricks in a pseudo-random order; the same in every round.
fn read<T: Sample>(store: &Store, seed: u64, reads: u64) -> Result<u64, StoreError> {
    let grid = store.geometry().grid_at(0);
    let mut brick = vec![T::default(); store.geometry().brick_samples()];
    let mut scratch = BrickScratch::default();
    let mut sum = 0;
    for xyz in rates::places(seed, grid, reads) {
        store.read_brick(NodeKey::new(0, xyz), &mut scratch, &mut brick)?;
        // Something must use the samples, or the decoding could be left out.
        sum += brick[brick.len() / 2].to_f64() as u64;
    }
    Ok(sum)
}

/// Reads regions at pseudo-random places; the same in every round.
fn read_regions<T: Sample>(
    store: &Store,
    seed: u64,
    reads: u64,
    side: u64,
) -> Result<u64, StoreError> {
    let dims = store.geometry().dims_xyz();
    let size = dims.map(|n| n.min(side.max(1)));
    let corners = [0, 1, 2].map(|axis| dims[axis] - size[axis] + 1);
    let mut sum = 0;
    for min in rates::places(seed, corners, reads) {
        let max = [0, 1, 2].map(|axis| min[axis] + size[axis]);
        let samples = store.read_region::<T>(0, Region { min, max })?;
        sum += samples[samples.len() / 2].to_f64() as u64;
    }
    Ok(sum)
}
