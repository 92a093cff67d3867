//! The slices of a level that are needed now: a queue of chunks of z slices.
//!
//! Bricking a level in order of z needs only as many slices as two rows of bricks and their overlap.
//! So a level above the source never exists as a whole: its slices come from the level below, are
//! bricked, and go. That keeps scratch at a few slices a level instead of an eighth of the source.
//! A chunk lives in memory, or in an unnamed mapped file where memory is too dear.

use crate::source::map::ScratchMap;
use octree_store::Sample;
use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;

/// Where a window keeps its chunks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum WindowPlace {
    /// In memory.
    Memory,
    /// In unnamed files of this folder.
    Scratch(PathBuf),
}

/// Some consecutive z slices of a level, `chunk` slices at a time.
#[derive(Debug)]
pub(crate) struct Window<T> {
    dims_xyz: [u64; 3],
    chunk: u64,
    place: WindowPlace,
    /// The chunks present, the first being chunk number `first`.
    chunks: VecDeque<Chunk<T>>,
    first: u64,
    /// Chunks that are done with, to be filled again.
    spare: Vec<Chunk<T>>,
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
    /// An empty window of a level of `dims_xyz` voxels, in chunks of `chunk` slices.
    pub(crate) fn new(dims_xyz: [u64; 3], chunk: u64, place: WindowPlace) -> Self {
        Self { dims_xyz, chunk, place, chunks: VecDeque::new(), first: 0, spare: Vec::new() }
    }

    /// Samples of a chunk: the last one may have fewer slices, but gets as much room.
    pub(crate) fn chunk_samples(dims_xyz: [u64; 3], chunk: u64) -> u64 {
        dims_xyz[0] * dims_xyz[1] * chunk.min(dims_xyz[2])
    }

    /// Slices present from the first slice of the level on.
    pub(crate) fn slices(&self) -> u64 {
        ((self.first + self.chunks.len() as u64) * self.chunk).min(self.dims_xyz[2])
    }

    /// A chunk to be filled and given back to [`Window::push`].
    pub(crate) fn blank(&mut self) -> io::Result<Chunk<T>> {
        if let Some(chunk) = self.spare.pop() {
            return Ok(chunk);
        }
        let samples = Self::chunk_samples(self.dims_xyz, self.chunk) as usize;
        let storage = match &self.place {
            WindowPlace::Memory => Storage::Memory(vec![T::default(); samples]),
            WindowPlace::Scratch(folder) => {
                Storage::Scratch(ScratchMap::new(folder, (samples * size_of::<T>()) as u64)?)
            }
        };
        Ok(Chunk { storage, samples })
    }

    /// Adds the next chunk.
    pub(crate) fn push(&mut self, chunk: Chunk<T>) {
        self.chunks.push_back(chunk);
    }

    /// A chunk that is done with, if there is one.
    pub(crate) fn take_spare(&mut self) -> Option<Chunk<T>> {
        self.spare.pop()
    }

    /// Lets go of the chunks that lie wholly before slice `z`.
    pub(crate) fn drop_before(&mut self, z: u64) {
        while !self.chunks.is_empty() && (self.first + 1) * self.chunk <= z {
            self.spare.extend(self.chunks.pop_front());
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
    fn slices_come_back_from_memory_and_from_scratch() {
        let folder = tempfile::tempdir().unwrap();
        for place in [WindowPlace::Memory, WindowPlace::Scratch(folder.path().to_owned())] {
            let mut window = Window::<u16>::new([3, 2, 9], 2, place);
            for number in 0..5 {
                let mut chunk = window.blank().unwrap();
                for (i, sample) in chunk.samples_mut().iter_mut().enumerate() {
                    *sample = (number * 12 + i) as u16;
                }
                window.push(chunk);
                window.drop_before(2 * number as u64);
                assert_eq!(window.slices(), (2 * number as u64 + 2).min(9));
                let z = 2 * number as u64;
                assert_eq!(window.row(1, z)[0], (number * 12 + 3) as u16);
            }
            assert!(window.spare.len() <= 1, "chunks are used again");
        }
    }
}
