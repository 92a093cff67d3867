//! Threads that read and decode bricks, so that a frame never waits for the disk.
//!
//! A job is the children of one node: their records are one read, and their payloads lie side by side. With
//! the bricks come the records beneath them, so that the next refinement finds them in core. Each frame
//! replaces the queue by what it wants now, the most urgent first; what is no longer wanted is thereby
//! cancelled, and what is already being read goes to the cache. What was read and not collected counts against the
//! queue's limit, so memory is bounded. On drop the threads end after the brick at hand.

use super::brick::Brick;
use super::nodes::{ChildRecord, Siblings, read_children, sorted, summaries};
use crate::error::StoreError;
use crate::geometry::Geometry;
use crate::key::NodeKey;
use crate::metadata::Metadata;
use crate::record::{BrickState, NodeRecord};
use crate::store::{BrickScratch, Store};
use std::cell::Cell;
use std::collections::{HashMap, VecDeque};
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Where bricks come from: a [`Store`], or something made up for a test or a simulation. Called from several threads.
pub trait BrickSource: Send + Sync + 'static {
    /// What the volume is.
    fn metadata(&self) -> &Metadata;
    /// Its folding.
    fn geometry(&self) -> &Geometry;
    /// The records of the children of a node, in octant order; the top level's brick is the only child of
    /// its parent. `None` where there is no such node; an error where its record cannot be read.
    fn records(&self, parent: NodeKey) -> [Option<Result<NodeRecord, StoreError>>; 8];
    /// Reads and decodes the brick of a stored record.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    fn brick(&self, record: &NodeRecord, scratch: &mut BrickScratch) -> Result<Brick, StoreError>;
}

impl BrickSource for Store {
    fn metadata(&self) -> &Metadata {
        self.metadata()
    }

    fn geometry(&self) -> &Geometry {
        self.geometry()
    }

    fn records(&self, parent: NodeKey) -> [Option<Result<NodeRecord, StoreError>>; 8] {
        let root = self.geometry().root();
        if parent == root.parent() {
            let mut found = [const { None }; 8];
            found[0] = Some(self.node(root));
            return found;
        }
        read_children(self, parent)
    }

    fn brick(&self, record: &NodeRecord, scratch: &mut BrickScratch) -> Result<Brick, StoreError> {
        self.upload_brick(record, scratch)
    }
}

/// The children of a node that are wanted: their records, and the bricks of some.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Job {
    pub(super) parent: NodeKey,
    /// The children whose bricks are wanted, a bit an octant; none where only records are.
    pub(super) octants: u8,
}

/// What came of a job.
#[derive(Debug)]
pub(super) struct Fetched {
    pub(super) job: Job,
    pub(super) bricks: Vec<(NodeRecord, Brick)>,
    /// Records that were read: a node, and what is known of its children.
    pub(super) siblings: Vec<(NodeKey, Siblings)>,
    pub(super) errors: Vec<(NodeKey, StoreError)>,
    pub(super) elapsed: Duration,
}

/// What the threads and the frame share.
#[derive(Debug, Default)]
struct Shared {
    queue: VecDeque<Job>,
    /// What is being read, and what was read and not collected.
    active: HashMap<NodeKey, Active>,
    done: Vec<Fetched>,
    /// Threads that have panicked, and the jobs that nobody will do because of it.
    lost: usize,
    lost_jobs: Vec<Job>,
}

impl Shared {
    /// A job is being read no longer.
    fn release(&mut self, job: Job) {
        if let Some(active) = self.active.get_mut(&job.parent) {
            active.jobs -= 1;
            active.octants &= !job.octants;
            if active.jobs == 0 {
                self.active.remove(&job.parent);
            }
        }
    }

