//! The slices of a level that are needed now: a queue of chunks of z slices.
//!
//! Bricking a level in order of z needs only as many slices as two rows of bricks and their overlap.
//! So a level above the source never exists as a whole: its slices come from the level below, are
//! bricked, and go. That keeps scratch at a few slices a level instead of an eighth of the source.
//!
//! A chunk lives in memory, in an unnamed mapped file, or in a slot of the scratch file of a
//! conversion that can be resumed: chunk c in slot c modulo their number, so that one who resumes
//! finds it again.

use crate::source::map::{ScratchMap, map_slot};
use octree_store::Sample;
use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

/// Where a window keeps its chunks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum WindowPlace {
    /// In memory.
    Memory,
    /// In unnamed files of this folder.
    Unnamed(PathBuf),
    /// In slots of the scratch file.
    Slots(Slots),
}

/// Slots of a scratch file, one after the other, each with room for a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Slots {
    /// Where the first one begins.
    pub(crate) offset: u64,
    /// How many there are.
    pub(crate) count: u64,
}

impl Slots {
    /// Bytes from slot to slot for chunks of so many bytes: whole pages.
    pub(crate) fn stride(chunk_bytes: u64) -> u64 {
        chunk_bytes.next_multiple_of(1 << 16)
    }

    /// Where the slot of a chunk begins.
    pub(crate) fn place_of(&self, chunk: u64, chunk_bytes: u64) -> u64 {
        self.offset + chunk % self.count * Self::stride(chunk_bytes)
    }
}

/// Some consecutive z slices of a level, `chunk` slices at a time.
#[derive(Debug)]
pub(crate) struct Window<T> {
    dims_xyz: [u64; 3],
    chunk: u64,
    place: WindowPlace,
    scratch: Option<Arc<File>>,
    /// The chunks present, the first being chunk number `first`.
    chunks: VecDeque<Chunk<T>>,
    first: u64,
    /// Chunks that are done with, to be filled again, the oldest first; each with the count of
    /// octets after which it was let go.
    spare: VecDeque<(Chunk<T>, u64)>,
    /// Chunks that were ever made.
    made: u64,
}

/// The samples of some z slices, x fastest.
#[derive(Debug)]
pub(crate) struct Chunk<T> {
    storage: Storage<T>,
    samples: usize,
}

#[derive(Debug)]
enum Storage<T> {
    Memory(Vec<T>),
    Scratch(ScratchMap),
}

impl<T: Sample> Chunk<T> {
    /// The chunk's samples.
    pub(crate) fn samples(&self) -> &[T] {
        match &self.storage {
            Storage::Memory(samples) => samples,
            Storage::Scratch(map) => map.samples(self.samples),
        }
    }

    /// The chunk's samples, to be written.
    pub(crate) fn samples_mut(&mut self) -> &mut [T] {
        match &mut self.storage {
            Storage::Memory(samples) => samples,
            Storage::Scratch(map) => map.samples_mut(self.samples),
        }
    }
}

impl<T: Sample> Window<T> {
    /// An empty window of a level of `dims_xyz` voxels, in chunks of `chunk` slices. Slots are in
    /// `scratch`.
    pub(crate) fn new(
        dims_xyz: [u64; 3],
        chunk: u64,
        place: WindowPlace,
        scratch: Option<Arc<File>>,
    ) -> Self {
        let (chunks, spare) = (VecDeque::new(), VecDeque::new());
        Self { dims_xyz, chunk, place, scratch, chunks, first: 0, spare, made: 0 }
    }

    /// Samples of a chunk: the last one may have fewer slices, but gets as much room.
    pub(crate) fn chunk_samples(dims_xyz: [u64; 3], chunk: u64) -> u64 {
        dims_xyz[0] * dims_xyz[1] * chunk.min(dims_xyz[2])
    }

    /// Slices present from the first slice of the level on.
    pub(crate) fn slices(&self) -> u64 {
        ((self.first + self.chunks.len() as u64) * self.chunk).min(self.dims_xyz[2])
    }

