//! A store, its loader and a backend: frame by frame until nothing is left to load.

use crate::backend::{Backend, Drawing, Drawn};
use crate::error::RenderError;
use crate::finite::{float_range, unit_brick};
use crate::picture::Picture;
use crate::transfer::TransferTable;
use crate::view::Look;
use octree_store::Geometry;
use octree_store::loader::{
    BrickFormat, BrickSource, Criterion, Event, Feedback, Loader, LoaderOptions, NodeData, Quality,
    Scene, SpatialIndex, Statistics, View,
};
use serde::Serialize;
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How much a renderer may take.
#[derive(Debug, Clone, Copy)]
pub struct RendererOptions {
    /// Slots of the brick pool.
    pub slots: usize,
    /// Bytes of decoded bricks in memory.
    pub memory_bytes: usize,
    /// Whether only what rays reached is refined.
    pub visibility: bool,
    /// Threads that read bricks.
    pub threads: usize,
}

impl Default for RendererOptions {
    fn default() -> Self {
        let LoaderOptions { slots, memory_bytes, threads, .. } = LoaderOptions::default();
        Self { slots, memory_bytes, visibility: true, threads }
    }
}

impl RendererOptions {
    /// The slots, or as many as a volume so folded can use, if those are fewer.
    pub fn slots_for(&self, geometry: &Geometry) -> usize {
        let bricks = usize::try_from(geometry.bricks()).unwrap_or(usize::MAX);
        self.slots.min(bricks.saturating_add(9))
    }
}

/// What rendering took. Counts and times since the renderer was made.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Effort {
    /// Leaves of the last frame's cut that have a payload.
    pub bricks_in_cut: u64,
    /// Distinct bricks read from the store.
    pub bricks_loaded: u64,
    /// Bytes of their payloads.
    pub bytes_read: u64,
    /// Frames.
    pub frames: u64,
    /// Milliseconds of the last frame.
    pub frame_ms: f64,
    /// Milliseconds of all uploads.
    pub upload_ms: f64,
    /// Milliseconds of the last frame on the device.
    pub gpu_ms: Option<f64>,
}

/// One frame.
#[derive(Debug)]
pub struct Rendered {
    /// The picture, as good as what is in core.
    pub picture: Picture,
    /// Whether nothing is left to load.
    pub converged: bool,
    /// Whether the cut is coarser than asked for, for want of room.
    pub limited: bool,
    /// What went wrong, in words.
    pub problems: Vec<String>,
}

/// Draws one store.
#[derive(Debug)]
pub struct Renderer {
    loader: Loader,
    backend: Box<dyn Backend>,
    visibility: bool,
    /// Values of texels 0 and 1 where they are floats.
    float_range: [f64; 2],
    format: BrickFormat,
    table: Option<(Look, TransferTable)>,
    effort: Effort,
    stop: Arc<AtomicBool>,
}

/// Pixels of a view for one of the small one that finds what it needs.
const SMALLER: u32 = 4;

/// The small view that finds what a view needs; none where the view is small itself.
fn small_of(view: &View) -> Option<View> {
    let size = view.size.map(|side| side / SMALLER);
    size.iter().all(|side| *side >= 16).then(|| View { camera: view.camera.clone(), size })
}

/// The longest that a frame waits for data when nothing else is to be done.
const PATIENCE: Duration = Duration::from_millis(50);

impl Renderer {
    /// A renderer of a store, or of another source of bricks. The backend's pool must have as many slots as [`RendererOptions::slots_for`] says.
    ///
    /// # Errors
    /// When the options leave too little to work with.
    pub fn new(
        source: impl BrickSource,
        backend: Box<dyn Backend>,
        options: &RendererOptions,
    ) -> Result<Self, RenderError> {
        let loader_options = LoaderOptions {
            slots: options.slots_for(source.geometry()),
            memory_bytes: options.memory_bytes,
            threads: options.threads,
            visibility: options.visibility,
            linger_frames: 2,
            uploads_per_frame: 4096,
            ..LoaderOptions::default()
        };
        let metadata = source.metadata();
        let value_range = [metadata.value_min.unwrap_or(0.0), metadata.value_max.unwrap_or(0.0)];
        Ok(Self {
            float_range: float_range(value_range),
            format: BrickFormat::of(metadata),
            loader: Loader::new(source, loader_options)?,
            backend,
            visibility: options.visibility,
            table: None,
            effort: Effort::default(),
            stop: Arc::default(),
        })
    }

    /// What it took so far.
    pub fn effort(&self) -> &Effort {
        &self.effort
    }

    /// What the loader did so far.
    pub fn statistics(&self) -> &Statistics {
        self.loader.statistics()
    }

    /// What draws.
    pub fn backend(&self) -> &dyn Backend {
        &*self.backend
    }

    /// From now on a picture is given up, with [`RenderError::Stopped`], soon after this is set.
    pub fn stop_on(&mut self, stop: Arc<AtomicBool>) {
        self.stop = stop;
    }

