//! `octavo serve`: stores over HTTP.

mod pictures;

use super::render::Drawer;
use crate::exit::Answer;
use crate::parse;
use anyhow::Context;
use clap::{Args, ValueEnum};
use octree_store::StoreError;
use pictures::Pictures;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serve::{Compressor, Options, ServeError, Server, Token, neuroglancer_link};
use std::future::Future;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Notify;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

/// Serve stores over HTTP: bricks for renderers, OME-Zarr and Neuroglancer for viewers, a web page
///
/// Folders are looked at again and again: stores may come, go and be replaced meanwhile. Without a token it
/// answers on this machine only. Ends cleanly on Ctrl-C.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo serve tooth.octavo\n  \
    octavo serve scans/ --bind 0.0.0.0:8642 --token-file token.txt --access-log")]
pub(super) struct Serve {
    /// Stores, and folders of stores
    #[arg(required = true, value_name = "STORE|DIR")]
    stores: Vec<PathBuf>,
    /// Address and port; port 0 takes any that is free
    #[arg(long, default_value = "127.0.0.1:8642", value_name = "ADDRESS:PORT")]
    bind: SocketAddr,
    /// File with the token that clients must show; needed where other machines can reach the address
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Let everybody read who can reach the address
    #[arg(long)]
    insecure_no_token: bool,
    /// How chunks of zarr arrays are compressed
    #[arg(long, value_enum, default_value_t)]
    compressor: CompressorName,
    /// Memory for answers that are kept ready
    #[arg(long, default_value = "256MiB", value_name = "SIZE", value_parser = parse::size)]
    cache: u64,
    /// Seconds between looks at folders and stores
    #[arg(long, default_value_t = 2.0, value_name = "SECONDS")]
    rescan: f64,
    /// Connections at once
    #[arg(long, default_value_t = 2048, value_name = "N")]
    connections: usize,
    /// Bricks decoded at once (default: one a processor)
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Who draws pictures for the 3-D view
    #[arg(long, value_enum, default_value_t)]
    renderer: Drawer,
    /// Write a line of JSON for every request to standard error
    #[arg(long)]
    access_log: bool,
}

#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum CompressorName {
    #[default]
    None,
    Zstd,
    BloscLz4,
}

impl Serve {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        for store in &self.stores {
            std::fs::metadata(store).map_err(|source| unreadable(store, source))?;
        }
        let mut options = self.options()?;
        self.log();
        let limits = &mut options.limits;
        limits.connections = room_for(limits.connections, limits.open_stores);
        // Half the processors move bytes: bricks are decoded on threads of their own, and clients near by want a processor too.
        let movers = std::thread::available_parallelism().map_or(1, |all| all.get().div_ceil(2));
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(movers)
            .enable_all()
            .build()
            .context("threads cannot be started")?;
        runtime.block_on(async {
            let renderer = (self.renderer != Drawer::None)
                .then(|| Arc::new(Pictures::new(self.renderer)) as Arc<dyn serve::Renderer>);
            let server = Server::bind(options, renderer).await.map_err(|error| match error {
                ServeError::Options(error) => anyhow::Error::new(error),
                ServeError::Bind { bind, source } => {
                    anyhow::Error::new(source).context(format!("{bind} cannot be listened on"))
                }
            })?;
            // Who started it may have stopped listening; it serves all the same.
            let _ = announce(&server);
            server.run(stopped()?).await;
            anyhow::Ok(())
        })?;
        Ok(Answer::Done)
    }

    fn options(&self) -> anyhow::Result<Options> {
        let mut options = Options::new(self.stores.clone());
        options.bind = self.bind;
        options.insecure_no_token = self.insecure_no_token;
        options.cache_bytes = self.cache;
        options.rescan = Duration::try_from_secs_f64(self.rescan.max(0.1)).context("--rescan")?;
        options.limits.connections = self.connections;
        if let Some(threads) = self.threads {
            options.limits.decodes = threads.max(1);
        }
        options.compressor = match self.compressor {
            CompressorName::None => Compressor::None,
            CompressorName::Zstd => Compressor::Zstd,
            CompressorName::BloscLz4 => Compressor::BloscLz4,
        };
        if let Some(file) = &self.token_file {
            let text = std::fs::read_to_string(file).map_err(|source| unreadable(file, source))?;
            let token = Token::new(&text).with_context(|| file.display().to_string())?;
            options.token = Some(token);
        }
        Ok(options)
    }

    /// Events as lines of JSON on standard error: what goes wrong, and requests where they are wanted.
    fn log(&self) {
        let access = tracing::Level::INFO;
        let warning = tracing::Level::WARN;
        let mut targets = Targets::new().with_targets([("octavo", warning), ("serve", warning)]);
        if self.access_log {
            targets = targets.with_target("octavo::access", access);
        }
        let lines = tracing_subscriber::fmt::layer()
            .json()
            .flatten_event(true)
            .with_writer(io::stderr)
            .with_filter(targets);
        // Where a log was set up before, that one stays.
        let _ = tracing_subscriber::registry().with(lines).try_init();
    }
}

/// Files that the server may have open beside connections and stores.
const OTHER_FILES: usize = 64;

/// How many connections of so many the system lets it have open beside its stores: without files to spare it could look
/// at no folder and open no store.
fn room_for(connections: usize, open_stores: usize) -> usize {
    let all = getrlimit(Resource::Nofile).maximum;
    // Shells mostly give a part of what they may.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: all, maximum: all });
    let Some(files) = getrlimit(Resource::Nofile).current else { return connections };
    let files = usize::try_from(files).unwrap_or(usize::MAX);
    let room = files.saturating_sub(open_stores + OTHER_FILES).max(1);
    if room < connections {
        tracing::warn!(connections = room, files, "fewer connections: so many files may be open");
    }
    connections.min(room)
}

/// The error for a file that was named and cannot be read.
fn unreadable(path: &Path, source: io::Error) -> StoreError {
    StoreError::Io { path: path.to_owned(), source }
}

/// Says where to look.
fn announce(server: &Server) -> io::Result<()> {
    let base = format!("http://{}", server.address());
    let mut out = io::stdout().lock();
    writeln!(out, "{base}/")?;
    for (name, state) in server.datasets() {
        // A line a dataset, whatever a file is called.
        let shown = name.replace(char::is_control, "\u{fffd}");
        match state {
            Ok(range) => writeln!(out, "{shown}: {}", neuroglancer_link(&base, &name, range))?,
            Err(problem) => writeln!(out, "{shown}: {problem}")?,
        }
    }
    out.flush()
}

/// Done when the user or the system asks the program to end.
fn stopped() -> anyhow::Result<impl Future<Output = ()>> {
    let notify = Arc::new(Notify::new());
    let told = Arc::clone(&notify);
    ctrlc::set_handler(move || notify.notify_one()).context("signals cannot be caught")?;
    Ok(async move { told.notified().await })
}
