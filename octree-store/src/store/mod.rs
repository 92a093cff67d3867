//! The store: one file of a first page, the payloads, and an index of records and metadata (FORMAT.md).
//!
//! Payloads form an append-only byte stream that is read in place; the index behind it is a redb
//! database, in which the records of eight siblings are one value keyed by their parent, so that
//! refining a node is one read. `tables.rs` alone names redb's tables, and `guard.rs` turns redb's
//! panics on damaged files into errors.

mod assemble;
mod check_index;
mod committer;
mod finish;
mod guard;
mod index_backend;
mod mend;
mod open;
mod payload_file;
mod reader;
mod records;
mod remains;
mod superblock;
mod tables;
mod texels;
mod writer;

pub use mend::Mender;
pub use open::OpenOptions;
pub use reader::{BrickScratch, Children, Store};
pub use writer::{Committed, StoreWriter};
