//! The walk over all bricks of all levels: every source voxel is read once, in order of z.
//!
//! Work goes by *octets*, the up to eight bricks that share a parent, in rows of one parent in z and
//! in Morton order within the row. The bricks' means are one brick core of the next level, which
//! becomes a chunk of that level's [`Window`]; as soon as a window holds a row of octets and the
//! overlap above it, that row is walked too. So all levels are walked together, with a few dozen
//! slices of each in memory, and the order does not depend on the number of threads.

use crate::downsample::{Core, StepDeviation, downsample, step_deviation};
use crate::error::PreprocessError;
use crate::gather::{Rows, gather};
use crate::source::{Slices, Source};
use crate::window::{Chunk, Window, WindowPlace};
use octree_store::{DownsampleFilter, Geometry, NodeKey, Sample};
use rayon::ThreadPool;
use rayon::prelude::*;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// What is done with each brick; called from many threads at once.
pub(crate) trait Visitor<T>: Sync {
    /// What comes of a brick.
    type Output: Send;
    /// What a thread keeps from brick to brick.
    type Scratch: Default + Send;

    /// Visits a brick: all its samples, and where its in-volume core is. What it changes at
    /// level 0 goes into the levels above.
    fn visit(
        &self,
        key: NodeKey,
        core: &Core,
        samples: &mut [T],
        scratch: &mut Self::Scratch,
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

/// The visited bricks that share a parent, in octant order.
pub(crate) type Octet<O> = Vec<Visited<O>>;

/// How a walk uses the machine.
#[derive(Debug, Clone)]
pub(crate) struct WalkOptions {
    /// Octets that are computed together, before any of them is handed on.
    pub(crate) batch_octets: usize,
    /// How a level is made of the one below it.
    pub(crate) downsample: DownsampleFilter,
    /// For each level above 0, where its window lives.
    pub(crate) window_places: Vec<WindowPlace>,
    /// For a streamed source, where the window of level 0 lives.
    pub(crate) stream_place: WindowPlace,
    /// For a streamed source, how many chunks may be decoded ahead of the walk.
    pub(crate) stream_chunks_ahead: u64,
}

/// Slices in a chunk of a streamed source's window.
pub(crate) const STREAM_CHUNK: u64 = 4;

/// Chunks that a streamed source's window holds at most, without those decoded ahead.
pub(crate) fn stream_window_chunks(geometry: &Geometry) -> u64 {
    let slices = 2 * u64::from(geometry.core() + geometry.overlap());
    slices.min(geometry.dims_xyz()[2]).div_ceil(STREAM_CHUNK) + 2
}

/// Chunks, of a core's slices each, that the window of a level above 0 holds at most: two to be
/// bricked, and one on either side for the overlap.
pub(crate) fn level_window_chunks(geometry: &Geometry, level: u8) -> u64 {
    geometry.grid_at(level)[2].min(4)
}

/// Walks a source; `sink` gets the octets in an order that depends on the geometry alone.
pub(crate) fn walk<T: Sample, V: Visitor<T>>(
    source: &Source,
    geometry: &Geometry,
    pool: &ThreadPool,
    options: &WalkOptions,
    visitor: &V,
    sink: &mut Sink<'_, V::Output>,
) -> Result<(), PreprocessError> {
    let levels = geometry.levels().skip(1).zip(&options.window_places);
    let mut levels: Vec<_> = levels
        .map(|(level, place)| {
            let chunk = u64::from(geometry.core());
            LevelState {
                window: Window::new(geometry.dims_at(level), chunk, place.clone()),
                next_row: 0,
            }
        })
        .collect();
    let WalkOptions { batch_octets, downsample, .. } = *options;
    let walker = Walker { geometry, pool, visitor, batch_octets, downsample };
    if let Some(mapped) = source.mapped() {
        for row in 0..walker.octet_rows(0) {
            walker.walk_row(&mapped, 0, row, &mut levels, sink)?;
        }
        return Ok(());
    }
    let mut window = Window::new(geometry.dims_xyz(), STREAM_CHUNK, options.stream_place.clone());
    let chunks = stream_window_chunks(geometry) + options.stream_chunks_ahead;
    let (full_sender, full) = sync_channel(chunks as usize);
    let (blank_sender, blanks) = sync_channel(chunks as usize);
    for _ in 0..chunks {
        let blank = window.blank().map_err(PreprocessError::Scratch)?;
        blank_sender.send(blank).expect("the channel has room for all, and its receiver is here");
    }
    let slices = source.slices()?;
    thread::scope(|scope| {
        let decoder = thread::Builder::new()
            .name("decode".into())
            .spawn_scoped(scope, move || decode(slices, geometry.dims_xyz(), &blanks, &full_sender))
            .map_err(PreprocessError::Thread)?;
        let walked = walker.walk_stream(&mut window, &full, &blank_sender, &mut levels, sink);
        drop((full, blank_sender));
        let decoded = decoder.join().map_err(|_| PreprocessError::Panic { thread: "decode" })?;
        // A walk that ran out of slices has no error of its own: the decoder's says why.
        walked.and(decoded)
    })
}

/// Where visited octets go, a batch at a time.
pub(crate) type Sink<'a, O> = dyn FnMut(Vec<Octet<O>>) -> Result<(), PreprocessError> + 'a;

/// Fills blank chunks with a source's slices, in order, until they end or nobody wants them.
fn decode<T: Sample>(
    mut slices: Slices<'_>,
    dims_xyz: [u64; 3],
    blanks: &Receiver<Chunk<T>>,
    full: &SyncSender<Chunk<T>>,
) -> Result<(), PreprocessError> {
    let slice = (dims_xyz[0] * dims_xyz[1]) as usize;
    let mut z = 0;
    while z < dims_xyz[2] {
        let Ok(mut chunk) = blanks.recv() else { return Ok(()) };
        for samples in chunk.samples_mut().chunks_exact_mut(slice) {
            if z < dims_xyz[2] {
                slices.next(samples)?;
                z += 1;
            }
        }
        if full.send(chunk).is_err() {
            return Ok(());
        }
    }
    Ok(())
}

/// A level above 0: its window, and the first row of octets that has not been walked.
struct LevelState<T> {
    window: Window<T>,
    next_row: u64,
}

struct Walker<'a, V> {
    geometry: &'a Geometry,
    pool: &'a ThreadPool,
    visitor: &'a V,
    batch_octets: usize,
    downsample: DownsampleFilter,
}

/// What a thread keeps from brick to brick.
struct ThreadScratch<T, S> {
    brick: Vec<T>,
    coarse: Vec<T>,
    visitor: S,
}

impl<V> Walker<'_, V> {
    fn octet_rows(&self, level: u8) -> u64 {
        self.geometry.grid_at(level)[2].div_ceil(2)
    }

