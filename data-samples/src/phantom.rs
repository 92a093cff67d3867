//! A phantom: a recipe and a size, and the rows and slices that follow from them.

use rayon::prelude::*;

use crate::{
    PhantomError, Sample, SampleType, analytic,
    micro_ct::{DEFAULT_NOISE_SIGMA, MicroCt},
};

/// What a phantom shows.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// Nested ellipsoids with foam-like pores, soft edges and noise. A `u16` by nature: `f32`
    /// holds the same numbers, `u8` their high bytes.
    MicroCt {
        /// Chooses the foam and the noise.
        seed: u64,
        /// Standard deviation of the noise; 0 for none.
        noise_sigma: f64,
    },
    /// a x + b y + c z, in voxels from 0, rounded and clamped to the sample type.
    Ramp {
        /// a, b and c.
        slope_xyz: [f64; 3],
    },
    /// A sphere in the middle of the volume, with a hard edge: a voxel is inside if its centre is.
    Sphere {
        /// Its radius.
        radius_voxels: f64,
        /// The value inside.
        inside: f64,
        /// The value outside.
        outside: f64,
    },
    /// One voxel that differs from all others.
    HotVoxel {
        /// Where it is; `None` for the middle, `dims / 2`.
        at_xyz: Option<[usize; 3]>,
        /// Its value.
        hot: f64,
        /// The value of all others.
        background: f64,
    },
    /// The same value everywhere.
    Constant {
        /// The value.
        value: f64,
    },
}

impl Kind {
    /// A micro-CT phantom with the usual noise.
    pub fn micro_ct(seed: u64) -> Self {
        Self::MicroCt { seed, noise_sigma: DEFAULT_NOISE_SIGMA }
    }

    /// The name used in file names and on the command line, such as `micro-ct`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::MicroCt { .. } => "micro-ct",
            Self::Ramp { .. } => "ramp",
            Self::Sphere { .. } => "sphere",
            Self::HotVoxel { .. } => "hot-voxel",
            Self::Constant { .. } => "constant",
        }
    }

    /// Every number of the recipe with its name.
    fn parameters(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Self::MicroCt { noise_sigma, .. } => vec![("the noise's sigma", noise_sigma)],
            Self::Ramp { slope_xyz: [a, b, c] } => {
                vec![("the slope along x", a), ("the slope along y", b), ("the slope along z", c)]
            }
            Self::Sphere { radius_voxels, inside, outside } => vec![
                ("the sphere's radius", radius_voxels),
                ("the value inside", inside),
                ("the value outside", outside),
            ],
            Self::HotVoxel { hot, background, .. } => {
                vec![("the hot voxel's value", hot), ("the background's value", background)]
            }
            Self::Constant { value } => vec![("the value", value)],
        }
    }

    /// The values that the volume consists of, where they are given: no ramp, no scan.
    fn plain_values(&self) -> Vec<(&'static str, f64)> {
        match self {
            Self::MicroCt { .. } | Self::Ramp { .. } => Vec::new(),
            Self::Sphere { .. } => self.parameters().split_off(1),
            Self::HotVoxel { .. } | Self::Constant { .. } => self.parameters(),
        }
    }
}

/// A synthetic volume of a given size, none of which exists until it is asked for.
#[derive(Debug)]
pub struct Phantom {
    kind: Kind,
    dims_xyz: [usize; 3],
    micro_ct: Option<MicroCt>,
}

impl Phantom {
    /// A phantom of `dims_xyz` voxels. A micro-CT phantom computes some tables here: about 100
    /// bytes for each voxel along x.
    ///
    /// # Errors
    /// If an axis is empty, the volume has more than 2^63 bytes, a parameter is not finite or is
    /// negative where it cannot be, or the hot voxel is outside.
    pub fn new(kind: Kind, dims_xyz: [usize; 3]) -> Result<Self, PhantomError> {
        if dims_xyz.contains(&0) {
            return Err(PhantomError::EmptyAxis { dims_xyz });
        }
        let bytes = dims_xyz.iter().try_fold(4_i64, |all, &n| all.checked_mul(n.try_into().ok()?));
        if bytes.is_none_or(|bytes| usize::try_from(bytes).is_err()) {
            return Err(PhantomError::TooLarge { dims_xyz });
        }
        for (name, value) in kind.parameters() {
            if !value.is_finite() {
                return Err(PhantomError::BadParameter { name, value, wanted: "finite" });
            }
        }
        let not_negative = match kind {
            Kind::MicroCt { .. } | Kind::Sphere { .. } => kind.parameters()[0],
            _ => ("", 0.0),
        };
        if let (name, value @ ..0.0) = not_negative {
            return Err(PhantomError::BadParameter { name, value, wanted: "0 or more" });
        }
        if let Kind::HotVoxel { at_xyz: Some(at_xyz), .. } = kind
            && at_xyz.iter().zip(dims_xyz).any(|(&at, n)| at >= n)
        {
            return Err(PhantomError::HotVoxelOutside { at_xyz, dims_xyz });
        }
        let micro_ct = match kind {
            Kind::MicroCt { seed, noise_sigma } => Some(MicroCt::new(seed, noise_sigma, dims_xyz)),
            _ => None,
        };
        Ok(Self { kind, dims_xyz, micro_ct })
    }

