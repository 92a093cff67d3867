//! How work tells what it has done, and learns that it is to stop.

/// Watches work; called from the threads that do it.
pub trait Progress: Sync {
    /// So many more bricks are done.
    fn bricks_done(&self, bricks: u64);

    /// Whether the work is to stop as soon as it can.
    fn should_stop(&self) -> bool {
        false
    }
}

/// Watches nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn bricks_done(&self, _: u64) {}
}
