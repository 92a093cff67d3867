//! Memory maps: sources that are read anywhere, and scratch that need not fit memory.
#![allow(unsafe_code, reason = "mapping a file is unsafe by nature: another process may change it")]

use bytemuck::Pod;
use memmap2::{Mmap, MmapMut, MmapOptions};
use octree_store::DiskFile;
use std::fs::File;
use std::io;
use std::path::Path;

/// Maps a whole file for reading.
///
/// # Errors
/// When the file cannot be opened or mapped.
pub(crate) fn map_file(path: &Path) -> io::Result<Mmap> {
    let file = File::open(path)?;
    // SAFETY: the map is read only as plain bytes, of which every value is valid. A program that
    // shortens the file meanwhile ends this one by SIGBUS, as with every mapped reader; one that
    // writes into it changes samples, which `verify --against` would find.
    unsafe { Mmap::map(&file) }
}

/// Samples in an unnamed file, mapped: they count as file pages, and leave when it is dropped.
#[derive(Debug)]
pub(crate) struct ScratchMap(MmapMut);

impl ScratchMap {
    /// Room for `bytes` bytes, zeroed, in a new unnamed file of `folder`. The blocks are taken
    /// now, so that a full disk shows here and not as a signal later.
    pub(crate) fn new(folder: &Path, bytes: u64) -> io::Result<Self> {
        let file = unnamed_file(folder, bytes)?;
        // SAFETY: the file has no name, so no other process can change or shorten it.
        unsafe { MmapMut::map_mut(file.file()) }.map(Self)
    }

    /// The first `count` samples.
    pub(crate) fn samples<T: Pod>(&self, count: usize) -> &[T] {
        bytemuck::cast_slice(&self.0[..count * size_of::<T>()])
    }

    /// The first `count` samples, to be written.
    pub(crate) fn samples_mut<T: Pod>(&mut self, count: usize) -> &mut [T] {
        bytemuck::cast_slice_mut(&mut self.0[..count * size_of::<T>()])
    }
}

/// A new unnamed file of `bytes` zeros in a folder, whose blocks are all taken.
pub(crate) fn unnamed_file(folder: &Path, bytes: u64) -> io::Result<DiskFile> {
    let file = DiskFile::from(tempfile::tempfile_in(folder)?);
    file.take_blocks(bytes.max(1))?;
    Ok(file)
}

/// Maps `bytes` bytes of a scratch file from `offset` on, for reading.
pub(crate) fn map_range(file: &File, offset: u64, bytes: u64) -> io::Result<Mmap> {
    // SAFETY: the file is this process's own. It writes a part of the file only while nobody reads
    // that part through the map. Another program that shortens the file ends this one by SIGBUS, as with
    // every mapped file.
    unsafe { MmapOptions::new().offset(offset).len(bytes as usize).map(file) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scratch_starts_at_zero_and_keeps_what_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut scratch = ScratchMap::new(folder.path(), 24).unwrap();
        assert_eq!(scratch.samples::<u16>(12), [0; 12]);
        scratch.samples_mut::<f64>(3)[2] = 1.5;
        assert_eq!(scratch.samples::<f64>(3), [0.0, 0.0, 1.5]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "it has no name");
    }

    #[test]
    fn scratch_that_does_not_fit_the_disk_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(ScratchMap::new(folder.path(), 1 << 60).is_err());
    }
}
