//! How many random sub-chunks a second the crate `zarrs` gives from a sharded zarr3 array, from a
//! warm cache: the other half of `random_reads`, with the same places in the same order.
//!
//! `cargo run --release --manifest-path bench/zarrs-reads/Cargo.toml -- STORE/0 [--reads N] [--threads T]`
//!
//! zarrs' own way for single sub-chunks: `retrieve_subchunk_opt` with a cache of the shards' indices,
//! a cache for each thread so that none waits for its lock, open files kept
//! (`file_handle_cache_size`), and one thread for decoding a sub-chunk, as the threads are ours.

#[path = "../../src/rates.rs"]
mod rates;

use anyhow::{Context, ensure};
use clap::Parser;
use std::path::PathBuf;
use std::sync::Arc;
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
    let Arguments { threads, reads, rounds, .. } = arguments;
    rates::print_rate("sub-chunks", [threads, reads], rounds, |seed| {
        read(&array, &caches[seed as usize - 1], seed, reads)
    })
}

/// Reads and decodes sub-chunks in the pseudo-random order of `random_reads`; the same in every round.
fn read(
    array: &Array<FilesystemStore>,
    cache: &ArrayShardedReadableExtCache,
    seed: u64,
    reads: u64,
) -> anyhow::Result<u64> {
    let mut grid = [1; 3];
    grid.copy_from_slice(array.subchunk_grid().grid_shape());
    grid.reverse();
    let options = CodecOptions::default().with_concurrent_target(1);
    let mut sum = 0;
    for [x, y, z] in rates::places(seed, grid, reads) {
        let chunk: Vec<u16> = array.retrieve_subchunk_opt(cache, &[z, y, x], &options)?;
        // Something must use the samples, or the decoding could be left out.
        sum += u64::from(chunk[chunk.len() / 2]);
    }
    Ok(sum)
}
