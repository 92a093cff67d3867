//! What draws: a device through wgpu, or the processor.

use crate::error::RenderError;
use crate::picture::Picture;
use crate::ray::{Bricks, Frame, Scene, Variant, draw_pixel, pack, table_rows};
use crate::transfer::TransferTable;
use crate::view::{Look, RayGrid};
use octree_store::Geometry;
use octree_store::loader::{SpatialIndex, Upload, View};
use rayon::prelude::*;
use std::fmt::Debug;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// What is to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct Drawing<'a> {
    /// The nodes.
    pub index: &'a SpatialIndex,
    /// The camera, and the image's size.
    pub view: &'a View,
    /// What it shows.
    pub look: &'a Look,
    /// The look's table.
    pub table: &'a TransferTable,
    /// Values of texels 0 and 1 of all bricks, where they hold floats; else each has its own.
    pub float_range: Option<[f64; 2]>,
    /// Distances from the eye at which rays end, a pixel each; none where nothing ends them.
    pub ends: Option<&'a [f32]>,
    /// Set when nobody waits for the picture any more.
    pub stop: &'a AtomicBool,
}

/// What was drawn.
#[derive(Debug)]
pub struct Drawn {
    /// The picture.
    pub picture: Picture,
    /// A byte for each node of the index: not zero where a ray came.
    pub seen: Vec<u8>,
    /// Seconds on the device, if it tells.
    pub device_secs: Option<f64>,
}

/// Something that draws.
pub trait Backend: Debug + Send {
    /// `gpu` or `cpu`.
    fn kind(&self) -> &'static str;
    /// The adapter's name; of the processor, how many threads.
    fn adapter(&self) -> String;
    /// Puts bricks into their slots.
    ///
    /// # Errors
    /// When the device fails.
    fn upload(&mut self, uploads: &[Upload]) -> Result<(), RenderError>;
    /// Draws.
    ///
    /// # Errors
    /// When the device fails, the volume is too wide, or it was stopped.
    fn draw(&mut self, drawing: &Drawing) -> Result<Drawn, RenderError>;
}

/// The mirror of the shader on the processor, a thread a row.
#[derive(Debug)]
pub struct CpuBackend {
    geometry: Geometry,
    spacing_xyz: [f64; 3],
    bricks: Bricks,
}

impl CpuBackend {
    /// A pool of so many slots.
    pub fn new(geometry: &Geometry, spacing_xyz: [f64; 3], slots: usize) -> Self {
        Self { geometry: *geometry, spacing_xyz, bricks: Bricks::new(geometry.brick_side(), slots) }
    }
}

impl Backend for CpuBackend {
    fn kind(&self) -> &'static str {
        "cpu"
    }

    fn adapter(&self) -> String {
        format!("{} threads", rayon::current_num_threads())
    }

    fn upload(&mut self, uploads: &[Upload]) -> Result<(), RenderError> {
        for upload in uploads {
            self.bricks.put(upload.slot, upload.brick.clone());
        }
        Ok(())
    }

    fn draw(&mut self, drawing: &Drawing) -> Result<Drawn, RenderError> {
        let Drawing { index, view, look, table, float_range, ends, stop } = *drawing;
        let grid = RayGrid::new(view, look, self.geometry.dims_xyz(), self.spacing_xyz);
        let frame = Frame::new(&grid, look, &self.geometry, [1, 1, 1])?;
        let nodes = pack(index, look, float_range);
        let seen: Vec<AtomicU32> = nodes.iter().map(|_| AtomicU32::new(0)).collect();
        let scene = Scene {
            frame: &frame,
            variant: Variant::of(look),
            nodes: &nodes,
            table: table_rows(table),
            bricks: &self.bricks,
            seen: &seen,
        };
        let [width, height] = view.size;
        let pixels: Vec<_> = (0..height)
            .into_par_iter()
            .flat_map_iter(|y| {
                let scene = &scene;
                let columns = if stop.load(Ordering::Relaxed) { 0 } else { width };
                (0..columns).map(move |x| {
                    let end = ends.map_or(f32::MAX, |ends| ends[(y * width + x) as usize]);
                    draw_pixel(scene, [x, y], end)
                })
            })
            .collect();
        if pixels.len() < width as usize * height as usize {
            return Err(RenderError::Stopped);
        }
        let picture = Picture {
            size: view.size,
            colors: pixels.iter().map(|p| p.color).collect(),
            depths: pixels.iter().map(|p| p.depth).collect(),
        };
        let seen = seen.iter().map(|s| s.load(Ordering::Relaxed) as u8).collect();
        Ok(Drawn { picture, seen, device_secs: None })
    }
}
