//! The adaptive loader: gives a renderer just the bricks that its view requires. It knows of no GPU.
//!
//! The method is that of Gobbetti et al., *A single-pass GPU ray casting framework for interactive out-of-core
//! rendering of massive volumetric datasets* (2008), and of its improved form for light field displays
//! (2010), which the files here cite by section.
//!
//! # A frame
//! [`Loader::frame`] takes a [`Scene`] (cameras and image sizes, accuracy in pixels a voxel, clip box, transfer
//! function or isovalue) and gives a [`Frame`]: bricks to upload into slots, slots that are free again, and the
//! [`SpatialIndex`] that rays walk. The renderer draws it and hands back what it saw ([`Loader::feedback`]).
//! Reading and decoding happen on threads of the loader's own; no call waits for them but [`Loader::wait`], whose purpose it is.
//!
//! # What holds in every frame
//! - The index's leaves cover the volume once.
//! - Every leaf has something to show. A node is refined only when the bricks of all its children that are in
//!   view, not empty and (where the renderer tells octants) seen are in core; until then it stays a leaf itself. A child that
//!   comes into view later shows its parent's brick until its own is there. Only before the very first
//!   brick has come is there nothing ([`NodeData::Missing`]).
//! - Nodes of one value, and nodes of which nothing can be seen, need no slot. Inner nodes keep theirs, to filter
//!   between levels and to fall back upon.
//! - What is empty, out of view or was not seen is not asked for.
//! - A node whose children are no longer needed keeps them for `linger_frames`, so that a trembling camera
//!   changes nothing. Then they go, so that the cut of a still camera does not depend on where the camera came from.
//! - A region that comes into sight is drawn in that frame, from what is there. With its feedback it is refined by one level a
//!   frame if the data is in core, by one level in two frames if reading takes less than a frame. So it is fine within two frames a
//!   level, and what the disk takes.
//! - A node that cannot be read is reported once, and its parent is shown in its place; all else goes on.
//!
//! [`select_cut`] chooses a cut at once, without loader or threads, from any [`NodeSource`].
//!
//! ```
//! use octree_store::loader::{
//!     Appearance, Camera, Loader, LoaderOptions, NodeData, Quality, Scene, TransferFunction, View,
//! };
//! # use octree_store::{Encoding, Geometry, Metadata, NodeKey, SampleType, Store, StoreWriter, encode_samples};
//! use std::time::Duration;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("ramp.octavo");
//! # let geometry = Geometry::new([8, 8, 8], 8, 1)?;
//! # let key = NodeKey::new(0, [0, 0, 0]);
//! # let samples: Vec<u16> = (0..1000).collect();
//! # let (record, payload) = encode_samples(key, &samples, Encoding::Quantised8);
//! # let mut writer = StoreWriter::create(&path, &folder.path().join("ramp.work"), Vec::new())?;
//! # writer.append(&mut [record], &payload, Vec::new())?;
//! # writer.finish(Metadata::new(&geometry, SampleType::U16, Encoding::Quantised8))?;
//! let store = Store::open(&path)?;
//! // Feedback is for renderers that draw; this one only counts.
//! let options = LoaderOptions { visibility: false, ..LoaderOptions::default() };
//! let mut loader = Loader::new(store, options)?;
//!
//! let camera: Camera = serde_json::from_str(
//!     r#"{"projection":"perspective","position":[4,4,-20],"target":[4,4,4],"up":[0,-1,0],"fov_y_deg":40}"#,
//! )?;
//! let transfer: TransferFunction = serde_json::from_str(
//!     r#"{"points":[{"value":0,"color":[0,0,0],"extinction":0},{"value":900,"color":[1,0.9,0.8],"extinction":2.5}]}"#,
//! )?;
//! let views = [View::new(camera, [640, 480])?];
//! let appearance = Appearance::Transfer(transfer);
//! let scene = Scene { views: &views, clip: None, appearance: &appearance, quality: Quality::default() };
//!
//! let mut pool = std::collections::HashMap::new();
//! let frame = loop {
//!     let frame = loader.frame(&scene);
//!     for upload in &frame.uploads {
//!         pool.insert(upload.slot, upload.brick.clone());
//!     }
//!     if frame.converged {
//!         break frame;
//!     }
//!     loader.wait(Duration::from_millis(100));
//! };
//! let (_, leaf) = frame.index.leaves().next().ok_or("no leaf")?;
//! let NodeData::Slot(slot) = leaf.data else { return Err("no brick".into()) };
//! assert_eq!(pool[&slot].texel_range, [0.0, 999.0]);
//! # Ok(())
//! # }
//! ```

mod brick;
mod cache;
mod camera;
mod cut;
mod demand;
mod fetch;
mod frame;
mod in_core;
mod index;
mod lru;
mod nodes;
mod prefetch;
mod projection;
mod refine;
mod slots;
mod transfer;
mod tree;
mod urgency;
mod visibility;
mod walk;

pub use brick::{Brick, BrickFormat};
pub use cache::CacheStatistics;
pub use camera::{Camera, CameraJson, ClipBox, View, ViewError};
pub use cut::{Cut, CutLeaf, LeafKind, Scene, select_cut};
pub use demand::{Criterion, Deviation, Quality};
pub use fetch::BrickSource;
pub use frame::{Event, Frame, Loader, LoaderError, LoaderOptions, Statistics, Upload};
pub use index::{IndexNode, NO_NODE, NodeData, SpatialIndex};
pub use nodes::{Child, Lookup, NodeSource, NodeSummary, Siblings, StoreNodes};
pub use projection::{Projection, Ray, RayFan, ViewSet, off_axis};
pub use transfer::{Appearance, ControlPoint, TransferError, TransferFunction};
pub use visibility::Feedback;
pub use walk::Step;
