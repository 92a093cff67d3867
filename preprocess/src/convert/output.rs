//! The output's names: work goes to `OUT.partial`, and becomes `OUT` when it is whole.

use super::plan::folder_of;
use crate::error::PreprocessError;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// An output in the making; what it made is removed unless it is finished.
#[derive(Debug)]
pub(super) struct Output {
    path: PathBuf,
    partial: PathBuf,
    /// Whether the partial file exists and is ours to remove.
    made: bool,
}

impl Output {
    /// Looks at what is there already. With `force`, an earlier output will be replaced at the end,
    /// and unfinished work goes now. `source` must not be the output.
    pub(super) fn prepare(
        path: &Path,
        source: &Path,
        force: bool,
    ) -> Result<Self, PreprocessError> {
        let owned = || path.to_owned();
        if path.canonicalize().is_ok_and(|path| source.canonicalize().is_ok_and(|s| s == path)) {
            return Err(PreprocessError::OutputIsInput { path: owned() });
        }
        if path.exists() && !(path.is_file() && force) {
            return Err(PreprocessError::Exists { path: owned() });
        }
        let mut partial = path.as_os_str().to_owned();
        partial.push(".partial");
        let partial = PathBuf::from(partial);
        if path.file_name().is_none() || !folder_of(path).is_dir() {
            let source = io::Error::new(io::ErrorKind::NotFound, "there is no such folder");
            return Err(PreprocessError::Output { path: owned(), source });
        }
        if partial.exists() {
            // The database keeps a lock on the file while it is written.
            let locked = File::open(&partial)
                .is_ok_and(|file| matches!(file.try_lock(), Err(fs::TryLockError::WouldBlock)));
            if locked {
                return Err(PreprocessError::Busy { path: partial });
            }
            if !force {
                return Err(PreprocessError::Unfinished { path: partial });
            }
            fs::remove_file(&partial)
                .map_err(|source| PreprocessError::Output { path: partial.clone(), source })?;
        }
        Ok(Self { path: owned(), partial, made: false })
    }

    /// Says that the file at [`Output::partial`] is ours from now on.
    pub(super) fn made(&mut self) {
        self.made = true;
    }

    /// Where to work.
    pub(super) fn partial(&self) -> &Path {
        &self.partial
    }

    /// Makes the work durable and gives it its name; an earlier output is replaced in one step.
    pub(super) fn finish(mut self) -> Result<(), PreprocessError> {
        let sync = || {
            File::open(&self.partial)?.sync_all()?;
            fs::rename(&self.partial, &self.path)?;
            File::open(folder_of(&self.path))?.sync_all()
        };
        sync().map_err(|source| PreprocessError::Output { path: self.path.clone(), source })?;
        self.made = false;
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if self.made {
            // Where this fails too, the next run names the file and what to do.
            let _ = fs::remove_file(&self.partial);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_finished_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.octavo");
        let mut output = Output::prepare(&path, Path::new("in"), false).unwrap();
        fs::write(output.partial(), "half").unwrap();
        output.made();
        drop(output);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn earlier_work_is_neither_lost_nor_mistaken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.octavo");
        fs::write(&path, "old").unwrap();
        assert!(matches!(
            Output::prepare(&path, Path::new("in"), false),
            Err(PreprocessError::Exists { .. })
        ));
        let output = Output::prepare(&path, Path::new("in"), true).unwrap();
        fs::write(output.partial(), "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old", "until the new one is whole");
        output.finish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");

        assert!(matches!(
            Output::prepare(&path, &folder.path().join("./a.octavo"), true),
            Err(PreprocessError::OutputIsInput { .. })
        ));

        let mine = folder.path().join("b.octavo.json");
        fs::write(&mine, "a report").unwrap();
        let left = folder.path().join("b.octavo.partial");
        fs::write(&left, "half").unwrap();
        let other = folder.path().join("b.octavo");
        assert!(matches!(
            Output::prepare(&other, Path::new("in"), false),
            Err(PreprocessError::Unfinished { .. })
        ));
        let writer = File::open(&left).unwrap();
        writer.lock().unwrap();
        let second = Output::prepare(&other, Path::new("in"), true);
        assert!(matches!(second, Err(PreprocessError::Busy { .. })), "someone is writing it");
        drop(writer);
        drop(Output::prepare(&other, Path::new("in"), true).unwrap());
        assert!(!left.exists());
        assert_eq!(fs::read_to_string(mine).unwrap(), "a report", "only what octavo makes goes");
    }
}
