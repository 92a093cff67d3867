//! redb in a part of a file: the index at the end of a store, of which the payload is the rest.

use redb::StorageBackend;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::Arc;

/// The part of a file from a byte on to its end, as redb's storage.
#[derive(Debug)]
pub(super) struct IndexBackend {
    file: Arc<File>,
    offset: u64,
    /// The part's length where it is fixed: then it is read only.
    length: Option<u64>,
}

impl IndexBackend {
    /// A part that is read only.
    pub(super) fn reading(file: Arc<File>, offset: u64, length: u64) -> Self {
        Self { file, offset, length: Some(length) }
    }

    /// The end of a file, which grows and shrinks with what redb does.
    pub(super) fn writing(file: Arc<File>, offset: u64) -> Self {
        Self { file, offset, length: None }
    }

    fn writable(&self) -> io::Result<()> {
        match self.length {
            None => Ok(()),
            Some(_) => Err(io::Error::new(io::ErrorKind::ReadOnlyFilesystem, "opened for reading")),
        }
    }
}

impl StorageBackend for IndexBackend {
    fn len(&self) -> io::Result<u64> {
        match self.length {
            Some(length) => Ok(length),
            None => Ok(self.file.metadata()?.len().saturating_sub(self.offset)),
        }
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        let end = offset.checked_add(out.len() as u64);
        if self.length.is_some_and(|length| end.is_none_or(|end| end > length)) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.file.read_exact_at(out, self.offset + offset)
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.writable()?;
        self.file.set_len(self.offset + len)
    }

    /// Does nothing: the file is no store before its first page says so, and all of it is synced before
    /// that is written.
    fn sync_data(&self) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.writable()?;
        self.file.write_all_at(data, self.offset + offset)
    }
}
