//! What a view costs and gives: one picture of the sample at several accuracies and steps, each held against the
//! sample itself, drawn in f64 without any octree.

use crate::commands::render::{Drawer, data_range, default_transfer};
use octree_store::loader::View;
use octree_store::{Sample, SampleBuffer, Store, with_sample_type};
use preprocess::tradeoff::Sampled;
use preprocess::{ConvertOptions, PreprocessError, Progress, Start, convert};
use render_check::picture::compare;
use render_check::reference::{self, Interpolation, SourceVolume};
use render_check::view::{Look, NamedView};
use render_check::{Renderer, RendererOptions};
use serde::Serialize;
use std::path::Path;

/// Pixels that a voxel may cover.
const ACCURACIES: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// Voxels between samples.
const STEPS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// Voxels between samples of the truth.
const TRUE_STEP: f64 = 0.125;

/// Pictures of the sample by the default encoding, with the transfer function chosen for it.
#[derive(Debug, Serialize)]
pub(super) struct ViewReading {
    /// `gpu` or `cpu`.
    pub(super) backend: &'static str,
    pub(super) adapter: String,
    pub(super) view: &'static str,
    /// Width and height in pixels.
    pub(super) size: [u32; 2],
    /// How the store drawn is encoded.
    pub(super) encoding: String,
    /// Voxels between samples of the truth.
    pub(super) true_step_voxels: f64,
    pub(super) pictures: Vec<PictureReading>,
}

/// One picture.
#[derive(Debug, Serialize)]
pub(super) struct PictureReading {
    /// Pixels that a voxel may cover.
    pub(super) accuracy: f64,
    /// Voxels of the level at hand between samples.
    pub(super) step_voxels: f64,
    /// Milliseconds of a frame that has all it needs.
    pub(super) frame_ms: f64,
    /// Bricks that it read.
    pub(super) bricks: u64,
    /// Bytes of their payloads.
    pub(super) bytes: u64,
    /// Of what a display shows, its peak white; null where no pixel differs.
    pub(super) psnr_db: Option<f64>,
    pub(super) ssim: f64,
}

impl PictureReading {
    /// `2, 0.5`: pixels a voxel, and the step.
    pub(super) fn name(&self) -> String {
        format!("{}, {}", self.accuracy, self.step_voxels)
    }
}

/// Draws the sample; nothing where nobody draws.
pub(super) fn measure(
    sampled: &Sampled,
    how: &ConvertOptions,
    drawer: Drawer,
    scratch: &Path,
    progress: &dyn Progress,
) -> anyhow::Result<Option<ViewReading>> {
    if drawer == Drawer::None {
        return Ok(None);
    }
    let path = scratch.join("view.octavo");
    let options = ConvertOptions { start: Start::Replace, ..how.clone() };
    let encoding = options.encoding.to_string();
    convert(&sampled.source, &path, &options, progress)?;
    let open = || -> anyhow::Result<Renderer> {
        let renderer = drawer.renderer(Store::open(&path)?, &RendererOptions::default())?;
        renderer.ok_or_else(|| anyhow::anyhow!("nobody draws here"))
    };
    let store = Store::open(&path)?;
    let mut renderer = open()?;
    let backend = renderer.backend().kind();
    let size = if backend == "gpu" { [480, 270] } else { [192, 108] };
    let named = NamedView::Oblique(0);
    let aspect = f64::from(size[0]) / f64::from(size[1]);
    let view = View::new(named.camera(store.metadata(), aspect)?, size)?;
    let look = Look::new(default_transfer(&store)?, data_range(&store));
    let truth = Look { step_voxels: TRUE_STEP, ..look.clone() };
    let truth = reference::draw(&whole(sampled, &store)?, &view, &truth, Interpolation::Trilinear)?
        .over([0.0; 3]);
    let adapter = renderer.backend().adapter();
    let mut pictures = Vec::new();
    for accuracy in ACCURACIES {
        for step_voxels in STEPS {
            if progress.should_stop() {
                return Err(PreprocessError::Cancelled.into());
            }
            let look = Look { accuracy, step_voxels, ..look.clone() };
            renderer.converge(&view, &look, None, None)?;
            // Once more: the last frame that loads also uploads.
            let rendered = renderer.frame(&view, &look, None)?;
            let effort = *renderer.effort();
            let found = compare(&rendered.picture.over([0.0; 3]), &truth)?;
            pictures.push(PictureReading {
                accuracy,
                step_voxels,
                frame_ms: effort.frame_ms,
                bricks: effort.bricks_loaded,
                bytes: effort.bytes_read,
                psnr_db: found.psnr_db,
                ssim: found.ssim,
            });
            // The next one begins with nothing read.
            renderer = open()?;
        }
    }
    Ok(Some(ViewReading {
        backend,
        adapter,
        view: named.name(),
        size,
        encoding,
        true_step_voxels: TRUE_STEP,
        pictures,
    }))
}

/// The sample in memory, spaced as its store.
fn whole(sampled: &Sampled, store: &Store) -> anyhow::Result<SourceVolume> {
    let metadata = store.metadata();
    let samples = with_sample_type!(sampled.sample_type(), T => samples_of::<T>(sampled)?);
    Ok(SourceVolume { dims_xyz: metadata.dims_xyz, spacing_xyz: metadata.spacing_xyz, samples })
}

fn samples_of<T: Sample>(sampled: &Sampled) -> Result<SampleBuffer, PreprocessError> {
    let [width, height, depth] = sampled.source.dims_xyz.map(|n| n as usize);
    let mut samples = vec![T::default(); width * height * depth];
    let mut slices = sampled.source.slices()?;
    for slice in samples.chunks_exact_mut(width * height) {
        slices.next(slice)?;
    }
    Ok(T::wrap(samples))
}
