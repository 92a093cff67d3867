//! What to serve, to whom, and within which limits.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;
use subtle::ConstantTimeEq;
use thiserror::Error;

/// How a server is to behave.
#[derive(Debug, Clone)]
pub struct Options {
    /// Stores, and folders whose stores are served.
    pub stores: Vec<PathBuf>,
    /// Where to listen.
    pub bind: SocketAddr,
    /// What a client must show; none: whoever reaches the address may read.
    pub token: Option<Token>,
    /// Allows an address that others can reach without a token.
    pub insecure_no_token: bool,
    /// How chunks of zarr arrays are compressed.
    pub compressor: Compressor,
    /// Bytes of answers that are kept ready.
    pub cache_bytes: u64,
    /// How often folders and stores are looked at for changes.
    pub rescan: Duration,
    /// What a client can make the server do at most.
    pub limits: Limits,
}

impl Options {
    /// Serves these stores on the loopback address, port 8642.
    pub fn new(stores: Vec<PathBuf>) -> Self {
        Self {
            stores,
            bind: SocketAddr::from(([127, 0, 0, 1], 8642)),
            token: None,
            insecure_no_token: false,
            compressor: Compressor::None,
            cache_bytes: 256 << 20,
            rescan: Duration::from_secs(2),
            limits: Limits::default(),
        }
    }

    /// Whether the address may be served with the token there is.
    pub(crate) fn check(&self) -> Result<(), OptionsError> {
        if self.bind.ip().is_loopback() || self.token.is_some() || self.insecure_no_token {
            Ok(())
        } else {
            Err(OptionsError::OpenToAll { bind: self.bind })
        }
    }
}

/// Bounds on what clients can make the server do.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Bytes of a request's body.
    pub body_bytes: usize,
    /// Bytes of bodies that are under way, of all requests together.
    pub all_body_bytes: u64,
    /// Bytes of answers that clients have not taken yet, of all together.
    pub answer_bytes: u64,
    /// Requests that are worked on at once.
    pub requests: usize,
    /// Keys in a request's list.
    pub list_keys: usize,
    /// Samples of a slice: a larger one is to be asked for at a coarser level.
    pub slice_samples: u64,
    /// Bytes of a request's head.
    pub head_bytes: usize,
    /// From a request's head until its answer begins.
    pub request_time: Duration,
    /// In which a request's head must be there; a connection may be idle for so long.
    pub head_time: Duration,
    /// For which a client may take no byte of an answer; of a long one it must take 64 KiB a second.
    pub stall_time: Duration,
    /// Within which a stream of frames must be taken.
    pub stream_time: Duration,
    /// Connections at once.
    pub connections: usize,
    /// Bricks that are decoded at once.
    pub decodes: usize,
    /// Stores whose files are open at once; each keeps up to 8 MiB of records.
    pub open_stores: usize,
    /// Requests that may wait to decode.
    pub waiting: usize,
    /// Streams of frames at once.
    pub streams: usize,
    /// For which open requests are waited for when the server is to stop.
    pub drain_time: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            body_bytes: 1 << 20,
            all_body_bytes: 64 << 20,
            answer_bytes: 256 << 20,
            requests: 4096,
            list_keys: 16_384,
            slice_samples: 1 << 24,
            head_bytes: 16 << 10,
            request_time: Duration::from_secs(30),
            head_time: Duration::from_secs(30),
            stall_time: Duration::from_secs(30),
            stream_time: Duration::from_mins(10),
            connections: 2048,
            decodes: std::thread::available_parallelism().map_or(2, usize::from),
            open_stores: 32,
            waiting: 512,
            streams: 64,
            drain_time: Duration::from_secs(10),
        }
    }
}

/// How chunks of zarr arrays are compressed. Neuroglancer's precomputed chunks are always plain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Compressor {
    /// Not at all: what costs least on a loopback or a fast network.
    #[default]
    None,
    /// Zstandard, level 1: higher ones search for matches that noise does not have.
    Zstd,
    /// Blosc with LZ4, bytes of samples shuffled.
    BloscLz4,
}

/// The level of [`Compressor::Zstd`].
pub(crate) const ZSTD_LEVEL: i32 = 1;

/// A secret that clients show, as `Authorization: Bearer TOKEN` or as the cookie `octavo_token`.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// A token from the text of its file; white space around it does not count.
    ///
    /// # Errors
    /// When it is shorter than 16 characters, or has one that cannot stand in a header.
    pub fn new(text: &str) -> Result<Self, OptionsError> {
        let text = text.trim();
        let plain = |c: char| c.is_ascii_alphanumeric() || "-._~+/=".contains(c);
        if text.len() < 16 || text.len() > 512 || !text.chars().all(plain) {
            return Err(OptionsError::Token);
        }
        Ok(Self(text.to_owned()))
    }

    /// Whether these are the token's bytes, in a time that does not tell how many of them are right.
    pub(crate) fn is(&self, shown: &[u8]) -> bool {
        // Hashes have one length, so the token's own does not show either.
        let [own, shown] = [self.0.as_bytes(), shown].map(blake3::hash);
        own.as_bytes().ct_eq(shown.as_bytes()).into()
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(…)")
    }
}

/// Why options cannot be used.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum OptionsError {
    /// An address that others can reach, without a token.
    #[error(
        "{bind} can be reached from other machines, and no token was given: give a token file, or say that \
        everybody may read with --insecure-no-token"
    )]
    OpenToAll {
        /// The address.
        bind: SocketAddr,
    },
    /// A token that is none.
    #[error("a token must have 16 to 512 characters, each a letter, a digit or one of -._~+/=")]
    Token,
}
