//! NRRD volumes: `.nrrd`, header and voxels in one, and `.nhdr`, whose voxels are in files of their own.
//!
//! The format is Teem's: <https://teem.sourceforge.net/nrrd/format.html>. Affines go from the header's
//! space to right-anterior-superior; spaces that are no patient's are kept as they are.

mod axes;
mod error;
mod header;
#[cfg(test)]
mod tests;

pub use error::NrrdError;

use super::data_files::{self, ArrayShape, DataFiles, DataStart};
use super::numbered::NumberedName;
use super::world::World;
use super::{Source, SourceError, SourceOptions, StreamCoding};
use axes::{Axes, Series};
use header::{Data, Encoding, Header, LONGEST_HEADER};
use std::path::{Path, PathBuf};

/// Whether a file's name ends as NRRD's do.
pub(super) fn is_name(path: &Path) -> bool {
    path.extension()
        .is_some_and(|end| end.eq_ignore_ascii_case("nrrd") || end.eq_ignore_ascii_case("nhdr"))
}

/// Whether these are an NRRD file's first bytes.
pub(super) fn is_magic(bytes: &[u8]) -> bool {
    header::is_magic(bytes)
}

/// Opens an NRRD volume; of a series, the volume that the options choose.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let wrong = |source| SourceError::Nrrd { path: path.to_owned(), source };
    let header = Header::parse(&data_files::read_start(path, LONGEST_HEADER)?).map_err(wrong)?;
    let axes = Axes::of(&header).map_err(wrong)?;
    let (shape, choice) = choose(path, &header, &axes, options)?;
    let mut world = World::of_nrrd(&header, &axes);
    world.notes.extend(choice);
    data_files(path, &header)?.open(&shape, world)
}

/// The one volume that is asked for.
fn choose(
    path: &Path,
    header: &Header,
    axes: &Axes,
    options: &SourceOptions,
) -> Result<(ArrayShape, Option<String>), SourceError> {
    let series = || axes.inner.iter().chain(&axes.outer);
    let of = |time: bool| {
        let mut found = series().filter(|series| series.time == time);
        match (found.next(), found.next()) {
            (found, None) => Ok(found.map_or(1, |series| series.count)),
            _ => Err(SourceError::TooManyDimensions {
                path: path.to_owned(),
                dims: header.sizes.clone(),
            }),
        }
    };
    let counts @ [times, channels] = [of(true)?, of(false)?];
    if let Some(Series { kind, .. }) = series().find(|series| axes::is_colour(&series.kind))
        && options.channel.is_none()
    {
        let source = NrrdError::Colour { kind: kind.clone() };
        return Err(SourceError::Nrrd { path: path.to_owned(), source });
    }
    let time = data_files::chosen(path, times, options.time)?;
    let channel = data_files::chosen(path, channels, options.channel)?;
    let index = |series: &Series| if series.time { time } else { channel };
    let mut volumes = 1_u64;
    let mut volume = 0;
    for series in &axes.outer {
        volume += index(series) * volumes;
        volumes = volumes.saturating_mul(series.count);
    }
    let shape = ArrayShape {
        stored: header.stored,
        dims_xyz: axes.dims_xyz,
        components: axes.inner.as_ref().map_or(1, |series| series.count),
        component: axes.inner.as_ref().map_or(0, index),
        volumes,
        volume,
    };
    Ok((shape, data_files::choice_note(counts, [time, channel])))
}

/// The files that hold the voxels.
fn data_files(path: &Path, header: &Header) -> Result<DataFiles, SourceError> {
    let beside = |name: &str| data_files::beside(path, name);
    let (paths, attached_at) = match &header.data {
        Data::Attached { at } => (vec![path.to_owned()], Some(*at)),
        Data::File(name) => (vec![beside(name)?], None),
        Data::List { names, subdim } => {
            check_count(path, header, names.len() as u64, *subdim)?;
            (names.iter().map(|name| beside(name)).collect::<Result<_, _>>()?, None)
        }
        Data::Numbered { pattern, first, last, step, subdim } => {
            let paths = numbered(path, header, pattern, [*first, *last, *step], *subdim)?;
            (paths, None)
        }
    };
    let start = match header.byte_skip {
        Some(bytes) => DataStart::After { lines: header.line_skip, bytes },
        None => DataStart::AtEnd,
    };
    let coding = match header.encoding {
        Encoding::Raw => None,
        Encoding::Text => Some(StreamCoding::Ascii(header.stored)),
        Encoding::Gzip => Some(StreamCoding::Gzip),
        Encoding::Bzip2 => Some(StreamCoding::Bzip2),
    };
    let big_endian = header.big_endian;
    Ok(DataFiles { header: path.to_owned(), attached_at, paths, coding, start, big_endian })
}

/// Files numbered from the first to the last in steps; each must be there.
fn numbered(
    path: &Path,
    header: &Header,
    pattern: &str,
    [first, last, step]: [i64; 3],
    subdim: Option<usize>,
) -> Result<Vec<PathBuf>, SourceError> {
    let wrong = |expected| SourceError::Nrrd {
        path: path.to_owned(),
        source: NrrdError::Field {
            field: "data file",
            expected,
            found: header::shown(&format!("{pattern} {first} {last} {step}")),
        },
    };
    let name =
        NumberedName::parse(pattern).ok_or_else(|| wrong("a name with one number such as %03d"))?;
    let sensible = || wrong("numbers of a sensible size");
    let span = last.checked_sub(first).ok_or_else(sensible)?;
    if step == 0 || (span != 0 && (span < 0) != (step < 0)) {
        return Err(wrong("numbers from first to last in steps that lead there"));
    }
    let steps = span.checked_div(step).ok_or_else(sensible)?;
    check_count(path, header, steps as u64 + 1, subdim)?;
    (0..=steps).map(|i| data_files::beside(path, &name.name(first + i * step))).collect()
}

/// Checks that so many files can hold the array: each all positions along the axes up to `subdim`, or
/// some along the last of these where it is the array's last.
fn check_count(
    path: &Path,
    header: &Header,
    count: u64,
    subdim: Option<usize>,
) -> Result<(), SourceError> {
    let dimension = header.sizes.len();
    let subdim = subdim.unwrap_or(dimension.saturating_sub(1));
    let fits = if subdim < dimension {
        let positions = header.sizes[subdim..].iter().try_fold(1_u64, |all, &n| all.checked_mul(n));
        positions == Some(count)
    } else {
        subdim == dimension && count > 0 && header.sizes[dimension - 1].is_multiple_of(count)
    };
    if fits {
        Ok(())
    } else {
        Err(SourceError::DataFileCount { path: path.to_owned(), found: count })
    }
}
