//! The output's names: work goes to files beside it (`OUT.partial`, `OUT.index`, and scratch), and
//! `OUT.partial` becomes `OUT` when it is whole.

use super::plan::folder_of;
use crate::error::PreprocessError;
use crate::source::map::take_blocks;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use twox_hash::XxHash3_64;

/// What is done with what is there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// An existing output or unfinished work is refused.
    #[default]
    Fresh,
    /// An existing output is replaced at the end, unfinished work at once.
    Replace,
    /// Unfinished work is gone on with, where there is any.
    Resume,
}

/// An output in the making; what it made is removed unless it is finished or kept.
#[derive(Debug)]
pub(super) struct Output {
    path: PathBuf,
    /// The store in the making.
    pub(super) partial: PathBuf,
    /// Its records.
    pub(super) index: PathBuf,
    /// The slots of the windows.
    pub(super) scratch: PathBuf,
    /// Whether there is earlier work to go on with.
    pub(super) resumes: bool,
    /// Whether the files are ours to remove.
    made: bool,
}

/// Refuses an output that would replace a source, or lie in no folder.
///
/// # Errors
/// When it would.
pub(crate) fn check_place(path: &Path, sources: &[PathBuf]) -> Result<(), PreprocessError> {
    let owned = || path.to_owned();
    let canonical = path.canonicalize().ok();
    if canonical.is_some() && sources.iter().any(|source| source.canonicalize().ok() == canonical) {
        return Err(PreprocessError::OutputIsInput { path: owned() });
    }
    if path.file_name().is_none() || !folder_of(path).is_dir() {
        let source = io::Error::new(io::ErrorKind::NotFound, "there is no such folder");
        return Err(PreprocessError::Output { path: owned(), source });
    }
    Ok(())
}

impl Output {
    /// Looks at what is there already. `sources` must not be the output.
    pub(super) fn prepare(
        path: &Path,
        sources: &[PathBuf],
        scratch_folder: Option<&Path>,
        start: Start,
    ) -> Result<Self, PreprocessError> {
        let owned = || path.to_owned();
        check_place(path, sources)?;
        let mut output = Self {
            path: owned(),
            partial: with_ending(path, ".partial"),
            index: with_ending(path, ".index"),
            scratch: scratch_path(path, scratch_folder),
            resumes: false,
            made: false,
        };
        let busy = File::open(&output.partial)
            .is_ok_and(|file| matches!(file.try_lock(), Err(fs::TryLockError::WouldBlock)));
        if busy {
            return Err(PreprocessError::Busy { path: output.partial.clone() });
        }
        let left = output.work().into_iter().find(|file| file.exists()).cloned();
        if path.exists() && (left.is_none() || start != Start::Resume) {
            let replaced = path.is_file() && start == Start::Replace;
            if !replaced {
                return Err(PreprocessError::Exists { path: owned() });
            }
        }
        match (start, left) {
            (Start::Fresh, Some(left)) => return Err(PreprocessError::Unfinished { path: left }),
            (Start::Resume, Some(_)) if output.partial.exists() && output.index.exists() => {
                output.resumes = true;
            }
            // The store has its name already, and was ended before all else was gone.
            (Start::Resume, Some(_)) if path.exists() && !output.partial.exists() => {
                output.remove_work()?;
                return Err(PreprocessError::Exists { path: owned() });
            }
            (Start::Replace | Start::Resume, Some(_)) => output.remove_work()?,
            (_, None) => {}
        }
        Ok(output)
    }

    /// The files that stand for unfinished work.
    fn work(&self) -> [&PathBuf; 3] {
        [&self.partial, &self.index, &self.scratch]
    }

