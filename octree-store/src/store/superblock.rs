//! A store's first page: what the file is, and where its parts are (FORMAT.md, "File").
//!
//! It is written twice: zeroed places when the file is made, the real ones when everything else is
//! durable. So a file with an index is whole, and one without was never finished.

use crate::disk::DiskFile;
use crate::metadata::FORMAT_VERSION;
use std::io;
use twox_hash::XxHash3_64;

/// Bytes of the first page; the payload stream begins after it.
pub(crate) const SUPERBLOCK_BYTES: u64 = 4096;
/// What a store begins with. The odd bytes show a file that was carried as text.
const MAGIC: [u8; 8] = *b"OCTAVO\r\n";
/// Bytes that are in use, checksum included.
const USED: usize = 48;
/// Features that a reader must know, a bit each: this version has none of them.
const KNOWN_FEATURES: u32 = 0;

/// Where a store's parts are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Superblock {
    /// The version of the layout.
    pub(crate) version: u32,
    /// Bytes of the payload stream, from [`SUPERBLOCK_BYTES`] on.
    pub(crate) payload_bytes: u64,
    /// Where the index, the table of records, begins; 0 in an unfinished store.
    pub(crate) index_offset: u64,
    /// Bytes of the index.
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
    /// Its layout is that of a draft.
    Older(u32),
    /// It needs features that this version has not.
    Features(u32),
    /// It is the first page of a store, and wrong.
    Damaged(&'static str),
}

impl Superblock {
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
    pub(crate) fn write(self, file: &DiskFile) -> io::Result<()> {
        file.write_all_at(&self.to_bytes(), 0)
    }

    /// The first page of a store that is being made.
    pub(crate) fn unfinished() -> Self {
        Self { version: FORMAT_VERSION, ..Self::default() }
    }

    /// Reads the first page.
    pub(crate) fn read(file: &DiskFile) -> Result<Self, SuperblockError> {
        let metadata = file.file().metadata().map_err(SuperblockError::Io)?;
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
        if version < FORMAT_VERSION {
            return Err(SuperblockError::Older(version));
        }
        let unknown = u32_at(12) & !KNOWN_FEATURES;
        if unknown != 0 {
            return Err(SuperblockError::Features(unknown));
        }
        Ok(Self {
            version,
            payload_bytes: u64_at(16),
            index_offset: u64_at(24),
            index_bytes: u64_at(32),
        })
    }

    /// Where the metadata frame begins: at the first page behind the payloads.
    pub(crate) fn metadata_offset(&self) -> u64 {
        page_after(self.payload_bytes.saturating_add(SUPERBLOCK_BYTES))
    }

    /// Where the metadata frame begins once more: at the first page behind the index.
    pub(crate) fn copy_offset(&self) -> u64 {
        page_after(self.index_offset.saturating_add(self.index_bytes))
    }

    /// Whether the parts lie in order, and their places are in a file of so many bytes.
    pub(crate) fn fits(&self, file_bytes: u64) -> bool {
        self.metadata_offset() < self.index_offset
            && self.index_offset.is_multiple_of(SUPERBLOCK_BYTES)
            && self.copy_offset() < file_bytes
    }
}

/// The first place at a page's edge from a byte on.
fn page_after(byte: u64) -> u64 {
    byte.checked_next_multiple_of(SUPERBLOCK_BYTES).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_of(bytes: &[u8]) -> DiskFile {
        let file = DiskFile::from(tempfile::tempfile().unwrap());
        file.write_all_at(bytes, 0).unwrap();
        file
    }

    #[test]
    fn it_reads_as_written_and_shows_any_change() {
        let written =
            Superblock { payload_bytes: 70_000, index_offset: 81_920, index_bytes: 9, version: 1 };
        let bytes = written.to_bytes();
        assert_eq!(Superblock::read(&file_of(&bytes)).unwrap(), written);
        assert_eq!((written.metadata_offset(), written.copy_offset()), (77_824, 86_016));
        assert!(written.fits(86_017) && !written.fits(86_016));
        for index_offset in [77_824, 73_728, 80_000, u64::MAX, u64::MAX - 4095] {
            let moved = Superblock { index_offset, ..written };
            assert!(!moved.fits(u64::MAX), "{index_offset}");
        }
        assert!(!Superblock { index_bytes: u64::MAX, ..written }.fits(u64::MAX));
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
    fn a_later_layout_and_a_draft_are_told_from_a_damaged_one() {
        let bytes = Superblock { version: FORMAT_VERSION + 1, ..Superblock::default() }.to_bytes();
        assert!(matches!(Superblock::read(&file_of(&bytes)), Err(SuperblockError::Newer(2))));
        let bytes = Superblock::default().to_bytes();
        assert!(matches!(Superblock::read(&file_of(&bytes)), Err(SuperblockError::Older(0))));
    }

    #[test]
    fn a_feature_that_must_be_known_and_is_not_is_refused() {
        let mut bytes = Superblock::unfinished().to_bytes();
        bytes[14] = 1;
        let checksum = XxHash3_64::oneshot(&bytes[..40]);
        bytes[40..USED].copy_from_slice(&checksum.to_le_bytes());
        let read = Superblock::read(&file_of(&bytes));
        assert!(matches!(read, Err(SuperblockError::Features(0x1_0000))), "{read:?}");
    }
}
