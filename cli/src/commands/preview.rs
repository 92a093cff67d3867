//! `octavo preview`: three slices and the histogram, in the terminal.

use crate::chart;
use crate::exit::Answer;
use crate::picture::{Axis, read_slice, robust_window};
use clap::{Args, ValueEnum};
use image::{DynamicImage, GrayImage};
use octree_store::Store;
use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;

/// Show three orthogonal slices and the histogram in the terminal
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  octavo preview tooth.octavo --width 60")]
pub(super) struct Preview {
    /// The store
    store: PathBuf,
    /// Columns that a slice takes
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(8..=512))]
    width: u16,
}

impl Preview {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open(&self.store)?;
        let geometry = store.geometry();
        // The coarsest level that still fills the columns.
        let fills =
            |level: &u8| geometry.dims_at(*level).iter().all(|&dim| dim >= u64::from(self.width));
        let level = geometry.levels().rev().find(fills).unwrap_or(0);
        let histogram = preprocess::histogram::histogram(&store, level, 256)?;
        let window = robust_window(&histogram);
        for axis in Axis::value_variants() {
            let middle = geometry.dims_at(level)[axis.index()] / 2;
            let slice = read_slice(&store, *axis, middle, level)?;
            let [width, height] = slice.size;
            writeln!(io::stdout(), "{} = {middle} of level {level}", axis.name())?;
            let pixels = slice.grey8(window);
            let image = GrayImage::from_raw(width, height, pixels);
            let image = image.map(DynamicImage::ImageLuma8);
            let config = viuer::Config {
                absolute_offset: false,
                width: Some(u32::from(self.width)),
                // Graphics protocols are for terminals; a file or pipe gets blocks.
                use_kitty: io::stdout().is_terminal(),
                use_iterm: io::stdout().is_terminal(),
                ..viuer::Config::default()
            };
            if let Some(image) = image {
                viuer::print(&image, &config)?;
            }
        }
        write!(io::stdout(), "{}", chart::in_terminal(&histogram))?;
        Ok(Answer::Done)
    }
}
