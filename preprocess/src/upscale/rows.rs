//! New voxels wherever they are asked for: a region at a time, cut into tiles that fit the caches.

use super::lattice::{LINE, WIDTH};
use super::noise::{Noise, NoiseScratch};
use super::real::Real;
use super::source::Enlarged;
use super::tile::{Kernels, Target, TileNoise, TileScratch, first_samples, make_tile, sample_dims};
use super::{Detail, Upscale};
use crate::gather::{Rows, gather, gather_octet};
use octree_store::{Geometry, NodeKey, Region, Sample, SampleType};
use std::sync::{Mutex, PoisonError};

/// A tile has at most so many new voxels along an axis.
pub(super) const TILE: u64 = 72;

/// Enlarges the voxels of one source, for any number of threads.
#[derive(Debug)]
pub(crate) struct Upscaler<T> {
    upscale: Upscale,
    /// Of the source.
    dims_xyz: [u64; 3],
    /// Where the source begins in its file: detail belongs to places in the file, not in the region.
    origin_xyz: [u64; 3],
    narrow: Kernels<f32>,
    wide: Kernels<f64>,
    noise: Option<(Noise, f64)>,
    /// Of threads that are not at work now.
    scratches: Mutex<Vec<Scratch<T>>>,
}

/// What a thread keeps from region to region.
#[derive(Debug, Default)]
struct Scratch<T> {
    row: Vec<T>,
    narrow: TileScratch<T, f32>,
    wide: TileScratch<T, f64>,
    noise: NoiseScratch,
    block: Vec<T>,
}

/// Some new voxels, x fastest.
#[derive(Debug)]
pub(super) struct Block<T> {
    pub(super) region: Region,
    pub(super) samples: Vec<T>,
}

impl<T: Sample> Rows<T> for Block<T> {
    #[inline(always)]
    fn read_row(&self, xyz: [u64; 3], out: &mut [T]) {
        let [width, height, _] = self.region.dims_xyz();
        let [x, y, z] = [0, 1, 2].map(|axis| xyz[axis] - self.region.min[axis]);
        let first = ((z * height + y) * width + x) as usize;
        out.copy_from_slice(&self.samples[first..first + out.len()]);
    }
}

/// A tile's computation in the type that fits `T`.
trait Computes<F> {
    fn kernels(&self) -> &Kernels<F>;
}

impl<T> Computes<f32> for Upscaler<T> {
    fn kernels(&self) -> &Kernels<f32> {
        &self.narrow
    }
}

impl<T> Computes<f64> for Upscaler<T> {
    fn kernels(&self) -> &Kernels<f64> {
        &self.wide
    }
}

impl<T: Sample> Upscaler<T> {
    /// Enlarges the voxels of what is enlarged.
    pub(crate) fn new(enlarged: &Enlarged) -> Self {
        let upscale = enlarged.upscale;
        let factor = upscale.factor() as usize;
        let noise = |Detail { amplitude, seed }| (Noise::new(seed, factor), amplitude);
        Self {
            upscale,
            dims_xyz: enlarged.source.dims_xyz,
            origin_xyz: enlarged.source.origin_xyz(),
            narrow: Kernels::new(&upscale),
            wide: Kernels::new(&upscale),
            noise: upscale.detail().map(noise),
            scratches: Mutex::default(),
        }
    }

    /// The enlarged voxels of a source's.
    pub(crate) fn rows<'a>(&'a self, source: &'a dyn Rows<T>) -> EnlargedRows<'a, T> {
        EnlargedRows { upscaler: self, source }
    }

    fn with_scratch<V>(&self, work: impl FnOnce(&mut Scratch<T>) -> V) -> V {
        let lock = || self.scratches.lock().unwrap_or_else(PoisonError::into_inner);
        let mut scratch = lock().pop().unwrap_or_default();
        let value = work(&mut scratch);
        lock().push(scratch);
        value
    }

