//! The program's own memory at its peak.
//!
//! Linux keeps a high-water mark of all resident pages (`VmHWM`), but that counts pages of mapped
//! files, which the system takes back when it needs them. What a program truly holds is `RssAnon`,
//! the resident pages of `/proc/self/statm` that are not shared. A thread reads it every ten
//! milliseconds, and more often in the beginning, so that short work is seen too. The system counts
//! pages for each processor apart and adds them up now and then: a few hundred kilobytes are noise.

use crate::error::PreprocessError;
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// The longest and the shortest time between two looks.
const INTERVAL: Duration = Duration::from_millis(10);
const FIRST_INTERVAL: Duration = Duration::from_micros(500);

/// A watch over this process's own memory, from its making to its end.
#[derive(Debug)]
pub struct PeakMemory {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    peak_bytes: AtomicU64,
    stop: AtomicBool,
}

impl PeakMemory {
    /// Begins to watch.
    ///
    /// # Errors
    /// When no thread can be started.
    pub fn watch() -> Result<Self, PreprocessError> {
        let shared = Arc::new(Shared::default());
        let watched = Arc::clone(&shared);
        let thread = thread::Builder::new()
            .name("memory".into())
            .spawn(move || {
                let begun = Instant::now();
                while !watched.stop.load(Ordering::Relaxed) {
                    watched.peak_bytes.fetch_max(own_bytes().unwrap_or(0), Ordering::Relaxed);
                    thread::park_timeout((begun.elapsed() / 20).clamp(FIRST_INTERVAL, INTERVAL));
                }
            })
            .map_err(PreprocessError::Thread)?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// The most that was seen so far; none where the system does not tell.
    pub fn peak_bytes(&self) -> Option<u64> {
        let now = own_bytes()?;
        Some(self.shared.peak_bytes.fetch_max(now, Ordering::Relaxed).max(now))
    }
}

impl Drop for PeakMemory {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // It cannot panic, and if it did there is nothing left to tell.
            let _ = thread.join();
        }
    }
}

/// Anonymous resident memory of this process now.
fn own_bytes() -> Option<u64> {
    let statm = fs::read_to_string("/proc/self/statm").ok()?;
    let mut pages = statm.split_whitespace().skip(1).map(str::parse::<u64>);
    let (resident, shared) = (pages.next()?.ok()?, pages.next()?.ok()?);
    Some(resident.saturating_sub(shared) * rustix::param::page_size() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_touched_shows_even_after_it_is_gone() {
        let watch = PeakMemory::watch().unwrap();
        let before = watch.peak_bytes().unwrap();
        let block = vec![1_u8; 64 << 20];
        assert!(block.iter().map(|&b| u64::from(b)).sum::<u64>() == 64 << 20);
        thread::sleep(10 * INTERVAL);
        drop(block);
        assert!(watch.peak_bytes().unwrap() >= before + (60 << 20));
    }
}
