//! An enlarged volume's slices, one after the other: a slab of them is computed at a time, by all threads.

use super::rows::{Block, TILE, Upscaler, thread_bytes};
use super::source::Enlarged;
use crate::error::PreprocessError;
use crate::gather::Rows;
use crate::source::{Slices, SourceError};
use octree_store::{Region, Sample};
use rayon::ThreadPool;
use rayon::prelude::*;
use std::any::Any;
use std::collections::VecDeque;
use std::sync::atomic::Ordering;

/// Slices that are computed together at most: more would cost memory and hardly save time.
const SLAB: u64 = 32;
/// Rows that a thread computes at a time.
const BAND: u64 = 64;
/// Memory of the program itself, its output's buffer included.
const BASE_BYTES: u64 = 5 << 20;
/// What each thread takes beside its buffers.
const THREAD_BYTES: u64 = 192 << 10;

/// How slices are made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlabLimits {
    threads: usize,
    /// Slices that are computed together.
    slab: u64,
}

impl Default for SlabLimits {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { threads, slab: 4 }
    }
}

impl SlabLimits {
    /// What fits a budget: as many threads as asked for, then as many slices at a time.
    pub(crate) fn within(
        enlarged: &Enlarged,
        threads: usize,
        budget: u64,
    ) -> Result<Self, PreprocessError> {
        let sample_type = enlarged.source.sample_type();
        let slice = |[x, y, _]: [u64; 3]| x * y * sample_type.bytes() as u64;
        let (old, new) = (slice(enlarged.source.dims_xyz), slice(enlarged.new_dims_xyz()));
        let depth = enlarged.new_dims_xyz()[2];
        let thread = THREAD_BYTES + thread_bytes(&enlarged.upscale, sample_type, TILE);
        let decoding = enlarged.source.decode_bytes().unwrap_or(0);
        // The slice being written is there twice: as samples, and as bytes.
        let memory = |threads: usize, slab: u64| {
            BASE_BYTES
                + threads as u64 * thread
                + decoding
                + 2 * new
                + slab * new
                + enlarged.window_slices(slab) * old
        };
        for threads in (1..=threads.max(1)).rev() {
            if let Some(slab) =
                (1..=SLAB.min(depth)).rev().find(|slab| memory(threads, *slab) <= budget)
            {
                return Ok(Self { threads, slab });
            }
        }
        Err(PreprocessError::MemoryTooSmall { budget, needed: memory(1, 1) })
    }
}

/// The way through an enlarged volume; what depends on the sample type is made with the first slice.
#[derive(Debug)]
pub(crate) struct EnlargedSlices<'a> {
    enlarged: &'a Enlarged,
    slices: Slices<'a>,
    slab: Option<Box<dyn Any + Send>>,
}

/// The slab that is being handed out, and the source's slices that it needs.
struct Slab<T> {
    upscaler: Upscaler<T>,
    pool: ThreadPool,
    window: SliceWindow<T>,
    blocks: Vec<Block<T>>,
    /// New slices that have been computed.
    end: u64,
    next: u64,
}

/// Some of the source's slices.
struct SliceWindow<T> {
    width: usize,
    slices: VecDeque<Vec<T>>,
    /// The number of the first.
    first: u64,
}

impl<T: Sample> Rows<T> for SliceWindow<T> {
    fn read_row(&self, [x, y, z]: [u64; 3], out: &mut [T]) {
        let first = y as usize * self.width + x as usize;
        out.copy_from_slice(&self.slices[(z - self.first) as usize][first..first + out.len()]);
    }
}

impl<'a> EnlargedSlices<'a> {
    /// From the first slice on.
    pub(crate) fn new(enlarged: &'a Enlarged) -> Result<Self, SourceError> {
        enlarged.clamped.store(0, Ordering::Relaxed);
        Ok(Self { enlarged, slices: enlarged.source.slices()?, slab: None })
    }

    /// Computes the next slice.
    pub(crate) fn next<T: Sample>(&mut self, slice: &mut [T]) -> Result<(), SourceError> {
        let enlarged = self.enlarged;
        let slab = match &mut self.slab {
            Some(slab) => slab,
            none => none.insert(Box::new(Slab::<T>::new(enlarged)?)),
        };
        let slab: &mut Slab<T> =
            slab.downcast_mut().expect("all slices of a volume have samples of one type");
        slab.next(enlarged, &mut self.slices, slice)
    }
}

impl<T: Sample> Slab<T> {
    fn new(enlarged: &Enlarged) -> Result<Self, SourceError> {
        let pool = crate::pool(enlarged.limits.threads).map_err(|error| SourceError::Io {
            path: enlarged.source.description.path.clone().into(),
            source: std::io::Error::other(error),
        })?;
        Ok(Self {
            upscaler: Upscaler::new(enlarged),
            pool,
            window: SliceWindow {
                width: enlarged.source.dims_xyz[0] as usize,
                slices: VecDeque::new(),
                first: 0,
            },
            blocks: Vec::new(),
            end: 0,
            next: 0,
        })
    }

    fn next(
        &mut self,
        enlarged: &Enlarged,
        slices: &mut Slices<'_>,
        slice: &mut [T],
    ) -> Result<(), SourceError> {
        if self.next == self.end {
            self.compute(enlarged, slices)?;
        }
        let width = enlarged.new_dims_xyz()[0] as usize;
        for block in &self.blocks {
            let rows = block.region.min[1]..block.region.max[1];
            for (row, y) in rows.clone().enumerate() {
                let plane = (self.next - block.region.min[2]) * (rows.end - rows.start);
                let from = (plane as usize + row) * width;
                let to = y as usize * width;
                slice[to..to + width].copy_from_slice(&block.samples[from..from + width]);
            }
        }
        self.next += 1;
        Ok(())
    }

    /// Reads what the next slab needs of the source, and computes it.
    fn compute(&mut self, enlarged: &Enlarged, slices: &mut Slices<'_>) -> Result<(), SourceError> {
        let [width, height, depth] = enlarged.new_dims_xyz();
        let (start, end) = (self.end, (self.end + enlarged.limits.slab).min(depth));
        let window = &mut self.window;
        let mut blank = Vec::new();
        while window.first < enlarged.first_slice(start) {
            blank.extend(window.slices.pop_front());
            window.first += 1;
        }
        while window.first + (window.slices.len() as u64) < enlarged.slices_needed(end) {
            let [width, height, _] = enlarged.source.dims_xyz;
            let mut slice = blank.pop().unwrap_or_default();
            slice.resize((width * height) as usize, T::default());
            slices.next(&mut slice)?;
            window.slices.push_back(slice);
        }
        let mut buffers: Vec<_> = self.blocks.drain(..).map(|block| block.samples).collect();
        let regions: Vec<_> = (0..height.div_ceil(BAND))
            .map(|band| Region {
                min: [0, band * BAND, start],
                max: [width, ((band + 1) * BAND).min(height), end],
            })
            .map(|region| (region, buffers.pop().unwrap_or_default()))
            .collect();
        let rows = self.upscaler.rows(&self.window);
        self.blocks = self.pool.install(|| {
            let each = regions.into_par_iter().with_max_len(1);
            let block = |(region, samples)| {
                let (block, clamped) = rows.block(region, samples);
                enlarged.clamped.fetch_add(clamped, Ordering::Relaxed);
                block
            };
            each.map(block).collect()
        });
        self.end = end;
        Ok(())
    }
}
