//! The walk over all bricks of all levels: every source voxel is read once, in order of z.
//!
//! Work goes by *octets*, the up to eight bricks that share a parent, in rows of one parent in z and
//! in Morton order within the row. The bricks' means are one brick core of the next level, which
//! is written to that level's [`LevelWindow`]; as soon as a window holds a row of octets and the
//! overlap above it, that row is walked too. So all levels are walked together, with a few dozen
//! slices of each in memory, and the order does not depend on the number of threads.
//!
//! A walk can skip the octets that an earlier one has done: it then goes the same way without
//! touching any voxel, and finds in the windows' slots what the earlier one left there.

#[cfg(test)]
mod tests;

use crate::decode::Decoder;
use crate::downsample::{Core, StepDeviation, downsample, step_deviation};
use crate::error::PreprocessError;
use crate::gather::{Rows, gather};
use crate::level_window::{ChunkWriter, Layout, LevelWindow};
use crate::source::Source;
use crate::upscale::Upscaler;
use crate::window::{Window, WindowPlace};
use octree_store::{DiskFile, DownsampleFilter, Geometry, NodeKey, Sample};
use rayon::ThreadPool;
use std::collections::{BTreeMap, VecDeque};
use std::panic::{self, AssertUnwindSafe};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, PoisonError};
use twox_hash::XxHash3_64;

/// What is done with each brick; called from many threads at once.
pub(crate) trait Visitor<T>: Sync {
    /// What comes of a brick.
    type Output: Send;
    /// What is kept from brick to brick.
    type Scratch: Default + Send;

    /// Visits a brick: all its samples, and where its in-volume core is. What it changes at
    /// level 0 goes into the levels above; its payload is added to its octet's.
    fn visit(
        &self,
        key: NodeKey,
        core: &Core,
        samples: &mut [T],
        scratch: &mut Self::Scratch,
        payloads: &mut Vec<u8>,
    ) -> Result<Self::Output, PreprocessError>;
}

/// A brick that has been visited.
#[derive(Debug)]
pub(crate) struct Visited<O> {
    pub(crate) key: NodeKey,
    pub(crate) output: O,
    /// How far its parent's cells lie from its own; zero at the top level.
    pub(crate) step: StepDeviation,
}

/// The visited bricks that share a parent.
#[derive(Debug)]
pub(crate) struct Octet<O> {
    /// In octant order.
    pub(crate) bricks: Vec<Visited<O>>,
    /// The bricks' payloads, one after the other.
    pub(crate) payloads: Vec<u8>,
    /// XXH3-64 of the parent's block as it went into its window; 0 where it has none.
    pub(crate) block_checksum: u64,
    /// Core voxels that the upscaler clamped to the type's range.
    pub(crate) clamped: u64,
}

/// Where visited octets go, in an order that depends on the geometry alone.
pub(crate) trait Sink<O> {
    /// Takes the next octet.
    fn take(&mut self, octet: Octet<O>) -> Result<(), PreprocessError>;

    /// Returns when the first so many octets of the walk are durable: a slot whose content they
    /// needed is about to be filled anew.
    fn wait_until_durable(&mut self, octets: u64) -> Result<(), PreprocessError>;
}

/// How a walk uses the machine.
#[derive(Debug, Clone)]
pub(crate) struct WalkOptions {
    /// Octets that are being made, or made and waiting for one before them.
    pub(crate) octets_ahead: usize,
    /// How a level is made of the one below it.
    pub(crate) downsample: DownsampleFilter,
    /// For each level above 0, where its window lies in the scratch file.
    pub(crate) layouts: Vec<Layout>,
    /// For a source that must be decoded, where the window of level 0 lives.
    pub(crate) stream_place: WindowPlace,
    /// Slices in a chunk of that window.
    pub(crate) stream_chunk: u64,
    /// How many chunks that window holds at most, without those decoded ahead.
    pub(crate) stream_window_chunks: u64,
    /// How many of its chunks may be decoded ahead of the walk.
    pub(crate) stream_chunks_ahead: u64,
}

/// What an earlier walk has left.
#[derive(Debug, Clone)]
pub(crate) struct Earlier {
    /// Octets that are done.
    pub(crate) octets: u64,
    /// The file of the windows' slots, all of whose blocks are taken.
    pub(crate) scratch: Arc<DiskFile>,
}

/// Payload buffers on their way back from the writer: none is allocated anew in the long run.
#[derive(Debug, Default)]
pub(crate) struct Buffers<B>(Mutex<Vec<Vec<B>>>);

impl Buffers<u8> {
    /// So many empty buffers with memory of their own, taken at once: what is planned is what is used, and
    /// a machine that has not got it says so in the beginning.
    pub(crate) fn reserved(count: usize, length: usize) -> Self {
        let buffer = |_| {
            // Zeros would not be there until they are used.
            let mut buffer = vec![1; length];
            buffer.clear();
            buffer
        };
        Self(Mutex::new((0..count).map(buffer).collect()))
    }
}

