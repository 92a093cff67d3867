//! What makes values of a store's codes, for a block of bricks: scale, offset, least and greatest value of each.

use crate::records::records;
use crate::views::codes::{Block, MAP_NUMBERS, block_xyz};
use octree_store::{BrickState, NodeKey, NodeRecord, Store, StoreError};

/// A block's numbers as its chunk has them: f64, x fastest but for the numbers themselves. Of bricks outside the volume
/// they are 0; of those whose record cannot be read NaN, and the errors come beside them.
pub(crate) fn block_bytes(store: &Store, block: Block) -> (Vec<u8>, Vec<StoreError>) {
    let geometry = store.geometry();
    let (side, grid) = (block_xyz(geometry, block.level), geometry.grid_at(block.level));
    let first = [0, 1, 2].map(|axis| block.place_xyz[axis] * side[axis]);
    let count = side.iter().product::<u64>();
    let place = |i: u64| [i % side[0], i / side[0] % side[1], i / side[0] / side[1]];
    let mut bricks: Vec<(NodeKey, u64)> = (0..count)
        .map(|i| (place(i), i))
        .map(|(at, i)| ([0, 1, 2].map(|axis| first[axis] + at[axis]), i))
        .filter(|(brick, _)| (0..3).all(|axis| brick[axis] < grid[axis]))
        .map(|(brick, i)| (NodeKey::new(block.level, brick), i))
        .collect();
    // In the order of keys siblings follow each other.
    bricks.sort_unstable();
    let mut map = vec![[0.0; MAP_NUMBERS]; count as usize];
    let mut errors = Vec::new();
    let keys = bricks.iter().map(|(key, _)| *key);
    for ((_, i), (_, record)) in bricks.iter().zip(records(store, keys)) {
        map[*i as usize] =
            record.and_then(|record| numbers(store, &record)).unwrap_or_else(|error| {
                errors.push(error);
                [f64::NAN; MAP_NUMBERS]
            });
    }
    (map.into_iter().flatten().flat_map(f64::to_le_bytes).collect(), errors)
}

fn numbers(store: &Store, record: &NodeRecord) -> Result<[f64; MAP_NUMBERS], StoreError> {
    let map = store.value_map(record)?;
    let (min, max) = match record.state {
        BrickState::Stored | BrickState::Lost => (record.brick_min, record.brick_max),
        BrickState::Uniform | BrickState::Empty => (map.offset, map.offset),
    };
    Ok([map.scale, map.offset, min, max])
}
