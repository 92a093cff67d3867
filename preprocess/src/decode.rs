//! Decoding a source's slices, chunk by chunk, on a thread of its own ahead of the walk; slices that
//! can be decoded apart are decoded by all threads of the pool.

use crate::error::PreprocessError;
use crate::source::{SliceVoxels, Slices, Source};
use crate::window::Chunk;
use octree_store::Sample;
use rayon::ThreadPool;
use rayon::prelude::*;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// What is to be decoded.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Decoder<'a> {
    pub(crate) source: &'a Source,
    pub(crate) pool: &'a ThreadPool,
    /// Slices in a chunk.
    pub(crate) chunk: u64,
    /// The first chunk that is wanted.
    pub(crate) first_chunk: u64,
}

impl Decoder<'_> {
    /// Fills blank chunks with the source's slices, in order, until they end or nobody wants them,
    /// while `consume` takes them and gives blank ones back.
    pub(crate) fn run<T: Sample>(
        self,
        blanks: Vec<Chunk<T>>,
        consume: impl FnOnce(&Receiver<Chunk<T>>, &SyncSender<Chunk<T>>) -> Result<(), PreprocessError>,
    ) -> Result<(), PreprocessError> {
        let (full_sender, full) = sync_channel(blanks.len());
        let (blank_sender, blank) = sync_channel(blanks.len());
        for chunk in blanks {
            blank_sender
                .send(chunk)
                .expect("the channel has room for all, and its receiver is here");
        }
        thread::scope(|scope| {
            let decoder = thread::Builder::new()
                .name("decode".into())
                .spawn_scoped(scope, move || self.decode(&blank, &full_sender))
                .map_err(PreprocessError::Thread)?;
            let consumed = consume(&full, &blank_sender);
            drop((full, blank_sender));
            let decoded =
                decoder.join().map_err(|_| PreprocessError::Panic { thread: "decode" })?;
            // A consumer that ran out of slices has no error of its own: the decoder's says why.
            consumed.and(decoded)
        })
    }

    fn decode<T: Sample>(
        self,
        blanks: &Receiver<Chunk<T>>,
        full: &SyncSender<Chunk<T>>,
    ) -> Result<(), PreprocessError> {
        let [x, y, depth] = self.source.dims_xyz;
        let slice = (x * y) as usize;
        let mut way = if let Some(files) = self.source.slice_files() {
            Way::Apart(files)
        } else {
            let mut slices = self.source.slices()?;
            slices.skip(self.first_chunk * self.chunk)?;
            Way::InOrder(slices)
        };
        for z in (self.first_chunk * self.chunk..depth).step_by(self.chunk as usize) {
            let Ok(mut chunk) = blanks.recv() else { return Ok(()) };
            let count = self.chunk.min(depth - z) as usize;
            let samples = &mut chunk.samples_mut()[..count * slice];
            match &mut way {
                Way::Apart(files) => self.pool.install(|| {
                    let slices = samples.par_chunks_exact_mut(slice).with_max_len(1).enumerate();
                    slices.try_for_each_init(Vec::new, |bytes, (i, samples)| {
                        files.read(z + i as u64, samples, bytes)
                    })
                })?,
                Way::InOrder(slices) => {
                    samples.chunks_exact_mut(slice).try_for_each(|samples| slices.next(samples))?;
                }
            }
            if full.send(chunk).is_err() {
                return Ok(());
            }
        }
        Ok(())
    }
}

/// How slices can be had.
enum Way<'a> {
    /// Each by itself.
    Apart(SliceVoxels<'a>),
    /// One after the other.
    InOrder(Slices<'a>),
}
