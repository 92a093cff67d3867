//! `octavo render`: a store's picture as a PNG, held against its source where that is at hand.

mod drawer;
mod look;
mod source;

use super::{RawArgs, SeriesArgs, print_json, write_whole};
use crate::exit::Answer;
use crate::parse;
use anyhow::bail;
use clap::{Args, ValueEnum};
pub(super) use drawer::Drawer;
pub(super) use look::{LookArgs, data_range, default_transfer, middle, transfer_of};
use octree_store::Store;
use octree_store::loader::{Camera, ClipBox, View};
use preprocess::PreprocessError;
use render_check::gpu::{AdapterChoice, GpuBackend, Sampling};
use render_check::picture::{
    Bits, Comparison, Shown, compare, difference, write_depth_png, write_depth_raw, write_png,
};
use render_check::reference::{self, Interpolation, SourceVolume};
use render_check::view::{Filter, Look, Mode, NamedView, Shading, orbit};
use render_check::{Backend, CpuBackend, Effort, Rendered, Renderer, RendererOptions};
use serde::Serialize;
pub(super) use source::read_source;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Draw a store as a PNG
///
/// Bricks are loaded until the picture is as fine as was asked for. With --against the same view of the source is
/// drawn in f64 without any octree, and the two are compared.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo render tooth.octavo -o tooth.png\n  \
    octavo render tooth.octavo -o tooth.png --view z- --mode iso --iso 600\n  \
    octavo render tooth.octavo -o tooth.png --camera eye.json --transfer bone.json --backend cpu\n  \
    octavo render tooth.octavo -o tooth.png --against tooth.nii.gz --diff difference.png --json\n  \
    octavo render tooth.octavo -o turn.png --orbit 36")]
pub(super) struct Render {
    /// The store
    store: PathBuf,
    /// The picture; of an orbit, numbers go before its ending
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "1024x576")]
    size: [u32; 2],
    /// Camera as JSON
    #[arg(long, value_name = "FILE.json", conflicts_with = "view")]
    camera: Option<PathBuf>,
    /// Camera by name: x-, x+, y-, y+, z-, z+, oblique1 to oblique3, inside, grazing
    #[arg(long, value_name = "NAME", default_value = "oblique1")]
    view: String,
    /// So many pictures from all around
    #[arg(long, value_name = "N", conflicts_with_all = ["camera", "view", "against", "depth"], value_parser = clap::value_parser!(u32).range(1..))]
    orbit: Option<u32>,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    device: DeviceArgs,
    /// Colour behind the volume, 0 to 1 each
    #[arg(long, value_name = "R,G,B", value_parser = color, default_value = "0,0,0")]
    background: [f64; 3],
    /// Bits a colour component: 8 or 16
    #[arg(long, value_enum, default_value_t = PngBits::Eight)]
    bits: PngBits,
    /// Refine everything in view, seen or hidden
    #[arg(long)]
    no_visibility_feedback: bool,
    /// Stop refining after so many seconds
    #[arg(long, value_name = "SECONDS", value_parser = parse::error_bound)]
    budget: Option<f64>,
    /// Write distances from the eye: as 16-bit PNG, or as raw f32
    #[arg(long, value_name = "OUT.png|.raw")]
    depth: Option<PathBuf>,
    /// End rays at these distances from the eye: little-endian f32 for every pixel, as --depth OUT.raw writes them
    #[arg(long, value_name = "FILE.raw", conflicts_with_all = ["orbit", "against"])]
    depth_in: Option<PathBuf>,
    /// The volume that the store was made of
    #[arg(long, value_name = "SOURCE")]
    against: Option<PathBuf>,
    /// Write the difference, 16 times as strong
    #[arg(long, value_name = "DIFF.png", requires = "against")]
    diff: Option<PathBuf>,
    /// How the reference interpolates between voxels
    #[arg(long, value_enum, default_value_t = InterpolationArg::Trilinear)]
    interpolation: InterpolationArg,
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
    /// Replace existing files
    #[arg(long)]
    force: bool,
    /// Print JSON (schema octavo.render/1)
    #[arg(long)]
    json: bool,
}

