//! Raw files: samples and nothing else, but for bytes to skip before them.

use super::map::map_file;
use super::{Found, Place, RawName, Source, SourceError, SourceOptions, StoredFormat};
use octree_store::{Geometry, LengthUnit, SampleType};
use std::path::Path;

/// Whether a file's name ends as a raw file's.
pub(super) fn is_name(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("raw"))
}

/// Opens a raw file with what the flags and the name say; flags win.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let name = RawName::parse(path);
    let owned = || path.to_owned();
    if !is_name(path) && !options.any_raw() {
        return Err(SourceError::UnknownKind { path: owned() });
    }
    let unknown = |missing, flag| SourceError::RawUnknown { path: owned(), missing, flag };
    let dims_xyz = options
        .dims_xyz
        .or(name.map(|name| name.dims_xyz))
        .ok_or_else(|| unknown("dimensions", "--dims X,Y,Z"))?;
    let stored = options
        .sample_type
        .or(name.map(|name| name.sample_type))
        .ok_or_else(|| unknown("sample type", "--dtype TYPE"))?;
    let format = StoredFormat {
        stored,
        big_endian: options.big_endian || name.is_some_and(|name| name.big_endian),
        scaling: None,
    };
    let skip = options.skip.unwrap_or(0);
    let found =
        std::fs::metadata(path).map_err(|source| SourceError::Io { path: owned(), source })?.len();
    check_size(path, dims_xyz, stored, skip, found)?;
    let map = map_file(path).map_err(|source| SourceError::Io { path: owned(), source })?;
    let found = Found {
        dims_xyz,
        spacing_xyz: [1.0; 3],
        unit: LengthUnit::default(),
        affine: None,
        path: owned(),
        bytes: found,
        notes: Vec::new(),
        files: vec![owned()],
        format,
        place: Place::Mapped { map, offset: skip },
    };
    Ok(found.into())
}

/// Checks that a file holds exactly the voxels that its dimensions say.
fn check_size(
    path: &Path,
    dims_xyz: [u64; 3],
    stored: SampleType,
    skip: u64,
    found: u64,
) -> Result<(), SourceError> {
    // Any brick will do: this asks only whether such a volume can be.
    Geometry::new(dims_xyz, 128, 0)
        .map_err(|source| SourceError::Geometry { path: path.to_owned(), source })?;
    let slice = u128::from(dims_xyz[0] * dims_xyz[1]) * stored.bytes() as u128;
    let expected = u128::from(skip) + slice * u128::from(dims_xyz[2]);
    if expected == u128::from(found) {
        return Ok(());
    }
    let voxels = u128::from(found.saturating_sub(skip));
    let hint = if voxels > 0 && voxels.is_multiple_of(slice) {
        format!(": {} x {} x {} would fit", dims_xyz[0], dims_xyz[1], voxels / slice)
    } else {
        String::new()
    };
    let expected = u64::try_from(expected).unwrap_or(u64::MAX);
    Err(SourceError::Size { path: path.to_owned(), dims_xyz, stored, skip, expected, found, hint })
}
