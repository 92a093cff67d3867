//! Folders and patterns of files that are one slice each, and single PNG files.
//!
//! Opening reads every file's header, so that what does not fit is found before the work begins; samples are
//! decoded when a slice is asked for.

mod error;
mod png;
mod series;
#[cfg(test)]
mod tests;

pub use error::{PngError, StackError};

use super::tiff::length::VoxelSize;
use super::tiff::{self, PageKind};
use super::{Found, Place, SliceFiles, Source, SourceError, SourceOptions, StoredFormat, dicom};
use octree_store::Geometry;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What a file of one slice is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SliceKind {
    Tiff,
    Png,
}

impl SliceKind {
    /// By the name's ending.
    fn of(path: &Path) -> Option<Self> {
        if tiff::is_name(path) {
            Some(Self::Tiff)
        } else if is_png_name(path) {
            Some(Self::Png)
        } else {
            None
        }
    }

    fn look_at(self, path: &Path) -> Result<Picture, SourceError> {
        match self {
            Self::Png => png::look_at(path),
            Self::Tiff => {
                let tiff::SinglePage { kind, voxel_size, decode_bytes } =
                    tiff::look_at_single(path)?;
                let bytes = std::fs::metadata(path)
                    .map_err(|source| SourceError::Io { path: path.to_owned(), source })?
                    .len();
                Ok(Picture { kind, voxel_size, decode_bytes, bytes })
            }
        }
    }
}

/// What a file's header says.
#[derive(Debug)]
struct Picture {
    kind: PageKind,
    voxel_size: VoxelSize,
    decode_bytes: u64,
    /// Bytes of the file.
    bytes: u64,
}

/// Whether a file's name ends as PNG's do.
pub(super) fn is_png_name(path: &Path) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png"))
}

/// Whether a file that begins with these bytes says that it is PNG.
pub(super) fn is_png_magic(start: &[u8]) -> bool {
    start.starts_with(b"\x89PNG\r\n\x1a\n")
}

/// Whether a path that does not exist may be a pattern.
pub(super) fn is_pattern(path: &Path) -> bool {
    path.to_str().is_some_and(|text| text.contains(['*', '?', '[']))
}

/// Opens a folder or a pattern by what it holds.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let refuse = |source| SourceError::Stack { path: path.to_owned(), source };
    let found = if path.is_dir() { files_of_folder(path)? } else { files_of_pattern(path)? };
    let count = found.len();
    let (slices, others): (Vec<_>, Vec<_>) =
        found.into_iter().partition(|file| SliceKind::of(file).is_some());
    let Some(kind) = slices.first().and_then(|first| SliceKind::of(first)) else {
        let (series, left_out) = find_dicom(path, others)?;
        if !series.is_empty() {
            return dicom::open(series, left_out, path, options);
        }
        return Err(refuse(match &options.series {
            Some(series) => StackError::NotDicom { series: series.clone() },
            None if count == 0 && !path.is_dir() => StackError::NoMatch,
            None => StackError::Empty { others: count },
        }));
    };
    let mut other_slices = slices.iter().filter(|file| SliceKind::of(file) != Some(kind));
    // What cannot be read is no slice unless its name says so.
    let is_dicom = |file: &&PathBuf| dicom::is_dicom(file).unwrap_or(false);
    let mut images = others.iter().filter(|file| !is_directory_file(file));
    if let Some(other) = other_slices.next().or_else(|| images.find(is_dicom)) {
        let (first, other) = (slices[0].clone(), other.clone());
        return Err(refuse(StackError::MixedKinds { first, other }));
    }
    if let Some(series) = &options.series {
        return Err(refuse(StackError::NotDicom { series: series.clone() }));
    }
    let files = series::arrange(slices, options.allow_gaps).map_err(refuse)?;
    let notes = super::left_out_note(&others).into_iter().collect();
    open_files(path, kind, files, notes, options)
}

/// Opens a single PNG file: a volume of one slice.
pub(super) fn open_png(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    open_files(path, SliceKind::Png, vec![path.to_owned()], Vec::new(), options)
}

/// How many folders one in the other are searched for DICOM files.
const FOLDERS_DOWN: usize = 8;

/// Whether a DICOM file only lists others.
fn is_directory_file(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.eq_ignore_ascii_case("DICOMDIR"))
}

/// Tells the DICOM files among those of a folder or pattern from others. Scanners and archives put each series
/// into folders below; these are searched where the folder itself has none.
fn find_dicom(
    path: &Path,
    files: Vec<PathBuf>,
) -> Result<(Vec<PathBuf>, Vec<PathBuf>), SourceError> {
    let (mut series, mut others) = (Vec::new(), Vec::new());
    let mut sort = |files: Vec<PathBuf>| -> Result<bool, SourceError> {
        for file in files.into_iter().filter(|file| !is_directory_file(file)) {
            let is_dicom = dicom::is_dicom(&file)?;
            if is_dicom { &mut series } else { &mut others }.push(file);
        }
        Ok(series.is_empty())
    };
    if sort(files)? && path.is_dir() {
        sort(files_below(path, FOLDERS_DOWN)?)?;
    }
    Ok((series, others))
}

