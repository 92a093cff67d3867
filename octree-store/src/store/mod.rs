//! The store: one file of a first page, the payloads, and a table of records between two copies of the metadata
//! (FORMAT.md).
//!
//! Payloads form an append-only byte stream that is read in place; a record's place in the table is its node's
//! rank, so that those of eight siblings are one read. While a store is made its records are in a database of
//! their own, redb: `tables.rs` alone names its tables, and `guard.rs` turns its panics into errors.

mod assemble;
mod committer;
mod finish;
mod guard;
mod mend;
mod open;
mod payload_file;
mod reader;
mod record_table;
mod records;
mod remains;
mod superblock;
mod tables;
mod texels;
mod work_backend;
mod writer;

pub use mend::Mender;
pub use reader::{BrickScratch, Children, Store};
pub use writer::{Committed, StoreWriter};
