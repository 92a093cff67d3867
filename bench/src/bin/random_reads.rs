//! How many random bricks or regions a second a store gives, read and decoded, from a warm cache.
//!
//! `cargo run --release -p bench --bin random_reads -- STORE [--reads N] [--threads T] [--rounds R] [--region SIDE]`

use clap::Parser;
use octree_store::{
    BrickScratch, NodeKey, OpenOptions, Region, Sample, SampleType, Store, StoreError,
    with_sample_type,
};
use std::path::PathBuf;
use std::time::Instant;

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
    /// redb's page cache in MiB
    #[arg(long, value_name = "MIB")]
    cache: Option<usize>,
    /// Read cubes of so many voxels a side at random places instead of bricks
    #[arg(long, value_name = "SIDE")]
    region: Option<u64>,
    /// Rounds, after one to warm up
    #[arg(long, default_value_t = 5)]
    rounds: usize,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let mut options = OpenOptions::default();
    options.cache_bytes = arguments.cache.map_or(options.cache_bytes, |mib| mib << 20);
    let store = options.open(&arguments.store)?;
    let sample_type: SampleType = store.metadata().sample_type;
    let mut rates = Vec::new();
    for round in 0..=arguments.rounds {
        let started = Instant::now();
        std::thread::scope(|scope| {
            let readers: Vec<_> = (0..arguments.threads)
                .map(|thread| {
                    let store = &store;
                    let seed = thread + 1;
                    scope.spawn(move || {
                        with_sample_type!(sample_type, T => match arguments.region {
                            Some(side) => read_regions::<T>(store, seed, arguments.reads, side),
                            None => read::<T>(store, seed, arguments.reads),
                        })
                    })
                })
                .collect();
            readers.into_iter().try_for_each(|reader| match reader.join() {
                Ok(result) => result.map(drop).map_err(anyhow::Error::from),
                Err(_) => anyhow::bail!("a reader stopped"),
            })
        })?;
        let rate = (arguments.reads * arguments.threads) as f64 / started.elapsed().as_secs_f64();
        if round > 0 {
            rates.push(rate);
        }
    }
    rates.sort_by(f64::total_cmp);
    println!(
        "{} threads: {:.0} {} a second (median of {}; {:.0} to {:.0})",
        arguments.threads,
        rates[rates.len() / 2],
        if arguments.region.is_some() { "regions" } else { "bricks" },
        rates.len(),
        rates[0],
        rates[rates.len() - 1]
    );
    Ok(())
}

/// Reads and decodes bricks in a pseudo-random order; the same in every round.
fn read<T: Sample>(store: &Store, seed: u64, reads: u64) -> Result<u64, StoreError> {
    let grid = store.geometry().grid_at(0);
    let bricks: u64 = grid.iter().product();
    let mut brick = vec![T::default(); store.geometry().brick_samples()];
    let mut scratch = BrickScratch::default();
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut sum = 0;
    for _ in 0..reads {
        let index = next(&mut state) % bricks;
        let xyz = [index % grid[0], index / grid[0] % grid[1], index / grid[0] / grid[1]];
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
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut sum = 0;
    for _ in 0..reads {
        let min = [0, 1, 2].map(|axis| next(&mut state) % (dims[axis] - size[axis] + 1));
        let max = [0, 1, 2].map(|axis| min[axis] + size[axis]);
        let samples = store.read_region::<T>(0, Region { min, max })?;
        sum += samples[samples.len() / 2].to_f64() as u64;
    }
    Ok(sum)
}

/// The next xorshift number.
fn next(state: &mut u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    *state
}
