//! A store's first page: what the file is, and where its parts are (FORMAT.md, "File").
//!
//! It is written twice: zeroed places when the file is made, the real ones when everything else is
//! durable. So a file with an index is whole, and one without was never finished.

use crate::metadata::FORMAT_VERSION;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use twox_hash::XxHash3_64;

/// Bytes of the first page; the payload stream begins after it.
pub(crate) const SUPERBLOCK_BYTES: u64 = 4096;
/// What a store begins with. The odd bytes show a file that was carried as text.
const MAGIC: [u8; 8] = *b"OCTAVO\r\n";
/// Bytes that are in use, checksum included.
const USED: usize = 48;

/// Where a store's parts are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Superblock {
    /// The version of the layout.
    pub(crate) version: u32,
    /// Bytes of the payload stream, from [`SUPERBLOCK_BYTES`] on.
    pub(crate) payload_bytes: u64,
    /// Where the index begins; 0 in an unfinished store.
    pub(crate) index_offset: u64,
    /// Bytes of the index, with which the file ends.
    pub(crate) index_bytes: u64,
}

/// Why a first page cannot be used.
#[derive(Debug)]
pub(crate) enum SuperblockError {
    /// The system refuses to read it.
    Io(io::Error),
    /// The file is something else.
    NotAStore(&'static str),
    /// Its layout is newer.
    Newer(u32),
    /// It is the first page of a store, and wrong.
    Damaged(&'static str),
}

impl Superblock {
    /// The place of an index that follows so many bytes of payload: the next whole page.
    pub(crate) fn index_offset_after(payload_bytes: u64) -> u64 {
        (SUPERBLOCK_BYTES + payload_bytes).next_multiple_of(SUPERBLOCK_BYTES)
    }

    fn to_bytes(self) -> [u8; SUPERBLOCK_BYTES as usize] {
        let mut bytes = [0; SUPERBLOCK_BYTES as usize];
        bytes[0..8].copy_from_slice(&MAGIC);
        bytes[8..12].copy_from_slice(&self.version.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.payload_bytes.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.index_offset.to_le_bytes());
        bytes[32..40].copy_from_slice(&self.index_bytes.to_le_bytes());
        let checksum = XxHash3_64::oneshot(&bytes[..40]);
        bytes[40..USED].copy_from_slice(&checksum.to_le_bytes());
        bytes
    }

    /// Writes the first page.
    pub(crate) fn write(self, file: &File) -> io::Result<()> {
        file.write_all_at(&self.to_bytes(), 0)
    }

    /// The first page of a store that is being made.
    pub(crate) fn unfinished() -> Self {
        Self { version: FORMAT_VERSION, ..Self::default() }
    }

    /// Reads the first page.
    pub(crate) fn read(file: &File) -> Result<Self, SuperblockError> {
        let metadata = file.metadata().map_err(SuperblockError::Io)?;
        if metadata.is_dir() {
            return Err(SuperblockError::NotAStore("it is a folder"));
        }
        let mut bytes = [0; USED];
        let there = bytes.len().min(metadata.len() as usize);
        file.read_exact_at(&mut bytes[..there], 0).map_err(SuperblockError::Io)?;
        if there == 0 {
            return Err(SuperblockError::NotAStore("it is an empty file"));
        }
        if there < USED || bytes[0..8] != MAGIC {
            return Err(SuperblockError::NotAStore("it does not begin as a store does"));
        }
        let u32_at =
            |at: usize| bytes[at..at + 4].iter().rev().fold(0, |v, &b| v << 8 | u32::from(b));
        let u64_at =
            |at: usize| bytes[at..at + 8].iter().rev().fold(0, |v, &b| v << 8 | u64::from(b));
        let version = u32_at(8);
        if u64_at(40) != XxHash3_64::oneshot(&bytes[..40]) {
            return Err(SuperblockError::Damaged("its first page fails its checksum"));
        }
        if version > FORMAT_VERSION {
            return Err(SuperblockError::Newer(version));
        }
        Ok(Self {
            version,
            payload_bytes: u64_at(16),
            index_offset: u64_at(24),
            index_bytes: u64_at(32),
        })
    }

    /// Whether the parts lie where the file's length puts them.
    pub(crate) fn fits(&self, file_bytes: u64) -> bool {
        self.index_offset.checked_add(self.index_bytes) == Some(file_bytes)
            && self.payload_bytes <= self.index_offset
            && Self::index_offset_after(self.payload_bytes) == self.index_offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_of(bytes: &[u8]) -> File {
        let file = tempfile::tempfile().unwrap();
        file.write_all_at(bytes, 0).unwrap();
        file
    }

    #[test]
    fn it_reads_as_written_and_shows_any_change() {
        let written =
            Superblock { payload_bytes: 70_000, index_offset: 77_824, index_bytes: 9, version: 0 };
        let bytes = written.to_bytes();
        assert_eq!(Superblock::read(&file_of(&bytes)).unwrap(), written);
        assert!(written.fits(77_833) && !written.fits(77_832));
        assert_eq!(Superblock::index_offset_after(70_000), 77_824);
        for at in 0..USED {
            let mut changed = bytes;
            changed[at] ^= 4;
            let read = Superblock::read(&file_of(&changed));
            match at {
                0..8 => assert!(matches!(read, Err(SuperblockError::NotAStore(_)))),
                _ => assert!(matches!(read, Err(SuperblockError::Damaged(_))), "byte {at}"),
            }
        }
        assert!(matches!(
            Superblock::read(&file_of(&bytes[..20])),
            Err(SuperblockError::NotAStore(_))
        ));
    }

    #[test]
    fn a_later_layout_is_told_from_a_damaged_one() {
        let bytes = Superblock { version: FORMAT_VERSION + 1, ..Superblock::default() }.to_bytes();
        assert!(matches!(Superblock::read(&file_of(&bytes)), Err(SuperblockError::Newer(_))));
    }
}
