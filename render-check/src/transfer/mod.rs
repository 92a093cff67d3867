//! Transfer functions: their exact integrals, the tables that shaders take, and a default for any volume.

mod color_map;
mod exact;
mod file;
mod guess;
mod opacity;
mod table;

pub use color_map::ColorMap;
pub(crate) use exact::ExactIntegrals;
pub use file::TransferFile;
pub use guess::guess;
pub(crate) use opacity::decay;
pub use table::TransferTable;
