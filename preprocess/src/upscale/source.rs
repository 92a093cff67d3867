//! The virtual source: a source that stands for another one, enlarged.

use super::Upscale;
use super::slices::SlabLimits;
use super::weights::REACH;
use crate::source::{Source, SourceError};
use octree_store::Geometry;
use std::sync::atomic::AtomicU64;

/// What is enlarged, and how.
#[derive(Debug)]
pub(crate) struct Enlarged {
    /// The source, cut to its region.
    pub(crate) source: Source,
    pub(crate) upscale: Upscale,
    /// How slices are made.
    pub(crate) limits: SlabLimits,
    /// Of the slices that were last read, the voxels that were clamped.
    pub(crate) clamped: AtomicU64,
}

impl Enlarged {
    /// Voxels along x, y, z.
    pub(crate) fn new_dims_xyz(&self) -> [u64; 3] {
        self.source.dims_xyz.map(|n| n * u64::from(self.upscale.factor()))
    }

    /// The source's slices that the first so many new slices need, counted from its first.
    pub(crate) fn slices_needed(&self, new_slices: u64) -> u64 {
        let Some(last) = new_slices.checked_sub(1) else { return 0 };
        let last = last / u64::from(self.upscale.factor()) + REACH as u64;
        (last + 1).min(self.source.dims_xyz[2])
    }

    /// The source's slices that so many new slices need together at most.
    pub(crate) fn window_slices(&self, new_slices: u64) -> u64 {
        let spanned = new_slices.div_ceil(u64::from(self.upscale.factor())) + 1;
        (spanned + 2 * REACH as u64).min(self.source.dims_xyz[2])
    }

    /// The first of the source's slices that new slices from `z` on need.
    pub(crate) fn first_slice(&self, z: u64) -> u64 {
        (z / u64::from(self.upscale.factor())).saturating_sub(REACH as u64)
    }
}

impl Source {
    /// The source enlarged. Nothing is computed before its voxels are read; the description stays that
    /// of the file. Spacing and affine follow: world positions stay.
    ///
    /// # Errors
    /// When the enlarged volume would be too large for any store.
    pub fn upscale(self, upscale: Upscale) -> Result<Self, SourceError> {
        let factor = upscale.factor();
        let dims_xyz = self.dims_xyz.map(|n| n.saturating_mul(factor.into()));
        Geometry::new(dims_xyz, 128, 0).map_err(|source| SourceError::Geometry {
            path: self.description.path.clone().into(),
            source,
        })?;
        let factor = f64::from(factor);
        let mut enlarged = Self::standing_for(self, dims_xyz, upscale);
        enlarged.spacing_xyz = enlarged.spacing_xyz.map(|spacing| spacing / factor);
        if let Some(affine) = &mut enlarged.affine {
            for row in affine.iter_mut().take(3) {
                // New voxel 0 is centred at (0 + 0.5) / f - 0.5 in old ones, on each axis.
                row[3] += (row[0] + row[1] + row[2]) * (0.5 / factor - 0.5);
                row.iter_mut().take(3).for_each(|value| *value /= factor);
            }
        }
        Ok(enlarged)
    }
}