/// Whether a path is to be looked at: a file, or what cannot be told, as a link that leads nowhere.
fn may_be_file(path: &Path) -> bool {
    !is_litter(path) && std::fs::metadata(path).map_or(true, |metadata| metadata.is_file())
}

/// The files of the folders below one; links to folders are not followed, which may lead round.
fn files_below(folder: &Path, depth: usize) -> Result<Vec<PathBuf>, SourceError> {
    let io_error = |source| SourceError::Io { path: folder.to_owned(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io_error)? {
        let entry = entry.map_err(io_error)?;
        if entry.file_type().map_err(io_error)?.is_dir() && !is_litter(&entry.path()) && depth > 0 {
            files.extend(files_of_folder(&entry.path())?);
            files.extend(files_below(&entry.path(), depth - 1)?);
        }
    }
    files.sort_unstable();
    Ok(files)
}

/// The files of a folder, hidden ones and those that systems leave apart.
fn files_of_folder(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let io_error = |source| SourceError::Io { path: folder.to_owned(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io_error)? {
        let path = entry.map_err(io_error)?.path();
        if may_be_file(&path) {
            files.push(path);
        }
    }
    files.sort_unstable();
    Ok(files)
}

/// The files that match a pattern.
fn files_of_pattern(pattern: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let refuse = |source| SourceError::Stack { path: pattern.to_owned(), source };
    let options = glob::MatchOptions {
        case_sensitive: true,
        require_literal_separator: true,
        require_literal_leading_dot: true,
    };
    let matches = glob::glob_with(&pattern.to_string_lossy(), options)
        .map_err(|source| refuse(StackError::Pattern { source }))?;
    let mut files = Vec::new();
    for found in matches {
        let path = found.map_err(|error| SourceError::Io {
            path: error.path().to_owned(),
            source: error.into(),
        })?;
        if may_be_file(&path) {
            files.push(path);
        }
    }
    files.sort_unstable();
    Ok(files)
}

/// What nobody put there on purpose.
fn is_litter(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with('.') || ["thumbs.db", "desktop.ini"].contains(&name.to_lowercase().as_str())
}

fn open_files(
    path: &Path,
    slice_kind: SliceKind,
    files: Vec<PathBuf>,
    mut notes: Vec<String>,
    options: &SourceOptions,
) -> Result<Source, SourceError> {
    if let Some(asked) = options.time.max(options.channel).filter(|&asked| asked > 0) {
        return Err(SourceError::NoSuchVolume { path: path.to_owned(), count: 1, asked });
    }
    let first = slice_kind.look_at(&files[0])?;
    let check = |file: &PathBuf| {
        let picture = slice_kind.look_at(file)?;
        check_alike(file, picture.kind, &files[0], first.kind)
            .map_err(|source| SourceError::Stack { path: path.to_owned(), source })?;
        Ok((picture.bytes, picture.decode_bytes))
    };
    let looked: Vec<Result<_, SourceError>> = files[1..].par_iter().map(check).collect();
    let (mut bytes, mut decode_bytes) = (first.bytes, first.decode_bytes);
    for looked in looked {
        let (more, decode) = looked?;
        bytes += more;
        decode_bytes = decode_bytes.max(decode);
    }
    let PageKind { dims_xy: [x, y], stored } = first.kind;
    let dims_xyz = [x, y, files.len() as u64];
    Geometry::new(dims_xyz, 128, 0)
        .map_err(|source| SourceError::Geometry { path: path.to_owned(), source })?;
    let VoxelSize { spacing_xyz, unit, notes: size_notes } = first.voxel_size;
    notes.extend(size_notes);
    let slices = Slices { files: files.clone(), slice_kind, kind: first.kind, decode_bytes };
    let found = Found {
        dims_xyz,
        spacing_xyz,
        unit,
        affine: None,
        path: path.to_owned(),
        bytes,
        notes,
        files,
        format: StoredFormat { stored, big_endian: false, scaling: None },
        place: Place::Slices(Box::new(slices)),
    };
    Ok(found.into())
}

fn check_alike(
    file: &Path,
    found: PageKind,
    first: &Path,
    expected: PageKind,
) -> Result<(), StackError> {
    if found == expected {
        return Ok(());
    }
    Err(StackError::Unlike {
        path: file.to_owned(),
        found_xy: found.dims_xy,
        found: found.stored,
        first: first.to_owned(),
        expected_xy: expected.dims_xy,
        expected: expected.stored,
    })
}

/// Files of one slice each.
#[derive(Debug)]
struct Slices {
    files: Vec<PathBuf>,
    slice_kind: SliceKind,
    kind: PageKind,
    decode_bytes: u64,
}

impl SliceFiles for Slices {
    fn read_slice(&self, z: u64, bytes: &mut [u8]) -> Result<(), SourceError> {
        let file = &self.files[z as usize];
        match self.slice_kind {
            SliceKind::Tiff => tiff::read_single(file, self.kind, bytes),
            SliceKind::Png => png::read(file, self.kind, bytes),
        }
    }

    fn decode_bytes(&self) -> u64 {
        self.decode_bytes
    }
}
