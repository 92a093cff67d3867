//! What a picture shows, as it is said on the command line.

use super::read_json;
use clap::{Args, ValueEnum};
use octree_store::loader::{ClipBox, TransferFunction};
use octree_store::{BrickScratch, BrickState, Store};
use render_check::transfer::{TransferFile, guess};
use render_check::view::{Filter, Look, Mode, Shading};
use std::path::{Path, PathBuf};

/// Transfer function, mode, shading, accuracy.
#[derive(Debug, Args)]
#[command(next_help_heading = "Look")]
pub(in crate::commands) struct LookArgs {
    /// Transfer function as JSON: control points, or a colour map by name [default: chosen from the values]
    #[arg(long, value_name = "FILE.json")]
    transfer: Option<PathBuf>,
    /// dvr (light through the volume), iso (a surface), mip (the greatest value)
    #[arg(long, value_enum, default_value_t = ModeArg::Dvr)]
    mode: ModeArg,
    /// Value of the surface, in source units [default: the middle of the values]
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    iso: Option<f64>,
    /// Values that are black and white where the greatest is shown [default: the ends of the transfer function if one is given, else of the data]
    #[arg(long, value_name = "LOW,HIGH", value_parser = window, allow_hyphen_values = true)]
    window: Option<[f64; 2]>,
    /// phong, or off [default: phong for surfaces, off else]
    #[arg(long, value_enum)]
    shading: Option<ShadingArg>,
    /// Distance of samples, in voxels of the level at hand
    #[arg(long, value_name = "VOXELS", default_value_t = 0.5)]
    step: f64,
    /// Pixels that a voxel may cover: above 1 is coarser and faster
    #[arg(long, value_name = "PIXELS", default_value_t = 1.0)]
    accuracy: f64,
    /// Between levels: quadrilinear blends them, trilinear does not
    #[arg(long, value_enum, default_value_t = FilterArg::Quadrilinear)]
    filter: FilterArg,
    /// Only what lies in this box, in world units from the volume's corner
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = clip_box, allow_hyphen_values = true)]
    clip: Option<ClipBox>,
}

/// `LOW,HIGH`: two numbers, the first below the second.
fn window(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(',').map(|(low, high)| (low.trim().parse(), high.trim().parse()));
    match ends {
        Some((Ok(low), Ok(high))) if low < high && f64::is_finite(high - low) => Ok([low, high]),
        _ => Err(format!("expected LOW,HIGH, the first below the second, and found '{text}'")),
    }
}

/// `X0,Y0,Z0,X1,Y1,Z1`: the lower corner, then the upper one.
fn clip_box(text: &str) -> Result<ClipBox, String> {
    let ends: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match ends[..] {
        [x0, y0, z0, x1, y1, z1] if text.split(',').count() == 6 => {
            ClipBox::new([x0, y0, z0], [x1, y1, z1]).map_err(|error| error.to_string())
        }
        _ => Err(format!("expected six numbers X0,Y0,Z0,X1,Y1,Z1 and found '{text}'")),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ModeArg {
    Dvr,
    Iso,
    Mip,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ShadingArg {
    Phong,
    Off,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FilterArg {
    Trilinear,
    Quadrilinear,
}

impl LookArgs {
    /// The look, for a store.
    pub(in crate::commands) fn look(&self, store: &Store) -> anyhow::Result<Look> {
        let range = data_range(store);
        let transfer = transfer_of(self.transfer.as_deref(), store)?;
        let mode = match self.mode {
            ModeArg::Dvr => Mode::Dvr,
            ModeArg::Mip => Mode::Mip,
            ModeArg::Iso => Mode::Iso(self.iso.unwrap_or_else(|| middle(&transfer, range))),
        };
        let shaded = self.shading.map_or(self.mode == ModeArg::Iso, |s| s == ShadingArg::Phong);
        let filter = match self.filter {
            FilterArg::Trilinear => Filter::Trilinear,
            FilterArg::Quadrilinear => Filter::Quadrilinear,
        };
        let mut look = Look::new(transfer, range);
        if mode == Mode::Mip {
            let whole = (self.transfer.is_none() && range[0] < range[1]).then_some(range);
            look.window = self.window.or(whole).unwrap_or(look.window);
        }
        Ok(Look {
            mode,
            shading: shaded.then(Shading::default),
            step_voxels: self.step,
            accuracy: self.accuracy,
            filter,
            clip: self.clip,
            ..look
        })
    }
}

/// The transfer function of a file, or one for the store's values.
pub(in crate::commands) fn transfer_of(
    path: Option<&Path>,
    store: &Store,
) -> anyhow::Result<TransferFunction> {
    match path {
        None => default_transfer(store),
        Some(path) => read_json(path, |text| Ok(TransferFile::parse(text)??)),
    }
}

/// Least and greatest value of a store.
pub(in crate::commands) fn data_range(store: &Store) -> [f64; 2] {
    let metadata = store.metadata();
    let [low, high] = [metadata.value_min.unwrap_or(0.0), metadata.value_max.unwrap_or(0.0)];
    // Dropped bricks read as a value that may be none of the source's.
    let dropped = metadata.levels.iter().any(|level| level.empty > 0);
    if dropped {
        [low.min(metadata.empty_value), high.max(metadata.empty_value)]
    } else {
        [low, high]
    }
}

/// A transfer function for the values of the top level.
pub(in crate::commands) fn default_transfer(store: &Store) -> anyhow::Result<TransferFunction> {
    let (geometry, metadata) = (store.geometry(), store.metadata());
    let record = store.node(geometry.root())?;
    let size = [0, 1, 2].map(|axis| geometry.dims_xyz()[axis] as f64 * metadata.spacing_xyz[axis]);
    let diagonal = size.iter().map(|s| s * s).sum::<f64>().sqrt();
    let values: Vec<f64> = if record.state == BrickState::Stored {
        let brick = store.upload_brick(&record, &mut BrickScratch::default())?;
        (0..geometry.brick_samples()).map(|i| brick.value(i)).collect()
    } else {
        vec![record.brick_min]
    };
    Ok(guess(values.into_iter(), diagonal))
}

/// The value at which the default transfer function is half opaque: a surface that is there in most volumes.
pub(in crate::commands) fn middle(transfer: &TransferFunction, range: [f64; 2]) -> f64 {
    match transfer.points() {
        [first, second, _] => f64::midpoint(first.value, second.value),
        _ => f64::midpoint(range[0], range[1]),
    }
}
