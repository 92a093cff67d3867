//! MetaImage volumes: `.mha`, header and voxels in one, and `.mhd`, whose voxels are in files of their
//! own.
//!
//! The format is MetaIO's, ITK's own: <https://itk.org/Wiki/MetaIO/Documentation>. Its world is
//! left-posterior-superior, as ITK's; affines here are right-anterior-superior.

mod error;
mod header;
#[cfg(test)]
mod tests;

pub use error::MetaImageError;

use super::data_files::{self, ArrayShape, DataFiles, DataStart};
use super::numbered::NumberedName;
use super::world::{self, World};
use super::{Source, SourceError, SourceOptions, StreamCoding};
use header::{Data, Header, LONGEST_HEADER};
use octree_store::{LengthUnit, SampleType};
use std::array::from_fn;
use std::path::{Path, PathBuf};

/// Whether a file's name ends as MetaImage's do.
pub(super) fn is_name(path: &Path) -> bool {
    path.extension()
        .is_some_and(|end| end.eq_ignore_ascii_case("mha") || end.eq_ignore_ascii_case("mhd"))
}

/// Whether these are a MetaImage file's first bytes.
pub(super) fn is_magic(bytes: &[u8]) -> bool {
    header::is_magic(bytes)
}

/// Opens a MetaImage volume; of a series, the volume that the options choose.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let wrong = |source| SourceError::MetaImage { path: path.to_owned(), source };
    let header = Header::parse(&data_files::read_start(path, LONGEST_HEADER)?).map_err(wrong)?;
    let dim = |axis: usize| header.dims.get(axis).copied().unwrap_or(1);
    if header.dims.iter().skip(4).any(|&dim| dim > 1) {
        let (path, dims) = (path.to_owned(), header.dims.clone());
        return Err(SourceError::TooManyDimensions { path, dims });
    }
    let channels = header.channels;
    let bytes = matches!(header.stored, SampleType::U8 | SampleType::I8);
    if bytes && matches!(channels, 3 | 4) && options.channel.is_none() {
        return Err(wrong(MetaImageError::Colour { channels }));
    }
    let time = data_files::chosen(path, dim(3), options.time)?;
    let channel = data_files::chosen(path, channels, options.channel)?;
    let shape = ArrayShape {
        stored: header.stored,
        dims_xyz: [dim(0), dim(1), dim(2)],
        components: channels,
        component: channel,
        volumes: dim(3),
        volume: time,
    };
    let mut world = world_of(&header);
    world.notes.extend(data_files::choice_note([dim(3), channels], [time, channel]));
    data_files(path, &header)?.open(&shape, world)
}

/// What a header says of the world. ITK's unit is the millimetre; a header may name another.
fn world_of(header: &Header) -> World {
    let mut notes = Vec::new();
    let (unit, factor) = match header.unit.as_deref().filter(|unit| *unit != "?") {
        None => (LengthUnit::Mm, 1.0),
        Some(name) => world::length_unit(name).unwrap_or_else(|| {
            notes.push(format!(
                "its unit of length '{}' is not known: mm is assumed (--unit gives another)",
                header::shown(name)
            ));
            (LengthUnit::Mm, 1.0)
        }),
    };
    let spacing_xyz: [f64; 3] = from_fn(|axis| {
        let size = header.spacing.get(axis).map_or(1.0, |size| size.abs());
        if size.is_finite() && size > 0.0 { size * factor } else { factor }
    });
    World { spacing_xyz, unit, affine: affine(header, spacing_xyz, factor), notes }
}

/// Voxel to world, right-anterior-superior, where the header says anything of it.
fn affine(header: &Header, spacing_xyz: [f64; 3], factor: f64) -> Option<[[f64; 4]; 4]> {
    if header.origin.is_empty() && header.directions.is_empty() {
        return None;
    }
    let dimensions = header.dims.len();
    let axes = from_fn(|axis| {
        from_fn(|component| {
            let unit = if axis == component { 1.0 } else { 0.0 };
            let inside = axis < dimensions && component < dimensions;
            let direction = header.directions.get(axis * dimensions + component);
            direction.filter(|_| inside).unwrap_or(&unit) * spacing_xyz[axis]
        })
    });
    let origin = from_fn(|axis| header.origin.get(axis).map_or(0.0, |v| v * factor));
    world::finite(world::ras_from_lps(world::affine(axes, origin)))
}

/// The files that hold the voxels.
fn data_files(path: &Path, header: &Header) -> Result<DataFiles, SourceError> {
    let beside = |name: &str| data_files::beside(path, name);
    let (paths, attached_at) = match &header.data {
        Data::Local { at } => (vec![path.to_owned()], Some(*at)),
        Data::File(name) => (vec![beside(name)?], None),
        Data::List { names, file_dims } => {
            let mut counts = header.dims[*file_dims..].iter();
            let expected = counts.try_fold(1_u64, |all, &n| all.checked_mul(n));
            let found = names.len() as u64;
            if expected != Some(found) {
                return Err(SourceError::DataFileCount { path: path.to_owned(), found });
            }
            (names.iter().map(|name| beside(name)).collect::<Result<_, _>>()?, None)
        }
        Data::Numbered { pattern, first, last, step } => {
            (numbered(path, header, pattern, [*first, *step], *last)?, None)
        }
    };
    let start = match header.skip_bytes {
        Some(bytes) => DataStart::After { lines: 0, bytes },
        None => DataStart::AtEnd,
    };
    let coding = match (header.binary, header.compressed) {
        (true, false) => None,
        (true, true) => Some(StreamCoding::Zlib),
        (false, _) => Some(StreamCoding::Ascii(header.stored)),
    };
    let big_endian = header.big_endian;
    Ok(DataFiles { header: path.to_owned(), attached_at, paths, coding, start, big_endian })
}

/// One file for each position along the last axis.
fn numbered(
    path: &Path,
    header: &Header,
    pattern: &str,
    [first, step]: [i64; 2],
    last: Option<i64>,
) -> Result<Vec<PathBuf>, SourceError> {
    let wrong = |expected| SourceError::MetaImage {
        path: path.to_owned(),
        source: MetaImageError::Value {
            key: "ElementDataFile",
            expected,
            found: header::shown(pattern),
        },
    };
    let name =
        NumberedName::parse(pattern).ok_or_else(|| wrong("a name with one number such as %03d"))?;
    let count = header.dims.last().copied().unwrap_or(1);
    let sensible = || wrong("numbers of a sensible size");
    let steps = i64::try_from(count).map_err(|_| sensible())? - 1;
    let end = steps.checked_mul(step).and_then(|span| first.checked_add(span));
    let end = end.ok_or_else(sensible)?;
    if step == 0 || last.is_some_and(|last| last.abs_diff(end) >= step.unsigned_abs()) {
        return Err(wrong("as many numbered files as the last axis has positions"));
    }
    (0..=steps).map(|i| data_files::beside(path, &name.name(first + i * step))).collect()
}
