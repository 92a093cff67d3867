//! What all rays of a picture share: view, box, material, and how bricks lie in the pool.
//!
//! Twin of `frame.wgsl`, byte for byte; a test holds the offsets against each other.

use super::ray::ray_of;
use crate::error::RenderError;
use crate::transfer::TransferTable;
use crate::view::{Filter, Look, Mode, RayGrid};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use octree_store::Geometry;

/// The uniform block.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Frame {
    /// The whole voxel in which the ray of the image's middle starts.
    pub(crate) origin_cell: [i32; 3],
    /// Voxels from one index to the next.
    pub(crate) step_voxels: f32,
    pub(crate) origin_frac: [f32; 3],
    /// Lengths of direction between the eye and where rays start.
    pub(crate) plane: f32,
    pub(crate) origin_across: [f32; 3],
    pub(crate) blend_offset: f32,
    pub(crate) origin_down: [f32; 3],
    pub(crate) blend_slope: f32,
    pub(crate) direction: [f32; 3],
    pub(crate) isovalue: f32,
    pub(crate) direction_across: [f32; 3],
    pub(crate) ambient: f32,
    pub(crate) direction_down: [f32; 3],
    pub(crate) diffuse: f32,
    /// World size of a voxel.
    pub(crate) spacing: [f32; 3],
    pub(crate) specular: f32,
    pub(crate) clip_min_cell: [i32; 3],
    pub(crate) shininess: f32,
    pub(crate) clip_min_frac: [f32; 3],
    /// Samples of a brick beyond its core, on every side.
    pub(crate) overlap: f32,
    pub(crate) clip_max_cell: [i32; 3],
    /// Samples of a brick's side.
    pub(crate) side: f32,
    pub(crate) clip_max_frac: [f32; 3],
    /// The last entry of the transfer table.
    pub(crate) last_entry: f32,
    pub(crate) dims: [i32; 3],
    /// Voxels of a brick's core.
    pub(crate) core: i32,
    /// Towards the light; zero for a light at the eye.
    pub(crate) light: [f32; 3],
    /// Iterations of a dispatch: a ray that needs more goes on in the next.
    pub(crate) budget: i32,
    pub(crate) surface: [f32; 3],
    /// The first row of pixels of this dispatch.
    pub(crate) first_row: u32,
    /// Width and height of the image.
    pub(crate) size: [u32; 2],
    /// Slots along x and y of the pool.
    pub(crate) pool: [u32; 2],
    /// Size of a texel where the pool is 1 wide.
    pub(crate) texel: [f32; 3],
    pub(crate) padding: u32,
}

/// Width of a volume that voxel numbers of 31 bits allow.
const WIDEST: u64 = 1 << 30;

