//! A store held against the source from which it was made: how to open it, and what may be used.

use super::{RawArgs, SeriesArgs};
use crate::parse;
use clap::Args;
use octree_store::Store;
use preprocess::source::RawName;
use preprocess::{ConvertOptions, Source, SourceError};
use std::path::{Path, PathBuf};

/// The flags of commands that hold a store against its source.
#[derive(Debug, Args)]
pub(super) struct AgainstArgs {
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
    /// Threads that compare bricks [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Own memory to use at most while comparing, pages of mapped files apart
    #[arg(long, value_name = "SIZE", value_parser = parse::size, default_value = "512MiB")]
    memory: u64,
    /// Folder of scratch files [default: the system's for temporary files]
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
}

impl AgainstArgs {
    /// Opens the source as the flags say, and as the store says where they do not: of a series the volume that the
    /// store was made from, and of a raw file that says nothing of itself the store's dimensions and type.
    pub(super) fn open(&self, path: &Path, store: &Store) -> Result<Source, SourceError> {
        let mut options = self.raw.source_options(Some(&self.series));
        let made = &store.metadata().options;
        let recorded = |name| made.get(name)?.as_u64();
        options.time = options.time.or_else(|| recorded("time"));
        options.channel = options.channel.or_else(|| recorded("channel"));
        if path.is_dir() && options.series.is_none() {
            let series = made.get("series").and_then(|uid| uid.as_str());
            options.series = series.map(str::to_owned);
        }
        let raw = path.extension().is_some_and(|extension| extension == "raw");
        if raw && RawName::parse(path).is_none() {
            // It was smaller where the store was enlarged from it.
            let factor = recorded("upscale").unwrap_or(1).max(1);
            let dims_xyz = store.metadata().dims_xyz.map(|n| n / factor);
            options.dims_xyz = options.dims_xyz.or(Some(dims_xyz));
            options.sample_type = options.sample_type.or(Some(store.metadata().sample_type));
        }
        Source::open(path, &options)
    }

    /// What the work may use.
    pub(super) fn options(&self) -> ConvertOptions {
        let defaults = ConvertOptions::default();
        ConvertOptions {
            threads: self.threads.map_or(defaults.threads, usize::from),
            memory_bytes: self.memory,
            scratch: self.scratch.clone(),
            ..defaults
        }
    }
}
