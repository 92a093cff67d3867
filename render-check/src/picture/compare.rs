//! How much two pictures differ, as display values from 0 to 1: PSNR, SSIM, the largest and the mean difference, and
//! the mean distance of colours as eyes see them.

use super::Shown;
use crate::error::RenderError;
use serde::Serialize;

/// The outcome of a comparison.
#[must_use]
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Comparison {
    /// Peak signal-to-noise ratio in dB, the peak being 1; none where the pictures are the same.
    pub psnr_db: Option<f64>,
    /// Structural similarity of luma, 1 where the pictures are the same (Wang et al. 2004; windows of 7 x 7).
    pub ssim: f64,
    /// The largest difference of a colour's component.
    pub max_abs_diff: f64,
    /// The mean difference of colours' components.
    pub mean_abs_diff: f64,
    /// The mean distance in the CIE's Lab space of 1976; 2.3 is just noticeable.
    pub mean_delta_e: f64,
}

impl Comparison {
    /// Whether the PSNR is at least so many dB.
    pub fn reaches(&self, psnr_db: f64) -> bool {
        self.psnr_db.is_none_or(|found| found >= psnr_db)
    }
}

/// Compares two pictures.
///
/// # Errors
/// When they differ in size.
pub fn compare(a: &Shown, b: &Shown) -> Result<Comparison, RenderError> {
    if a.size != b.size {
        return Err(RenderError::Sizes { a: a.size, b: b.size });
    }
    let (mut squares, mut sum, mut largest, mut apart) = (0.0, 0.0, 0.0_f64, 0.0);
    for (p, q) in a.pixels.iter().zip(&b.pixels) {
        for c in 0..3 {
            let d = apart_by(p[c], q[c]);
            squares += d * d;
            sum += d.abs();
            largest = largest.max(d.abs());
        }
        let (p, q) = (lab(p.map(shown_as)), lab(q.map(shown_as)));
        apart += (0..3).map(|c| (p[c] - q[c]).powi(2)).sum::<f64>().sqrt();
    }
    let pixels = a.pixels.len() as f64;
    let mse = squares / (3.0 * pixels);
    Ok(Comparison {
        psnr_db: (mse > 0.0).then(|| -10.0 * mse.log10()),
        ssim: ssim(a, b),
        max_abs_diff: largest,
        mean_abs_diff: sum / (3.0 * pixels),
        mean_delta_e: apart / pixels,
    })
}

/// How far two components lie apart; what is no number could not lie farther from anything.
fn apart_by(a: f32, b: f32) -> f64 {
    let d = f64::from(a) - f64::from(b);
    if d.is_finite() { d } else { 1.0 }
}

/// A component as a display has it: what is no number is black.
fn shown_as(component: f32) -> f32 {
    if component.is_finite() { component } else { 0.0 }
}

/// The differences, `gain` times as large.
///
/// # Errors
/// When the pictures differ in size.
pub fn difference(a: &Shown, b: &Shown, gain: f32) -> Result<Shown, RenderError> {
    if a.size != b.size {
        return Err(RenderError::Sizes { a: a.size, b: b.size });
    }
    let apart = |(p, q): (&[f32; 3], &[f32; 3])| {
        [0, 1, 2].map(|c| (apart_by(p[c], q[c]).abs() as f32 * gain).min(1.0))
    };
    Ok(Shown { size: a.size, pixels: a.pixels.iter().zip(&b.pixels).map(apart).collect() })
}