impl Frame {
    /// The block of a view. `pool_slots` are the slots along x, y and z of the pool.
    pub(crate) fn new(
        grid: &RayGrid,
        look: &Look,
        geometry: &Geometry,
        pool_slots: [u32; 3],
    ) -> Result<Self, RenderError> {
        let dims_xyz = geometry.dims_xyz();
        if dims_xyz.iter().any(|n| *n > WIDEST) {
            return Err(RenderError::TooWide { dims_xyz, limit: WIDEST });
        }
        let limit = WIDEST as f64;
        let cell = |v: DVec3| v.floor().clamp(DVec3::splat(-limit), DVec3::splat(limit));
        let whole = |v: DVec3| cell(v).as_ivec3().to_array();
        let rest = |v: DVec3| (v - cell(v)).as_vec3().to_array();
        let float = |v: DVec3| v.as_vec3().to_array();
        // A camera's matrix may be scaled as it likes, so directions have any length: they get one near 1, by a power of
        // two, which rounds nothing.
        let longest = grid.longest_direction();
        let scale = if longest.is_normal() { longest.log2().floor().exp2() } else { 1.0 };
        let direction = |v: DVec3| float(v / scale);
        let shading = look.shading.unwrap_or_default();
        let light = shading.light.map_or(DVec3::ZERO, |l| DVec3::from_array(l).normalize_or_zero());
        let isovalue = if let Mode::Iso(value) = look.mode { look.normalised(value) } else { 0.0 };
        let frame = Self {
            origin_cell: whole(grid.origin),
            step_voxels: grid.step_voxels as f32,
            origin_frac: rest(grid.origin),
            plane: (grid.plane * scale) as f32,
            origin_across: float(grid.origin_across),
            blend_offset: grid.blend[0] as f32,
            origin_down: float(grid.origin_down),
            blend_slope: (grid.blend[1] / scale) as f32,
            direction: direction(grid.direction),
            isovalue: isovalue as f32,
            direction_across: direction(grid.direction_across),
            ambient: shading.ambient as f32,
            direction_down: direction(grid.direction_down),
            diffuse: shading.diffuse as f32,
            spacing: float(grid.spacing),
            specular: shading.specular as f32,
            clip_min_cell: whole(grid.clip_min),
            shininess: shading.shininess as f32,
            clip_min_frac: rest(grid.clip_min),
            overlap: geometry.overlap() as f32,
            clip_max_cell: whole(grid.clip_max),
            side: geometry.brick_side() as f32,
            clip_max_frac: rest(grid.clip_max),
            last_entry: (look.table_entries - 1) as f32,
            dims: dims_xyz.map(|n| n as i32),
            core: geometry.core() as i32,
            light: float(light),
            budget: BUDGET,
            surface: look.surface_color.map(|c| c as f32),
            first_row: 0,
            size: grid.size,
            pool: [pool_slots[0], pool_slots[1]],
            texel: pool_slots.map(|n| 1.0 / (f64::from(n) * geometry.brick_side() as f64) as f32),
            padding: 0,
        };
        if frame.is_in_scale() { Ok(frame) } else { Err(RenderError::OutOfScale) }
    }

    /// Whether all rays have numbers that f32 holds, squares of lengths among them. A ray of others has neither end nor
    /// direction, and would be followed for ever. What is greatest of a ray is so at a corner of the image.
    fn is_in_scale(&self) -> bool {
        let moderate = |v: f32| v.abs() < 1e30;
        let starts = [self.origin_frac, self.origin_across, self.origin_down];
        let [right, bottom] = self.size.map(|n| n.saturating_sub(1));
        let corners = [[0, 0], [right, 0], [0, bottom], [right, bottom]];
        starts.into_iter().flatten().all(moderate)
            && self.spacing.iter().all(|side| (1e-14..=1e14).contains(side))
            && moderate(self.plane)
            && corners.into_iter().map(|pixel| ray_of(self, pixel, f32::MAX)).all(|ray| {
                moderate(ray.world_before)
                    && moderate(ray.depth_step)
                    && (ray.step.length() / self.step_voxels - 1.0).abs() < 0.01
            })
    }
}

/// Mesa 22.3 ends loops after 65,535 iterations of a group of eight rays, without a word. Eight rays of which each waits
/// for the others take eight times the iterations of one.
const BUDGET: i32 = 8000;

/// What is compiled into a shader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Variant {
    /// 0 volume rendering, 1 surface, 2 maximum.
    pub(crate) mode: u32,
    pub(crate) shaded: bool,
    pub(crate) blended: bool,
}

impl Variant {
    pub(crate) fn of(look: &Look) -> Self {
        let mode = match look.mode {
            Mode::Dvr => 0,
            Mode::Iso(_) => 1,
            Mode::Mip => 2,
        };
        Self { mode, shaded: look.shading.is_some(), blended: look.filter == Filter::Quadrilinear }
    }
}

/// The rows of a table as a shader reads them.
pub(crate) fn table_rows(table: &TransferTable) -> &[[[f32; 4]; 3]] {
    &table.rows
}
