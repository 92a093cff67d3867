//! The slots of the renderer's pool of bricks: which brick is in which.
//!
//! Slots of the current cut are pinned. A slot that is given back keeps its brick until another brick needs
//! the room, the one that was used longest ago first: a view that returns finds its bricks in place.

use super::cache::CacheStatistics;
use super::lru::Lru;
use crate::key::NodeKey;

#[derive(Debug)]
pub(super) struct SlotPool {
    bricks: Lru<NodeKey, u32>,
    /// Slots that never had a brick, as a range.
    unused: std::ops::Range<u32>,
    pinned: usize,
    pub(super) statistics: CacheStatistics,
}

impl SlotPool {
    pub(super) fn new(count: usize) -> Self {
        let unused = 0..count as u32;
        let statistics = CacheStatistics::default();
        Self { bricks: Lru::new(), unused, pinned: 0, statistics }
    }

    pub(super) fn pinned(&self) -> usize {
        self.pinned
    }

    pub(super) fn contains(&self, key: NodeKey) -> bool {
        self.bricks.peek(key).is_some()
    }

    /// Whether a slot is pinned, with this brick or another.
    pub(super) fn is_in_use(&self, key: NodeKey, slot: u32) -> bool {
        // A slot that another brick took is no longer this one's.
        self.bricks.peek(key) != Some(&slot) || self.bricks.is_pinned(key)
    }

    /// Pins the slot that has a brick, if one has.
    pub(super) fn pin(&mut self, key: NodeKey) -> Option<u32> {
        let slot = *self.bricks.peek(key)?;
        self.bricks.pin(key);
        self.pinned += 1;
        self.statistics.hits += 1;
        Some(slot)
    }

    /// Pins a slot for a brick that has none; `None` where all are pinned.
    pub(super) fn place(&mut self, key: NodeKey) -> Option<u32> {
        let slot = if let Some(slot) = self.unused.next() {
            slot
        } else {
            let (_, slot) = self.bricks.pop_oldest()?;
            self.statistics.evictions += 1;
            slot
        };
        self.bricks.insert(key, slot);
        self.bricks.pin(key);
        self.pinned += 1;
        self.statistics.misses += 1;
        Some(slot)
    }

    pub(super) fn unpin(&mut self, key: NodeKey) {
        if self.contains(key) {
            self.bricks.unpin(key);
            self.pinned -= 1;
        }
    }

    /// The statistics, with bytes for bricks of the given size.
    pub(super) fn statistics(&self, brick_bytes: usize) -> CacheStatistics {
        let bricks = self.bricks.len();
        CacheStatistics { bricks, bytes: bricks * brick_bytes, ..self.statistics }
    }
}
