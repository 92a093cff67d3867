//! `octavo slice`: one slice as a PNG picture.

use super::write_whole;
use crate::exit::Answer;
use crate::parse;
use crate::picture::{self, Axis, Depth};
use clap::Args;
use octree_store::Store;
use std::path::PathBuf;

/// Write one slice as a PNG
///
/// Across z the picture's axes are x and y, across y they are x and z, across x they are y and z; the
/// first voxel is at the top left. Values map linearly from the window to black and white.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo slice tooth.octavo --axis z --index 80 -o tooth.png\n  \
    octavo slice tooth.octavo --axis x --index 12 --level 2 --window 200,1100 -o coarse.png\n  \
    octavo slice tooth.octavo --axis z --index 80 --bits 16 -o tooth16.png")]
pub(super) struct Slice {
    /// The store
    store: PathBuf,
    /// Axis across the slice
    #[arg(long, value_enum)]
    axis: Axis,
    /// Which slice, in voxels of the level
    #[arg(long, value_name = "N")]
    index: u64,
    /// Level
    #[arg(long, value_name = "L", default_value_t = 0)]
    level: u8,
    /// Values of black and white [default: the source's range; with --bits 16, u8 and u16 values
    /// as they are]
    #[arg(long, value_name = "LO,HI", value_parser = parse::window, allow_hyphen_values = true)]
    window: Option<[f64; 2]>,
    /// Bits a pixel: 8 or 16
    #[arg(long, value_enum, default_value_t = Depth::Eight)]
    bits: Depth,
    /// The picture
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    /// Replace an existing file
    #[arg(long)]
    force: bool,
}

impl Slice {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open(&self.store)?;
        let slice = picture::read_slice(&store, self.axis, self.index, self.level)?;
        let window = picture::window(&store, self.window, self.bits);
        write_whole(&self.output, self.force, |file| slice.write_png(file, window, self.bits))?;
        Ok(Answer::Done)
    }
}
