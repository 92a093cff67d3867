//! A store or a source: anything that gives a volume's slices one after the other.

use crate::error::PreprocessError;
use crate::source::{Slices, Source, SourceError, SourceOptions};
use crate::window::{Chunk, Window, WindowPlace};
use octree_store::{
    BrickScratch, LengthUnit, NodeKey, Region, Sample, SampleType, Store, StoreError,
};
use std::path::Path;

/// Slabs of bricks up to this size stay in memory; larger ones go to a mapped scratch file.
const SLAB_MEMORY_BYTES: u64 = 128 << 20;

/// A volume that can be read from front to back.
#[derive(Debug)]
pub enum Volume {
    /// A region of a level of a store.
    Store {
        /// The store.
        store: Box<Store>,
        /// The level.
        level: u8,
        /// The region, in voxels of the level.
        region: Region,
    },
    /// A volume file.
    Source(Box<Source>),
}

impl Volume {
    /// Opens a file as a store where it is one (level 0), else as a source.
    ///
    /// # Errors
    /// When it is neither.
    pub fn open(path: impl AsRef<Path>, options: &SourceOptions) -> Result<Self, PreprocessError> {
        let path = path.as_ref();
        match Store::open(path) {
            Ok(store) => Self::of_store(store, 0, None),
            Err(StoreError::NotAStore { .. } | StoreError::Io { .. })
                if path.extension().is_none_or(|extension| extension != "octavo") =>
            {
                Ok(Self::Source(Box::new(Source::open(path, options)?)))
            }
            Err(error) => Err(error.into()),
        }
    }

    /// A level of a store, or a region of it in voxels of that level.
    ///
    /// # Errors
    /// When the store has no such level, or the region is empty or leaves it.
    pub fn of_store(
        store: Store,
        level: u8,
        region: Option<Region>,
    ) -> Result<Self, PreprocessError> {
        let dims_xyz = store.geometry().dims_at(level);
        let region = region.unwrap_or(Region::whole(dims_xyz));
        if level > store.geometry().top_level() || !region.lies_within(dims_xyz) {
            let Region { min, max } = region;
            return Err(StoreError::Region { level, min, max, dims_xyz }.into());
        }
        Ok(Self::Store { store: Box::new(store), level, region })
    }

    /// Voxels along x, y, z.
    pub fn dims_xyz(&self) -> [u64; 3] {
        match self {
            Self::Store { region, .. } => region.dims_xyz(),
            Self::Source(source) => source.dims_xyz,
        }
    }

    /// The type of the samples.
    pub fn sample_type(&self) -> SampleType {
        match self {
            Self::Store { store, .. } => store.metadata().sample_type,
            Self::Source(source) => source.sample_type(),
        }
    }

    /// The size of a voxel; a level's voxels are 2^level times those of level 0.
    pub fn spacing_xyz(&self) -> [f64; 3] {
        match self {
            Self::Store { store, level, .. } => {
                store.metadata().spacing_xyz.map(|spacing| spacing * 2_f64.powi(i32::from(*level)))
            }
            Self::Source(source) => source.spacing_xyz,
        }
    }

    /// The unit of the spacing.
    pub fn unit(&self) -> LengthUnit {
        match self {
            Self::Store { store, .. } => store.metadata().unit,
            Self::Source(source) => source.unit,
        }
    }

    /// Voxel index to world. The centre of voxel i of level k lies at `(i + 0.5) * 2^k - 0.5` in
    /// level-0 voxels.
    pub fn affine(&self) -> Option<[[f64; 4]; 4]> {
        match self {
            Self::Store { store, level, region } => {
                let scale = 2_f64.powi(i32::from(*level));
                let mut affine = store.metadata().affine?;
                for row in affine.iter_mut().take(3) {
                    for axis in 0..3 {
                        let first = (region.min[axis] as f64 + 0.5) * scale - 0.5;
                        row[3] += row[axis] * first;
                    }
                    for value in row.iter_mut().take(3) {
                        *value *= scale;
                    }
                }
                Some(affine)
            }
            Self::Source(source) => source.affine,
        }
    }