impl<B> Buffers<B> {
    /// An empty buffer, with room from earlier use where there is one.
    pub(crate) fn take(&self) -> Vec<B> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// Gives a buffer back.
    pub(crate) fn give(&self, mut buffer: Vec<B>) {
        buffer.clear();
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }
}

/// Chunks of so many slices that a decoded source's window holds at most, without those decoded
/// ahead.
pub(crate) fn stream_window_chunks(source: &Source, geometry: &Geometry, chunk: u64) -> u64 {
    let slices = (2 * u64::from(geometry.core() + geometry.overlap())).min(geometry.dims_xyz()[2]);
    let (slices, depth) = match source.enlarged() {
        Some(enlarged) => (enlarged.window_slices(slices), enlarged.source.dims_xyz[2]),
        None => (slices, source.dims_xyz[2]),
    };
    (slices.div_ceil(chunk) + 2).min(depth.div_ceil(chunk))
}

/// Chunks, of a core's slices each, that the window of a level above 0 holds at most: two to be
/// bricked, and one on either side for the overlap.
pub(crate) fn level_window_chunks(geometry: &Geometry, level: u8) -> u64 {
    geometry.grid_at(level)[2].min(4)
}

/// Octets in each row of a level.
pub(crate) fn octets_in_row(geometry: &Geometry, level: u8) -> u64 {
    let [columns, lines, _] = geometry.grid_at(level).map(|n| n.div_ceil(2));
    columns * lines
}

/// Walks a source from where an earlier walk has left it; `sink` gets the octets.
#[allow(clippy::too_many_arguments, reason = "what is walked, by what means, for whom")]
pub(crate) fn walk<T: Sample, V: Visitor<T>>(
    source: &Source,
    geometry: &Geometry,
    pool: &ThreadPool,
    options: &WalkOptions,
    visitor: &V,
    payloads: &Buffers<u8>,
    earlier: &Earlier,
    sink: &mut dyn Sink<V::Output>,
) -> Result<(), PreprocessError> {
    let levels = geometry.levels().skip(1).zip(&options.layouts);
    let levels = levels.map(|(level, layout)| {
        let scratch = Arc::clone(&earlier.scratch);
        let window = LevelWindow::new(geometry, level, *layout, scratch)?;
        Ok(LevelState { window, next_row: 0 })
    });
    let mut levels = levels.collect::<Result<Vec<_>, _>>().map_err(PreprocessError::Scratch)?;
    let makers = octets_in_row(geometry, 0).min(pool.current_num_threads() as u64);
    let scratches = Mutex::new((0..makers).map(|_| OctetScratch::default()).collect());
    let WalkOptions { octets_ahead, downsample, .. } = *options;
    let walker = Walker { geometry, pool, visitor, octets_ahead, downsample, payloads, scratches };
    let mut course = Course { done: 0, skip: earlier.octets, sink };
    // An enlarged source's voxels are computed from another's.
    let (source, enlarged) = (source.in_files(), source.enlarged());
    let upscaler = enlarged.map(Upscaler::new);
    let needed = |slices| enlarged.map_or(slices, |enlarged| enlarged.slices_needed(slices));
    let first_needed = |z| enlarged.map_or(z, |enlarged| enlarged.first_slice(z));
    if let Some(mapped) = source.mapped() {
        for row in 0..walker.octet_rows(0) {
            let soon = walker.slices_after(row);
            mapped.will_need(needed(soon.start)..needed(soon.end));
            match &upscaler {
                Some(upscaler) => {
                    walker.walk_row(&upscaler.rows(&mapped), 0, row, &mut levels, &mut course)?;
                }
                None => walker.walk_row(&mapped, 0, row, &mut levels, &mut course)?,
            }
        }
        return Ok(());
    }
    let (place, chunk) = (options.stream_place.clone(), options.stream_chunk);
    let mut window = Window::new(source.dims_xyz, chunk, place);
    // Rows that are done need no voxels.
    let mut first_row = 0;
    while first_row < walker.octet_rows(0)
        && course.done + octets_in_row(geometry, 0) <= course.skip
    {
        walker.walk_row(&window, 0, first_row, &mut levels, &mut course)?;
        first_row += 1;
    }
    if first_row == walker.octet_rows(0) {
        return Ok(());
    }
    let first_slice = first_needed(walker.slices_done(first_row.wrapping_sub(1)));
    let decoder = Decoder { source, pool, chunk, first_chunk: first_slice / chunk };
    window.begin_at(decoder.first_chunk);
    let chunks = options.stream_window_chunks + options.stream_chunks_ahead;
    let blanks = (0..chunks).map(|_| window.blank()).collect::<Result<_, _>>();
    decoder.run(blanks.map_err(PreprocessError::Scratch)?, |full, blanks| {
        for row in first_row..walker.octet_rows(0) {
            while window.slices() < needed(walker.slices_needed(0, row)) {
                // Slices that end early have an error of their own.
                let Ok(chunk) = full.recv() else { return Ok(()) };
                window.push(chunk);
            }
            match &upscaler {
                Some(upscaler) => {
                    walker.walk_row(&upscaler.rows(&window), 0, row, &mut levels, &mut course)?;
                }
                None => walker.walk_row(&window, 0, row, &mut levels, &mut course)?,
            }
            window.drop_before(first_needed(walker.slices_done(row)));
            while let Some(blank) = window.take_spare() {
                // A decoder that is done needs no more.
                if blanks.send(blank).is_err() {
                    break;
                }
            }
        }
        Ok(())
    })
}

