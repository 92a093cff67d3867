//! The slices of a level above 0 that are needed now: a queue of chunks, each of a core's slices.
//!
//! Bricking a level in order of z needs only as many slices as two rows of bricks and their overlap.
//! So a level above the source never exists as a whole: it comes from the level below, is bricked,
//! and goes. That keeps scratch at a few slices a level instead of an eighth of the source.
//!
//! Chunk c lies in slot c modulo their number of a scratch file, so that one who resumes finds it
//! again. A slot holds its chunk as *blocks*, the cores of its bricks, one after the other: a block is
//! written by the thread that made it, in one call, and read through a map. Nothing is written
//! through the map: the kernel would have to take each page from all processors before each sync.

use crate::source::map::map_range;
use bytemuck::cast_slice;
use memmap2::Mmap;
use octree_store::{DiskFile, Geometry, NodeKey, Sample};
use std::collections::VecDeque;
use std::io;
use std::sync::Arc;

/// Slots of a scratch file, one after the other, each with room for a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Slots {
    /// Where the first one begins: at a page's edge.
    pub(crate) offset: u64,
    /// How many there are.
    pub(crate) count: u64,
}

/// Where the blocks of a level lie in a scratch file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layout {
    slots: Slots,
    /// Blocks along x and y.
    grid: [u64; 2],
    block_bytes: u64,
}

impl Layout {
    /// The layout of a level whose samples have so many bytes.
    pub(crate) fn new(geometry: &Geometry, level: u8, sample_bytes: usize, slots: Slots) -> Self {
        let [x, y, _] = geometry.grid_at(level);
        let block_bytes = u64::from(geometry.core()).pow(3) * sample_bytes as u64;
        Self { slots, grid: [x, y], block_bytes }
    }

    /// Bytes from slot to slot: whole pages, however large they are.
    pub(crate) fn slot_bytes(&self) -> u64 {
        (self.grid[0] * self.grid[1] * self.block_bytes).next_multiple_of(1 << 16)
    }

    /// Bytes of all slots.
    pub(crate) fn bytes(&self) -> u64 {
        self.slots.count * self.slot_bytes()
    }

    /// Where the block of a brick begins in the file.
    pub(crate) fn place_of(&self, brick_xyz: [u64; 3]) -> u64 {
        self.slots.offset + self.within(brick_xyz)
    }

    /// Where it begins in the slots.
    #[inline(always)]
    fn within(&self, [x, y, chunk]: [u64; 3]) -> u64 {
        chunk % self.slots.count * self.slot_bytes() + (y * self.grid[0] + x) * self.block_bytes
    }
}

/// Some consecutive chunks of a level.
#[derive(Debug)]
pub(crate) struct LevelWindow {
    layout: Layout,
    dims_z: u64,
    core: u64,
    file: Arc<DiskFile>,
    map: Mmap,
    /// The chunks present are `first..end`.
    first: u64,
    end: u64,
    /// For each chunk that was let go and whose slot has not been filled anew: the count of octets
    /// after which it was.
    freed: VecDeque<u64>,
}

/// Where the blocks of a chunk are written, from any thread.
#[derive(Debug)]
pub(crate) struct ChunkWriter {
    layout: Layout,
    file: Arc<DiskFile>,
}

impl ChunkWriter {
    /// Writes the block of a brick: its core, `core^3` samples, whatever lies outside the volume.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(crate) fn write<T: Sample>(&self, brick: NodeKey, block: &[T]) -> io::Result<()> {
        self.file.write_all_at(cast_slice(block), self.layout.place_of(brick.brick_xyz()))
    }
}

impl LevelWindow {
    /// An empty window of a level in its place in a scratch file, which is long enough.
    ///
    /// # Errors
    /// When the file cannot be mapped.
    pub(crate) fn new(
        geometry: &Geometry,
        level: u8,
        layout: Layout,
        file: Arc<DiskFile>,
    ) -> io::Result<Self> {
        let map = map_range(file.file(), layout.slots.offset, layout.bytes())?;
        let (dims_z, core) = (geometry.dims_at(level)[2], u64::from(geometry.core()));
        Ok(Self { layout, dims_z, core, file, map, first: 0, end: 0, freed: VecDeque::new() })
    }

