//! The store: payloads, records and metadata in one redb file.
//!
//! Payloads form an append-only byte stream cut into pages of [`PAGE_BYTES`], each one redb value,
//! so that redb's rounding to powers of two costs nothing; the records of eight siblings are one
//! value keyed by their parent, so that refining a node is one read. `tables.rs` alone names redb's
//! tables, and `guard.rs` turns redb's panics on damaged files into errors.

mod guard;
mod reader;
mod tables;
mod writer;

pub use reader::{BrickScratch, Children, OpenOptions, Store};
pub use writer::StoreWriter;

/// Bytes of a page of the payload stream: with redb's 16 bytes of leaf it fills 16 KiB.
pub(crate) const PAGE_BYTES: usize = 16 * 1024 - 16;

/// The redb key of a page: the stream in the top 16 bits, the page number below.
fn page_key(stream: u16, page: u64) -> u64 {
    u64::from(stream) << 48 | page
}
