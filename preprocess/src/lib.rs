//! From volume files to stores: sources, the pyramid, the conversion pipeline, error statistics, and
//! the way back.
//!
//! [`Source`] opens a volume; [`convert`] makes a store of it; [`verify_against`] and
//! [`compare`](compare::compare) measure what was lost; [`Volume`] reads stores and sources alike,
//! slice by slice, in bounded memory, which is how [`export`] writes them out again; [`tradeoff`] measures what
//! each way to convert costs and gives.

mod again;
pub mod compare;
mod convert;
mod decode;
mod disk;
mod downsample;
mod error;
pub mod export;
mod gather;
pub mod histogram;
mod level_window;
pub mod memory;
mod progress;
mod repair;
mod salvage;
pub mod source;
pub mod tradeoff;
mod upscale;
mod value_stats;
mod verify_against;
mod volume;
mod walk;
mod window;

pub use convert::{Conversion, ConversionPlan, ConvertOptions, PlannedLevel, Start, convert};
pub use disk::DiskSpace;
pub use error::PreprocessError;
pub use progress::{NoProgress, Progress};
pub use repair::{Repair, repair};
pub use salvage::salvage;
pub use source::{Source, SourceError, SourceOptions};
pub use upscale::{CubicKernel, Detail, Upscale};
pub use verify_against::{AgainstReport, OverlapReport, verify_against};
pub use volume::{Volume, VolumeSlices};

/// A pool of named threads.
fn pool(threads: usize) -> Result<rayon::ThreadPool, PreprocessError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("brick-{index}"))
        .build()
        .map_err(|error| PreprocessError::Thread(std::io::Error::other(error)))
}
