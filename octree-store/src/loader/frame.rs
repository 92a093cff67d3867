//! The loader itself: one call a frame, which never waits for the disk.
//!
//! A frame takes in what the threads have read, refines the last frame's cut, hands out uploads and the
//! index, and tells the threads what to read next.

use super::brick::{Brick, BrickFormat};
use super::cache::{BrickCache, CacheStatistics};
use super::cut::Scene;
use super::demand::{Change, Demand, Holder, Outcome, Quality};
use super::fetch::{BrickSource, Fetcher, Job};
use super::in_core::{Pools, Records};
use super::index::SpatialIndex;
use super::lru::Lru;
use super::nodes::Child;
use super::prefetch;
use super::projection::{Projection, ViewSet};
use super::refine::Refiner;
use super::slots::SlotPool;
use super::transfer::Appearance;
use super::visibility::{Feedback, mark};
use crate::error::StoreError;
use crate::key::NodeKey;
use std::collections::{HashSet, VecDeque};
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use thiserror::Error;

/// What a loader may take, and how it goes about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LoaderOptions {
    /// Slots of the renderer's pool, a brick each.
    pub slots: usize,
    /// Bytes of decoded bricks kept in memory. The cut's bricks are among them, and up to a quarter is kept free
    /// for those that are being read: a cut has at most so many bricks as fit both the slots and the rest of this.
    pub memory_bytes: usize,
    /// Bricks that are asked for or being read at once.
    pub requests: usize,
    /// Bricks handed to the renderer in one frame.
    pub uploads_per_frame: usize,
    /// Threads that read and decode.
    pub threads: usize,
    /// Frames for which children stay that are no longer needed, so that a cut does not flicker.
    pub linger_frames: u32,
    /// Frames that the camera's motion is carried on for prefetching; 0 for none.
    pub prefetch_frames: u32,
    /// Whether only what the renderer saw is refined: it gives [`Loader::feedback`] for its frames. Without
    /// feedback every node in view counts as seen.
    pub visibility: bool,
}

impl Default for LoaderOptions {
    /// 4,096 slots, 512 MiB, 256 requests, 64 uploads a frame, 2 threads, and visibility feedback.
    fn default() -> Self {
        Self {
            slots: 4096,
            memory_bytes: 512 << 20,
            requests: 256,
            uploads_per_frame: 64,
            threads: 2,
            linger_frames: 8,
            prefetch_frames: 8,
            visibility: true,
        }
    }
}

/// Why a loader cannot be made.
#[derive(Debug, Error)]
pub enum LoaderError {
    /// Too little for one group of siblings beside what they stand in for.
    #[error("{what} is {found}, and a loader needs at least {least}")]
    TooLittle {
        /// Which option.
        what: &'static str,
        /// What was given.
        found: usize,
        /// What is needed.
        least: usize,
    },
    /// More slots than an index can name.
    #[error("{found} slots were given, and an index names at most {limit}")]
    TooManySlots {
        /// What was given.
        found: usize,
        /// The most there can be.
        limit: usize,
    },
    /// The system gives no more threads.
    #[error("the fetch threads cannot be started: {source}")]
    Threads {
        /// The system's error.
        source: io::Error,
    },
}

/// A brick that the renderer must put into its pool before it draws the frame.
#[derive(Debug, Clone)]
pub struct Upload {
    /// Where it goes.
    pub slot: u32,
    /// Which node's it is.
    pub key: NodeKey,
    /// Its texels.
    pub brick: Arc<Brick>,
}

/// What went wrong, beside the view.
#[derive(Debug)]
pub enum Event {
    /// A node cannot be read. What stands above it is shown in its place, and it is not asked for again.
    Damaged {
        /// The node.
        key: NodeKey,
        /// Why.
        error: StoreError,
    },
    /// Fetch threads have ended by a panic, which is a bug; the others go on. What they were asked to read counts as
    /// damaged, as does everything once no thread is left.
    ThreadsLost {
        /// How many.
        count: usize,
    },
}

