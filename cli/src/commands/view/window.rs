//! The window: it takes keys and the mouse to the scene, wishes to the painter, and pictures to the screen.

use super::latest::Latest;
use super::overlay::{self, Canvas};
use super::painter::{Painted, Wish, paint};
use super::scene::{Act, KEYS, Scene, act_of};
use crate::commands::render::view_text;
use crate::commands::{by, human_bytes, write_whole};
use anyhow::{Context as _, anyhow};
use octree_store::Metadata;
use octree_store::loader::View;
use render_check::Renderer;
use render_check::picture::{Bits, Shown, write_png};
use render_check::view::{Filter, Look, Mode};
use softbuffer::{Context, Surface};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, OwnedDisplayHandle};
use winit::keyboard::Key;
use winit::window::{Window, WindowId};

/// The hand rests when it has not moved for so long.
const REST: Duration = Duration::from_millis(150);

/// Where pictures that are taken go, and what they say of themselves.
#[derive(Debug)]
pub(super) struct Shot {
    pub(super) store: PathBuf,
    pub(super) digest: String,
    pub(super) folder: PathBuf,
    pub(super) stem: String,
    pub(super) background: [f64; 3],
}

/// What the painter tells the window.
enum News {
    Painted(Box<Painted>),
    Failed(anyhow::Error),
}

/// A window upon a store.
pub(super) struct Viewer {
    scene: Scene,
    metadata: Metadata,
    shot: Shot,
    adapter: String,
    wishes: Arc<Latest<Wish>>,
    wanted_size: [u32; 2],
    /// The window and its pixels, once there is one.
    shown: Option<Surface<OwnedDisplayHandle, Arc<Window>>>,
    display: Context<OwnedDisplayHandle>,
    /// The number of the last wish.
    serial: u64,
    /// When the hand will have rested.
    rests_at: Option<Instant>,
    pointer: [f64; 2],
    held: Option<MouseButton>,
    painted: Option<Painted>,
    problem: Option<String>,
    figures: bool,
    help: bool,
    /// A picture is to be taken as soon as one is whole.
    shoot: bool,
    failed: Option<anyhow::Error>,
}

impl Viewer {
    /// Shows a window until it is closed.
    ///
    /// # Errors
    /// When there is no display, or drawing fails.
    pub(super) fn show(
        renderer: Renderer,
        scene: Scene,
        metadata: Metadata,
        shot: Shot,
        wanted_size: [u32; 2],
    ) -> anyhow::Result<()> {
        let events = EventLoop::<News>::with_user_event().build().map_err(no_display)?;
        let display = Context::new(events.owned_display_handle()).map_err(no_display)?;
        let adapter = renderer.backend().adapter();
        let wishes = Arc::new(Latest::new());
        let wished = Arc::clone(&wishes);
        let proxy = events.create_proxy();
        let painter = thread::Builder::new().name("painter".to_owned()).spawn(move || {
            let show = |painted| proxy.send_event(News::Painted(Box::new(painted))).is_ok();
            if let Err(error) = paint(renderer, &wished, show) {
                // Without a window nobody is there to be told.
                proxy.send_event(News::Failed(error)).ok();
            }
        })?;
        let mut viewer = Self {
            scene,
            metadata,
            shot,
            adapter,
            wishes,
            wanted_size,
            shown: None,
            display,
            serial: 0,
            rests_at: None,
            pointer: [0.0; 2],
            held: None,
            painted: None,
            problem: None,
            figures: true,
            help: false,
            shoot: false,
            failed: None,
        };
        events.run_app(&mut viewer).map_err(no_display)?;
        let Self { failed, wishes, .. } = viewer;
        wishes.close();
        let ended = painter.join();
        match failed {
            Some(error) => Err(error),
            None => ended.map_err(|_| anyhow!("the thread that draws has panicked")),
        }
    }

    /// The window's size in pixels; none while it has no area.
    fn size(&self) -> Option<[u32; 2]> {
        let PhysicalSize { width, height } = self.shown.as_ref()?.window().inner_size();
        (width > 0 && height > 0).then_some([width, height])
    }

    /// Tells the painter what is to be seen.
    fn wish(&mut self, moving: bool) -> anyhow::Result<()> {
        let Some(size) = self.size() else { return Ok(()) };
        self.serial += 1;
        self.rests_at = moving.then(|| Instant::now() + REST);
        let (camera, look) = (self.scene.camera()?, self.scene.look());
        let wish = Wish { serial: self.serial, camera, look, size, moving };
        self.wishes.put(wish);
        Ok(())
    }

    fn redraw(&self) {
        if let Some(shown) = &self.shown {
            shown.window().request_redraw();
        }
    }

    fn key(&mut self, key: &str, events: &ActiveEventLoop) -> anyhow::Result<()> {
        let Some(act) = act_of(key) else { return Ok(()) };
        match act {
            Act::Look(named) => {
                let Some([width, height]) = self.size() else { return Ok(()) };
                let aspect = f64::from(width) / f64::from(height);
                self.scene.look_from(&named.camera(&self.metadata, aspect)?);
                return self.wish(true);
            }
            Act::Figures => self.figures = !self.figures,
            Act::Help => self.help = !self.help,
            Act::Quit => events.exit(),
            Act::Screenshot => {
                self.shoot = true;
                return self.wish(false);
            }
            act => {
                if self.scene.act(act) {
                    return self.wish(true);
                }
            }
        }
        self.redraw();
        Ok(())
    }

