//! The slices of a decoded source or store that are needed now: a queue of chunks of z slices, in
//! memory or in an unnamed mapped file.

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
    Unnamed(PathBuf),
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
    spare: VecDeque<Chunk<T>>,
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
    /// An empty window of `dims_xyz` voxels, in chunks of `chunk` slices.
    pub(crate) fn new(dims_xyz: [u64; 3], chunk: u64, place: WindowPlace) -> Self {
        let (chunks, spare) = (VecDeque::new(), VecDeque::new());
        Self { dims_xyz, chunk, place, chunks, first: 0, spare }
    }

    /// Samples of a chunk: the last one may have fewer slices, but gets as much room.
    pub(crate) fn chunk_samples(dims_xyz: [u64; 3], chunk: u64) -> u64 {
        dims_xyz[0] * dims_xyz[1] * chunk.min(dims_xyz[2])
    }

    /// Slices present from the first slice of the level on.
    pub(crate) fn slices(&self) -> u64 {
        ((self.first + self.chunks.len() as u64) * self.chunk).min(self.dims_xyz[2])
    }

    /// A new chunk, to be filled and given to [`Window::push`].
    ///
    /// # Errors
    /// When scratch space cannot be had.
    pub(crate) fn blank(&self) -> io::Result<Chunk<T>> {
        let samples = Self::chunk_samples(self.dims_xyz, self.chunk) as usize;
        let storage = match &self.place {
            WindowPlace::Unnamed(folder) => {
                Storage::Scratch(ScratchMap::new(folder, (samples * size_of::<T>()) as u64)?)
            }
            WindowPlace::Memory => Storage::Memory(vec![T::default(); samples]),
        };
        Ok(Chunk { storage, samples })
    }

    /// Adds the next chunk.
    pub(crate) fn push(&mut self, chunk: Chunk<T>) {
        self.chunks.push_back(chunk);
    }

    /// A chunk that is done with, if there is one.
    pub(crate) fn take_spare(&mut self) -> Option<Chunk<T>> {
        self.spare.pop_front()
    }

    /// Begins an empty window at a later chunk than the first.
    pub(crate) fn begin_at(&mut self, chunk: u64) {
        self.first = chunk;
    }

    /// Lets go of the chunks that lie wholly before slice `z`.
    pub(crate) fn drop_before(&mut self, z: u64) {
        while (self.first + 1) * self.chunk <= z {
            let Some(chunk) = self.chunks.pop_front() else { break };
            self.spare.push_back(chunk);
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
        for place in [WindowPlace::Memory, WindowPlace::Unnamed(folder.path().to_owned())] {
            let mut window = Window::<u16>::new([3, 2, 9], 2, place);
            for number in 0..5 {
                let mut chunk = match window.take_spare() {
                    Some(chunk) => chunk,
                    None => window.blank().unwrap(),
                };
                for (i, sample) in chunk.samples_mut().iter_mut().enumerate() {
                    *sample = (number * 12 + i) as u16;
                }
                window.push(chunk);
                window.drop_before(2 * number as u64);
                assert_eq!(window.slices(), (2 * number as u64 + 2).min(9));
                assert_eq!(window.row(1, 2 * number as u64)[0], (number * 12 + 3) as u16);
            }
            assert!(window.spare.len() <= 2, "chunks are used again");
        }
    }
}