/// What a loader has done and how long it took; counts since it was made.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Statistics {
    /// The frame.
    pub frame: u64,
    /// Decoded bricks in memory.
    pub memory: CacheStatistics,
    /// The renderer's slots.
    pub slots: CacheStatistics,
    /// Slots of the current cut.
    pub slots_in_use: usize,
    /// Bricks read from the store.
    pub bricks_read: u64,
    /// Bytes of their payloads.
    pub bytes_read: u64,
    /// Bricks handed to the renderer.
    pub bricks_uploaded: u64,
    /// Groups of siblings that wait to be read.
    pub queued: usize,
    /// Groups of siblings being read, or read and not yet taken in.
    pub active: usize,
    /// Leaves of the cut that wait for data.
    pub waiting: usize,
    /// Leaves of the cut that wait for a frame with uploads left.
    pub deferred: usize,
    /// Nodes kept beyond their need.
    pub lingering: usize,
    /// Whether the last frame's cut is coarser than asked for because slots or memory are all in use.
    pub limited: bool,
    /// Nodes of the index, those outside the volume included.
    pub index_nodes: usize,
    /// Time of the last frame's refinement.
    pub refine_secs: f64,
    /// Time of building its index; 0 where it is the one before.
    pub index_secs: f64,
    /// Time of the whole call.
    pub frame_secs: f64,
    /// Time the threads spent reading and decoding, summed over threads.
    pub fetch_secs: f64,
}

/// What the renderer needs for one frame.
#[derive(Debug)]
pub struct Frame {
    /// Bricks to put into the pool first.
    pub uploads: Vec<Upload>,
    /// Slots that this frame's index uses no longer. They keep their bricks, and may come back without an upload.
    pub freed: Vec<u32>,
    /// The nodes to draw.
    pub index: Arc<SpatialIndex>,
    /// What went wrong since the last frame.
    pub events: Vec<Event>,
    /// Whether nothing is left to do: the same call again would give the same index, and nothing is being read. With
    /// visibility, only once the renderer has given its feedback for this index.
    pub converged: bool,
}

/// Indices that feedback may still be given for.
const REMEMBERED: usize = 4;

/// The adaptive loader of one store. See [the module](super) for an example.
#[derive(Debug)]
pub struct Loader {
    options: LoaderOptions,
    refiner: Refiner,
    records: Records,
    pools: Pools,
    fetcher: Fetcher,
    indices: VecDeque<Arc<SpatialIndex>>,
    /// The index that the last feedback was for.
    feedback_serial: Option<u64>,
    scene: Option<OwnedScene>,
    views_before: Vec<Projection>,
    statistics: Statistics,
}

#[derive(Debug, PartialEq)]
struct OwnedScene {
    views: Vec<super::View>,
    clip: Option<super::ClipBox>,
    appearance: Appearance,
    quality: Quality,
}

impl Loader {
    /// A loader over a source of bricks, such as a [`crate::Store`]; starts its threads.
    ///
    /// # Errors
    /// When an option is too small to work with, or the threads cannot be started.
    pub fn new(source: impl BrickSource, options: LoaderOptions) -> Result<Self, LoaderError> {
        let (metadata, geometry) = (source.metadata(), *source.geometry());
        let format = BrickFormat::of(metadata);
        let brick_bytes = geometry.brick_samples() * format.bytes();
        let spacing_xyz = metadata.spacing_xyz;
        // A node and its children, and a group that is being read; and a group is uploaded in one frame.
        for (what, found, least) in [
            ("slots", options.slots, 9),
            ("memory_bytes", options.memory_bytes, 17 * brick_bytes),
            ("requests", options.requests, 8),
            ("uploads_per_frame", options.uploads_per_frame, 8),
            ("threads", options.threads, 1),
        ] {
            if found < least {
                return Err(LoaderError::TooLittle { what, found, least });
            }
        }
        let limit = (u32::MAX - 4) as usize;
        if options.slots > limit {
            return Err(LoaderError::TooManySlots { found: options.slots, limit });
        }
        let in_memory = options.memory_bytes / brick_bytes;
        let arriving = (in_memory / 4).clamp(8, options.requests);
        let source: Arc<dyn BrickSource> = Arc::new(source);
        let fetcher = Fetcher::start(&source, options.threads)
            .map_err(|source| LoaderError::Threads { source })?;
        Ok(Self {
            options,
            refiner: Refiner::new(),
            records: Records {
                geometry,
                spacing_xyz,
                groups: Lru::new(),
                wanted: Vec::new(),
                root: None,
            },
            pools: Pools {
                slots: SlotPool::new(options.slots),
                memory: BrickCache::new(options.memory_bytes),
                capacity: options.slots.min(in_memory - arriving),
                arriving,
                brick_bytes,
                uploads_per_frame: options.uploads_per_frame,
                damaged: HashSet::new(),
                uploads: Vec::new(),
                freed: Vec::new(),
                jobs: Vec::new(),
            },
            fetcher,
            indices: VecDeque::new(),
            feedback_serial: None,
            scene: None,
            views_before: Vec::new(),
            statistics: Statistics::default(),
        })
    }