    /// Computes a region's voxels into `out`, x fastest; returns how many of those in `core` had to be
    /// clamped.
    fn region(
        &self,
        source: &dyn Rows<T>,
        target: &mut Target<'_, T>,
        scratch: &mut Scratch<T>,
    ) -> u64 {
        let Region { min, max } = target.region;
        // Tiles of like size.
        let count = target.region.dims_xyz().map(|n| n.div_ceil(TILE));
        let cut = |axis: usize, i: u64| min[axis] + (max[axis] - min[axis]) * i / count[axis];
        let mut clamped = 0;
        for i in 0..count.iter().product() {
            let at = [i % count[0], i / count[0] % count[1], i / count[0] / count[1]];
            let tile = Region {
                min: [0, 1, 2].map(|axis| cut(axis, at[axis])),
                max: [0, 1, 2].map(|axis| cut(axis, at[axis] + 1)),
            };
            let Scratch { row, narrow, wide, noise, .. } = &mut *scratch;
            clamped += if T::FITS_F32 {
                self.tile(source, &tile, row, narrow, noise, target)
            } else {
                self.tile(source, &tile, row, wide, noise, target)
            };
        }
        clamped
    }

    fn tile<F: Real>(
        &self,
        source: &dyn Rows<T>,
        tile: &Region,
        row: &mut Vec<T>,
        scratch: &mut TileScratch<T, F>,
        noise: &mut NoiseScratch,
        target: &mut Target<'_, T>,
    ) -> u64
    where
        Self: Computes<F>,
    {
        let factor = u64::from(self.upscale.factor());
        self.read_samples(source, tile, row, scratch);
        let noise = self.noise.as_ref().map(|(octaves, amplitude)| {
            let first = tile.min.map(|o| o / factor);
            let voxels =
                [0, 1, 2].map(|axis| (tile.max[axis].div_ceil(factor) - first[axis]) as usize);
            let place = [0, 1, 2].map(|axis| first[axis] + self.origin_xyz[axis]);
            octaves.fill(place, voxels, noise);
            TileNoise {
                values: &noise.values,
                height: noise.height,
                first_yz: [1, 2].map(|axis| (tile.min[axis] - first[axis] * factor) as usize),
                amplitude: *amplitude,
            }
        });
        make_tile(self.kernels(), scratch, tile, noise, target)
    }

    /// Reads the source samples that a tile needs; outside the volume the edge repeats.
    fn read_samples<F: Real>(
        &self,
        source: &dyn Rows<T>,
        tile: &Region,
        row: &mut Vec<T>,
        scratch: &mut TileScratch<T, F>,
    ) {
        let factor = u64::from(self.upscale.factor());
        let (first, dims) = (first_samples(tile, factor), sample_dims(tile, factor));
        let last = self.dims_xyz.map(|n| n as i64 - 1);
        let inside = |axis: usize, i: usize| (first[axis] + i as i64).clamp(0, last[axis]);
        // What a line has of the volume, and the edges repeated before and after it.
        let (start, end) = (inside(0, 0), inside(0, dims[0] - 1) + 1);
        let before = (start - first[0]) as usize;
        row.resize((end - start) as usize, T::default());
        scratch.samples.resize(dims[1] * dims[2], [F::default(); LINE]);
        scratch.dims_xyz = dims;
        for (i, line) in scratch.samples.iter_mut().enumerate() {
            let (y, z) = (inside(1, i % dims[1]), inside(2, i / dims[1]));
            source.read_row([start, y, z].map(|v| v as u64), row);
            for (out, sample) in line[before..].iter_mut().zip(row.iter()) {
                *out = F::of(*sample);
            }
            let after = before + row.len();
            let (leftmost, rightmost) = (line[before], line[after - 1]);
            line[..before].fill(leftmost);
            line[after..].fill(rightmost);
        }
    }
}

/// The enlarged voxels of a source's, to be gathered like any others. Few rows are read of the source, so a
/// call for each does not matter, and the code is made once.
pub(crate) struct EnlargedRows<'a, T> {
    upscaler: &'a Upscaler<T>,
    source: &'a dyn Rows<T>,
}

