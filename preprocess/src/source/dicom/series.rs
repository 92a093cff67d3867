//! Slices put in order: by their places along the normal of their planes, or by their numbers.
//!
//! After DICOM PS3.3, C.7.6.2 (image plane): x goes along a row, y along a column; slices may come in any
//! order of files.

use super::super::world::{self, cross, length};
use super::DicomError;
use super::image::{Frame, Image};
use std::path::PathBuf;

/// Slices in their order, and how they lie in the world.
#[derive(Debug)]
pub(super) struct Arranged {
    /// Image and frame of each slice.
    pub(super) order: Vec<(usize, usize)>,
    pub(super) spacing_xyz: [f64; 3],
    /// Right-anterior-superior, in mm.
    pub(super) affine: Option<[[f64; 4]; 4]>,
    pub(super) notes: Vec<String>,
}

/// What is wrong, and in which file.
pub(super) type Refusal = (PathBuf, DicomError);

/// Distances that differ by no more than this part are even.
const EVEN: f64 = 0.01;

/// A slice, and where it is along the way from the first to the last.
#[derive(Debug, Clone, Copy)]
struct Placed<'a> {
    image: &'a Image,
    frame: &'a Frame,
    index: (usize, usize),
    at: f64,
}

/// Orders the frames of images of one size; all of one series.
pub(super) fn arrange(images: &[Image], allow_gaps: bool) -> Result<Arranged, Refusal> {
    let mut notes = Vec::new();
    let mut slices = Vec::new();
    for (i, image) in images.iter().enumerate() {
        for (j, frame) in image.frames.iter().enumerate() {
            slices.push(Placed { image, frame, index: (i, j), at: 0.0 });
        }
    }
    let Some(&first) = slices.first() else {
        return Err((PathBuf::new(), DicomError::NoImages));
    };
    for slice in &slices {
        same_plane(first, *slice)?;
    }
    let normal = first.frame.orientation.map(|[x, y]| cross(x, y));
    let positioned = |slice: &Placed<'_>| slice.frame.position.is_some();
    let by_position = normal.filter(|_| slices.iter().all(positioned));
    if by_position.is_none()
        && images.len() > 1
        && slices.iter().any(|slice| positioned(slice) && slice.index.1 == 0)
        && let Some(without) = slices.iter().find(|slice| !positioned(slice) && slice.index.1 == 0)
    {
        let what = "ImagePositionPatient";
        return Err((without.image.path.clone(), DicomError::Unplaced { what }));
    }
    let mut distance = first.frame.distance;
    if let Some(normal) = by_position {
        for slice in &mut slices {
            let [x, y, z] = slice.frame.position.unwrap_or_default();
            slice.at = x * normal[0] + y * normal[1] + z * normal[2];
        }
        slices.sort_by(|a, b| a.at.total_cmp(&b.at).then(a.index.cmp(&b.index)));
        let even = evenly(&slices, "mm", allow_gaps, &mut notes)?;
        distance = even.or(distance);
    } else {
        number(&mut slices, images, allow_gaps, &mut notes)?;
    }
    let spacing_xy = first.frame.spacing_xy.unwrap_or_else(|| {
        notes.push("it names no size of pixels: 1 mm is assumed (--spacing gives another)".into());
        [1.0; 2]
    });
    let last = slices[slices.len() - 1];
    let first = slices[0];
    let [size_x, size_y] = spacing_xy;
    let (step, size_z) = match (by_position, first.frame.position, last.frame.position) {
        (Some(_), Some(from), Some(to)) if slices.len() > 1 && from != to => {
            let count = (slices.len() - 1) as f64;
            let step = [0, 1, 2].map(|i| (to[i] - from[i]) / count);
            drift(&slices, step, size_x.min(size_y), allow_gaps)?;
            (Some(step), length(step))
        }
        _ => {
            let size = distance.unwrap_or_else(|| {
                if slices.len() > 1 {
                    notes.push(
                        "it names no distance of slices: 1 mm is assumed (--spacing gives another)"
                            .into(),
                    );
                }
                1.0
            });
            (normal.map(|normal| normal.map(|v| v * size)), size)
        }
    };
    let affine = match (first.frame.orientation, step, first.frame.position) {
        (Some([x, y]), Some(step), Some(origin)) => {
            let axes = [x.map(|v| v * size_x), y.map(|v| v * size_y), step];
            world::finite(world::ras_from_lps(world::affine(axes, origin)))
        }
        _ => None,
    };
    Ok(Arranged {
        order: slices.iter().map(|slice| slice.index).collect(),
        spacing_xyz: [size_x, size_y, size_z],
        affine,
        notes,
    })
}