    /// The slices of a level that rows of octets up to `row` need, overlap included.
    fn slices_needed(&self, level: u8, row: u64) -> u64 {
        let depth = 2 * u64::from(self.geometry.core());
        ((row + 1) * depth + u64::from(self.geometry.overlap()))
            .min(self.geometry.dims_at(level)[2])
    }

    /// The first slice of a level that rows of octets after `row` need.
    fn slices_done(&self, row: u64) -> u64 {
        let depth = 2 * u64::from(self.geometry.core());
        ((row + 1) * depth).saturating_sub(u64::from(self.geometry.overlap()))
    }

    /// Walks level 0 as its slices arrive; ends early where they end early.
    fn walk_stream<T: Sample>(
        &self,
        window: &mut Window<T>,
        full: &Receiver<Chunk<T>>,
        blanks: &SyncSender<Chunk<T>>,
        levels: &mut [LevelState<T>],
        sink: &mut Sink<'_, V::Output>,
    ) -> Result<(), PreprocessError>
    where
        V: Visitor<T>,
    {
        for row in 0..self.octet_rows(0) {
            while window.slices() < self.slices_needed(0, row) {
                let Ok(chunk) = full.recv() else { return Ok(()) };
                window.push(chunk);
            }
            self.walk_row(window, 0, row, levels, sink)?;
            window.drop_before(self.slices_done(row));
            while let Some(blank) = window.take_spare() {
                // A decoder that is done needs no more.
                if blanks.send(blank).is_err() {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Walks one row of octets of a level, then every row of the levels above that it completes.
    fn walk_row<T: Sample>(
        &self,
        rows: &impl Rows<T>,
        level: u8,
        row: u64,
        above: &mut [LevelState<T>],
        sink: &mut Sink<'_, V::Output>,
    ) -> Result<(), PreprocessError>
    where
        V: Visitor<T>,
    {
        let Some((next, above)) = above.split_first_mut() else {
            return self.walk_batches(rows, level, row, None, sink);
        };
        let mut chunk = next.window.blank().map_err(PreprocessError::Scratch)?;
        self.walk_batches(rows, level, row, Some(&mut chunk), sink)?;
        next.window.push(chunk);
        while next.next_row < self.octet_rows(level + 1)
            && next.window.slices() >= self.slices_needed(level + 1, next.next_row)
        {
            self.walk_row(&next.window, level + 1, next.next_row, above, sink)?;
            next.window.drop_before(self.slices_done(next.next_row));
            next.next_row += 1;
        }
        Ok(())
    }

    fn walk_batches<T: Sample>(
        &self,
        rows: &impl Rows<T>,
        level: u8,
        row: u64,
        mut chunk: Option<&mut Chunk<T>>,
        sink: &mut Sink<'_, V::Output>,
    ) -> Result<(), PreprocessError>
    where
        V: Visitor<T>,
    {
        let [columns, lines, _] = self.geometry.grid_at(level).map(|n| n.div_ceil(2));
        let mut parents: Vec<NodeKey> = (0..lines)
            .flat_map(|y| (0..columns).map(move |x| NodeKey::new(level + 1, [x, y, row])))
            .collect();
        parents.sort_unstable();
        let samples = self.geometry.brick_samples();
        for batch in parents.chunks(self.batch_octets) {
            let visited: Vec<_> = self.pool.install(|| {
                let init = || ThreadScratch {
                    brick: vec![T::default(); samples],
                    coarse: Vec::new(),
                    visitor: V::Scratch::default(),
                };
                let each = |scratch: &mut _, parent: &NodeKey| {
                    self.visit_octet(rows, *parent, chunk.is_some(), scratch)
                };
                batch.par_iter().map_init(init, each).collect::<Result<_, PreprocessError>>()
            })?;
            let mut octets = Vec::with_capacity(visited.len());
            for (&parent, (octet, block)) in batch.iter().zip(visited) {
                if let Some(chunk) = &mut chunk {
                    self.place_block(parent, &block, chunk.samples_mut());
                }
                octets.push(octet);
            }
            sink(octets)?;
        }
        Ok(())
    }

    /// Visits the children of `parent`; with `coarsen`, their means come too: the parent's
    /// in-volume core, x fastest.
    fn visit_octet<T: Sample>(
        &self,
        rows: &impl Rows<T>,
        parent: NodeKey,
        coarsen: bool,
        scratch: &mut ThreadScratch<T, V::Scratch>,
    ) -> Result<(Octet<V::Output>, Vec<T>), PreprocessError>
    where
        V: Visitor<T>,
    {
        let geometry = self.geometry;
        let [bx, by, bz] = if coarsen {
            geometry.core_region(parent).dims_xyz().map(|n| n as usize)
        } else {
            [0; 3]
        };
        let mut block = vec![T::default(); bx * by * bz];
        let mut octet = Vec::with_capacity(8);
        let half = geometry.core() as usize / 2;
        for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
            gather(rows, geometry, key, &mut scratch.brick);
            let core = Core::of(geometry, key);
            let output =
                self.visitor.visit(key, &core, &mut scratch.brick, &mut scratch.visitor)?;
            let mut step = StepDeviation::default();
            if coarsen {
                downsample(self.downsample, &scratch.brick, &core, &mut scratch.coarse);
                step = step_deviation(&scratch.brick, &core, &scratch.coarse, geometry, key);
                let [cx, cy, _] = core.coarse_extent();
                let octant = key.octant();
                let [x, y, z] = [octant & 1, octant >> 1 & 1, octant >> 2].map(|bit| bit * half);
                for (i, row) in scratch.coarse.chunks_exact(cx).enumerate() {
                    let to = ((z + i / cy) * by + y + i % cy) * bx + x;
                    block[to..to + cx].copy_from_slice(row);
                }
            }
            octet.push(Visited { key, output, step });
        }
        Ok((octet, block))
    }

    /// Copies a parent's core into the chunk of its level that holds its slices.
    fn place_block<T: Sample>(&self, parent: NodeKey, block: &[T], chunk: &mut [T]) {
        let region = self.geometry.core_region(parent);
        let [width, height, _] = self.geometry.dims_at(parent.level()).map(|n| n as usize);
        let [bx, by, _] = region.dims_xyz().map(|n| n as usize);
        let [x, y] = [region.min[0] as usize, region.min[1] as usize];
        for (i, row) in block.chunks_exact(bx).enumerate() {
            let to = (i / by * height + y + i % by) * width + x;
            chunk[to..to + bx].copy_from_slice(row);
        }
    }
}
