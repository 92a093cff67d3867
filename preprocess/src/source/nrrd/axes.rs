//! Which of an NRRD array's axes are x, y and z, and how they lie in the world.

use super::super::world::{self, World};
use super::{Header, NrrdError};
use octree_store::LengthUnit;

/// A row of samples or volumes that is not space.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Series {
    pub(super) count: u64,
    /// Whether it is time, and not channels.
    pub(super) time: bool,
    pub(super) kind: String,
}

/// An array's axes, sorted.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axes {
    pub(super) dims_xyz: [u64; 3],
    /// The header's axes that are x, y, z; a volume may have fewer.
    pub(super) space: Vec<usize>,
    /// Samples side by side, before x.
    pub(super) inner: Option<Series>,
    /// Volumes one after the other, fastest first.
    pub(super) outer: Vec<Series>,
}

/// Whether an axis of this kind lies in space, where the kind says so.
fn kind_is_space(kind: &str) -> Option<bool> {
    match kind {
        "domain" | "space" => Some(true),
        "" | "???" | "none" => None,
        _ => Some(false),
    }
}

/// Kinds whose components make colours.
pub(super) fn is_colour(kind: &str) -> bool {
    kind.ends_with("color")
}

impl Axes {
    /// Sorts a header's axes: those whose kind or direction says that they are space, else the first
    /// three. Axes of one sample that are not space do not count.
    pub(super) fn of(header: &Header) -> Result<Self, NrrdError> {
        let kind = |axis: usize| header.kinds.get(axis).map_or("", String::as_str);
        let is_space = |axis: usize| match (kind_is_space(kind(axis)), header.directions.get(axis))
        {
            (Some(false), _) | (_, Some(None)) => false,
            // Of more than three axes, one whose spacing is no number says the same in older files.
            (None, None) => {
                header.sizes.len() <= 3 || !header.spacings.get(axis).is_some_and(|s| s.is_nan())
            }
            _ => true,
        };
        let mut axes = Self { dims_xyz: [1; 3], space: Vec::new(), inner: None, outer: Vec::new() };
        for (axis, &count) in header.sizes.iter().enumerate() {
            let kind = kind(axis);
            if is_space(axis) && axes.space.len() < 3 {
                if let Some(between) = axes.outer.first() {
                    let kind = between.kind.clone();
                    return Err(NrrdError::AxisBetween { axis: axis - 1, kind });
                }
                axes.dims_xyz[axes.space.len()] = count;
                axes.space.push(axis);
                continue;
            }
            if count == 1 {
                continue;
            }
            let series = |time| Series { count, time, kind: kind.to_owned() };
            if axes.space.is_empty() {
                if axes.inner.is_some() {
                    return Err(NrrdError::AxisBetween { axis, kind: kind.to_owned() });
                }
                axes.inner = Some(series(kind == "time"));
            } else {
                axes.outer.push(series(kind_is_space(kind) != Some(false) || kind == "time"));
            }
        }
        Ok(axes)
    }
}

impl World {
    /// What an NRRD header says of these axes: directions, or else spacings, or else where
    /// axes begin and end, or else thicknesses.
    pub(super) fn of_nrrd(header: &Header, axes: &Axes) -> Self {
        let mut notes = Vec::new();
        let directions = directions(header, axes);
        let (unit, factor) = unit(header, axes).unwrap_or_else(|| {
            notes.push("it names no unit of length: mm is assumed (--unit gives another)".into());
            (LengthUnit::Mm, 1.0)
        });
        let mut spacing_xyz = [1.0; 3];
        for (size, (i, &axis)) in spacing_xyz.iter_mut().zip(axes.space.iter().enumerate()) {
            let direction = directions.map(|directions| world::length(directions[i]));
            let spacing = header.spacings.get(axis).map(|s| s.abs());
            let thickness = header.thicknesses.get(axis).map(|s| s.abs());
            let good = |size: &f64| size.is_finite() && *size > 0.0;
            let extent = extent(header, axis);
            if let Some(found) = [direction, spacing, extent].into_iter().flatten().find(good) {
                *size = found * factor;
            } else if let Some(found) = thickness.filter(good) {
                notes.push(format!(
                    "it gives no spacing along {}: the thickness of its samples is taken for it",
                    ["x", "y", "z"][i]
                ));
                *size = found * factor;
            }
        }
        let affine = directions.map(|directions| affine(header, directions));
        let scaled = |mut affine: [[f64; 4]; 4]| {
            affine[..3].iter_mut().flatten().for_each(|v| *v *= factor);
            affine
        };
        Self { spacing_xyz, unit, affine: affine.map(scaled).and_then(world::finite), notes }
    }
}

/// The distance of samples on an axis that begins and ends somewhere: at its first and last sample, or, if
/// nothing else is said, as in Teem, at the borders of their cells.
fn extent(header: &Header, axis: usize) -> Option<f64> {
    let (min, max) = header.axis_mins.get(axis).zip(header.axis_maxs.get(axis))?;
    let nodes = header.centers.get(axis).is_some_and(|center| center == "node");
    let steps = header.sizes[axis] - u64::from(nodes);
    Some((max - min).abs() / steps as f64)
}

/// The space's axes that point the other way than right, anterior, superior. Spaces that are no
/// patient's stay as they are.
fn flipped(space: Option<&str>) -> [bool; 3] {
    match space.map(|space| space.trim_end_matches("-time")) {
        Some("left-posterior-superior" | "lps" | "lpst") => [true, true, false],
        Some("left-anterior-superior" | "las" | "last") => [true, false, false],
        _ => [false; 3],
    }
}

/// The voxel axes in the world; what is missing of a slice or a row is made up at right angles.
fn directions(header: &Header, axes: &Axes) -> Option<[[f64; 3]; 3]> {
    let mut found = Vec::new();
    for &axis in &axes.space {
        let vector = header.directions.get(axis)?.as_ref()?;
        // A fourth component is time.
        let component = |i: usize| vector.get(i).copied().unwrap_or(0.0);
        (2..=4).contains(&vector.len()).then_some(())?;
        found.push([component(0), component(1), component(2)]);
    }
    match found[..] {
        [x, y, z] => Some([x, y, z]),
        [x, y] => {
            let normal = world::cross(x, y);
            let length = world::length(normal);
            let normal = if length > 0.0 { normal.map(|v| v / length) } else { [0.0, 0.0, 1.0] };
            Some([x, y, normal])
        }
        _ => None,
    }
}

fn affine(header: &Header, directions: [[f64; 3]; 3]) -> [[f64; 4]; 4] {
    let origin = |i: usize| header.origin.as_ref().and_then(|o| o.get(i)).copied().unwrap_or(0.0);
    let affine = world::affine(directions, [origin(0), origin(1), origin(2)]);
    world::mirrored(affine, flipped(header.space.as_deref()))
}

/// The unit of length, where all axes name one and the same.
fn unit(header: &Header, axes: &Axes) -> Option<(LengthUnit, f64)> {
    let space_units = header.space_units.iter().take(3).map(String::as_str);
    let axis_units =
        axes.space.iter().map(|&axis| header.units.get(axis).map_or("", String::as_str));
    let names: Vec<&str> =
        if header.space_units.is_empty() { axis_units.collect() } else { space_units.collect() };
    let unit = world::length_unit(names.first()?)?;
    names.iter().all(|name| world::length_unit(name) == Some(unit)).then_some(unit)
}
