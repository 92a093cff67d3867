//! redb's storage: a file of a disk.

use crate::disk::DiskFile;
use redb::StorageBackend;
use std::io;

/// A whole file. Who has it open has locked what it belongs to: it has no lock of its own.
#[derive(Debug)]
pub(super) struct WorkBackend(pub(super) DiskFile);

impl StorageBackend for WorkBackend {
    fn len(&self) -> io::Result<u64> {
        self.0.length()
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        self.0.read_exact_at(out, offset)
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.0.set_len(len)
    }

    fn sync_data(&self) -> io::Result<()> {
        self.0.sync_data()
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.0.write_all_at(data, offset)
    }
}