/// Who draws.
#[derive(Debug, Args)]
pub(super) struct DeviceArgs {
    /// gpu (Vulkan), or cpu
    #[arg(long, value_enum, default_value_t = BackendArg::Gpu)]
    backend: BackendArg,
    /// A part of the graphics adapter's name
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Who interpolates between texels: manual (exact) or hardware (fast)
    #[arg(long, value_enum, default_value_t = SamplingArg::Hardware)]
    sampling: SamplingArg,
    /// Bricks that the pool of the renderer holds
    #[arg(long, value_name = "N", default_value_t = 4096)]
    slots: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BackendArg {
    Gpu,
    Cpu,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SamplingArg {
    Manual,
    Hardware,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum InterpolationArg {
    Trilinear,
    Tricubic,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PngBits {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

/// What a PNG says of itself.
#[derive(Serialize)]
struct ViewText<'a> {
    store: String,
    digest: &'a str,
    camera: &'a Camera,
    size: [u32; 2],
    transfer: &'a octree_store::loader::TransferFunction,
    mode: Mode,
    window: [f64; 2],
    shading: Option<Shading>,
    step_voxels: f64,
    accuracy: f64,
    filter: Filter,
    clip: Option<ClipBox>,
    background: [f64; 3],
}

/// What a picture shows, as JSON: enough to draw it again.
pub(super) fn view_text(
    store: (&Path, &str),
    view: &View,
    look: &Look,
    background: [f64; 3],
) -> serde_json::Result<String> {
    serde_json::to_string(&ViewText {
        store: store.0.display().to_string(),
        digest: store.1,
        camera: &view.camera,
        size: view.size,
        transfer: &look.transfer,
        mode: look.mode,
        window: look.window,
        shading: look.shading,
        step_voxels: look.step_voxels,
        accuracy: look.accuracy,
        filter: look.filter,
        clip: look.clip,
        background,
    })
}

#[derive(Serialize)]
struct Report {
    schema: &'static str,
    size: [u32; 2],
    backend: &'static str,
    adapter: String,
    #[serde(flatten)]
    effort: Effort,
    converged: bool,
    limited: bool,
    #[serde(flatten)]
    comparison: Option<Comparison>,
    problems: Vec<String>,
}

impl DeviceArgs {
    /// A renderer of a store.
    pub(super) fn renderer(&self, store: Store, visibility: bool) -> anyhow::Result<Renderer> {
        let brick_bytes = store.geometry().brick_samples() * 4;
        let defaults = RendererOptions::default();
        let memory_bytes = defaults.memory_bytes.max(32 * brick_bytes);
        let options = RendererOptions { slots: self.slots, visibility, memory_bytes, ..defaults };
        let (geometry, metadata) = (*store.geometry(), store.metadata());
        let slots = options.slots_for(&geometry);
        let backend: Box<dyn Backend> = match self.backend {
            BackendArg::Cpu => Box::new(CpuBackend::new(&geometry, metadata.spacing_xyz, slots)),
            BackendArg::Gpu => {
                let choice = AdapterChoice { name: self.adapter.clone() };
                let sampling = match self.sampling {
                    SamplingArg::Manual => Sampling::Manual,
                    SamplingArg::Hardware => Sampling::Hardware,
                };
                Box::new(GpuBackend::new(&choice, sampling, &geometry, metadata, slots)?)
            }
        };
        Ok(Renderer::new(store, backend, &options)?)
    }
}

impl Render {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        self.check_outputs()?;
        let store = Store::open(&self.store)?;
        let metadata = store.metadata().clone();
        let look = self.look.look(&store)?;
        look.check()?;
        let source = match &self.against {
            None => None,
            Some(path) => Some(read_source(path, &self.raw, &self.series, &store)?),
        };
        let aspect = f64::from(self.size[0]) / f64::from(self.size[1]);
        let cameras = match (self.orbit, &self.camera) {
            (Some(count), _) => orbit(&metadata, aspect, count.max(1))?,
            (None, Some(path)) => vec![read_json(path, |text| Ok(serde_json::from_str(text)?))?],
            (None, None) => vec![NamedView::find(&self.view)?.camera(&metadata, aspect)?],
        };
        let mut renderer = self.device.renderer(store, !self.no_visibility_feedback)?;
        let at_most = self.budget.map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
        let ends = self.depth_in.as_ref().map(|path| read_depths(path, self.size)).transpose()?;
        for (number, camera) in cameras.iter().enumerate() {
            let view = View::new(camera.clone(), self.size)?;
            let rendered = renderer.converge(&view, &look, ends.as_deref(), at_most)?;
            let store = (self.store.as_path(), metadata.digest.as_str());
            let text = view_text(store, &view, &look, self.background)?;
            let shown = rendered.picture.over(self.background);
            let path = match self.orbit {
                Some(count) => numbered(&self.output, number, count),
                None => self.output.clone(),
            };
            self.write(&path, &shown, &text)?;
            self.write_depth(&rendered)?;
            let comparison = match &source {
                None => None,
                Some(source) => Some(self.compare(source, &view, &look, &shown, &text)?),
            };
            self.tell(&renderer, rendered, comparison)?;
        }
        Ok(Answer::Done)
    }

    /// Refuses outputs that are there without --force, that are inputs, or that are one another, before anything is drawn.
    fn check_outputs(&self) -> anyhow::Result<()> {
        let pictures = [Some(&self.output), self.diff.as_ref()];
        for path in
            pictures.into_iter().flatten().chain(self.depth.iter().filter(|path| !is_raw(path)))
        {
            if path.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("png")) {
                bail!("{}: a picture's name ends in .png", path.display());
            }
        }
        let inputs = [
            Some(&self.store),
            self.camera.as_ref(),
            self.against.as_ref(),
            self.depth_in.as_ref(),
        ];
        let place = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let mut taken: Vec<PathBuf> =
            inputs.into_iter().flatten().map(|path| place(path)).collect();
        for path in
            [Some(&self.output), self.diff.as_ref(), self.depth.as_ref()].into_iter().flatten()
        {
            if taken.contains(&place(path)) {
                bail!("{}: it is named twice; each output needs a name of its own", path.display());
            }
            taken.push(place(path));
            if self.orbit.is_none() && path.exists() && !self.force {
                return Err(PreprocessError::Exists { path: path.clone() }.into());
            }
        }
        Ok(())
    }

    fn write(&self, path: &Path, shown: &Shown, text: &str) -> anyhow::Result<()> {
        let bits = match self.bits {
            PngBits::Eight => Bits::Eight,
            PngBits::Sixteen => Bits::Sixteen,
        };
        write_whole(path, self.force, |file| write_png(file, shown, bits, text))
    }

    fn write_depth(&self, rendered: &Rendered) -> anyhow::Result<()> {
        let Some(path) = &self.depth else { return Ok(()) };
        let picture = &rendered.picture;
        if is_raw(path) {
            write_whole(path, self.force, |file| write_depth_raw(file, picture))
        } else {
            write_whole(path, self.force, |file| write_depth_png(file, picture))
        }
    }

    fn compare(
        &self,
        source: &SourceVolume,
        view: &View,
        look: &Look,
        shown: &Shown,
        text: &str,
    ) -> anyhow::Result<Comparison> {
        let interpolation = match self.interpolation {
            InterpolationArg::Trilinear => Interpolation::Trilinear,
            InterpolationArg::Tricubic => Interpolation::Tricubic,
        };
        let truth = reference::draw(source, view, look, interpolation)?.over(self.background);
        if let Some(path) = &self.diff {
            self.write(path, &difference(shown, &truth, 16.0)?, text)?;
        }
        Ok(compare(shown, &truth)?)
    }

    fn tell(
        &self,
        renderer: &Renderer,
        rendered: Rendered,
        comparison: Option<Comparison>,
    ) -> anyhow::Result<()> {
        let effort = *renderer.effort();
        let (backend, adapter) = (renderer.backend().kind(), renderer.backend().adapter());
        for problem in &rendered.problems {
            eprintln!("octavo: {problem}");
        }
        if self.json {
            return print_json(&Report {
                schema: "octavo.render/1",
                size: self.size,
                backend,
                adapter,
                effort,
                converged: rendered.converged,
                limited: rendered.limited,
                comparison,
                problems: rendered.problems,
            });
        }
        let Effort { bricks_in_cut, bricks_loaded, bytes_read, frames, frame_ms, .. } = effort;
        let bytes = super::human_bytes(bytes_read);
        println!(
            "{bricks_loaded} bricks read ({bytes}), {bricks_in_cut} shown; {frames} frames, the last in {frame_ms:.0} ms on {adapter}"
        );
        if rendered.limited {
            println!("coarser than asked for: more --slots would show more");
        }
        if let Some(found) = comparison {
            let psnr = found.psnr_db.map_or("the same".to_owned(), |db| format!("PSNR {db:.1} dB"));
            println!(
                "against the source: {psnr}, SSIM {:.4}, largest difference {:.4}, mean delta E {:.3}",
                found.ssim, found.max_abs_diff, found.mean_delta_e
            );
        }
        Ok(())
    }
}

/// Reads a JSON file; errors name it.
pub(super) fn read_json<T>(
    path: &Path,
    parse: impl FnOnce(&str) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    // What cannot be read is unusable input, as a store that is not there is.
    let text = std::fs::read_to_string(path)
        .map_err(|error| anyhow::anyhow!("{}: {error}", path.display()))?;
    // One message with its causes: a RenderError beneath a context would be told without.
    parse(&text).map_err(|error| anyhow::anyhow!("{}: {error:#}", path.display()))
}

/// Whether a name is a raw file's.
fn is_raw(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "raw")
}

/// Distances from the eye, rows from the top; what is no number ends no ray.
fn read_depths(path: &Path, [width, height]: [u32; 2]) -> anyhow::Result<Vec<f32>> {
    let bytes =
        std::fs::read(path).map_err(|error| anyhow::anyhow!("{}: {error}", path.display()))?;
    let wanted = 4 * u64::from(width) * u64::from(height);
    if bytes.len() as u64 != wanted {
        bail!(
            "{}: {width} x {height} distances of 4 bytes are {wanted} bytes, and it has {}",
            path.display(),
            bytes.len()
        );
    }
    let distance = |&bytes: &[u8; 4]| match f32::from_le_bytes(bytes) {
        end if end.is_nan() => f32::INFINITY,
        end => end,
    };
    Ok(bytes.as_chunks().0.iter().map(distance).collect())
}

/// `turn.png` as `turn007.png`.
fn numbered(path: &Path, number: usize, count: u32) -> PathBuf {
    let digits = count.saturating_sub(1).to_string().len();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}{number:0digits$}.{ending}"))
}

/// `WxH`: two whole numbers.
pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text
        .split_once('x')
        .and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    parsed
        .filter(|size: &[u32; 2]| size.iter().all(|n| (1..=16_384).contains(n)))
        .ok_or_else(|| format!("expected WxH, each 1 to 16384, and found '{text}'"))
}

/// `R,G,B`: three numbers from 0 to 1.
pub(super) fn color(text: &str) -> Result<[f64; 3], String> {
    let parts: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match parts[..] {
        [r, g, b] if parts.iter().all(|c| (0.0..=1.0).contains(c)) => Ok([r, g, b]),
        _ => Err(format!("expected three numbers R,G,B from 0 to 1 and found '{text}'")),
    }
}

/// Refuses what is not the store's source.
pub(super) fn check_dims(store: &Store, source_xyz: [u64; 3]) -> anyhow::Result<()> {
    let store_xyz = store.geometry().dims_xyz();
    if store_xyz != source_xyz {
        bail!(render_check::RenderError::Dims { store_xyz, source_xyz });
    }
    Ok(())
}
