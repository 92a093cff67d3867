//! What a path is opened as: by its name, or by its first bytes where the name says nothing.

use super::{Source, SourceError, SourceOptions};
use super::{data_files, dicom, meta_image, nifti, nrrd, raw, stack, tiff};
use std::io;
use std::path::Path;

/// A kind of source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Nifti,
    Nrrd,
    MetaImage,
    Dicom,
    Tiff,
    Png,
    Folder,
    Pattern,
    Raw,
}

impl Format {
    /// What a path is.
    pub(super) fn of(path: &Path, options: &SourceOptions) -> Result<Self, SourceError> {
        match std::fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => Ok(Self::Folder),
            Ok(metadata) if metadata.is_file() => Ok(Self::of_file(path, options)),
            // To open a pipe would wait for one who writes to it.
            Ok(_) => Err(SourceError::NoFile { path: path.to_owned() }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                if stack::is_pattern(path) {
                    Ok(Self::Pattern)
                } else {
                    Err(SourceError::Missing { path: path.to_owned() })
                }
            }
            Err(source) => Err(SourceError::Io { path: path.to_owned(), source }),
        }
    }

    fn of_file(path: &Path, options: &SourceOptions) -> Self {
        if nifti::is_name(path) {
            Self::Nifti
        } else if nrrd::is_name(path) {
            Self::Nrrd
        } else if meta_image::is_name(path) {
            Self::MetaImage
        } else if dicom::is_name(path) {
            Self::Dicom
        } else if tiff::is_name(path) {
            Self::Tiff
        } else if stack::is_png_name(path) {
            Self::Png
        } else if options.any_raw() || raw::is_name(path) {
            Self::Raw
        } else {
            // A file that cannot be read is refused by whoever opens it.
            let start = data_files::read_start(path, 256).unwrap_or_default();
            match start.as_slice() {
                start if nrrd::is_magic(start) => Self::Nrrd,
                start if meta_image::is_magic(start) => Self::MetaImage,
                start if tiff::is_magic(start) => Self::Tiff,
                start if stack::is_png_magic(start) => Self::Png,
                _ if dicom::is_dicom(path).unwrap_or(false) => Self::Dicom,
                _ => Self::Raw,
            }
        }
    }

    /// What a message calls it, where it says its dimensions itself.
    pub(super) fn headed(self) -> Option<&'static str> {
        match self {
            Self::Nifti => Some("a NIfTI file"),
            Self::Nrrd => Some("an NRRD file"),
            Self::MetaImage => Some("a MetaImage file"),
            Self::Dicom => Some("a DICOM file"),
            Self::Tiff => Some("a TIFF file"),
            Self::Png => Some("a PNG file"),
            Self::Folder => Some("a folder"),
            Self::Pattern => Some("a pattern"),
            Self::Raw => None,
        }
    }

    /// Whether it can hold DICOM series.
    pub(super) fn may_have_series(self) -> bool {
        matches!(self, Self::Dicom | Self::Folder | Self::Pattern)
    }

    /// Opens it.
    pub(super) fn open(self, path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
        match self {
            Self::Nifti => nifti::open(path, options),
            Self::Nrrd => nrrd::open(path, options),
            Self::MetaImage => meta_image::open(path, options),
            Self::Dicom => dicom::open(vec![path.to_owned()], Vec::new(), path, options),
            Self::Tiff => tiff::open(path, options),
            Self::Png => stack::open_png(path, options),
            Self::Folder | Self::Pattern => stack::open(path, options),
            Self::Raw => raw::open(path, options),
        }
    }
}
