//! Volumes to try things on: small real ones that lie beside this crate, and synthetic ones of any
//! size that it computes.
//!
//! A [`Phantom`] is a recipe, not data: every voxel is a pure function of the recipe, the volume's
//! size and the voxel's place, so that any row or slice can be had alone, in any order and on any
//! thread, and a terabyte needs no more memory than a megabyte. The program `phantom` writes one
//! to a raw file.
//!
//! | kind | what for |
//! |---|---|
//! | [`Kind::MicroCt`] | speed and compression: looks like a noisy micro-CT scan of a foam part |
//! | [`Kind::Ramp`] | interpolation and axis order: the right answer is a formula |
//! | [`Kind::Sphere`] | surfaces, volumes and gradients with a known answer |
//! | [`Kind::HotVoxel`] | nothing may lose one bright voxel |
//! | [`Kind::Constant`] | uniform bricks |
//!
//! # What is guaranteed
//! The same bytes on every machine, operating system and thread count. Only integer arithmetic and
//! the IEEE operations `+ - * /`, square root and conversion are used, in a fixed order; sines come
//! from a polynomial of our own instead of the platform's mathematics library, noise from a hash
//! of (seed, x, y, z). A change of the bytes for a given recipe is a change of this
//! crate's interface: a test holds the checksums.
//!
//! # Example
//! ```
//! use data_samples::{ByteOrder, Kind, Phantom, SampleType, write_raw};
//!
//! let phantom = Phantom::new(Kind::micro_ct(7), [64, 48, 40])?;
//!
//! let mut slice = vec![0_u16; 64 * 48];
//! phantom.slice(20, &mut slice)?; // any slice, no other needed
//!
//! let mut file = Vec::new(); // or a File; write_raw_file also renames into place
//! write_raw(&phantom, SampleType::U16, ByteOrder::Little, &mut file)?;
//! assert_eq!(file.len(), 64 * 48 * 40 * 2);
//! let start = 20 * 64 * 48 * 2;
//! assert_eq!(file[start..start + 2], slice[0].to_le_bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod analytic;
mod ellipsoid;
mod error;
mod foam;
mod micro_ct;
mod noise;
mod phantom;
mod real;
mod sample;
mod trig;
mod write;

pub use error::{PhantomError, WriteError};
pub use micro_ct::{AIR, CASING, CORE, DEFAULT_NOISE_SIGMA, KERNEL, VOID_FILLING, WALL};
pub use phantom::{Kind, Phantom};
pub use real::{folder, sample_path};
pub use sample::{ByteOrder, Sample, SampleType};
pub use write::{write_raw, write_raw_file};