    /// Once all of so many threads are lost, nobody does what is queued.
    fn give_up(&mut self, threads: usize) {
        if self.lost == threads {
            self.lost_jobs.extend(self.queue.drain(..));
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Active {
    jobs: u32,
    octants: u8,
}

#[derive(Debug)]
struct Common {
    shared: Mutex<Shared>,
    wake: Condvar,
    stop: AtomicBool,
}

impl Common {
    fn lock(&self) -> MutexGuard<'_, Shared> {
        // What is shared is whole between any two statements, so a panic elsewhere does not spoil it.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A bounded pool of threads that fetch.
#[derive(Debug)]
pub(super) struct Fetcher {
    common: Arc<Common>,
    threads: Vec<JoinHandle<()>>,
    lost_told: usize,
}

impl Fetcher {
    pub(super) fn start(source: &Arc<dyn BrickSource>, threads: usize) -> io::Result<Self> {
        let common = Arc::new(Common {
            shared: Mutex::new(Shared::default()),
            wake: Condvar::new(),
            stop: AtomicBool::new(false),
        });
        let mut fetcher = Self { common: Arc::clone(&common), threads: Vec::new(), lost_told: 0 };
        for number in 0..threads {
            let (source, common) = (Arc::clone(source), Arc::clone(&common));
            let thread = std::thread::Builder::new()
                .name(format!("octavo-fetch-{number}"))
                .spawn(move || work(&*source, &common, threads))?;
            fetcher.threads.push(thread);
        }
        Ok(fetcher)
    }

    /// Replaces the queue. Of each job, what is being read already is left out; bricks beyond `limit` that would be
    /// wanted or being read at once are left for a later frame.
    pub(super) fn replace(&self, jobs: impl Iterator<Item = Job>, limit: usize) {
        let mut shared = self.common.lock();
        let mut bricks: usize =
            shared.active.values().map(|active| active.octants.count_ones() as usize).sum();
        shared.queue.clear();
        for mut job in jobs {
            if let Some(active) = shared.active.get(&job.parent) {
                let records_alone = job.octants == 0;
                job.octants &= !active.octants;
                if records_alone || job.octants == 0 {
                    continue;
                }
            }
            bricks += (job.octants.count_ones() as usize).max(1);
            if bricks > limit {
                break;
            }
            shared.queue.push_back(job);
        }
        shared.give_up(self.threads.len());
        if !shared.queue.is_empty() {
            self.common.wake.notify_all();
        }
    }

    /// What has been fetched since the last call.
    pub(super) fn collect(&self) -> Vec<Fetched> {
        let mut shared = self.common.lock();
        let done = std::mem::take(&mut shared.done);
        for fetched in &done {
            shared.release(fetched.job);
        }
        if !done.is_empty() {
            self.common.wake.notify_all();
        }
        done
    }

    /// Jobs in the queue, and jobs being read or not collected.
    pub(super) fn load(&self) -> (usize, usize) {
        let shared = self.common.lock();
        let active = shared.active.values().map(|active| active.jobs as usize).sum();
        (shared.queue.len(), active)
    }

    /// Jobs in the queue or being read now.
    pub(super) fn unread(&self) -> usize {
        let shared = self.common.lock();
        let active: u32 = shared.active.values().map(|active| active.jobs).sum();
        shared.queue.len() + active as usize - shared.done.len()
    }

    /// Waits until something has been fetched that was not collected, or for so long.
    pub(super) fn wait(&self, at_most: Duration) {
        let started = Instant::now();
        let mut shared = self.common.lock();
        while shared.done.is_empty() && !(shared.queue.is_empty() && shared.active.is_empty()) {
            let left = at_most.saturating_sub(started.elapsed());
            if left.is_zero() {
                return;
            }
            let waited = self.common.wake.wait_timeout(shared, left);
            shared = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Threads that have ended by a panic since the last call, and jobs that were lost by it.
    pub(super) fn lost(&mut self) -> (usize, Vec<Job>) {
        let mut shared = self.common.lock();
        let told = std::mem::replace(&mut self.lost_told, shared.lost);
        (shared.lost - told, std::mem::take(&mut shared.lost_jobs))
    }
}

impl Drop for Fetcher {
    fn drop(&mut self) {
        self.common.stop.store(true, Ordering::Relaxed);
        self.common.lock().queue.clear();
        self.common.wake.notify_all();
        for thread in self.threads.drain(..) {
            // Its panic was counted; there is nobody left to tell.
            let _ = thread.join();
        }
    }
}

/// Counts a thread that panics, and tells what it was reading.
struct Alive<'a> {
    common: &'a Common,
    threads: usize,
    job: Cell<Option<Job>>,
}

impl Drop for Alive<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let mut shared = self.common.lock();
            shared.lost += 1;
            if let Some(job) = self.job.take() {
                shared.release(job);
                shared.lost_jobs.push(job);
            }
            shared.give_up(self.threads);
            self.common.wake.notify_all();
        }
    }
}

/// What each thread does.
fn work(source: &dyn BrickSource, common: &Common, threads: usize) {
    let alive = Alive { common, threads, job: Cell::new(None) };
    let mut scratch = BrickScratch::default();
    loop {
        let job = {
            let mut shared = common.lock();
            loop {
                if common.stop.load(Ordering::Relaxed) {
                    return;
                }
                if let Some(job) = shared.queue.pop_front() {
                    let active = shared.active.entry(job.parent).or_default();
                    active.jobs += 1;
                    active.octants |= job.octants;
                    break job;
                }
                shared = common.wake.wait(shared).unwrap_or_else(PoisonError::into_inner);
            }
        };
        alive.job.set(Some(job));
        let fetched = fetch(source, job, &common.stop, &mut scratch);
        common.lock().done.push(fetched);
        common.wake.notify_all();
    }
}

/// Does one job.
fn fetch(
    source: &dyn BrickSource,
    job: Job,
    stop: &AtomicBool,
    scratch: &mut BrickScratch,
) -> Fetched {
    let started = Instant::now();
    let mut fetched = Fetched {
        job,
        bricks: Vec::new(),
        siblings: Vec::new(),
        errors: Vec::new(),
        elapsed: Duration::ZERO,
    };
    let records = sorted(source.records(job.parent), job.parent, &mut fetched.errors);
    fetched.siblings.push((job.parent, summaries(&records, source.metadata())));
    for (octant, record) in records.iter().enumerate() {
        let ChildRecord::Known(record) = record else { continue };
        if job.octants >> octant & 1 == 0 {
            continue;
        }
        if stop.load(Ordering::Relaxed) {
            break;
        }
        if matches!(record.state, BrickState::Stored | BrickState::Lost) {
            match source.brick(record, scratch) {
                Ok(brick) => fetched.bricks.push((*record, brick)),
                Err(error) => fetched.errors.push((record.key, error)),
            }
        }
        if record.key.level() > 0 {
            let beneath = sorted(source.records(record.key), record.key, &mut fetched.errors);
            fetched.siblings.push((record.key, summaries(&beneath, source.metadata())));
        }
    }
    fetched.elapsed = started.elapsed();
    fetched
}
