//! Whether there is room on the disk: asked before long work, as far as the system tells.

use crate::convert::{ConversionPlan, ConvertOptions, folder_of};
use crate::error::PreprocessError;
use serde::Serialize;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Free space, and what a conversion may need of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct DiskSpace {
    /// Free where the store goes; none where the system does not tell.
    pub output_free_bytes: Option<u64>,
    /// Free where scratch files go.
    pub scratch_free_bytes: Option<u64>,
    /// Whether even the bounds fit: the store, its records in the making, and scratch.
    pub fits: bool,
    /// Where they may not, the most that is needed of a disk, and what is free.
    #[serde(skip)]
    pub short: Option<(u64, u64)>,
}

impl ConversionPlan {
    /// Looks at the disks that a conversion would write to.
    pub fn disk_space(&self, output: &Path, options: &ConvertOptions) -> DiskSpace {
        let folder = folder_of(output);
        let scratch = options.scratch.as_deref().unwrap_or(&folder);
        let device = |path: &Path| std::fs::metadata(path).ok().map(|found| found.dev());
        let (output_free, scratch_free) = (free_bytes(&folder), free_bytes(scratch));
        let needs = if device(&folder) == device(scratch) {
            vec![(self.output_bytes_max + self.scratch_bytes, output_free)]
        } else {
            vec![(self.output_bytes_max, output_free), (self.scratch_bytes, scratch_free)]
        };
        let short = needs
            .into_iter()
            .filter_map(|(needed, free)| Some((needed, free?)))
            .find(|(needed, free)| needed > free);
        DiskSpace {
            output_free_bytes: output_free,
            scratch_free_bytes: scratch_free,
            fits: short.is_none(),
            short,
        }
    }
}

/// Refuses a file of so many bytes where the disk has not so many free.
///
/// # Errors
/// When it would not fit.
pub(crate) fn check_room(output: &Path, needed: u64) -> Result<(), PreprocessError> {
    match free_bytes(&folder_of(output)) {
        Some(free) if free < needed => {
            Err(PreprocessError::DiskTooSmall { path: output.to_owned(), needed, free })
        }
        _ => Ok(()),
    }
}

/// Bytes that a folder's disk has free for this user.
fn free_bytes(folder: &Path) -> Option<u64> {
    let found = rustix::fs::statvfs(folder).ok()?;
    Some(found.f_bavail * found.f_frsize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_fit_is_refused_and_what_fits_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        assert!(check_room(&path, 1).is_ok());
        let refused = check_room(&path, u64::MAX);
        assert!(matches!(refused, Err(error @ PreprocessError::DiskTooSmall { .. })
            if error.is_environment()));
    }
}
