//! Where bricks are decoded: so many at once, and so many requests that wait for it.
//!
//! A request for one brick is refused when too many wait; a stream, whose answer has begun, waits its turn.
//! Streams are few, and each has two bricks under way.

use crate::problem::Problem;
use octree_store::BrickScratch;
use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// The bounded pool.
#[derive(Debug)]
pub(crate) struct Decoders {
    running: Arc<Semaphore>,
    streams: Arc<Semaphore>,
    waiting: AtomicUsize,
    waiting_limit: usize,
    threads: usize,
}

/// Counts one that waits, however its waiting ends.
struct Waiting<'a>(&'a AtomicUsize);

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

thread_local! {
    /// Buffers that a thread keeps from brick to brick.
    static SCRATCH: RefCell<BrickScratch> = RefCell::default();
}

impl Decoders {
    pub(crate) fn new(threads: usize, waiting_limit: usize, streams: usize) -> Self {
        Self {
            running: Arc::new(Semaphore::new(threads.max(1))),
            streams: Arc::new(Semaphore::new(streams.max(1))),
            waiting: AtomicUsize::new(0),
            waiting_limit,
            threads: threads.max(1),
        }
    }

    /// Does work on a thread of the pool, or refuses when too many wait for one.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut BrickScratch) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        if let Ok(permit) = Arc::clone(&self.running).try_acquire_owned() {
            return Self::with(permit, work).await;
        }
        if self.waiting.fetch_add(1, Ordering::Relaxed) >= self.waiting_limit {
            self.waiting.fetch_sub(1, Ordering::Relaxed);
            return Err(Problem::busy("too many requests wait for bricks to be decoded"));
        }
        let waiting = Waiting(&self.waiting);
        let permit = self.turn().await?;
        drop(waiting);
        Self::with(permit, work).await
    }

    /// Does work on a thread of the pool, when its turn comes.
    pub(crate) async fn run_in_turn<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut BrickScratch) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        Self::with(self.turn().await?, work).await
    }

    async fn turn(&self) -> Result<OwnedSemaphorePermit, Problem> {
        let permit = Arc::clone(&self.running).acquire_owned().await;
        permit.map_err(|_| Problem::busy("the server is stopping"))
    }

    async fn with<T: Send + 'static>(
        permit: OwnedSemaphorePermit,
        work: impl FnOnce(&mut BrickScratch) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        // The permit goes with the work: a client that leaves does not make room for another decode.
        let task = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            SCRATCH.with_borrow_mut(work)
        });
        task.await
            .map_err(|_| Problem::internal("reading failed for a reason of the program's own"))
    }

    /// Room for a stream of frames; whoever holds it, streams.
    pub(crate) fn stream(&self) -> Result<OwnedSemaphorePermit, Problem> {
        let permit = Arc::clone(&self.streams).try_acquire_owned();
        permit.map_err(|_| Problem::busy("too many streams are open"))
    }

    /// Work that runs now, and work that waits.
    pub(crate) fn load(&self) -> (usize, usize) {
        let running = self.threads.saturating_sub(self.running.available_permits());
        (running, self.waiting.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use std::time::Duration;

    #[tokio::test]
    async fn one_who_leaves_makes_no_room_until_the_work_is_done() {
        let decoders = Decoders::new(1, 1, 1);
        let ((begun, has_begun), (end, may_end)) =
            (mpsc::sync_channel(1), mpsc::sync_channel::<()>(1));
        let work = decoders.run(move |_| {
            begun.send(()).unwrap();
            may_end.recv().unwrap();
        });
        assert!(tokio::time::timeout(Duration::from_millis(50), work).await.is_err(), "it left");
        has_begun.recv().unwrap();
        let next = decoders.run(|_| ());
        assert!(tokio::time::timeout(Duration::from_millis(50), next).await.is_err(), "no room");
        assert_eq!(decoders.load(), (1, 0));
        end.send(()).unwrap();
        decoders.run(|_| ()).await.unwrap();
    }
}