    /// Takes in what the renderer saw when it drew the index with this serial number. Feedback for one of the last
    /// four indices counts, older feedback is passed over.
    pub fn feedback(&mut self, serial: u64, feedback: Feedback) {
        let Some(index) = self.indices.iter().find(|index| index.serial() == serial) else {
            return;
        };
        if let Some((tree, number)) = self.refiner.begin_feedback() {
            mark(tree, index, feedback, number);
            self.feedback_serial = Some(serial);
        }
    }

    /// What is to be drawn of a scene now, with what is in core now. Never waits for the disk.
    pub fn frame(&mut self, scene: &Scene) -> Frame {
        let started = Instant::now();
        self.statistics.frame += 1;
        let events = self.take_in();
        let views =
            ViewSet::new(scene.views, scene.clip, &self.records.geometry, self.records.spacing_xyz);
        let change = self.remember(scene);
        let demand = Demand {
            views: &views,
            appearance: scene.appearance,
            quality: scene.quality,
            only_seen: self.options.visibility,
            linger_frames: self.options.linger_frames,
            waiting_limit: self.pools.arriving,
            keep_inner: true,
            change,
        };
        let outcome = self.refiner.update(&demand, &mut self.records, &mut self.pools);
        let refined = Instant::now();
        let index = self.index(outcome.changed);
        let indexed = Instant::now();
        let uploads = std::mem::take(&mut self.pools.uploads);
        let freed = self.freed();
        self.ask(scene, &views, &outcome);
        let (queued, active) = self.fetcher.load();
        let drawn = !self.options.visibility || self.feedback_serial == Some(index.serial());
        let idle = queued == 0 && active == 0 && outcome.waiting == 0 && outcome.deferred == 0;
        let converged = drawn
            && idle
            && outcome.lingering == 0
            && !outcome.changed
            && change == Change::Nothing;
        let statistics = &mut self.statistics;
        statistics.memory = self.pools.memory.statistics;
        statistics.slots = self.pools.slots.statistics(self.pools.brick_bytes);
        statistics.slots_in_use = self.pools.slots.pinned();
        statistics.bricks_uploaded += uploads.len() as u64;
        (statistics.queued, statistics.active) = (queued, active);
        (statistics.waiting, statistics.deferred) = (outcome.waiting, outcome.deferred);
        (statistics.lingering, statistics.limited) = (outcome.lingering, outcome.starved);
        statistics.index_nodes = index.nodes().len();
        statistics.refine_secs = (refined - started).as_secs_f64();
        statistics.index_secs = (indexed - refined).as_secs_f64();
        statistics.frame_secs = started.elapsed().as_secs_f64();
        Frame { uploads, freed, index, events, converged }
    }

    /// Waits until a thread has read something that no frame has taken in, until nothing is left to read, or for so long:
    /// for one who wants the finished picture alone, instead of calling frames in a circle.
    pub fn wait(&self, at_most: Duration) {
        self.fetcher.wait(at_most);
    }

    /// Groups of siblings that wait to be read or are being read at this moment.
    pub fn unread(&self) -> usize {
        self.fetcher.unread()
    }

    /// What the loader has done so far.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Forgets which nodes were found damaged, so that they are tried again: after a disk came back.
    pub fn retry_damaged(&mut self) {
        self.pools.damaged.clear();
        self.records.groups = Lru::new();
        self.records.root = None;
        self.refiner.forget_damage(&mut self.pools);
    }