    /// The pointer was moved to a place in the window.
    fn pointed(&mut self, to: [f64; 2]) -> anyhow::Result<()> {
        let [x, y] = [to[0] - self.pointer[0], to[1] - self.pointer[1]];
        self.pointer = to;
        let (Some(held), Some(size)) = (self.held, self.size()) else { return Ok(()) };
        let height = f64::from(size[1]);
        if held == MouseButton::Left {
            self.scene.drag(x / height, y / height);
        } else {
            self.scene.pan(x / height, y / height);
        }
        self.wish(true)
    }

    fn painted(&mut self, painted: Painted) {
        if let Some(problem) = painted.problems.last() {
            eprintln!("octavo: {problem}");
            self.problem = Some(problem.clone());
        }
        if self.shoot && painted.whole && painted.wish.serial == self.serial {
            self.shoot = false;
            match self.shot.take(&painted) {
                Ok(path) => println!("{}", path.display()),
                // Told, not fatal: the view is still there.
                Err(error) => {
                    eprintln!("octavo: {error:#}");
                    self.problem = Some(format!("{error:#}"));
                }
            }
        }
        self.painted = Some(painted);
        self.redraw();
    }

    /// What is to be read upon the picture.
    fn lines(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.figures
            && let Some(painted) = &self.painted
        {
            lines.extend(self.figures_of(painted));
        }
        if self.help {
            lines.extend(KEYS.iter().map(|(_, told)| (*told).to_owned()));
        }
        lines
    }

    fn figures_of(&self, painted: &Painted) -> Vec<String> {
        let Painted { effort, wish, .. } = painted;
        let [width, height] = painted.picture.size;
        let state = match (painted.whole, painted.limited) {
            (true, false) => "whole",
            (true, true) => "coarser than asked for: more --slots would show more",
            (false, _) => "loading",
        };
        let metadata = &self.metadata;
        let mut lines = vec![
            format!(
                "{}  {} {}, {}",
                self.shot.stem,
                by(metadata.dims_xyz),
                metadata.sample_type,
                self.adapter
            ),
            format!(
                "{width} x {height} in {:.1} ms, {state}; {} bricks shown, {} read ({})",
                effort.frame_ms,
                effort.bricks_in_cut,
                effort.bricks_loaded,
                human_bytes(effort.bytes_read)
            ),
            told(&wish.look, self.scene.map_name()),
        ];
        lines.extend(self.problem.clone());
        lines.push("h: keys".to_owned());
        lines
    }

    fn present(&mut self) -> anyhow::Result<()> {
        let (Some(size), lines) = (self.size(), self.lines()) else { return Ok(()) };
        let background = self.shot.background;
        let mut canvas = match &self.painted {
            Some(painted) => stretched(&painted.picture.over(background), size),
            None => Canvas { size, bytes: vec![0; (size[0] * size[1] * 3) as usize] },
        };
        overlay::write(&mut canvas, &lines)?;
        let Some(shown) = &mut self.shown else { return Ok(()) };
        let sides = size.map(NonZeroU32::new);
        let [Some(width), Some(height)] = sides else { return Ok(()) };
        shown.resize(width, height).map_err(failed_to_show)?;
        let mut pixels = shown.buffer_mut().map_err(failed_to_show)?;
        for (pixel, rgb) in pixels.iter_mut().zip(canvas.bytes.chunks_exact(3)) {
            *pixel = u32::from_be_bytes([0, rgb[0], rgb[1], rgb[2]]);
        }
        pixels.present().map_err(failed_to_show)
    }

    fn open(&mut self, events: &ActiveEventLoop) -> anyhow::Result<()> {
        let [width, height] = self.wanted_size;
        let attributes = Window::default_attributes()
            .with_title(format!("{} - octavo", self.shot.stem))
            .with_inner_size(PhysicalSize::new(width, height));
        let window = Arc::new(events.create_window(attributes).context("cannot be opened")?);
        self.shown = Some(Surface::new(&self.display, window).map_err(failed_to_show)?);
        self.wish(true)
    }

    fn window_event(&mut self, event: WindowEvent, events: &ActiveEventLoop) -> anyhow::Result<()> {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(_) => return self.wish(true),
            WindowEvent::RedrawRequested => return self.present(),
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                return match event.logical_key {
                    Key::Character(typed) => self.key(&typed, events),
                    Key::Named(named) => self.key(&format!("{named:?}"), events),
                    _ => Ok(()),
                };
            }
            WindowEvent::MouseInput { state, button, .. } => {
                self.held = (state == ElementState::Pressed).then_some(button);
            }
            WindowEvent::CursorMoved { position, .. } => {
                return self.pointed([position.x, position.y]);
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(y),
                    MouseScrollDelta::PixelDelta(by) => by.y / 50.0,
                };
                self.scene.act(Act::Zoom(1.15_f64.powf(notches)));
                return self.wish(true);
            }
            _ => {}
        }
        Ok(())
    }

    /// Ends it all where something failed.
    fn check(&mut self, result: anyhow::Result<()>, events: &ActiveEventLoop) {
        if let Err(error) = result {
            self.failed.get_or_insert(error);
            events.exit();
        }
    }
}

