//! The upscaler: a volume enlarged by a whole factor, computed where it is needed and never stored.
//!
//! Tricubic interpolation ([`kernel`], [`weights`]), separable, by one set of weights for each of the
//! `factor` places that a new voxel can have within an old one; and, if wanted, procedural
//! [`noise`] of the frequencies that the source cannot hold, as strong as the source's local
//! [`contrast`]. New voxel o is centred at `(o + 0.5) / factor - 0.5` in old voxels; outside the
//! volume the edge repeats. That is how the 2010 work made its 64-gigavoxel models.
//!
//! A new voxel's value is a pure function of the source, the options and its place: every sum has
//! one order, so whoever asks for it, in whichever brick or slice, gets the same bits. The slow twin
//! is in `tests/laws/upscale.rs`: 64 taps in f64.

mod contrast;
mod kernel;
mod lattice;
mod noise;
mod octave;
mod real;
mod rows;
mod slices;
mod source;
mod tile;
mod weights;

pub use kernel::CubicKernel;
pub(crate) use rows::{Upscaler, thread_bytes};
pub(crate) use slices::{EnlargedSlices, SlabLimits};
pub(crate) use source::Enlarged;

use crate::error::PreprocessError;
use std::collections::BTreeMap;

/// How a volume is enlarged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Upscale {
    factor: u32,
    kernel: CubicKernel,
    detail: Option<Detail>,
}

/// Noise that fills the frequencies between the source's Nyquist frequency and the new one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detail {
    /// The RMS of the detail over the source's local contrast: the mean absolute difference between
    /// a source voxel and its six face neighbours, interpolated linearly.
    pub amplitude: f64,
    /// Other seeds give other noise.
    pub seed: u64,
}

impl Upscale {
    /// The factors there are.
    pub const FACTORS: [u32; 4] = [2, 3, 4, 8];

    /// Enlarges `factor` times along every axis.
    ///
    /// # Errors
    /// When the factor is none of [`Upscale::FACTORS`], or the detail's amplitude is no number or
    /// below 0.
    pub fn new(
        factor: u32,
        kernel: CubicKernel,
        detail: Option<Detail>,
    ) -> Result<Self, PreprocessError> {
        let bad = |option, value, why| Err(PreprocessError::BadValue { option, value, why });
        if !Self::FACTORS.contains(&factor) {
            return bad("--upscale", f64::from(factor), "it must be 2, 3, 4 or 8");
        }
        if let Some(Detail { amplitude, .. }) = detail
            && !(0.0..=1e6).contains(&amplitude)
        {
            return bad("--detail", amplitude, "it must be 0 to 1000000 times the local contrast");
        }
        let detail = detail.filter(|detail| detail.amplitude > 0.0);
        Ok(Self { factor, kernel, detail })
    }

    /// New voxels along an old one.
    pub fn factor(&self) -> u32 {
        self.factor
    }

    /// The kernel of the interpolation.
    pub fn kernel(&self) -> CubicKernel {
        self.kernel
    }

    /// The detail that is added.
    pub fn detail(&self) -> Option<Detail> {
        self.detail
    }

    /// As a store's metadata keep it.
    pub(crate) fn record(&self, options: &mut BTreeMap<String, serde_json::Value>) {
        options.insert("upscale".into(), self.factor.into());
        options.insert("kernel".into(), self.kernel.name().into());
        if let Some(Detail { amplitude, seed }) = self.detail {
            options.insert("detail".into(), amplitude.into());
            options.insert("seed".into(), seed.into());
        }
    }

    /// The upscaling that a store's options name, if any.
    ///
    /// # Errors
    /// When they name one that this version cannot do.
    pub fn recorded(
        options: &BTreeMap<String, serde_json::Value>,
    ) -> Result<Option<Self>, PreprocessError> {
        let Some(factor) = options.get("upscale") else { return Ok(None) };
        let unknown = || PreprocessError::UnknownUpscale {
            found: ["upscale", "kernel", "detail", "seed"]
                .iter()
                .filter_map(|name| Some(format!("{name} {}", options.get(*name)?)))
                .collect::<Vec<_>>()
                .join(", "),
        };
        let factor = factor.as_u64().and_then(|v| u32::try_from(v).ok()).ok_or_else(unknown)?;
        let kernel = options.get("kernel").and_then(|v| v.as_str());
        let kernel = kernel.and_then(|name| name.parse().ok()).ok_or_else(unknown)?;
        let number = |name: &str| options.get(name);
        let detail = match (number("detail"), number("seed")) {
            (None, None) => None,
            (Some(amplitude), Some(seed)) => Some(Detail {
                amplitude: amplitude.as_f64().ok_or_else(unknown)?,
                seed: seed.as_u64().ok_or_else(unknown)?,
            }),
            _ => return Err(unknown()),
        };
        Self::new(factor, kernel, detail).map(Some).map_err(|_| unknown())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_store_records_is_what_was_asked() {
        let detail = Some(Detail { amplitude: 0.1, seed: u64::MAX });
        for kernel in CubicKernel::ALL {
            for detail in [None, detail] {
                let upscale = Upscale::new(3, kernel, detail).unwrap();
                let mut options = BTreeMap::new();
                upscale.record(&mut options);
                assert_eq!(Upscale::recorded(&options).unwrap(), Some(upscale));
            }
        }
        assert_eq!(Upscale::recorded(&BTreeMap::new()).unwrap(), None);
    }

    #[test]
    fn what_cannot_be_done_is_refused() {
        for factor in [0, 1, 5, 6, 7, 16] {
            assert!(Upscale::new(factor, CubicKernel::CatmullRom, None).is_err());
        }
        for amplitude in [-1.0, f64::NAN, f64::INFINITY] {
            let detail = Some(Detail { amplitude, seed: 0 });
            assert!(Upscale::new(4, CubicKernel::CatmullRom, detail).is_err());
        }
        let mut options = BTreeMap::new();
        Upscale::new(4, CubicKernel::CatmullRom, None).unwrap().record(&mut options);
        for (name, value) in [("kernel", "sinc".into()), ("upscale", 5.into()), ("seed", 1.into())]
        {
            let mut options = options.clone();
            options.insert(name.into(), value);
            let refused = Upscale::recorded(&options);
            assert!(matches!(refused, Err(PreprocessError::UnknownUpscale { .. })), "{name}");
        }
    }
}