impl<T: Sample> EnlargedRows<'_, T> {
    /// Computes a region; every voxel counts.
    pub(super) fn block(&self, region: Region, samples: Vec<T>) -> (Block<T>, u64) {
        let mut block = Block { region, samples };
        block.samples.resize(region.voxels() as usize, T::default());
        let clamped = self.upscaler.with_scratch(|scratch| {
            let mut target = Target { out: &mut block.samples, region, core: region };
            self.upscaler.region(self.source, &mut target, scratch)
        });
        (block, clamped)
    }
}

impl<T: Sample> Rows<T> for EnlargedRows<'_, T> {
    fn read_row(&self, xyz: [u64; 3], out: &mut [T]) {
        let max = [xyz[0] + out.len() as u64, xyz[1] + 1, xyz[2] + 1];
        let (block, _) = self.block(Region { min: xyz, max }, Vec::new());
        out.copy_from_slice(&block.samples);
    }

    fn read_octet(&self, geometry: &Geometry, parent: NodeKey, bricks: &mut [T]) -> Option<u64> {
        self.upscaler.with_scratch(|scratch| {
            let overlap = u64::from(geometry.overlap());
            let core = octet_core(geometry, parent);
            let dims = geometry.dims_at(parent.level() - 1);
            let region = Region {
                min: core.min.map(|v| v.saturating_sub(overlap)),
                max: [0, 1, 2].map(|axis| (core.max[axis] + overlap).min(dims[axis])),
            };
            let mut block = Block { region, samples: std::mem::take(&mut scratch.block) };
            block.samples.resize(region.voxels() as usize, T::default());
            let mut target = Target { out: &mut block.samples, region, core };
            let clamped = self.upscaler.region(self.source, &mut target, scratch);
            if !gather_octet(&block, geometry, parent, bricks) {
                let samples = geometry.brick_samples();
                for key in parent.children().into_iter().filter(|key| geometry.contains(*key)) {
                    gather(&block, geometry, key, &mut bricks[key.octant() * samples..][..samples]);
                }
            }
            scratch.block = block.samples;
            Some(clamped)
        })
    }
}

/// The voxels of an octet's cores.
fn octet_core(geometry: &Geometry, parent: NodeKey) -> Region {
    let first = geometry.core_region(parent.children()[0]);
    let dims = geometry.dims_at(parent.level() - 1);
    let side = 2 * u64::from(geometry.core());
    Region { min: first.min, max: [0, 1, 2].map(|axis| (first.min[axis] + side).min(dims[axis])) }
}

/// Bytes that a thread takes for enlarging octets of `side` voxels along an axis, overlap included.
pub(crate) fn thread_bytes(upscale: &Upscale, sample_type: SampleType, side: u64) -> u64 {
    let real = if octree_store::with_sample_type!(sample_type, T => T::FITS_F32) { 4 } else { 8 };
    let tile = side.min(TILE);
    let factor = u64::from(upscale.factor());
    let samples = tile / factor + 6;
    let (line, row) = (LINE as u64, WIDTH as u64);
    // Source samples, stretched along x, along z.
    let stretched = real * (line * samples.pow(2) + row * samples * (samples + 1));
    let block = (side.pow(3) + tile * row) * sample_type.bytes() as u64;
    if upscale.detail().is_none() {
        return block + stretched;
    }
    block + 2 * stretched + Noise::thread_bytes(factor, tile)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::upscale::octave::octaves;
    use crate::upscale::weights::REACH;

    #[test]
    fn every_tile_fits_rows_and_lines_of_fixed_length() {
        for factor in Upscale::FACTORS.map(|factor| factor as usize) {
            assert!(WIDTH / factor + 2 * REACH <= LINE, "taps of the last voxel of a row");
            for first in 0..factor {
                let voxels = (first + TILE as usize).div_ceil(factor);
                assert!(voxels * factor <= WIDTH, "factor {factor} from {first}");
                assert!(voxels + 2 * REACH <= LINE);
                for octave in octaves(factor) {
                    let cells = voxels * octave.cells;
                    match octave.stretch {
                        Some(_) => assert!(cells + 2 * REACH <= LINE, "factor {factor}"),
                        None => assert_eq!(octave.cells, factor, "cells are the new voxels"),
                    }
                }
            }
        }
    }
}
