//! Decoded bricks in memory (2008 text, section 4: a second-level cache before the disk).
//!
//! The bricks of the current cut are pinned; of the others the least recently used go first. Sizes are in bytes.

use super::brick::Brick;
use super::lru::Lru;
use crate::key::NodeKey;
use std::sync::Arc;

/// What a cache has done since it was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CacheStatistics {
    /// Bricks that were wanted and there.
    pub hits: u64,
    /// Bricks that were wanted and not there.
    pub misses: u64,
    /// Bricks that were dropped for others.
    pub evictions: u64,
    /// Bricks in it now.
    pub bricks: usize,
    /// Bytes of them.
    pub bytes: usize,
}

#[derive(Debug)]
pub(super) struct BrickCache {
    bricks: Lru<NodeKey, Arc<Brick>>,
    limit_bytes: usize,
    pub(super) statistics: CacheStatistics,
}

impl BrickCache {
    pub(super) fn new(limit_bytes: usize) -> Self {
        Self { bricks: Lru::new(), limit_bytes, statistics: CacheStatistics::default() }
    }

    pub(super) fn contains(&self, key: NodeKey) -> bool {
        self.bricks.peek(key).is_some()
    }

    /// A brick, which becomes the last used.
    pub(super) fn get(&mut self, key: NodeKey) -> Option<&Arc<Brick>> {
        self.bricks.get(key)
    }

    /// Adds a brick, in place of others where room is short. If all others are pinned it is let go.
    pub(super) fn insert(&mut self, key: NodeKey, brick: Brick) {
        let bytes = brick.texels.len();
        if self.contains(key) {
            return;
        }
        while self.statistics.bytes + bytes > self.limit_bytes {
            let Some((_, dropped)) = self.bricks.pop_oldest() else { return };
            self.statistics.bytes -= dropped.texels.len();
            self.statistics.evictions += 1;
        }
        self.statistics.bytes += bytes;
        self.bricks.insert(key, Arc::new(brick));
        self.statistics.bricks = self.bricks.len();
    }

    pub(super) fn pin(&mut self, key: NodeKey) {
        self.bricks.pin(key);
    }

    pub(super) fn unpin(&mut self, key: NodeKey) {
        self.bricks.unpin(key);
    }
}