    /// Slices present from the first slice of the level on.
    pub(crate) fn slices(&self) -> u64 {
        (self.end * self.core).min(self.dims_z)
    }

    /// Begins the next chunk: where its blocks go, and the count of octets after which what is in its
    /// slot was let go, if it had any content.
    ///
    /// # Errors
    /// When every slot is needed.
    pub(crate) fn begin(&mut self) -> io::Result<(ChunkWriter, Option<u64>)> {
        let freed_at = match self.end {
            new if new < self.layout.slots.count => None,
            _ => Some(self.freed.pop_front().ok_or(io::ErrorKind::OutOfMemory)?),
        };
        Ok((ChunkWriter { layout: self.layout, file: Arc::clone(&self.file) }, freed_at))
    }

    /// Says that the chunk begun last is written.
    pub(crate) fn end(&mut self) {
        self.end += 1;
    }

    /// Lets go of the chunks that lie wholly before slice `z`, after `octets` octets.
    pub(crate) fn drop_before(&mut self, z: u64, octets: u64) {
        while self.first < self.end && (self.first + 1) * self.core <= z {
            self.freed.push_back(octets);
            self.first += 1;
        }
    }

    /// Reads `out.len()` voxels from (x, y, z) along x; their chunk must be present.
    #[inline(always)]
    pub(crate) fn read_row<T: Sample>(&self, [mut x, y, z]: [u64; 3], mut out: &mut [T]) {
        let core = self.core;
        let row = (z % core * core + y % core) * core * size_of::<T>() as u64;
        while !out.is_empty() {
            let block = self.layout.within([x / core, y / core, z / core]);
            let at = (block + row) as usize + (x % core) as usize * size_of::<T>();
            let length = out.len().min((core - x % core) as usize);
            let (now, later) = out.split_at_mut(length);
            now.copy_from_slice(cast_slice(&self.map[at..at + length * size_of::<T>()]));
            x += length as u64;
            out = later;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_come_back_from_their_slots() {
        let geometry = Geometry::new([70, 40, 300], 16, 2).unwrap();
        let (level, core) = (1, 16_u64);
        let dims = geometry.dims_at(level);
        let [grid_x, grid_y, grid_z] = geometry.grid_at(level);
        let slots = Slots { offset: 1 << 16, count: 3 };
        let layout = Layout::new(&geometry, level, 4, slots);
        let file = Arc::new(DiskFile::from(tempfile::tempfile().unwrap()));
        file.set_len(slots.offset + layout.bytes()).unwrap();
        let mut window = LevelWindow::new(&geometry, level, layout, Arc::clone(&file)).unwrap();
        let value = |[x, y, z]: [u64; 3]| (x + 1000 * y + 1_000_000 * z) as u32;
        for chunk in 0..grid_z {
            let (writer, freed_at) = window.begin().unwrap();
            // Chunk n is let go after octet n, when chunk n + 1 has come.
            assert_eq!(freed_at, (chunk >= 3).then(|| chunk - 3));
            for (x, y) in (0..grid_x).flat_map(|x| (0..grid_y).map(move |y| (x, y))) {
                let block: Vec<u32> = (0..core.pow(3))
                    .map(|i| [x * core + i % core, y * core + i / core % core, i / core / core])
                    .map(|[x, y, z]| value([x, y, z + chunk * core]))
                    .collect();
                let brick = NodeKey::new(level, [x, y, chunk]);
                writer.write(brick, &block).unwrap();
                let mut found = vec![0; block.len() * 4];
                file.read_exact_at(&mut found, layout.place_of([x, y, chunk])).unwrap();
                assert_eq!(found, cast_slice::<_, u8>(&block));
            }
            window.end();
            assert_eq!(window.slices(), ((chunk + 1) * core).min(dims[2]));
            let mut row = vec![0; dims[0] as usize - 3];
            for z in chunk.saturating_sub(1) * core..window.slices() {
                for y in 0..dims[1] {
                    window.read_row([1, y, z], &mut row);
                    assert!(row.iter().zip(1..).all(|(v, x)| *v == value([x, y, z])));
                }
            }
            window.drop_before(chunk * core, chunk - u64::from(chunk > 0));
        }
    }
}