    /// Removes unfinished work.
    pub(super) fn remove_work(&mut self) -> Result<(), PreprocessError> {
        self.resumes = false;
        for file in self.work() {
            match fs::remove_file(file) {
                Err(source) if source.kind() != io::ErrorKind::NotFound => {
                    return Err(PreprocessError::Output { path: file.clone(), source });
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Says that the files are ours from now on.
    pub(super) fn made(&mut self) {
        self.made = true;
    }

    /// Says that the files stay for one who resumes.
    pub(super) fn keep(&mut self) {
        self.made = false;
    }

    /// The scratch file, with room for so many bytes; a new one unless work is resumed.
    pub(super) fn open_scratch(&self, bytes: u64) -> Result<File, PreprocessError> {
        let open = || {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create_new(!self.resumes);
            let file = options.open(&self.scratch)?;
            if file.metadata()?.len() != bytes {
                if self.resumes {
                    return Err(io::Error::new(io::ErrorKind::InvalidData, "it has another size"));
                }
                take_blocks(&file, bytes)?;
            }
            Ok(file)
        };
        open().map_err(|source| PreprocessError::ScratchFile { path: self.scratch.clone(), source })
    }

    /// Gives the finished store its name, in one step, and removes what was needed on the way.
    pub(super) fn finish(mut self) -> Result<(), PreprocessError> {
        let rename = || {
            fs::rename(&self.partial, &self.path)?;
            File::open(folder_of(&self.path))?.sync_all()
        };
        rename().map_err(|source| PreprocessError::Output { path: self.path.clone(), source })?;
        self.made = false;
        self.remove_work()
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if self.made {
            // Where this fails too, the next run names the file and what to do.
            let _ = self.remove_work();
        }
    }
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name: OsString = path.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

/// Beside the output, or in another folder under a name that tells outputs of one name apart.
fn scratch_path(path: &Path, folder: Option<&Path>) -> PathBuf {
    let Some(folder) = folder else { return with_ending(path, ".scratch") };
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let hash = XxHash3_64::oneshot(whole.as_os_str().as_encoded_bytes());
    let name = PathBuf::from(path.file_name().unwrap_or_default());
    folder.join(with_ending(&name, &format!(".{hash:016x}.scratch")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prepare(path: &Path, start: Start) -> Result<Output, PreprocessError> {
        Output::prepare(path, &["in".into()], None, start)
    }

    #[test]
    fn what_is_not_finished_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.octavo");
        let mut output = prepare(&path, Start::Fresh).unwrap();
        fs::write(&output.partial, "half").unwrap();
        assert_eq!(output.open_scratch(100).unwrap().metadata().unwrap().len(), 100);
        output.made();
        drop(output);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn earlier_work_is_neither_lost_nor_mistaken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.octavo");
        fs::write(&path, "old").unwrap();
        for start in [Start::Fresh, Start::Resume] {
            assert!(matches!(prepare(&path, start), Err(PreprocessError::Exists { .. })));
        }
        let output = prepare(&path, Start::Replace).unwrap();
        fs::write(&output.partial, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old", "until the new one is whole");
        output.finish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");

        let itself = [folder.path().join("./a.octavo")];
        assert!(matches!(
            Output::prepare(&path, &itself, None, Start::Replace),
            Err(PreprocessError::OutputIsInput { .. })
        ));

        let mine = folder.path().join("b.octavo.json");
        fs::write(&mine, "a report").unwrap();
        let other = folder.path().join("b.octavo");
        let left = ["partial", "index", "scratch"]
            .map(|end| other.with_extension(format!("octavo.{end}")));
        for left in &left {
            fs::write(left, "half").unwrap();
            assert!(matches!(
                prepare(&other, Start::Fresh),
                Err(PreprocessError::Unfinished { .. })
            ));
        }
        assert!(prepare(&other, Start::Resume).unwrap().resumes);
        let writer = File::open(&left[0]).unwrap();
        writer.lock().unwrap();
        let second = prepare(&other, Start::Replace);
        assert!(matches!(second, Err(PreprocessError::Busy { .. })), "someone is writing it");
        drop(writer);
        assert!(!prepare(&other, Start::Replace).unwrap().resumes);
        assert!(left.iter().all(|file| !file.exists()));
        assert_eq!(fs::read_to_string(mine).unwrap(), "a report", "only what octavo makes goes");

        fs::write(&left[1], "half").unwrap();
        assert!(
            !prepare(&other, Start::Resume).unwrap().resumes,
            "without the rest it is of no use"
        );
        assert!(!left[1].exists());

        // Ended between the store's name and the end of what it was made of.
        fs::write(&other, "whole").unwrap();
        fs::write(&left[1], "half").unwrap();
        assert!(matches!(prepare(&other, Start::Resume), Err(PreprocessError::Exists { .. })));
        assert!(!left[1].exists());
        assert_eq!(fs::read_to_string(&other).unwrap(), "whole");
    }

    #[test]
    fn outputs_of_one_name_have_scratch_of_their_own() {
        let names = ["a/x.octavo", "b/x.octavo"]
            .map(|path| scratch_path(Path::new(path), Some(Path::new("s"))));
        assert_ne!(names[0], names[1]);
        assert!(names[0].starts_with("s"));
    }
}