/// Display values (sRGB) in Lab with white point D65.
fn lab(color: [f32; 3]) -> [f64; 3] {
    let [r, g, b] = color.map(|c| {
        let c = f64::from(c);
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    });
    let x = (0.412_456 * r + 0.357_576 * g + 0.180_437 * b) / 0.950_47;
    let y = 0.212_673 * r + 0.715_152 * g + 0.072_175 * b;
    let z = (0.019_334 * r + 0.119_192 * g + 0.950_304 * b) / 1.088_83;
    let [x, y, z] = [x, y, z].map(|t: f64| {
        if t > 216.0 / 24389.0 { t.cbrt() } else { (24389.0 / 27.0 * t + 16.0) / 116.0 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The mean of SSIM over all windows that lie in the picture; of smaller pictures, of one window.
fn ssim(a: &Shown, b: &Shown) -> f64 {
    const SIDE: usize = 7;
    const C1: f64 = 0.01 * 0.01;
    const C2: f64 = 0.03 * 0.03;
    let luma = |shown: &Shown| -> Vec<f64> {
        let weigh = |p: &[f32; 3]| {
            let [r, g, b] = p.map(|c| f64::from(shown_as(c)));
            0.299 * r + 0.587 * g + 0.114 * b
        };
        shown.pixels.iter().map(weigh).collect()
    };
    let (p, q) = (luma(a), luma(b));
    let [width, height] = a.size.map(|n| n as usize);
    let (across, down) = (SIDE.min(width), SIDE.min(height));
    let count = (across * down) as f64;
    let mut sum = 0.0;
    for y in 0..=height - down {
        for x in 0..=width - across {
            let [mut sp, mut sq, mut spp, mut sqq, mut spq] = [0.0; 5];
            for j in y..y + down {
                for i in j * width + x..j * width + x + across {
                    let (u, v) = (p[i], q[i]);
                    sp += u;
                    sq += v;
                    spp += u * u;
                    sqq += v * v;
                    spq += u * v;
                }
            }
            let (mp, mq) = (sp / count, sq / count);
            let (vp, vq) = (spp / count - mp * mp, sqq / count - mq * mq);
            let both = spq / count - mp * mq;
            sum += (2.0 * mp * mq + C1) * (2.0 * both + C2)
                / ((mp * mp + mq * mq + C1) * (vp + vq + C2));
        }
    }
    sum / ((height - down + 1) * (width - across + 1)) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(f: impl Fn(u32, u32) -> [f32; 3]) -> Shown {
        let pixels = (0..16).flat_map(|y| (0..20).map(move |x| (x, y))).map(|(x, y)| f(x, y));
        Shown { size: [20, 16], pixels: pixels.collect() }
    }

    #[test]
    fn the_same_picture_differs_by_nothing() {
        let a = shown(|x, y| [x as f32 / 20.0, y as f32 / 16.0, 0.5]);
        let found = compare(&a, &a).unwrap();
        assert_eq!((found.psnr_db, found.max_abs_diff, found.mean_delta_e), (None, 0.0, 0.0));
        assert!((found.ssim - 1.0).abs() < 1e-12);
        assert!(found.reaches(1e9));
    }

    #[test]
    fn a_tenth_everywhere_is_20_db() {
        let a = shown(|x, _| [x as f32 / 40.0; 3]);
        let b = shown(|x, _| [x as f32 / 40.0 + 0.1; 3]);
        let found = compare(&a, &b).unwrap();
        assert!((found.psnr_db.unwrap() - 20.0).abs() < 1e-4, "{found:?}");
        assert!((found.mean_abs_diff - 0.1).abs() < 1e-6);
        assert!(found.ssim < 0.999 && found.ssim > 0.5);
        assert!(!found.reaches(20.1) && found.reaches(19.9));
    }

    #[test]
    fn what_is_no_number_is_as_far_from_all_as_can_be() {
        let a = shown(|_, _| [0.5; 3]);
        let b = shown(|x, _| if x == 3 { [f32::NAN, 0.5, 0.5] } else { [0.5; 3] });
        for (a, b) in [(&a, &b), (&b, &a), (&b, &b)] {
            let found = compare(a, b).unwrap();
            assert!(!found.reaches(20.0), "{found:?}");
            assert_eq!(found.max_abs_diff, 1.0);
            assert!(found.ssim.is_finite() && found.mean_delta_e.is_finite(), "{found:?}");
            assert_eq!(difference(a, b, 1.0).unwrap().pixels[3], [1.0, 0.0, 0.0]);
        }
    }

    #[test]
    fn black_and_white_are_100_apart_to_the_eye() {
        let [black, white] = [0.0, 1.0].map(|v| shown(|_, _| [v; 3]));
        assert!((compare(&black, &white).unwrap().mean_delta_e - 100.0).abs() < 0.01);
    }

    #[test]
    fn pictures_of_two_sizes_are_not_compared() {
        let a = shown(|_, _| [0.0; 3]);
        let b = Shown { size: [16, 20], ..a.clone() };
        assert!(compare(&a, &b).is_err() && difference(&a, &b, 1.0).is_err());
    }
}