/// Slices without places of their own: files by their numbers, frames as they come.
fn number(
    slices: &mut [Placed<'_>],
    images: &[Image],
    allow_gaps: bool,
    notes: &mut Vec<String>,
) -> Result<(), Refusal> {
    if images.len() == 1 {
        if slices.len() > 1 {
            notes.push(
                "its frames have no places of their own: they are taken in their order".into(),
            );
        }
        return Ok(());
    }
    for slice in slices.iter_mut() {
        let what = "ImagePositionPatient, nor an InstanceNumber";
        let refusal = || (slice.image.path.clone(), DicomError::Unplaced { what });
        slice.at = slice.image.instance.ok_or_else(refusal)?;
    }
    slices.sort_by(|a, b| a.at.total_cmp(&b.at).then(a.index.cmp(&b.index)));
    let firsts: Vec<_> = slices.iter().copied().filter(|slice| slice.index.1 == 0).collect();
    evenly(&firsts, "in InstanceNumber", allow_gaps, notes)?;
    notes.push("its slices do not say where they are: they are ordered by InstanceNumber".into());
    Ok(())
}

/// The distance that neighbours have, where all have the same.
fn evenly(
    slices: &[Placed<'_>],
    unit: &str,
    allow_gaps: bool,
    notes: &mut Vec<String>,
) -> Result<Option<f64>, Refusal> {
    let mut distances: Vec<f64> = slices.windows(2).map(|pair| pair[1].at - pair[0].at).collect();
    distances.sort_by(f64::total_cmp);
    let Some(&usual) = distances.get(distances.len() / 2) else { return Ok(None) };
    let path = |slice: &Placed<'_>| slice.image.path.clone();
    for pair in slices.windows(2) {
        let found = pair[1].at - pair[0].at;
        let same = found <= 0.0 || found <= usual * EVEN;
        if !same && (found - usual).abs() <= usual * EVEN {
            continue;
        }
        if allow_gaps {
            notes.push(format!(
                "its slices are not evenly spaced (near {}): they are taken as if they were",
                pair[1].image.path.display()
            ));
            return Ok(None);
        }
        let refusal = if same {
            DicomError::SamePlace {
                other: path(&pair[0]),
                place: format!("{:.4} {unit}", pair[1].at),
            }
        } else {
            DicomError::Gap {
                before: path(&pair[0]),
                expected: format!("{usual:.4} {unit}"),
                found: format!("{found:.4} {unit}"),
            }
        };
        return Err((path(&pair[1]), refusal));
    }
    Ok(Some(usual))
}

/// Checks that slices lie on one straight line, within a tenth of a pixel and a hundredth of a step.
fn drift(
    slices: &[Placed<'_>],
    step: [f64; 3],
    pixel: f64,
    allow_gaps: bool,
) -> Result<(), Refusal> {
    let limit = 0.1 * pixel + EVEN * length(step);
    let mut before = &slices[0];
    let [x, y, z] = before.frame.position.unwrap_or_default();
    for (k, slice) in slices.iter().enumerate() {
        let [a, b, c] = slice.frame.position.unwrap_or_default();
        let k = k as f64;
        let off = length([a - x - k * step[0], b - y - k * step[1], c - z - k * step[2]]);
        if off > limit && !allow_gaps {
            let refusal = DicomError::Gap {
                before: before.image.path.clone(),
                expected: "on one line with the first and the last".to_owned(),
                found: format!("{off:.4} mm off it"),
            };
            return Err((slice.image.path.clone(), refusal));
        }
        before = slice;
    }
    Ok(())
}

/// Checks that a slice is as large as the first, and lies in a parallel plane.
fn same_plane(first: Placed<'_>, slice: Placed<'_>) -> Result<(), Refusal> {
    let differs = |what, expected, found| {
        let first = first.image.path.clone();
        Err((slice.image.path.clone(), DicomError::Differs { what, first, expected, found }))
    };
    let size = |slice: Placed<'_>| (slice.image.format.columns, slice.image.format.rows);
    if size(first) != size(slice) {
        let shown = |(columns, rows)| format!("{columns} x {rows}");
        return differs("size in pixels", shown(size(first)), shown(size(slice)));
    }
    let near = |a: Option<&[f64]>, b: Option<&[f64]>, part: f64| match (a, b) {
        (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() <= part),
        (a, b) => a.is_none() && b.is_none(),
    };
    let [a, b] = [first, slice].map(|slice| slice.frame.orientation);
    if !near(a.as_ref().map(|a| a.as_flattened()), b.as_ref().map(|b| b.as_flattened()), 1e-3) {
        return differs("orientation", orientation_shown(a), orientation_shown(b));
    }
    let [a, b] = [first, slice].map(|slice| slice.frame.spacing_xy);
    let part = a.map_or(0.0, |a| 1e-3 * a[0]);
    if !near(a.as_ref().map(|a| &a[..]), b.as_ref().map(|b| &b[..]), part) {
        let shown = |size: Option<[f64; 2]>| {
            size.map_or("not said".to_owned(), |size| format!("{} mm", numbers_shown(&size, " x ")))
        };
        return differs("size of pixels", shown(a), shown(b));
    }
    Ok(())
}

/// An orientation in words: the plane by its name, and the directions along rows and columns.
fn orientation_shown(orientation: Option<[[f64; 3]; 2]>) -> String {
    let Some([x, y]) = orientation else { return "not said".to_owned() };
    let normal = cross(x, y).map(f64::abs);
    let along = |axis: usize| normal[axis] > 0.99 * length(normal);
    let plane = match [along(0), along(1), along(2)] {
        [true, ..] => "sagittal",
        [_, true, _] => "coronal",
        [.., true] => "axial",
        _ => "oblique",
    };
    let [x, y] = [x, y].map(|direction| numbers_shown(&direction, ", "));
    format!("{plane} (rows along {x}; columns along {y})")
}

/// Numbers to four places.
fn numbers_shown(numbers: &[f64], between: &str) -> String {
    // Zero is added so that none is shown as -0.
    let shown = numbers.iter().map(|v| ((v * 1e4).round() / 1e4 + 0.0).to_string());
    shown.collect::<Vec<_>>().join(between)
}
