//! Three wishes, and the rung that fulfils each best.

use super::rung::RungReading;
use serde::Serialize;

/// What someone wants.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "wish", rename_all = "snake_case")]
pub enum Wish {
    /// The smallest store whose AMAX is at most this, in source units.
    SmallestUnderError {
        /// The limit.
        amax: f64,
    },
    /// The least RMS in a store of at most so many bits a voxel, pyramid and index included.
    MostAccurateUnderSize {
        /// The limit.
        bits_per_voxel: f64,
    },
    /// The fastest read of a brick at a random place, in a store whose AMAX is at most this.
    FastestToReadUnderError {
        /// The limit.
        amax: f64,
    },
}

/// The rung that fulfils a wish best, by its place; `None` where none is within the limit. Of equals the first.
pub fn choose(wish: Wish, rungs: &[RungReading]) -> Option<usize> {
    let cost = |rung: &RungReading| -> Option<[f64; 2]> {
        match wish {
            Wish::SmallestUnderError { amax } => {
                (rung.amax <= amax).then_some([rung.file_bits_per_voxel, rung.rms])
            }
            Wish::MostAccurateUnderSize { bits_per_voxel } => (rung.file_bits_per_voxel
                <= bits_per_voxel)
                .then_some([rung.rms, rung.file_bits_per_voxel]),
            Wish::FastestToReadUnderError { amax } => {
                (rung.amax <= amax).then_some([rung.random_read_micros, rung.file_bits_per_voxel])
            }
        }
    };
    let costs = rungs.iter().enumerate().filter_map(|(place, rung)| Some((cost(rung)?, place)));
    let best = costs.min_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    best.map(|(_, place)| place)
}
