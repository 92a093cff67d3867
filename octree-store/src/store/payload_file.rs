//! The payload stream on its way into the store's file, past the page cache where the system can do
//! that (`O_DIRECT`).
//!
//! Through the cache each byte is copied once more by the kernel, into pages that it must find first
//! and write back later: a third of a conversion's processor time. And a store larger than memory
//! would drive out the very source that is being read. Direct writes want whole pages at aligned
//! places in memory and file, so bytes gather in an aligned buffer. A page that is only partly filled
//! is written with zeros behind it where it must be durable, and again when it is full.

use super::superblock::SUPERBLOCK_BYTES;
use crate::disk::DiskFile;
use bytemuck::{Pod, Zeroable, cast_slice, cast_slice_mut};
use rustix::io::Errno;
use std::io;
use std::sync::Arc;

/// A page: no disk has larger blocks that a direct write must not split.
const PAGE: usize = 4096;

/// A page at a place in memory that direct writes accept.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(4096))]
struct Page([u8; PAGE]);

// The stream begins at a page's edge.
const _: () = assert!(SUPERBLOCK_BYTES.is_multiple_of(PAGE as u64));

/// Appends to the payload stream.
#[derive(Debug)]
pub(super) struct PayloadFile {
    file: Arc<DiskFile>,
    /// The same file, opened for direct writing, where the system can do that.
    direct: Option<DiskFile>,
    /// What is not yet in the file, and the page before it as far as it is filled.
    buffer: Vec<Page>,
    /// Bytes of the buffer that are filled.
    filled: usize,
    /// Of these, how many the file has already: less than a page.
    written: usize,
    /// Where the buffer begins in the stream: at a page's edge.
    start: u64,
}

impl PayloadFile {
    /// Bytes that are written at a time: large enough for a disk's full speed, and small enough that
    /// those who make payloads go on meanwhile.
    pub(super) const BUFFER_BYTES: usize = 1 << 20;

    /// Goes on after the first `bytes` bytes of the stream, which the file holds.
    pub(super) fn open(file: Arc<DiskFile>, bytes: u64) -> io::Result<Self> {
        let direct = file.open_direct();
        let filled = (bytes % PAGE as u64) as usize;
        let start = bytes - filled as u64;
        let mut buffer = Vec::new();
        if filled > 0 {
            let mut page = Page([0; PAGE]);
            file.read_exact_at(&mut page.0[..filled], SUPERBLOCK_BYTES + start)?;
            buffer.push(page);
        }
        // Taken at once: what is predicted is what is used.
        buffer.resize(Self::BUFFER_BYTES / PAGE, Page::zeroed());
        // A file system that cannot write directly is written to as usual.
        Ok(Self { file, direct: direct.ok(), buffer, filled, written: filled, start })
    }

    /// Bytes of the stream so far.
    pub(super) fn bytes(&self) -> u64 {
        self.start + self.filled as u64
    }

    /// Appends bytes; they may wait in the buffer.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(super) fn append(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            let (now, later) = bytes.split_at(bytes.len().min(Self::BUFFER_BYTES - self.filled));
            let end = self.filled + now.len();
            cast_slice_mut(&mut self.buffer)[self.filled..end].copy_from_slice(now);
            self.filled = end;
            if end == Self::BUFFER_BYTES {
                self.flush()?;
            }
            bytes = later;
        }
        Ok(())
    }

    /// Writes what is in the buffer, the last page filled up with zeros.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        if self.filled == self.written {
            return Ok(());
        }
        let pages = self.filled.div_ceil(PAGE);
        cast_slice_mut::<_, u8>(&mut self.buffer)[self.filled..pages * PAGE].fill(0);
        self.write_pages(pages)?;
        let whole = self.filled / PAGE;
        if whole < pages {
            self.buffer[0] = self.buffer[whole];
        }
        self.start += (whole * PAGE) as u64;
        self.filled -= whole * PAGE;
        self.written = self.filled;
        Ok(())
    }

    fn write_pages(&mut self, pages: usize) -> io::Result<()> {
        let bytes: &[u8] = cast_slice(&self.buffer[..pages]);
        let at = SUPERBLOCK_BYTES + self.start;
        if let Some(direct) = &self.direct {
            match direct.write_all_at(bytes, at) {
                // Some file systems say only now that they cannot.
                Err(error) if Errno::from_io_error(&error) == Some(Errno::INVAL) => {
                    self.direct = None;
                }
                written => return written,
            }
        }
        self.file.write_all_at(bytes, at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disk::Disk;
    use proptest::prelude::*;
    use std::path::Path;

    fn new_file(path: &Path) -> Arc<DiskFile> {
        Arc::new(Disk::default().create_new(path).unwrap())
    }

    proptest! {
        #[test]
        fn the_file_holds_what_was_appended_however_it_was_cut(
            lengths in proptest::collection::vec((0_usize..700_000, any::<bool>()), 1..8),
            direct in any::<bool>(), reopened_after in 0_usize..8,
        ) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("stream");
            let file = new_file(&path);
            let mut stream = PayloadFile::open(Arc::clone(&file), 0).unwrap();
            let mut expected = Vec::new();
            for (i, (length, flushed)) in lengths.into_iter().enumerate() {
                if !direct {
                    stream.direct = None;
                }
                let bytes: Vec<u8> = (0..length).map(|j| (j * 31 + i * 7 + (j >> 12)) as u8).collect();
                stream.append(&bytes).unwrap();
                expected.extend(bytes);
                prop_assert_eq!(stream.bytes(), expected.len() as u64);
                if flushed || i == reopened_after {
                    stream.flush().unwrap();
                    let found = std::fs::read(&path).unwrap();
                    prop_assert!(expected.is_empty() || found[PAGE..].starts_with(&expected));
                    prop_assert!(found.iter().skip(PAGE + expected.len()).all(|&byte| byte == 0));
                }
                if i == reopened_after {
                    stream = PayloadFile::open(Arc::clone(&file), stream.bytes()).unwrap();
                }
            }
        }
    }
}