    /// The recipe.
    pub fn kind(&self) -> &Kind {
        &self.kind
    }

    /// Voxels along x, y and z.
    pub fn dims_xyz(&self) -> [usize; 3] {
        self.dims_xyz
    }

    /// Voxels in all.
    pub fn voxel_count(&self) -> usize {
        self.dims_xyz.iter().product()
    }

    /// `NAME_XxYxZ_TYPE.raw`, a name that says how to read the file: `ramp_64x48x40_u16.raw`.
    pub fn file_name(&self, sample_type: SampleType) -> String {
        let [nx, ny, nz] = self.dims_xyz;
        format!("{}_{nx}x{ny}x{nz}_{sample_type}.raw", self.kind.name())
    }

    /// Whether `sample_type` can hold the recipe's values; a ramp is clamped, which always fits.
    ///
    /// # Errors
    /// [`PhantomError::ValueOutOfRange`] for the first value that does not fit.
    pub fn check_fits(&self, sample_type: SampleType) -> Result<(), PhantomError> {
        let (min, max) = sample_type.range();
        for (name, value) in self.kind.plain_values() {
            if !(min..=max).contains(&value) {
                return Err(PhantomError::ValueOutOfRange { name, value, sample_type });
            }
        }
        Ok(())
    }

    /// One voxel, computed the slow and obvious way; `None` outside the volume.
    pub fn voxel<T: Sample>(&self, x: usize, y: usize, z: usize) -> Option<T> {
        let [nx, ny, nz] = self.dims_xyz;
        if x >= nx || y >= ny || z >= nz {
            return None;
        }
        Some(match &self.micro_ct {
            Some(micro_ct) => T::from_micro_ct(micro_ct.voxel(x, y, z)),
            None => T::from_f64(analytic::value(&self.kind, self.dims_xyz, x, y, z)),
        })
    }

    /// Fills `out` with the row at y and z, on the calling thread.
    ///
    /// # Errors
    /// If there is no such row, or `out` is not as long as the row.
    pub fn row<T: Sample>(&self, y: usize, z: usize, out: &mut [T]) -> Result<(), PhantomError> {
        let [nx, ny, nz] = self.dims_xyz;
        check_index("y", y, ny)?;
        check_index("z", z, nz)?;
        check_length(nx, out.len())?;
        self.fill_row(y, z, out);
        Ok(())
    }

    /// Fills `out` with slice z, x fastest, on rayon's threads.
    ///
    /// # Errors
    /// If there is no such slice, or `out` is not as long as the slice.
    pub fn slice<T: Sample>(&self, z: usize, out: &mut [T]) -> Result<(), PhantomError> {
        let [nx, ny, nz] = self.dims_xyz;
        check_index("z", z, nz)?;
        check_length(nx * ny, out.len())?;
        out.par_chunks_mut(nx).enumerate().for_each(|(y, row)| self.fill_row(y, z, row));
        Ok(())
    }

    /// The whole volume in memory, x fastest, then y: for tests, and for what fits.
    pub fn volume<T: Sample>(&self) -> Vec<T> {
        let [nx, ny, _] = self.dims_xyz;
        let mut all = vec![T::default(); self.voxel_count()];
        all.par_chunks_mut(nx).enumerate().for_each(|(i, row)| self.fill_row(i % ny, i / ny, row));
        all
    }

    /// The row at y and z, which the caller has checked.
    pub(crate) fn fill_row<T: Sample>(&self, y: usize, z: usize, out: &mut [T]) {
        let Some(micro_ct) = &self.micro_ct else {
            for (x, out) in out.iter_mut().enumerate() {
                *out = T::from_f64(analytic::value(&self.kind, self.dims_xyz, x, y, z));
            }
            return;
        };
        let mut row = vec![0; out.len()];
        micro_ct.row(y, z, &mut row);
        for (out, value) in out.iter_mut().zip(row) {
            *out = T::from_micro_ct(value);
        }
    }
}

fn check_index(axis: &'static str, index: usize, count: usize) -> Result<(), PhantomError> {
    if index < count { Ok(()) } else { Err(PhantomError::Outside { axis, index, count }) }
}

fn check_length(expected: usize, found: usize) -> Result<(), PhantomError> {
    if expected == found { Ok(()) } else { Err(PhantomError::BufferLength { expected, found }) }
}
