//! The trade of size, speed and accuracy, measured: one sample of a volume, converted in every way that
//! is worth a look, each read back and held against the source.
//!
//! [`Sampled::take`] decodes the sample once into a raw file, so that what is timed afterwards is Octavo
//! alone; [`ladder()`] says which ways there are; [`Sampled::measure`] goes one of them, and [`read_levels`]
//! looks at its levels; [`choose`] finds the best for a wish.

mod ladder;
mod lod;
mod rung;
mod sample;
mod threshold;
mod wishes;

pub use ladder::{LadderOptions, Rung, ladder};
pub use lod::{LevelReading, read_levels};
pub use rung::RungReading;
pub use sample::{SampleValues, Sampled, sample_region};
pub use threshold::otsu;
pub use wishes::{Wish, choose};
