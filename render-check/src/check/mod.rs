//! A fixed set of pictures of a store, each held against the source: eleven views, two transfer functions and a surface.

mod page;

use crate::error::RenderError;
use crate::picture::{Comparison, Shown, compare, difference};
use crate::reference::{self, Interpolation, SourceVolume};
use crate::renderer::Renderer;
use crate::view::{Filter, Look, Mode, NamedView, Shading};
use octree_store::Metadata;
use octree_store::loader::{ControlPoint, TransferFunction, View};
use serde::Serialize;

pub use page::page;

/// What is asked of pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckOptions {
    /// Width and height.
    pub size: [u32; 2],
    /// The least PSNR, in dB; of a surface, whose pixels at silhouettes are all or nothing, 5 less.
    pub min_psnr_db: f64,
    /// Distance of samples in voxels.
    pub step_voxels: f64,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self { size: [320, 240], min_psnr_db: 40.0, step_voxels: 0.5 }
    }
}

impl CheckOptions {
    /// The least PSNR of a look's pictures, in dB.
    fn limit_of(&self, look: &Look) -> f64 {
        self.min_psnr_db - if let Mode::Iso(_) = look.mode { 5.0 } else { 0.0 }
    }
}

/// One picture and what came of it.
#[derive(Debug, Serialize)]
pub struct Checked {
    /// The view's name.
    pub view: &'static str,
    /// `opaque`, `transparent` or `surface`.
    pub look: &'static str,
    /// Against the source.
    #[serde(flatten)]
    pub comparison: Comparison,
    /// Whether it is as good as was asked.
    pub ok: bool,
    /// What is wrong with the store, as far as it was seen until then.
    pub problems: Vec<String>,
    /// Whether the cut was held coarser for want of room.
    pub limited: bool,
    /// Leaves of the cut that have a payload.
    pub bricks_in_cut: u64,
    /// The store's picture, the source's, and 16 times their difference.
    #[serde(skip)]
    pub pictures: [Shown; 3],
}

/// The looks that are checked, for values in this range and a transfer function that shows them: level 0 everywhere.
///
/// # Errors
/// When extinctions overflow.
pub fn looks(
    transfer: &TransferFunction,
    data_range: [f64; 2],
    options: &CheckOptions,
) -> Result<[(&'static str, Look); 3], RenderError> {
    let scaled = |by: f64| {
        let scale = |p: &ControlPoint| ControlPoint { extinction: p.extinction * by, ..*p };
        TransferFunction::new(transfer.points().iter().map(scale).collect())
    };
    let base = Look {
        accuracy: 1e-3,
        filter: Filter::Trilinear,
        step_voxels: options.step_voxels,
        ..Look::new(transfer.clone(), data_range)
    };
    let points = transfer.points();
    let surface = match points {
        [first, second, ..] => f64::midpoint(first.value, second.value),
        _ => f64::midpoint(data_range[0], data_range[1]),
    };
    let shading = Some(Shading::default());
    Ok([
        ("opaque", Look { transfer: scaled(4.0)?, shading, ..base.clone() }),
        ("transparent", Look { transfer: scaled(0.25)?, ..base.clone() }),
        ("surface", Look { mode: Mode::Iso(surface), shading, ..base }),
    ])
}

/// Draws and compares all pictures; `watch` hears of each.
///
/// # Errors
/// When one cannot be drawn.
pub fn check(
    renderer: &mut Renderer,
    metadata: &Metadata,
    source: &SourceVolume,
    looks: &[(&'static str, Look)],
    options: &CheckOptions,
    mut watch: impl FnMut(&Checked),
) -> Result<Vec<Checked>, RenderError> {
    let aspect = f64::from(options.size[0]) / f64::from(options.size[1]);
    let background = [0.1, 0.12, 0.15];
    let mut all = Vec::new();
    let mut problems: Vec<String> = Vec::new();
    for named in NamedView::ALL {
        let view = View::new(named.camera(metadata, aspect)?, options.size)?;
        for (name, look) in looks {
            let rendered = renderer.converge(&view, look, None, None)?;
            problems.extend(rendered.problems);
            let shown = rendered.picture.over(background);
            let truth =
                reference::draw(source, &view, look, Interpolation::Trilinear)?.over(background);
            let comparison = compare(&shown, &truth)?;
            let apart = difference(&shown, &truth, 16.0)?;
            let checked = Checked {
                view: named.name(),
                look: name,
                comparison,
                ok: comparison.reaches(options.limit_of(look)) && problems.is_empty(),
                problems: problems.clone(),
                limited: rendered.limited,
                bricks_in_cut: renderer.effort().bricks_in_cut,
                pictures: [shown, truth, apart],
            };
            watch(&checked);
            all.push(checked);
        }
    }
    Ok(all)
}
