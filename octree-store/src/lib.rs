//! An out-of-core octree of small compressed bricks, in one file.
//!
//! A *volume* is a rectilinear grid of scalars, x fastest. [`Geometry`] folds it into levels of
//! bricks; a [`NodeKey`] names one brick; a [`NodeRecord`] says what is known of it; an
//! [`encoding`] turns its samples into a payload and back; [`StoreWriter`] writes all of it and
//! [`Store`] reads it from any number of threads and processes. [`verify`] tells whether a store
//! is whole, and [`loader`] gives a renderer the bricks that its view requires. `FORMAT.md` beside
//! this crate is the byte-level specification.
//!
//! The crate knows nothing of volume files, of GPUs, or of the command line.
//!
//! ```
//! use octree_store::{
//!     BrickScratch, Encoding, Geometry, Metadata, NodeKey, NodeRecord, Region, SampleType, Store,
//!     StoreWriter, encode_samples,
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("ramp.octavo");
//!
//! // A volume of 8 x 8 x 8 voxels is one brick of core 8; its top level is level 0.
//! let geometry = Geometry::new([8, 8, 8], 8, 1)?;
//! let key = NodeKey::new(0, [0, 0, 0]);
//! let side = geometry.brick_side() as i64;
//! let mut samples = Vec::new();
//! for z in 0..side {
//!     for y in 0..side {
//!         for x in 0..side {
//!             // Outside the volume the edge repeats.
//!             let [x, y, z] = [x, y, z].map(|i| (i - 1).clamp(0, 7) as u16);
//!             samples.push(1000 + 100 * x + 10 * y + z);
//!         }
//!     }
//! }
//! let (record, payload) = encode_samples(key, &samples, Encoding::Lossless);
//!
//! let metadata = Metadata::new(&geometry, SampleType::U16, Encoding::Lossless);
//! let work = folder.path().join("ramp.work");
//! let mut writer = StoreWriter::create(&path, &work, Vec::new())?;
//! writer.append(&mut [record], &payload, Vec::new())?;
//! writer.finish(metadata)?;
//!
//! let store = Store::open(&path)?;
//! let mut brick = vec![0_u16; store.geometry().brick_samples()];
//! let record = store.read_brick(key, &mut BrickScratch::default(), &mut brick)?;
//! assert_eq!((record.brick_min, record.brick_max), (1000.0, 1777.0));
//! assert_eq!(brick, samples);
//!
//! let region = store.read_region::<u16>(0, Region { min: [2, 0, 0], max: [4, 1, 1] })?;
//! assert_eq!(region, [1200, 1300]);
//! # Ok(())
//! # }
//! ```

#[cfg(target_endian = "big")]
compile_error!("samples and payloads are little-endian, and nothing swaps them here yet");

mod compensated_sum;
pub mod digest;
mod disk;
pub mod encoding;
mod error;
mod error_sum;
mod exact_sum;
mod geometry;
pub mod info_json;
mod instruction_set;
mod key;
pub mod loader;
mod metadata;
mod overlap_bound;
mod record;
mod region;
mod salvage;
mod sample;
mod store;
mod summary;
pub mod verify;

pub use compensated_sum::{CompensatedSum, WeightedRms};
pub use disk::{Disk, DiskFile, Operation, Watch};
pub use encoding::{
    Effort, Encoding, MaxError, OverlapAtRest, Upload, UploadFormat, ValueMap, encode_samples,
};
pub use error::{Damage, StoreError, is_denied};
pub use error_sum::{ErrorSum, ErrorTotal};
pub use exact_sum::ExactSum;
pub use geometry::{Geometry, GeometryError, Region};
pub use instruction_set::instruction_set;
pub use key::NodeKey;
pub use metadata::{
    DownsampleFilter, FORMAT_VERSION, LengthUnit, LevelSummary, Metadata, SourceDescription,
};
pub use record::{BrickState, NodeRecord, PayloadPlace};
pub use salvage::{SALVAGED_OF, Salvaged, salvage};
pub use sample::{Sample, SampleBuffer, SampleType, to_le_bytes};
pub use store::{BrickScratch, Children, Committed, Mender, Store, StoreWriter};