    /// Draws one frame with what is in core, and asks for what is not.
    ///
    /// # Errors
    /// When the look is none, or the device fails.
    pub fn frame(
        &mut self,
        view: &View,
        look: &Look,
        ends: Option<&[f32]>,
    ) -> Result<Rendered, RenderError> {
        self.step(view, view, look, ends)
    }

    /// A frame for a view, drawn as another sees it.
    fn step(
        &mut self,
        view: &View,
        drawn: &View,
        look: &Look,
        ends: Option<&[f32]>,
    ) -> Result<Rendered, RenderError> {
        let started = Instant::now();
        let (index, converged, problems) = self.load(view, look)?;
        let Drawn { picture, seen, device_secs } = self.draw(&index, drawn, look, ends)?;
        self.loader.feedback(index.serial(), Feedback::Nodes(&seen));
        self.effort.frames += 1;
        self.effort.gpu_ms = device_secs.map(|secs| secs * 1e3);
        self.effort.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        self.count(&index);
        let limited = self.loader.statistics().limited;
        Ok(Rendered { picture, converged, limited, problems })
    }

    /// Draws frames until nothing is left to load, or for so long. Without visibility only the last is drawn;
    /// with it the first are drawn small, as rays some pixels apart reach the same nodes but for slivers, and whole ones find those.
    ///
    /// # Errors
    /// When the look is none, or the device fails.
    pub fn converge(
        &mut self,
        view: &View,
        look: &Look,
        ends: Option<&[f32]>,
        at_most: Option<Duration>,
    ) -> Result<Rendered, RenderError> {
        let started = Instant::now();
        let mut problems = Vec::new();
        let stop = Arc::clone(&self.stop);
        let late = || {
            stop.load(Ordering::Relaxed) || at_most.is_some_and(|limit| started.elapsed() >= limit)
        };
        if !self.visibility {
            loop {
                let (_, converged, new) = self.load(view, look)?;
                problems.extend(new);
                if converged || late() {
                    break;
                }
                self.loader.wait(PATIENCE);
            }
        }
        if let Some(small) = small_of(view).filter(|_| self.visibility && ends.is_none()) {
            loop {
                let rendered = self.step(view, &small, look, None)?;
                problems.extend(rendered.problems);
                if rendered.converged || late() {
                    break;
                }
                self.wait(PATIENCE);
            }
        }
        loop {
            let mut rendered = self.frame(view, look, ends)?;
            problems.append(&mut rendered.problems);
            if !rendered.converged && self.stop.load(Ordering::Relaxed) {
                return Err(RenderError::Stopped);
            }
            if rendered.converged || late() {
                return Ok(Rendered { problems, ..rendered });
            }
            self.wait(PATIENCE);
        }
    }

    /// Waits until something that was asked for has come, at most so long; not at all where nothing is awaited.
    pub fn wait(&self, at_most: Duration) {
        if self.loader.unread() > 0 {
            self.loader.wait(at_most);
        }
    }

    /// A frame of the loader, and its uploads.
    fn load(
        &mut self,
        view: &View,
        look: &Look,
    ) -> Result<(Arc<SpatialIndex>, bool, Vec<String>), RenderError> {
        look.check()?;
        let appearance = look.appearance();
        let views = std::slice::from_ref(view);
        let quality = Quality { accuracy: look.accuracy, criterion: Criterion::ProjectedSize };
        let mut frame =
            self.loader.frame(&Scene { views, clip: look.clip, appearance: &appearance, quality });
        let started = Instant::now();
        for upload in &mut frame.uploads {
            upload.brick = unit_brick(&upload.brick, self.float_range);
        }
        self.backend.upload(&frame.uploads)?;
        self.effort.upload_ms += started.elapsed().as_secs_f64() * 1e3;
        let problems = frame.events.into_iter().map(|event| match event {
            Event::Damaged { error, .. } => error.to_string(),
            Event::ThreadsLost { count } => format!("{count} threads that read bricks have ended"),
        });
        Ok((frame.index, frame.converged, problems.collect()))
    }

    fn draw(
        &mut self,
        index: &SpatialIndex,
        view: &View,
        look: &Look,
        ends: Option<&[f32]>,
    ) -> Result<Drawn, RenderError> {
        if self.table.as_ref().is_none_or(|(made_for, _)| made_for != look) {
            self.table = Some((look.clone(), TransferTable::of(look)));
        }
        let Some((_, table)) = &self.table else { unreachable!("the table was made just now") };
        let float_range = (self.format == BrickFormat::R32Float).then_some(self.float_range);
        let stop = &self.stop;
        self.backend.draw(&Drawing { index, view, look, table, float_range, ends, stop })
    }

    fn count(&mut self, index: &SpatialIndex) {
        let leaves = index.leaves().filter(|(key, node)| {
            matches!(node.data, NodeData::Slot(_)) && node.data_level == key.level()
        });
        self.effort.bricks_in_cut = leaves.map(|(key, _)| key).collect::<HashSet<_>>().len() as u64;
        let statistics = self.loader.statistics();
        self.effort.bricks_loaded = statistics.bricks_read;
        self.effort.bytes_read = statistics.bytes_read;
    }
}
