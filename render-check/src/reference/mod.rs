//! The truth: the source volume in f64, without octree, bricks, levels or tables, sample by sample.
//!
//! The equations are those of [`crate::ray`]; rays do not end early, and the transfer function is integrated exactly. One
//! thread a row.

mod gather;
mod sample;

use crate::error::RenderError;
use crate::finite::range_of;
use crate::picture::Picture;
use crate::transfer::ExactIntegrals;
use crate::view::{Look, Mode, PixelRay, RayGrid};
use glam::DVec3;
use octree_store::SampleBuffer;
use octree_store::loader::View;
use rayon::prelude::*;

pub use sample::Interpolation;

/// A volume in memory.
#[derive(Debug, Clone)]
pub struct SourceVolume {
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// World size of a voxel.
    pub spacing_xyz: [f64; 3],
    /// The voxels, x fastest.
    pub samples: SampleBuffer,
}

/// Draws the picture of a view.
///
/// # Errors
/// When the look is none.
pub fn draw(
    volume: &SourceVolume,
    view: &View,
    look: &Look,
    interpolation: Interpolation,
) -> Result<Picture, RenderError> {
    look.check()?;
    let tracer = Tracer::new(volume, view, look, interpolation);
    let [width, height] = view.size;
    let pixels: Vec<Traced> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let tracer = &tracer;
            (0..width).map(move |x| tracer.pixel([x, y]))
        })
        .collect();
    Ok(Picture {
        size: view.size,
        colors: pixels.iter().map(|p| p.color.map(|c| c as f32)).collect(),
        depths: pixels.iter().map(|p| p.depth as f32).collect(),
    })
}

/// A pixel in f64.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Traced {
    pub(crate) color: [f64; 4],
    pub(crate) depth: f64,
}

/// All that rays share.
#[derive(Debug)]
pub(crate) struct Tracer<'a> {
    volume: &'a SourceVolume,
    look: &'a Look,
    interpolation: Interpolation,
    grid: RayGrid,
    integrals: ExactIntegrals,
    /// Least and greatest value, for what is no number; none where all types are whole.
    range: Option<[f64; 2]>,
}

/// What a ray has gathered so far.
#[derive(Debug, Clone, Copy)]
struct Gathered {
    color: DVec3,
    left: f64,
    alpha: f64,
    depth: f64,
    best: f64,
}

impl<'a> Tracer<'a> {
    pub(crate) fn new(
        volume: &'a SourceVolume,
        view: &View,
        look: &'a Look,
        interpolation: Interpolation,
    ) -> Self {
        Self {
            volume,
            look,
            interpolation,
            grid: RayGrid::new(view, look, volume.dims_xyz, volume.spacing_xyz),
            integrals: ExactIntegrals::new(&look.transfer),
            range: (!volume.samples.sample_type().is_integer()).then(|| range_of(&volume.samples)),
        }
    }

    /// A pixel: samples where its ray enters, at every index of the grid inside, and where it leaves.
    pub(crate) fn pixel(&self, pixel: [u32; 2]) -> Traced {
        let Some(ray) = self.grid.ray(pixel, f64::INFINITY) else {
            return Traced { color: [0.0; 4], depth: f64::INFINITY };
        };
        let mut gathered = Gathered {
            color: DVec3::ZERO,
            left: 1.0,
            alpha: 0.0,
            depth: f64::INFINITY,
            best: f64::NEG_INFINITY,
        };
        let mut from = ray.enter;
        let mut value = self.value(at(&ray, from));
        if self.look.mode == Mode::Mip {
            gather::take_greater(&ray, from, value, &mut gathered);
        }
        while from < ray.leave && gathered.left > 0.0 {
            let to = (from.floor() + 1.0).min(ray.leave);
            let next = self.value(at(&ray, to));
            match self.look.mode {
                Mode::Dvr => self.add_light(&ray, [from, to], [value, next], &mut gathered),
                Mode::Iso(surface) => {
                    self.find_surface(&ray, [from, to], [value, next], surface, &mut gathered);
                }
                Mode::Mip => gather::take_greater(&ray, to, next, &mut gathered),
            }
            (from, value) = (to, next);
        }
        if self.look.mode == Mode::Mip {
            let grey = self.look.normalised(gathered.best).clamp(0.0, 1.0);
            return Traced { color: [grey, grey, grey, 1.0], depth: gathered.depth };
        }
        Traced { color: gathered.color.extend(gathered.alpha).to_array(), depth: gathered.depth }
    }

    fn value(&self, at: DVec3) -> f64 {
        sample::value(self.volume, at, self.interpolation, self.range)
    }
}

/// The voxel place of an index.
fn at(ray: &PixelRay, index: f64) -> DVec3 {
    ray.start + index * ray.step
}

#[cfg(test)]
mod tests;