    /// Puts what the threads have read into the caches.
    fn take_in(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        for fetched in self.fetcher.collect() {
            self.statistics.fetch_secs += fetched.elapsed.as_secs_f64();
            for (parent, siblings) in fetched.siblings {
                self.records.insert(parent, Arc::new(siblings));
            }
            for (record, brick) in fetched.bricks {
                self.statistics.bricks_read += 1;
                self.pools.memory.statistics.misses += 1;
                self.statistics.bytes_read += u64::from(record.place.length);
                self.pools.memory.insert(record.key, brick);
            }
            for (key, error) in fetched.errors {
                self.refiner.mark_damaged(key);
                if self.pools.damaged.insert(key) {
                    events.push(Event::Damaged { key, error });
                }
            }
        }
        let (count, jobs) = self.fetcher.lost();
        for Job { parent, octants } in jobs {
            if octants == 0 {
                self.records.insert(parent, Arc::new([Child::Damaged; 8]));
                continue;
            }
            let top = self.records.geometry.root();
            let children = if parent == top.parent() { [top; 8] } else { parent.children() };
            for key in (0..8).filter(|i| octants >> i & 1 == 1).map(|i| children[i]) {
                self.refiner.mark_damaged(key);
                self.pools.damaged.insert(key);
            }
        }
        if count > 0 {
            events.push(Event::ThreadsLost { count });
        }
        events
    }

    /// What differs from the last frame's scene.
    fn remember(&mut self, scene: &Scene) -> Change {
        let change = match &self.scene {
            Some(old) if old.appearance.is(scene.appearance) && old.quality.is(&scene.quality) => {
                if old.views == scene.views && old.clip == scene.clip {
                    return Change::Nothing;
                }
                Change::Views
            }
            _ => Change::Appearance,
        };
        self.scene = Some(OwnedScene {
            views: scene.views.to_vec(),
            clip: scene.clip,
            appearance: scene.appearance.clone(),
            quality: scene.quality,
        });
        change
    }

    /// This frame's index: the last one, or a new one.
    fn index(&mut self, changed: bool) -> Arc<SpatialIndex> {
        if let Some(last) = self.indices.back().filter(|_| !changed) {
            return Arc::clone(last);
        }
        let (serial, expected) = (self.indices.back())
            .map_or((0, 64), |last| (last.serial() + 1, last.nodes().len() + 512));
        let index = Arc::new(SpatialIndex::build(self.refiner.tree(), serial, expected));
        if self.indices.len() == REMEMBERED {
            self.indices.pop_front();
        }
        self.indices.push_back(Arc::clone(&index));
        index
    }

    /// Slots that were given back and not taken again within the frame.
    fn freed(&mut self) -> Vec<u32> {
        let freed = std::mem::take(&mut self.pools.freed);
        let slots = &self.pools.slots;
        freed.into_iter().filter(|(key, slot)| !slots.is_in_use(*key, *slot)).map(|f| f.1).collect()
    }

    /// Tells the threads what to read.
    fn ask(&mut self, scene: &Scene, views: &ViewSet, outcome: &Outcome) {
        let mut jobs = std::mem::take(&mut self.pools.jobs);
        jobs.extend(self.records.wanted.drain(..).map(|parent| Job { parent, octants: 0 }));
        if self.options.prefetch_frames > 0 {
            let frames = f64::from(self.options.prefetch_frames);
            let ahead = prefetch::views_ahead(views.projections(), &self.views_before, frames);
            self.views_before = views.projections().to_vec();
            let Records { geometry, spacing_xyz, groups, .. } = &self.records;
            let room = self.pools.room().saturating_sub(outcome.reserved) / 2;
            if let (Some(ahead), Some(tree)) = (ahead, self.refiner.tree()) {
                let ahead = ViewSet::of_projections(ahead, scene.clip, geometry, *spacing_xyz);
                jobs.extend(prefetch::jobs(
                    tree,
                    &ahead,
                    scene.appearance,
                    scene.quality,
                    self.options.visibility.then(|| self.refiner.feedback()),
                    |key| groups.peek(key).map(|siblings| &**siblings),
                    |key| {
                        self.pools.memory.contains(key)
                            || self.pools.slots.contains(key)
                            || self.pools.damaged.contains(&key)
                    },
                    room,
                ));
            }
        }
        // What is there and waits for a frame with uploads left must not be dropped for what comes.
        let limit = self.pools.arriving.saturating_sub(outcome.deferred_bricks);
        self.fetcher.replace(jobs.into_iter(), limit);
    }
}