    /// The slices from front to back, as samples of type `T`.
    ///
    /// # Errors
    /// When the volume cannot be read, or its samples are not `T`.
    pub fn slices<T: Sample>(&self) -> Result<VolumeSlices<'_, T>, PreprocessError> {
        let stored = self.sample_type();
        if stored != T::TYPE {
            return Err(StoreError::SampleType { stored, asked: T::TYPE }.into());
        }
        Ok(match self {
            Self::Store { store, level, region } => {
                let [width, height, _] = region.dims_xyz();
                let core = u64::from(store.geometry().core());
                let bytes = width * height * core * size_of::<T>() as u64;
                let place = if bytes <= SLAB_MEMORY_BYTES {
                    WindowPlace::Memory
                } else {
                    WindowPlace::Unnamed(std::env::temp_dir())
                };
                let window = Window::new([width, height, core], core, place);
                let slab = window.blank().map_err(PreprocessError::Scratch)?;
                let brick = vec![T::default(); store.geometry().brick_samples()];
                VolumeSlices::Store(Box::new(StoreSlices {
                    store,
                    level: *level,
                    region: *region,
                    slab,
                    slab_z: None,
                    brick,
                    scratch: BrickScratch::default(),
                    next_z: region.min[2],
                }))
            }
            Self::Source(source) => VolumeSlices::Source(source.slices()?),
        })
    }
}

/// A volume's slices, one after the other.
#[derive(Debug)]
pub enum VolumeSlices<'a, T> {
    /// From a store.
    Store(Box<StoreSlices<'a, T>>),
    /// From a file.
    Source(Slices<'a>),
}

impl<T: Sample> VolumeSlices<'_, T> {
    /// Reads the next slice into `dims_xyz[0] * dims_xyz[1]` samples, x fastest.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn next(&mut self, slice: &mut [T]) -> Result<(), PreprocessError> {
        match self {
            Self::Store(slices) => slices.next(slice),
            Self::Source(slices) => slices.next(slice).map_err(SourceError::into),
        }
    }
}

/// A store's slices: a slab of bricks is decoded at a time.
#[derive(Debug)]
pub struct StoreSlices<'a, T> {
    store: &'a Store,
    level: u8,
    region: Region,
    /// The slices of one row of bricks, cut to the region along x and y.
    slab: Chunk<T>,
    /// Which row of bricks that is.
    slab_z: Option<u64>,
    brick: Vec<T>,
    scratch: BrickScratch,
    next_z: u64,
}

impl<T: Sample> StoreSlices<'_, T> {
    fn next(&mut self, slice: &mut [T]) -> Result<(), PreprocessError> {
        let core = u64::from(self.store.geometry().core());
        let brick_z = self.next_z / core;
        if self.slab_z != Some(brick_z) {
            self.decode_slab(brick_z)?;
            self.slab_z = Some(brick_z);
        }
        let samples = slice.len();
        let start = (self.next_z % core) as usize * samples;
        slice.copy_from_slice(&self.slab.samples()[start..start + samples]);
        self.next_z += 1;
        Ok(())
    }

    fn decode_slab(&mut self, brick_z: u64) -> Result<(), PreprocessError> {
        let Self { store, level, region, slab, brick, scratch, .. } = self;
        let geometry = store.geometry();
        let [width, height, _] = region.dims_xyz().map(|n| n as usize);
        let first = geometry.brick_of_voxel(*level, region.min).brick_xyz();
        let last = geometry.brick_of_voxel(*level, region.max.map(|v| v - 1)).brick_xyz();
        let side = geometry.brick_side();
        let slab = slab.samples_mut();
        for (x, y) in (first[1]..=last[1]).flat_map(|y| (first[0]..=last[0]).map(move |x| (x, y))) {
            let key = NodeKey::new(*level, [x, y, brick_z]);
            store.read_brick_core(key, scratch, brick)?;
            let core = geometry.core_region(key);
            let shared = core.intersection(region);
            let origin = geometry.sample_origin(key);
            let at = |axis: usize, v: u64| (v as i64 - origin[axis]) as usize;
            let length = (shared.max[0] - shared.min[0]) as usize;
            for z in shared.min[2]..shared.max[2] {
                for y in shared.min[1]..shared.max[1] {
                    let from = (at(2, z) * side + at(1, y)) * side + at(0, shared.min[0]);
                    let row = (z - core.min[2]) as usize * height + (y - region.min[1]) as usize;
                    let to = row * width + (shared.min[0] - region.min[0]) as usize;
                    slab[to..to + length].copy_from_slice(&brick[from..from + length]);
                }
            }
        }
        Ok(())
    }
}
