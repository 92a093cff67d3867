//! How far two volumes lie apart: RMS, AMAX, PSNR, and where the worst voxel is.

use crate::error::PreprocessError;
use crate::volume::Volume;
use octree_store::{ErrorSum, ErrorTotal, Sample, with_sample_type};
use serde::Serialize;

/// What a comparison found; values in source units.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The schema's name and version.
    pub schema: &'static str,
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// Voxels compared: those that are finite in both.
    pub voxels: u64,
    /// Voxels left out: NaN or infinite in one of them.
    pub not_finite: u64,
    /// Of these, the ones that differ: not the same kind of no number in both.
    pub not_finite_different: u64,
    /// Root mean square of (b - a).
    pub rms: f64,
    /// Largest |b - a|.
    pub amax: f64,
    /// Peak signal to noise in dB, the peak being the range of a; none where they are equal.
    pub psnr_db: Option<f64>,
    /// Where |b - a| is largest, first in x, then y, then z; none where they are equal.
    pub worst_xyz: Option<[u64; 3]>,
    /// The values of a and b there.
    pub worst_values: Option<[f64; 2]>,
    /// Voxels whose values differ.
    pub different: u64,
}

/// Compares two volumes of equal size, whatever their sample types.
///
/// # Errors
/// When they differ in size, or one cannot be read.
pub fn compare(a: &Volume, b: &Volume) -> Result<Comparison, PreprocessError> {
    if a.dims_xyz() != b.dims_xyz() {
        return Err(PreprocessError::DifferentDims { a: a.dims_xyz(), b: b.dims_xyz() });
    }
    with_sample_type!(a.sample_type(), A => {
        with_sample_type!(b.sample_type(), B => compare_typed::<A, B>(a, b))
    })
}

fn compare_typed<A: Sample, B: Sample>(
    a: &Volume,
    b: &Volume,
) -> Result<Comparison, PreprocessError> {
    let dims_xyz = a.dims_xyz();
    let [width, height, depth] = dims_xyz;
    let (mut slices_a, mut slices_b) = (a.slices::<A>()?, b.slices::<B>()?);
    let mut slice_a = vec![A::default(); (width * height) as usize];
    let mut slice_b = vec![B::default(); (width * height) as usize];
    let mut total = ErrorTotal::default();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut not_finite, mut not_finite_different, mut different) = (0, 0, 0);
    let mut worst: Option<(f64, [u64; 3], [f64; 2])> = None;
    for z in 0..depth {
        slices_a.next(&mut slice_a)?;
        slices_b.next(&mut slice_b)?;
        for (y, (row_a, row_b)) in slice_a
            .chunks_exact(width as usize)
            .zip(slice_b.chunks_exact(width as usize))
            .enumerate()
        {
            let mut row = ErrorSum::default();
            for (x, (va, vb)) in row_a.iter().zip(row_b).enumerate() {
                let (va, vb) = (va.to_f64(), vb.to_f64());
                if !(va.is_finite() && vb.is_finite()) {
                    not_finite += 1;
                    not_finite_different += u64::from(va != vb && !(va.is_nan() && vb.is_nan()));
                    continue;
                }
                (low, high) = (low.min(va), high.max(va));
                let error = vb - va;
                row.voxels += 1;
                row.squares += error * error;
                row.amax = row.amax.max(error.abs());
                different += u64::from(error != 0.0);
                if error.abs() > worst.map_or(0.0, |(most, ..)| most) {
                    worst = Some((error.abs(), [x as u64, y as u64, z], [va, vb]));
                }
            }
            if row.amax > 0.0 && !PLAIN.contains(&row.amax) {
                row = scaled(row_a, row_b);
            }
            total.add(&row);
        }
    }
    let total = total.total();
    let (voxels, rms, amax) = (total.voxels, total.rms(), total.amax);
    let peak = (high - low).min(f64::MAX);
    Ok(Comparison {
        schema: "octavo.compare/1",
        dims_xyz,
        voxels,
        not_finite,
        not_finite_different,
        rms,
        amax,
        psnr_db: (rms > 0.0 && peak > 0.0).then(|| 20.0 * (peak / rms).log10()),
        worst_xyz: worst.map(|(_, xyz, _)| xyz),
        worst_values: worst.map(|(.., values)| values),
        different,
    })
}

/// Largest errors whose squares neither overflow nor vanish.
const PLAIN: std::ops::Range<f64> = 1e-130..1e150;

/// The errors of a row, whatever their size.
fn scaled<A: Sample, B: Sample>(row_a: &[A], row_b: &[B]) -> ErrorSum {
    let mut row = ErrorSum::default();
    for (va, vb) in row_a.iter().zip(row_b).filter(|(a, b)| a.is_finite() && b.is_finite()) {
        row.add(vb.to_f64() - va.to_f64());
    }
    row
}
