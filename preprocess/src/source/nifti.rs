//! NIfTI-1, NIfTI-2 and Analyze volumes: `.nii`, `.hdr` + `.img`, each plain or gzip-compressed.

use super::map::map_file;
use super::nifti_header::{NiftiDatatype, NiftiHeader, NiftiKind, NiftiUnit};
use super::{Found, Place, Source, SourceError, SourceOptions};
use super::{StoredFormat, StreamCoding, StreamPlace};
use octree_store::{LengthUnit, SampleType};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// As much of a file as a header can take: NIfTI-2's 540 bytes and the extension flag.
const HEADER_BYTES: u64 = 544;

/// Whether a file's name ends as NIfTI's and Analyze's do.
pub(super) fn is_name(path: &Path) -> bool {
    matches!(ending(path).0, ".nii" | ".hdr" | ".img")
}

/// The ending without `.gz`, and whether `.gz` follows it.
fn ending(path: &Path) -> (&'static str, bool) {
    let name =
        path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
    let (name, gzip) = name.strip_suffix(".gz").map_or((name.as_str(), false), |name| (name, true));
    let known = [".nii", ".hdr", ".img"].into_iter().find(|end| name.ends_with(end));
    (known.unwrap_or(""), gzip)
}

/// Opens a NIfTI or Analyze volume; of a series, the volume that the options choose.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let (header_path, image_path) = halves(path)?;
    let header = read_header(&header_path)?;
    let single = header.kind == NiftiKind::SingleFile;
    if !single && header_path == image_path {
        return Err(SourceError::HeaderOnly { path: header_path });
    }
    if single && header_path != image_path {
        // An .hdr that says n+1 carries its voxels itself.
        return open_with(&header_path, &header_path, &header, options);
    }
    open_with(&header_path, &image_path, &header, options)
}

/// The header's file and the image's: one for .nii, two for a pair, whichever of them was given.
fn halves(path: &Path) -> Result<(PathBuf, PathBuf), SourceError> {
    let (end, gzip) = ending(path);
    if end == ".nii" {
        return Ok((path.to_owned(), path.to_owned()));
    }
    let name = path.to_string_lossy();
    let stem = &name[..name.len() - end.len() - if gzip { 3 } else { 0 }];
    let upper = name[stem.len()..].starts_with(&end.to_uppercase());
    let other = if end == ".hdr" { ".img" } else { ".hdr" };
    let other = if upper { other.to_uppercase() } else { other.to_owned() };
    let candidates = [format!("{stem}{other}"), format!("{stem}{other}.gz")].map(PathBuf::from);
    let partner = candidates.iter().find(|candidate| candidate.is_file()).cloned();
    match partner {
        Some(partner) if end == ".hdr" => Ok((path.to_owned(), partner)),
        Some(partner) => Ok((partner, path.to_owned())),
        // A header may turn out to be a single file.
        None if end == ".hdr" => {
            let header = read_header(path)?;
            if header.kind == NiftiKind::SingleFile {
                Ok((path.to_owned(), path.to_owned()))
            } else {
                let [partner, _] = candidates;
                Err(SourceError::PartnerMissing { path: path.to_owned(), partner })
            }
        }
        None => {
            let [partner, _] = candidates;
            Err(SourceError::PartnerMissing { path: path.to_owned(), partner })
        }
    }
}

fn read_header(path: &Path) -> Result<NiftiHeader, SourceError> {
    let mut bytes = Vec::new();
    if ending(path).1 {
        let stream = gzip(path).open()?;
        stream.reader.take(HEADER_BYTES).read_to_end(&mut bytes).map_err(|error| {
            SourceError::Decompression { path: path.to_owned(), what: error.to_string() }
        })?;
    } else {
        let file = open_file(path)?;
        file.take(HEADER_BYTES)
            .read_to_end(&mut bytes)
            .map_err(|source| SourceError::Io { path: path.to_owned(), source })?;
    }
    NiftiHeader::parse(&bytes)
        .map_err(|source| SourceError::NiftiHeader { path: path.to_owned(), source })
}

