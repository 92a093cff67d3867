//! `octavo view`: a store in a window, frame after frame of the same renderer that draws pictures and proves them.

mod camera;
mod latest;
mod overlay;
mod painter;
mod scene;
mod transfer;
mod window;

use super::render::{DeviceArgs, LookArgs, color, data_range, read_json, size};
use crate::exit::Answer;
use clap::Args;
use octree_store::Store;
use render_check::view::NamedView;
use scene::{KEYS, Opened, Scene};
use std::path::PathBuf;
use window::{Shot, Viewer};

/// Look at a store in a window
///
/// Only what is in view and not hidden is loaded, as fine as the window shows. The figures and the keys are shown with f and h.
#[derive(Debug, Args)]
#[command(after_help = help())]
pub(super) struct View {
    /// The store
    store: PathBuf,
    /// Width and height of the window in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "1024x576")]
    size: [u32; 2],
    /// Camera as JSON
    #[arg(long, value_name = "FILE.json", conflicts_with = "named")]
    camera: Option<PathBuf>,
    /// Camera by name: x-, x+, y-, y+, z-, z+, oblique1 to oblique3, inside, grazing
    #[arg(long = "view", value_name = "NAME", default_value = "oblique1")]
    named: String,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    device: DeviceArgs,
    /// Colour behind the volume, 0 to 1 each
    #[arg(long, value_name = "R,G,B", value_parser = color, default_value = "0,0,0")]
    background: [f64; 3],
    /// Folder for pictures that are taken
    #[arg(long, value_name = "DIR", default_value = ".")]
    screenshots: PathBuf,
}

fn help() -> String {
    let keys: Vec<String> = KEYS.iter().map(|(_, told)| format!("  {told}")).collect();
    format!(
        "Keys:\n{}\n\nExamples:\n  \
        octavo view tooth.octavo\n  \
        octavo view tooth.octavo --backend cpu --accuracy 2 --size 640x360",
        keys.join("\n")
    )
}

impl View {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let store = Store::open(&self.store)?;
        let metadata = store.metadata().clone();
        let look = self.look.look(&store)?;
        look.check()?;
        let aspect = f64::from(self.size[0]) / f64::from(self.size[1]);
        let camera = match &self.camera {
            Some(path) => read_json(path, |text| Ok(serde_json::from_str(text)?))?,
            None => NamedView::find(&self.named)?.camera(&metadata, aspect)?,
        };
        let dims = store.geometry().dims_xyz();
        let size_xyz = [0, 1, 2].map(|axis| dims[axis] as f64 * metadata.spacing_xyz[axis]);
        let scene = Scene::new(Opened { camera, look, range: data_range(&store), size_xyz });
        let stem = self.store.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let shot = Shot {
            store: self.store,
            digest: metadata.digest.clone(),
            folder: self.screenshots,
            stem,
            background: self.background,
        };
        if !shot.folder.is_dir() {
            anyhow::bail!("{}: there is no such folder for pictures", shot.folder.display());
        }
        let renderer = self.device.renderer(store, true)?;
        Viewer::show(renderer, scene, metadata, shot, self.size)?;
        Ok(Answer::Done)
    }
}
