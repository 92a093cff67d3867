//! A new store of what is whole in a damaged one: see [`octree_store::salvage`].

use crate::convert::{Output, Start};
use crate::error::PreprocessError;
use crate::progress::Progress;
use octree_store::{Salvaged, Store, StoreWriter};
use std::path::Path;

/// Copies all whole bricks of a store into a new one at `output`. The store is best opened by
/// [`Store::open_remains`].
///
/// # Errors
/// When the output exists and `start` does not replace it, a file cannot be read or written, or `progress` asks
/// to stop. Nothing is left under the output's name.
pub fn salvage(
    store: &Store,
    output: &Path,
    start: Start,
    progress: &dyn Progress,
) -> Result<Salvaged, PreprocessError> {
    let mut place = Output::prepare(store.disk(), output, &[store.path().to_owned()], None, start)?;
    let writer = StoreWriter::create_in(place.file()?, &place.partial, &place.index, vec![])?;
    let salvaged = octree_store::salvage(store, writer, || {
        progress.bricks_done(1);
        !progress.should_stop()
    })?;
    let salvaged = salvaged.ok_or(PreprocessError::Cancelled)?;
    place.finish()?;
    Ok(salvaged)
}
