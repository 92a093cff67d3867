//! What the flags say of enlarging, for the commands that do it.

use clap::{Args, builder::PossibleValuesParser, builder::TypedValueParser};
use preprocess::{CubicKernel, Detail, PreprocessError, Upscale};

/// How a volume is enlarged.
#[derive(Debug, Clone, Args)]
pub(super) struct EnlargeArgs {
    /// The cubic kernel: catmull-rom passes through the samples, b-spline never overshoots, mitchell
    /// is between the two
    /// [default: catmull-rom]
    #[arg(long, value_name = "KERNEL", value_parser = kernels())]
    kernel: Option<CubicKernel>,
    /// Add noise of the frequencies that the source cannot hold, with A times the local contrast as its
    /// RMS: the mean difference between a voxel and its six neighbours
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    detail: Option<f64>,
    /// Which noise: another seed, another noise
    /// [default: 0]
    #[arg(long, value_name = "N", requires = "detail")]
    seed: Option<u64>,
}

impl EnlargeArgs {
    pub(super) fn upscale(&self, factor: u32) -> Result<Upscale, PreprocessError> {
        let seed = self.seed.unwrap_or(0);
        let detail = self.detail.map(|amplitude| Detail { amplitude, seed });
        Upscale::new(factor, self.kernel.unwrap_or_default(), detail)
    }

    /// Whether any of the flags was given.
    pub(super) fn any(&self) -> bool {
        self.kernel.is_some() || self.detail.is_some()
    }
}

fn kernels() -> impl TypedValueParser<Value = CubicKernel> {
    PossibleValuesParser::new(CubicKernel::ALL.map(CubicKernel::name))
        .try_map(|name| name.parse::<CubicKernel>())
}

/// `2`, `3`, `4` or `8`.
pub(super) fn factors() -> impl TypedValueParser<Value = u32> {
    PossibleValuesParser::new(["2", "3", "4", "8"]).try_map(|factor| factor.parse::<u32>())
}
