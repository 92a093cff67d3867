//! What can go wrong between a store and its picture.

use octree_store::StoreError;
use octree_store::loader::{LoaderError, TransferError, ViewError};
use thiserror::Error;

/// Why there is no picture.
#[derive(Debug, Error)]
pub enum RenderError {
    /// Nobody waits for the picture any more.
    #[error("the picture was given up")]
    Stopped,
    /// A number out of its range.
    #[error("{what} must be above 0 and at most {limit}, and {found} was given")]
    Number {
        /// Which.
        what: &'static str,
        /// What was given.
        found: f64,
        /// The most it may be.
        limit: f64,
    },
    /// A step that no picture needs.
    #[error("step must be at least {least} voxels, and {found} was given")]
    Step {
        /// What was given.
        found: f64,
        /// The shortest.
        least: f64,
    },
    /// An extinction whose sums overflow.
    #[error("extinction must be at most {limit} per world unit, and {found} was given")]
    Extinction {
        /// What was given.
        found: f64,
        /// The most.
        limit: f64,
    },
    /// A surface at a value that is none.
    #[error("isovalue must be a finite number, and is {found}")]
    Isovalue {
        /// What was given.
        found: f64,
    },
    /// A colour map that does not exist.
    #[error("there is no colour map {found:?}: choose one of {known}")]
    ColorMap {
        /// The name that was given.
        found: String,
        /// The names that exist.
        known: String,
    },
    /// A named view that does not exist.
    #[error("there is no view {found:?}: choose one of {known}, or a camera's JSON file")]
    NamedView {
        /// The name that was given.
        found: String,
        /// The names that exist.
        known: String,
    },
    /// A volume too wide for 32-bit voxel numbers.
    #[error("a volume of {} x {} x {} voxels is too wide to render: at most {limit} a side", dims_xyz[0], dims_xyz[1], dims_xyz[2])]
    TooWide {
        /// Voxels along x, y, z.
        dims_xyz: [u64; 3],
        /// The most along each.
        limit: u64,
    },
    /// A camera or a voxel's size whose rays 32-bit floats cannot hold.
    #[error(
        "the camera's numbers and the voxels' size lie too far apart to be drawn: an image must not be 1e15 times as large as a voxel, or a voxel as an image"
    )]
    OutOfScale,
    /// No Vulkan driver, or none of that name.
    #[error("no graphics adapter{} was found (of {found} in all): install a Vulkan driver (on Debian and Ubuntu the package mesa-vulkan-drivers draws without a graphics card), or use --backend cpu", .wanted.as_ref().map(|w| format!(" named {w:?}")).unwrap_or_default())]
    NoAdapter {
        /// The name that was asked for.
        wanted: Option<String>,
        /// How many there are.
        found: usize,
    },
    /// The adapter cannot do what is needed.
    #[error("the graphics adapter {adapter} cannot be used: {reason}")]
    Adapter {
        /// Its name.
        adapter: String,
        /// Why.
        reason: String,
    },
    /// The driver reported an error while drawing.
    #[error("the graphics driver failed while {doing}: {reason}")]
    Driver {
        /// What was being done.
        doing: &'static str,
        /// What it said.
        reason: String,
    },
    /// Pictures that cannot be compared.
    #[error("pictures of {} x {} and {} x {} pixels cannot be compared", a[0], a[1], b[0], b[1])]
    Sizes {
        /// Size of the first.
        a: [u32; 2],
        /// Size of the second.
        b: [u32; 2],
    },
    /// A source that is not the store's.
    #[error("the store's volume is {} x {} x {} and the source's {} x {} x {}: they are not the same", store_xyz[0], store_xyz[1], store_xyz[2], source_xyz[0], source_xyz[1], source_xyz[2])]
    Dims {
        /// The store's.
        store_xyz: [u64; 3],
        /// The source's.
        source_xyz: [u64; 3],
    },
    /// A camera or clip box.
    #[error(transparent)]
    View(#[from] ViewError),
    /// A transfer function.
    #[error(transparent)]
    Transfer(#[from] TransferError),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The loader.
    #[error(transparent)]
    Loader(#[from] LoaderError),
}

impl RenderError {
    /// Whether the machine is at fault and not what was asked for.
    pub fn is_environment(&self) -> bool {
        match self {
            Self::NoAdapter { .. } | Self::Adapter { .. } | Self::Driver { .. } => true,
            Self::Store(error) => error.is_environment(),
            Self::Loader(error) => matches!(error, LoaderError::Threads { .. }),
            _ => false,
        }
    }
}
