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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_within_the_limit_is_chosen_and_of_equals_the_first() {
        let rung = |file_bits_per_voxel, rms, amax, random_read_micros| RungReading {
            file_bits_per_voxel,
            rms,
            amax,
            random_read_micros,
            ..RungReading::default()
        };
        let rungs = [
            rung(4.0, 1.0, 3.0, 10.0),
            rung(3.0, 2.0, 5.0, 5.0),
            rung(3.0, 1.5, 6.0, 2.0),
            rung(3.0, 2.0, 5.0, 5.0),
        ];
        let chosen = |wish| choose(wish, &rungs);
        for (amax, smallest, fastest) in [
            (2.9, None, None),
            (3.0, Some(0), Some(0)),
            (5.0, Some(1), Some(1)),
            (6.0, Some(2), Some(2)),
        ] {
            assert_eq!(chosen(Wish::SmallestUnderError { amax }), smallest, "{amax}");
            assert_eq!(chosen(Wish::FastestToReadUnderError { amax }), fastest, "{amax}");
        }
        for (bits_per_voxel, best) in [(2.9, None), (3.0, Some(2)), (4.0, Some(0))] {
            assert_eq!(chosen(Wish::MostAccurateUnderSize { bits_per_voxel }), best);
        }
        assert_eq!(choose(Wish::SmallestUnderError { amax: 9.0 }, &[]), None);
    }
}
