//! How many random sub-chunks a second the crate `zarrs` gives from a sharded zarr3 array, from a
//! warm cache: the other half of `random_reads`, with the same places in the same order.
//!
//! `cargo run --release --manifest-path bench/zarrs-reads/Cargo.toml -- STORE/0 [--reads N] [--threads T]`
//!
//! zarrs' own way for single sub-chunks: `retrieve_subchunk_opt` with a cache of the shards' indices,
//! a cache for each thread so that none waits for its lock, open files kept
//! (`file_handle_cache_size`), and one thread for decoding a sub-chunk, as the threads are ours.

use anyhow::{Context, bail, ensure};
use clap::Parser;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use zarrs::array::{
    Array, ArrayShardedExt, ArrayShardedReadableExt, ArrayShardedReadableExtCache, CodecOptions,
};
use zarrs::filesystem::{FilesystemStore, FilesystemStoreOptions};

/// Read random sub-chunks and print how many a second, the median of the rounds
#[derive(Debug, Parser)]
struct Arguments {
    /// The array's folder: a sharded zarr3 array of u16
    array: PathBuf,
    /// Sub-chunks that each thread reads in a round
    #[arg(long, default_value_t = 20_000)]
    reads: u64,
    /// Threads
    #[arg(long, default_value_t = 1)]
    threads: u64,
    /// Rounds, after one to warm up
    #[arg(long, default_value_t = 5)]
    rounds: usize,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let mut options = FilesystemStoreOptions::default();
    options.file_handle_cache_size(512);
    let store = FilesystemStore::new_with_options(&arguments.array, options)?;
    let array = Array::open(Arc::new(store), "/")
        .with_context(|| format!("no zarr3 array in {}", arguments.array.display()))?;
    ensure!(array.is_exclusively_sharded(), "{} is not sharded", arguments.array.display());
    let caches: Vec<_> =
        (0..arguments.threads).map(|_| ArrayShardedReadableExtCache::new(&array)).collect();
    let mut rates = Vec::new();
    for round in 0..=arguments.rounds {
        let started = Instant::now();
        std::thread::scope(|scope| {
            let readers: Vec<_> = (1..)
                .zip(&caches)
                .map(|(seed, cache)| {
                    let array = &array;
                    scope.spawn(move || read(array, cache, seed, arguments.reads))
                })
                .collect();
            readers.into_iter().try_for_each(|reader| match reader.join() {
                Ok(result) => result.map(drop),
                Err(_) => bail!("a reader stopped"),
            })
        })?;
        let rate = (arguments.reads * arguments.threads) as f64 / started.elapsed().as_secs_f64();
        if round > 0 {
            rates.push(rate);
        }
    }
    rates.sort_by(f64::total_cmp);
    println!(
        "{} threads: {:.0} sub-chunks a second (median of {}; {:.0} to {:.0})",
        arguments.threads,
        rates[rates.len() / 2],
        rates.len(),
        rates[0],
        rates[rates.len() - 1]
    );
    Ok(())
}

/// Reads and decodes sub-chunks in the pseudo-random order of `random_reads`; the same in every round.
fn read(
    array: &Array<FilesystemStore>,
    cache: &ArrayShardedReadableExtCache,
    seed: u64,
    reads: u64,
) -> anyhow::Result<u64> {
    let grid_zyx = array.subchunk_grid().grid_shape().to_vec();
    let chunks: u64 = grid_zyx.iter().product();
    let options = CodecOptions::default().with_concurrent_target(1);
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut sum = 0;
    for _ in 0..reads {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let index = state % chunks;
        let (x, y, z) = (
            index % grid_zyx[2],
            index / grid_zyx[2] % grid_zyx[1],
            index / grid_zyx[2] / grid_zyx[1],
        );
        let chunk: Vec<u16> = array.retrieve_subchunk_opt(cache, &[z, y, x], &options)?;
        // Something must use the samples, or the decoding could be left out.
        sum += u64::from(chunk[chunk.len() / 2]);
    }
    Ok(sum)
}