/// A level above 0: its window, and the first row of octets that has not been walked.
struct LevelState {
    window: LevelWindow,
    next_row: u64,
}

/// How far the walk is, and where it delivers.
struct Course<'a, O> {
    /// Octets walked, skipped ones included.
    done: u64,
    /// Octets that an earlier walk has done.
    skip: u64,
    sink: &'a mut dyn Sink<O>,
}

struct Walker<'a, T: Sample, V: Visitor<T>> {
    geometry: &'a Geometry,
    pool: &'a ThreadPool,
    visitor: &'a V,
    octets_ahead: usize,
    downsample: DownsampleFilter,
    payloads: &'a Buffers<u8>,
    /// Those that no octet is made with now, of as many as octets are made at once. They are used in turn, so
    /// that a busy machine takes what is planned, as an idle one does.
    scratches: Mutex<VecDeque<OctetScratch<T, V::Scratch>>>,
}

/// What is kept from octet to octet.
struct OctetScratch<T, S> {
    /// The bricks of an octet.
    bricks: Vec<T>,
    coarse: Vec<T>,
    /// The parent's core.
    block: Vec<T>,
    visitor: S,
}

impl<T, S: Default> Default for OctetScratch<T, S> {
    fn default() -> Self {
        Self { bricks: Vec::new(), coarse: Vec::new(), block: Vec::new(), visitor: S::default() }
    }
}

/// A brick's thread panicked: a bug.
const PANIC: PreprocessError = PreprocessError::Panic { thread: "brick" };

