//! The program's own memory at its peak.
//!
//! Linux keeps a high-water mark of all resident pages (`VmHWM`), but that counts pages of mapped
//! files, which the system takes back when it needs them. What a program truly holds is `RssAnon`;
//! a thread reads it from `/proc/self/status` every few milliseconds.

use crate::error::PreprocessError;
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

const INTERVAL: Duration = Duration::from_millis(10);

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
                while !watched.stop.load(Ordering::Relaxed) {
                    watched.peak_bytes.fetch_max(own_bytes().unwrap_or(0), Ordering::Relaxed);
                    thread::park_timeout(INTERVAL);
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
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("RssAnon:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib << 10)
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
