//! `octavo extract`: a store, or a part of it, as a volume file again.

use crate::exit::Answer;
use crate::parse;
use crate::progress::Bar;
use anyhow::bail;
use clap::Args;
use octree_store::{Region, Store};
use preprocess::Volume;
use preprocess::export::{ExportFormat, export};
use std::path::PathBuf;

/// Write a store, a level or a region as a volume file
///
/// Keeps the source's type, spacing and affine; world positions stay, at any level. TIFF files have a page for
/// each slice and ImageJ's metadata, which hold the spacing but no affine; raw files hold neither.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo extract tooth.octavo -o tooth.nii.gz\n  \
    octavo extract tooth.octavo --level 1 -o half.nrrd\n  \
    octavo extract tooth.octavo --roi 20:80,20:80,0:161 -o part.tif")]
pub(super) struct Extract {
    /// The store
    store: PathBuf,
    /// The file: .nii, .nii.gz, .nrrd, .tif (BigTIFF above 4 GiB) or .raw
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Level
    #[arg(long, value_name = "L", default_value_t = 0)]
    level: u8,
    /// Part of the volume: half-open, in level-0 voxels; a coarser level gives every cell that
    /// touches it
    #[arg(long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = parse::region)]
    roi: Option<Region>,
    /// Replace an existing file
    #[arg(long)]
    force: bool,
}

impl Extract {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let Some(format) = ExportFormat::of_name(&self.output) else {
            bail!(
                "{}: its name must end in .nii, .nii.gz, .nrrd, .tif, .tiff or .raw",
                self.output.display()
            );
        };
        let store = Store::open(&self.store)?;
        let dims_xyz = store.geometry().dims_xyz();
        let top = store.geometry().top_level();
        if self.level > top {
            let (path, level) = (self.store.display(), self.level);
            bail!("{path}: it has levels 0 to {top}, and level {level} was asked for");
        }
        if let Some(roi) = self.roi.filter(|roi| !roi.lies_within(dims_xyz)) {
            let Region { min, max } = roi;
            return Err(octree_store::StoreError::Region { level: 0, min, max, dims_xyz }.into());
        }
        let region = self.roi.map(|roi| Region {
            min: roi.min.map(|v| v >> self.level),
            max: roi.max.map(|v| ((v - 1) >> self.level) + 1),
        });
        let volume = Volume::of_store(store, self.level, region)?;
        let bar = Bar::of("extracting", volume.dims_xyz()[2], "slices");
        let done = export(&volume, &self.output, format, self.force, &bar);
        bar.finish();
        done?;
        if volume.affine().is_some() && format == ExportFormat::Tiff {
            let path = self.output.display();
            eprintln!(
                "octavo: {path}: TIFF holds the spacing alone: where the voxels lie in the world is left \
                 out (.nrrd and .nii keep it)"
            );
        }
        Ok(Answer::Done)
    }
}
