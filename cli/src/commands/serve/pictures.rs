//! Pictures for whoever asks the server: render-check's renderers, kept from one request to the next, so that what a view
//! has loaded is there for the next one.

use super::super::render::{Drawer, data_range, default_transfer};
use octree_store::Store;
use octree_store::loader::TransferFunction;
use render_check::picture::{Bits, write_png};
use render_check::view::Look;
use render_check::{Renderer, RendererOptions};
use serve::{Picture, RenderError, RenderRequest};
use std::sync::{Arc, Mutex, PoisonError};

/// Stores whose renderers are kept.
const KEPT: usize = 2;

/// Bricks in a renderer's pool: 50 MB of 8-bit ones.
const SLOTS: usize = 1024;

/// A store that is being looked at.
struct Kept {
    digest: String,
    renderer: Renderer,
    range: [f64; 2],
    transfer: TransferFunction,
}

/// Draws on one device.
pub(super) struct Pictures {
    drawer: Drawer,
    kept: Mutex<Vec<Kept>>,
}

impl Pictures {
    pub(super) fn new(drawer: Drawer) -> Self {
        Self { drawer, kept: Mutex::new(Vec::new()) }
    }

    fn open(&self, store: &Store) -> anyhow::Result<Kept> {
        let digest = store.metadata().digest.clone();
        let own = Store::open(store.path())?;
        anyhow::ensure!(own.metadata().digest == digest, "the dataset is being replaced");
        let (range, transfer) = (data_range(&own), default_transfer(&own)?);
        let options = RendererOptions { slots: SLOTS, ..RendererOptions::default() };
        let Some(renderer) = self.drawer.renderer(own, &options)? else {
            anyhow::bail!("nobody draws here");
        };
        Ok(Kept { digest, renderer, range, transfer })
    }

    fn draw(&self, store: &Store, request: &RenderRequest) -> anyhow::Result<Picture> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let digest = &store.metadata().digest;
        // Taken out while it draws: one that panics or fails is not used again.
        let mut own = match kept.iter().position(|kept| kept.digest == *digest) {
            Some(at) => kept.remove(at),
            None => self.open(store)?,
        };
        let transfer = request.transfer.as_ref().unwrap_or(&own.transfer).clone();
        let look = Look {
            accuracy: request.accuracy,
            step_voxels: request.step_voxels,
            ..Look::new(transfer, own.range)
        };
        let at_most = Some(request.at_most);
        own.renderer.stop_on(Arc::clone(&request.given_up));
        let rendered = own.renderer.converge(&request.view, &look, None, at_most);
        if matches!(
            rendered,
            Ok(_) | Err(render_check::RenderError::Stopped | render_check::RenderError::OutOfScale)
        ) {
            if kept.len() == KEPT {
                kept.remove(0);
            }
            kept.push(own);
        }
        let rendered = rendered?;
        let mut bytes = Vec::new();
        write_png(&mut bytes, &rendered.picture.over([0.0; 3]), Bits::Eight, "{}")?;
        Ok(Picture { bytes, content_type: "image/png", converged: rendered.converged })
    }
}

impl serve::Renderer for Pictures {
    fn render(&self, store: &Store, request: &RenderRequest) -> Result<Picture, RenderError> {
        self.draw(store, request).map_err(|error| {
            let said = format!("{error:#}");
            match error.downcast_ref() {
                Some(render_check::RenderError::OutOfScale) => RenderError::Request(said),
                _ => RenderError::Failed(said),
            }
        })
    }
}