fn open_with(
    header_path: &Path,
    image_path: &Path,
    header: &NiftiHeader,
    options: &SourceOptions,
) -> Result<Source, SourceError> {
    let mut notes = Vec::new();
    let dim = |axis: usize| header.dims.get(axis).copied().unwrap_or(1);
    let dims_xyz = [dim(0), dim(1), dim(2)];
    if header.dims.iter().skip(5).any(|&dim| dim > 1) {
        let (path, dims) = (header_path.to_owned(), header.dims.clone());
        return Err(SourceError::TooManyDimensions { path, dims });
    }
    let (times, channels) = (dim(3), dim(4));
    let time = chosen(header_path, times, options.time)?;
    let channel = chosen(header_path, channels, options.channel)?;
    if times * channels > 1 {
        notes.push(format!(
            "it holds {times} times and {channels} channels: time {time} of channel {channel} is used \
             (--time and --channel choose another)"
        ));
    }
    let unit = match header.spatial_unit {
        NiftiUnit::Metre => LengthUnit::M,
        NiftiUnit::Millimetre => LengthUnit::Mm,
        NiftiUnit::Micrometre => LengthUnit::Um,
        NiftiUnit::Unknown => {
            notes.push("it names no unit of length: mm is assumed (--unit gives another)".into());
            LengthUnit::Mm
        }
    };
    let stored = sample_type(header.datatype);
    let scaling = header.scaling();
    // A header's affine may be anything; only numbers can be kept.
    let affine = header.affine().filter(|rows| rows.iter().flatten().all(|v| v.is_finite()));
    let volume_bytes = dims_xyz.iter().product::<u64>() * stored.bytes() as u64;
    let volumes = times * channels;
    let index = channel * times + time;
    let offset = header.vox_offset + index * volume_bytes;
    let found = std::fs::metadata(image_path)
        .map_err(|source| SourceError::Io { path: image_path.to_owned(), source })?
        .len();
    let place = if ending(image_path).1 {
        // Deflate packs 1032 to 1 at best: what claims more is not there.
        let needed = offset.saturating_add(volume_bytes);
        if needed / 1032 > found {
            return Err(SourceError::Truncated { path: image_path.to_owned() });
        }
        let ends_with_volume = index + 1 == volumes;
        Place::Stream(StreamPlace { offset, ends_with_volume, ..gzip(image_path) })
    } else {
        let expected = header.vox_offset + volumes * volume_bytes;
        if found != expected {
            let path = image_path.to_owned();
            let skip = header.vox_offset + (volumes - 1) * volume_bytes;
            let hint = String::new();
            return Err(SourceError::Size { path, dims_xyz, stored, skip, expected, found, hint });
        }
        let map = map_file(image_path)
            .map_err(|source| SourceError::Io { path: image_path.to_owned(), source })?;
        Place::Mapped { map, offset }
    };
    let mut files = vec![header_path.to_owned(), image_path.to_owned()];
    files.dedup();
    let found = Found {
        dims_xyz,
        spacing_xyz: header.spacing_xyz(),
        unit,
        affine,
        path: header_path.to_owned(),
        bytes: found,
        notes,
        files,
        format: StoredFormat { stored, big_endian: header.big_endian, scaling },
        place,
    };
    Ok(found.into())
}

/// The number that was asked for, or 0, if there are so many.
fn chosen(path: &Path, count: u64, asked: Option<u64>) -> Result<u64, SourceError> {
    let asked = asked.unwrap_or(0);
    if asked < count {
        Ok(asked)
    } else {
        Err(SourceError::NoSuchVolume { path: path.to_owned(), count, asked })
    }
}

fn sample_type(datatype: NiftiDatatype) -> SampleType {
    match datatype {
        NiftiDatatype::U8 => SampleType::U8,
        NiftiDatatype::I8 => SampleType::I8,
        NiftiDatatype::U16 => SampleType::U16,
        NiftiDatatype::I16 => SampleType::I16,
        NiftiDatatype::U32 => SampleType::U32,
        NiftiDatatype::I32 => SampleType::I32,
        NiftiDatatype::F32 => SampleType::F32,
        NiftiDatatype::F64 => SampleType::F64,
    }
}

/// A gzip file from its first byte on.
fn gzip(path: &Path) -> StreamPlace {
    StreamPlace {
        path: path.to_owned(),
        file_offset: 0,
        coding: StreamCoding::Gzip,
        pick: None,
        offset: 0,
        ends_with_volume: false,
    }
}

fn open_file(path: &Path) -> Result<File, SourceError> {
    File::open(path).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => SourceError::Missing { path: path.to_owned() },
        _ => SourceError::Io { path: path.to_owned(), source },
    })
}