impl<T: Sample, V: Visitor<T>> Walker<'_, T, V> {
    fn octet_rows(&self, level: u8) -> u64 {
        self.geometry.grid_at(level)[2].div_ceil(2)
    }

    /// The slices of a level that rows of octets up to `row` need, overlap included.
    fn slices_needed(&self, level: u8, row: u64) -> u64 {
        let depth = 2 * u64::from(self.geometry.core());
        ((row + 1) * depth + u64::from(self.geometry.overlap()))
            .min(self.geometry.dims_at(level)[2])
    }

    /// The first slice of a level that rows of octets after `row` need; `row` may be -1.
    fn slices_done(&self, row: u64) -> u64 {
        let depth = 2 * u64::from(self.geometry.core());
        (row.wrapping_add(1) * depth).saturating_sub(u64::from(self.geometry.overlap()))
    }

    /// The slices of level 0 that the row of octets after `row` needs, and none up to it.
    fn slices_after(&self, row: u64) -> std::ops::Range<u64> {
        self.slices_needed(0, row)..self.slices_needed(0, row + 1)
    }

    /// Walks one row of octets of a level, then every row of the levels above that it completes.
    fn walk_row(
        &self,
        rows: &impl Rows<T>,
        level: u8,
        row: u64,
        above: &mut [LevelState],
        course: &mut Course<'_, V::Output>,
    ) -> Result<(), PreprocessError> {
        let Some((next, above)) = above.split_first_mut() else {
            return self.walk_octets(rows, level, row, None, course);
        };
        let (chunk, freed_at) = next.window.begin().map_err(PreprocessError::Scratch)?;
        if let Some(octets) = freed_at.filter(|octets| *octets > course.skip) {
            course.sink.wait_until_durable(octets)?;
        }
        self.walk_octets(rows, level, row, Some(&chunk), course)?;
        next.window.end();
        while next.next_row < self.octet_rows(level + 1)
            && next.window.slices() >= self.slices_needed(level + 1, next.next_row)
        {
            self.walk_row(&next.window, level + 1, next.next_row, above, course)?;
            next.window.drop_before(self.slices_done(next.next_row), course.done);
            next.next_row += 1;
        }
        Ok(())
    }

    /// Walks the octets of one row: the pool makes some of them at a time, in any order; this thread
    /// hands them on in theirs.
    fn walk_octets(
        &self,
        rows: &impl Rows<T>,
        level: u8,
        row: u64,
        chunk: Option<&ChunkWriter>,
        course: &mut Course<'_, V::Output>,
    ) -> Result<(), PreprocessError> {
        let [columns, lines, _] = self.geometry.grid_at(level).map(|n| n.div_ceil(2));
        let mut parents: Vec<NodeKey> = (0..lines)
            .flat_map(|y| (0..columns).map(move |x| NodeKey::new(level + 1, [x, y, row])))
            .collect();
        parents.sort_unstable();
        let skipped = course.skip.saturating_sub(course.done).min(parents.len() as u64);
        course.done += skipped;
        let parents = &parents[skipped as usize..];
        let (sender, made) = sync_channel(self.octets_ahead);
        self.pool.in_place_scope_fifo(|scope| {
            let mut begun = 0;
            let mut early = BTreeMap::new();
            for index in 0..parents.len() {
                for (at, &parent) in
                    (begun..).zip(&parents[begun..]).take(index + self.octets_ahead - begun)
                {
                    let sender = sender.clone();
                    scope.spawn_fifo(move |_| {
                        // There is room for it; one who no longer listens has failed already.
                        let _ = sender.send((at, self.visit(rows, parent, chunk)));
                    });
                    begun += 1;
                }
                let octet = loop {
                    if let Some(next) = early.remove(&index) {
                        break next;
                    }
                    let (at, next) = made.recv().map_err(|_| PANIC)?;
                    early.insert(at, next?);
                };
                course.done += 1;
                course.sink.take(octet)?;
            }
            Ok(())
        })
    }

    /// Visits an octet with scratch that no other has now; a panic becomes an error.
    fn visit(
        &self,
        rows: &impl Rows<T>,
        parent: NodeKey,
        chunk: Option<&ChunkWriter>,
    ) -> Result<Octet<V::Output>, PreprocessError> {
        let scratches = || self.scratches.lock().unwrap_or_else(PoisonError::into_inner);
        let visit = || {
            let mut scratch = scratches().pop_front().unwrap_or_default();
            let octet = self.visit_octet(rows, parent, chunk, &mut scratch);
            scratches().push_back(scratch);
            octet
        };
        panic::catch_unwind(AssertUnwindSafe(visit)).unwrap_or(Err(PANIC))
    }

    /// Visits the children of `parent`; their means go into its chunk, if it has one.
    fn visit_octet(
        &self,
        rows: &impl Rows<T>,
        parent: NodeKey,
        chunk: Option<&ChunkWriter>,
        scratch: &mut OctetScratch<T, V::Scratch>,
    ) -> Result<Octet<V::Output>, PreprocessError> {
        let geometry = self.geometry;
        let side = geometry.core() as usize;
        let samples = geometry.brick_samples();
        scratch.block.resize(side.pow(3), T::default());
        scratch.bricks.resize(8 * samples, T::default());
        let at_once = rows.read_octet(geometry, parent, &mut scratch.bricks);
        let mut octet = Octet {
            bricks: Vec::with_capacity(8),
            payloads: self.payloads.take(),
            block_checksum: 0,
            clamped: at_once.unwrap_or(0),
        };
        for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
            let OctetScratch { bricks, coarse, block, visitor } = scratch;
            let brick = &mut bricks[key.octant() * samples..][..samples];
            if at_once.is_none() {
                gather(rows, geometry, key, brick);
            }
            let core = Core::of(geometry, key);
            let output = self.visitor.visit(key, &core, brick, visitor, &mut octet.payloads)?;
            let mut step = StepDeviation::default();
            if chunk.is_some() {
                downsample(self.downsample, brick, &core, coarse);
                step = step_deviation(brick, &core, coarse, geometry, key);
                let [cx, cy, _] = core.coarse_extent();
                let octant = key.octant();
                let [x, y, z] =
                    [octant & 1, octant >> 1 & 1, octant >> 2].map(|bit| bit * side / 2);
                for (i, row) in coarse.chunks_exact(cx).enumerate() {
                    let to = ((z + i / cy) * side + y + i % cy) * side + x;
                    block[to..to + cx].copy_from_slice(row);
                }
            }
            octet.bricks.push(Visited { key, output, step });
        }
        if let Some(chunk) = chunk {
            octet.block_checksum = block_checksum(&scratch.block);
            chunk.write(parent, &scratch.block).map_err(PreprocessError::Scratch)?;
        }
        Ok(octet)
    }
}

/// The checksum of a parent's block.
pub(crate) fn block_checksum<T: Sample>(block: &[T]) -> u64 {
    XxHash3_64::oneshot(bytemuck::cast_slice(block))
}
