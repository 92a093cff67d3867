//! Cubic interpolation kernels: the two-parameter family of Mitchell and Netravali.
//!
//! D. P. Mitchell and A. N. Netravali, "Reconstruction filters in computer graphics", SIGGRAPH 1988,
//! equation 8. Every (B, C) sums to 1 over the integers at any offset; B = 0 interpolates (passes
//! through the samples); 2C + B = 1 reproduces second-order polynomials best.

use std::fmt;
use std::str::FromStr;

/// A cubic kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CubicKernel {
    /// (0, 1/2): passes through the samples, and overshoots a little at edges.
    #[default]
    CatmullRom,
    /// (1, 0): smooth and never beyond the samples' range; blurs them.
    BSpline,
    /// (1/3, 1/3): between the two.
    Mitchell,
}

impl CubicKernel {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::CatmullRom, Self::BSpline, Self::Mitchell];

    /// The name on the command line and in stores.
    pub fn name(self) -> &'static str {
        match self {
            Self::CatmullRom => "catmull-rom",
            Self::BSpline => "b-spline",
            Self::Mitchell => "mitchell",
        }
    }

    /// The parameters (B, C).
    pub fn b_c(self) -> (f64, f64) {
        match self {
            Self::CatmullRom => (0.0, 0.5),
            Self::BSpline => (1.0, 0.0),
            Self::Mitchell => (1.0 / 3.0, 1.0 / 3.0),
        }
    }

    /// The kernel at a distance, in samples; 0 from 2 on.
    pub fn at(self, distance: f64) -> f64 {
        let (b, c) = self.b_c();
        let x = distance.abs();
        if x < 1.0 {
            let cubic = (12.0 - 9.0 * b - 6.0 * c) * x + (-18.0 + 12.0 * b + 6.0 * c);
            (cubic * x * x + (6.0 - 2.0 * b)) / 6.0
        } else if x < 2.0 {
            let square = (-b - 6.0 * c) * x + (6.0 * b + 30.0 * c);
            ((square * x + (-12.0 * b - 48.0 * c)) * x + (8.0 * b + 24.0 * c)) / 6.0
        } else {
            0.0
        }
    }
}

impl fmt::Display for CubicKernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for CubicKernel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let kernel = Self::ALL.into_iter().find(|kernel| kernel.name() == text);
        kernel.ok_or_else(|| {
            format!("unknown kernel '{text}': use catmull-rom, b-spline or mitchell")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_sums_to_one_and_is_what_the_books_say() {
        for kernel in CubicKernel::ALL {
            for step in 0..100 {
                let t = f64::from(step) / 100.0;
                let sum: f64 = (-2..=2).map(|k| kernel.at(t - f64::from(k))).sum();
                assert!((sum - 1.0).abs() < 1e-14, "{kernel} at {t}: {sum}");
            }
        }
        let half = |kernel: CubicKernel| [0.5, 1.5].map(|x| kernel.at(x) * 48.0);
        assert_eq!(half(CubicKernel::CatmullRom), [27.0, -3.0], "9/16 and -1/16");
        assert_eq!(half(CubicKernel::BSpline).map(f64::round), [23.0, 1.0], "23/48 and 1/48");
        assert!((CubicKernel::Mitchell.at(0.0) - 8.0 / 9.0).abs() < 1e-15);
        assert!((CubicKernel::Mitchell.at(1.0) - 1.0 / 18.0).abs() < 1e-15);
    }
}