    /// A chunk to be filled and given back to [`Window::push`], and the count of octets after which
    /// its last content was let go, if it had any.
    pub(crate) fn blank(&mut self) -> io::Result<(Chunk<T>, Option<u64>)> {
        let all_made = match self.place {
            WindowPlace::Slots(slots) => self.made == slots.count,
            WindowPlace::Memory | WindowPlace::Unnamed(_) => !self.spare.is_empty(),
        };
        if all_made {
            let (chunk, freed_at) = self.spare.pop_front().ok_or(io::ErrorKind::OutOfMemory)?;
            return Ok((chunk, Some(freed_at)));
        }
        let samples = Self::chunk_samples(self.dims_xyz, self.chunk) as usize;
        let bytes = (samples * size_of::<T>()) as u64;
        let storage = match (&self.place, &self.scratch) {
            (WindowPlace::Unnamed(folder), _) => Storage::Scratch(ScratchMap::new(folder, bytes)?),
            (WindowPlace::Slots(slots), Some(file)) => {
                Storage::Scratch(map_slot(file, slots.place_of(self.made, bytes), bytes)?)
            }
            _ => Storage::Memory(vec![T::default(); samples]),
        };
        self.made += 1;
        Ok((Chunk { storage, samples }, None))
    }

    /// Adds the next chunk.
    pub(crate) fn push(&mut self, chunk: Chunk<T>) {
        self.chunks.push_back(chunk);
    }

    /// A chunk that is done with, if there is one.
    pub(crate) fn take_spare(&mut self) -> Option<Chunk<T>> {
        self.spare.pop_front().map(|(chunk, _)| chunk)
    }

    /// Begins an empty window at a later chunk than the first.
    pub(crate) fn begin_at(&mut self, chunk: u64) {
        self.first = chunk;
    }

    /// Lets go of the chunks that lie wholly before slice `z`, after `octets` octets.
    pub(crate) fn drop_before(&mut self, z: u64, octets: u64) {
        while (self.first + 1) * self.chunk <= z {
            let Some(chunk) = self.chunks.pop_front() else { break };
            self.spare.push_back((chunk, octets));
            self.first += 1;
        }
    }

    /// The row of voxels at (y, z), which must be present.
    #[inline]
    pub(crate) fn row(&self, y: u64, z: u64) -> &[T] {
        let chunk = &self.chunks[(z / self.chunk - self.first) as usize];
        let width = self.dims_xyz[0];
        let start = ((z % self.chunk * self.dims_xyz[1] + y) * width) as usize;
        &chunk.samples()[start..start + width as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_come_back_from_every_place() {
        let folder = tempfile::tempdir().unwrap();
        let file = Arc::new(tempfile::tempfile().unwrap());
        file.set_len(1 << 20).unwrap();
        let slots = WindowPlace::Slots(Slots { offset: 1 << 16, count: 3 });
        for place in [WindowPlace::Memory, WindowPlace::Unnamed(folder.path().to_owned()), slots] {
            let in_slots = matches!(place, WindowPlace::Slots(_));
            let mut window = Window::<u16>::new([3, 2, 9], 2, place, Some(Arc::clone(&file)));
            for number in 0..5 {
                let (mut chunk, freed_at) = window.blank().unwrap();
                if in_slots {
                    // Chunk n is let go when chunk n + 1 has come.
                    assert_eq!(freed_at, (number >= 3).then(|| number as u64 - 2));
                }
                for (i, sample) in chunk.samples_mut().iter_mut().enumerate() {
                    *sample = (number * 12 + i) as u16;
                }
                window.push(chunk);
                window.drop_before(2 * number as u64, number as u64);
                assert_eq!(window.slices(), (2 * number as u64 + 2).min(9));
                let z = 2 * number as u64;
                assert_eq!(window.row(1, z)[0], (number * 12 + 3) as u16);
                if in_slots {
                    let at = (1 << 16) + number as u64 % 3 * Slots::stride(24);
                    let slot = map_slot(&file, at, 24).unwrap();
                    assert_eq!(slot.samples::<u16>(12)[3], (number * 12 + 3) as u16);
                }
            }
            assert!(window.spare.len() <= 2, "chunks are used again");
        }
    }
}