impl ApplicationHandler<News> for Viewer {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.shown.is_none() {
            let opened = self.open(events);
            self.check(opened, events);
        }
    }

    fn new_events(&mut self, events: &ActiveEventLoop, cause: StartCause) {
        if let StartCause::ResumeTimeReached { .. } = cause {
            let wished = self.wish(false);
            self.check(wished, events);
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, news: News) {
        let result = match news {
            News::Painted(painted) => {
                self.painted(*painted);
                Ok(())
            }
            News::Failed(error) => Err(error),
        };
        self.check(result, events);
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let result = self.window_event(event, events);
        self.check(result, events);
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        events.set_control_flow(self.rests_at.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }
}

impl Shot {
    /// Writes a picture under the next name that is free.
    fn take(&self, painted: &Painted) -> anyhow::Result<PathBuf> {
        let Wish { camera, look, size, .. } = &painted.wish;
        let view = View::new(camera.clone(), *size)?;
        let text = view_text((&self.store, &self.digest), &view, look, self.background)?;
        let path = free_name(&self.folder, &self.stem);
        let shown = painted.picture.over(self.background);
        write_whole(&path, false, |file| write_png(file, &shown, Bits::Eight, &text))?;
        Ok(path)
    }
}

/// `FOLDER/STEM-001.png`, or the first number after it that names no file.
fn free_name(folder: &Path, stem: &str) -> PathBuf {
    let mut number = 0_u32;
    loop {
        number += 1;
        let path = folder.join(format!("{stem}-{number:03}.png"));
        if !path.exists() {
            return path;
        }
    }
}

/// A look in words.
fn told(look: &Look, map: Option<&str>) -> String {
    let mode = match look.mode {
        Mode::Dvr => "volume".to_owned(),
        Mode::Iso(value) => format!("surface at {value}"),
        Mode::Mip => "greatest value".to_owned(),
    };
    let [low, high] = look.window;
    let blended = match look.filter {
        Filter::Trilinear => "",
        Filter::Quadrilinear => ", levels blended",
    };
    let shaded = if look.shading.is_some() { ", shaded" } else { "" };
    let cut = if look.clip.is_some() { ", cut" } else { "" };
    let colors = map.unwrap_or("own colours");
    format!(
        "{mode}, {low} to {high}, {colors}; {} pixels a voxel, step {}{blended}{shaded}{cut}",
        look.accuracy, look.step_voxels
    )
}

/// A picture in the window's size, each of its pixels as a block.
fn stretched(shown: &Shown, size: [u32; 2]) -> Canvas {
    let [width, height] = size.map(|side| side as usize);
    let [from_width, from_height] = shown.size.map(|side| side as usize);
    let columns: Vec<usize> = (0..width).map(|x| x * from_width / width).collect();
    let mut bytes = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        let row = &shown.pixels[y * from_height / height * from_width..][..from_width];
        bytes.extend(columns.iter().flat_map(|&x| row[x].map(|c| (c * 255.0).round() as u8)));
    }
    Canvas { size, bytes }
}

/// No display is the environment's fault, as a disk that cannot be read is.
fn no_display<E>(_: E) -> std::io::Error {
    std::io::Error::other(
        "there is no display to open a window on: octavo render writes pictures, octavo serve shows them in a browser",
    )
}

fn failed_to_show(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("the picture cannot be shown: {error}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_stretched_by_blocks() {
        let pixels = vec![[0.0; 3], [1.0; 3], [0.5, 0.25, 1.0], [0.0, 1.0, 0.0]];
        let shown = Shown { size: [2, 2], pixels };
        let canvas = stretched(&shown, [4, 3]);
        let pixel = |x: usize, y: usize| &canvas.bytes[3 * (4 * y + x)..][..3];
        assert_eq!(canvas.bytes.len(), 36);
        for (x, y, expected) in [
            (0, 0, [0, 0, 0]),
            (1, 1, [0, 0, 0]),
            (2, 0, [255; 3]),
            (3, 1, [255; 3]),
            (1, 2, [128, 64, 255]),
            (3, 2, [0, 255, 0]),
        ] {
            assert_eq!(pixel(x, y), expected, "{x} {y}");
        }
        assert_eq!(stretched(&shown, [2, 2]).bytes[6..9], [128, 64, 255]);
    }

    #[test]
    fn a_name_that_is_taken_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(free_name(folder.path(), "a"), folder.path().join("a-001.png"));
        std::fs::write(folder.path().join("a-001.png"), "").unwrap();
        std::fs::write(folder.path().join("a-002.png"), "").unwrap();
        assert_eq!(free_name(folder.path(), "a"), folder.path().join("a-003.png"));
    }
}
