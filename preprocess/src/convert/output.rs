//! The output's names: work goes to files beside it (`OUT.partial`, `OUT.index`, and scratch), and
//! `OUT.partial` becomes `OUT` when it is whole. Whoever works on an output holds the lock of `OUT.partial`,
//! and takes it before looking at anything else.

use super::plan::folder_of;
use crate::error::PreprocessError;
use octree_store::{Disk, DiskFile};
use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
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
    /// An existing output is replaced at the end; unfinished work is refused.
    Mend,
}

/// An output in the making; what it made is removed unless it is finished or kept.
#[derive(Debug)]
pub(crate) struct Output {
    path: PathBuf,
    /// The store in the making.
    pub(crate) partial: PathBuf,
    /// Its records.
    pub(crate) index: PathBuf,
    /// The slots of the windows.
    pub(crate) scratch: PathBuf,
    /// Whether there is earlier work to go on with.
    pub(crate) resumes: bool,
    /// Whether the files are ours to remove.
    made: bool,
    /// `OUT.partial`, locked.
    file: DiskFile,
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
    /// Takes an output and looks at what is there already. `sources` must not be the output.
    pub(crate) fn prepare(
        disk: &Disk,
        path: &Path,
        sources: &[PathBuf],
        scratch_folder: Option<&Path>,
        start: Start,
    ) -> Result<Self, PreprocessError> {
        check_place(path, sources)?;
        let exists = || PreprocessError::Exists { path: path.to_owned() };
        let expected = match start {
            Start::Fresh => false,
            Start::Resume => true,
            Start::Replace | Start::Mend => path.is_file(),
        };
        if path.exists() && !expected {
            return Err(exists());
        }
        let partial = with_ending(path, ".partial");
        let mut output = Self {
            path: path.to_owned(),
            index: with_ending(path, ".index"),
            scratch: scratch_path(path, scratch_folder),
            resumes: false,
            made: false,
            file: lock(disk, &partial)?,
            partial,
        };
        let begun = output.file.length().map_err(|source| at(&output.partial, source))? > 0;
        let work = [&output.partial, &output.index, &output.scratch];
        let left = work[usize::from(!begun)..].iter().find(|file| file.exists());
        match (start, left.map(|file| (*file).clone())) {
            // The store has its name already, and was ended before all else was gone.
            (Start::Resume, _) if path.exists() && !begun => {
                output.remove_work()?;
                return Err(exists());
            }
            (Start::Fresh | Start::Mend, Some(left)) => {
                if !begun {
                    remove(disk, &output.partial).map_err(|source| at(&left, source))?;
                }
                return Err(PreprocessError::Unfinished { path: left });
            }
            (Start::Resume, Some(_)) if begun && output.index.exists() => output.resumes = true,
            (Start::Replace | Start::Resume, Some(_)) => output.start_over()?,
            (_, None) => output.made = true,
        }
        Ok(output)
    }

    /// The locked file of the store in the making.
    pub(crate) fn file(&self) -> Result<DiskFile, PreprocessError> {
        self.file.try_clone().map_err(|source| at(&self.partial, source))
    }

    /// Empties what earlier work has left; from now on the files are ours.
    pub(crate) fn start_over(&mut self) -> Result<(), PreprocessError> {
        self.resumes = false;
        self.made = true;
        for file in [&self.index, &self.scratch] {
            remove(self.file.disk(), file).map_err(|source| at(file, source))?;
        }
        self.file.set_len(0).map_err(|source| at(&self.partial, source))
    }

    /// Makes durable that the files are there.
    pub(crate) fn keep_names(&self) -> Result<(), PreprocessError> {
        for file in [&self.partial, &self.scratch] {
            let synced = self.file.disk().sync_folder(&folder_of(file));
            synced.map_err(|source| at(file, source))?;
        }
        Ok(())
    }

    fn remove_work(&self) -> Result<(), PreprocessError> {
        // The lock's file goes last: who takes the output then finds nothing else.
        for file in [&self.index, &self.scratch, &self.partial] {
            remove(self.file.disk(), file).map_err(|source| at(file, source))?;
        }
        Ok(())
    }

    /// Says that the files stay for one who resumes.
    pub(crate) fn keep(&mut self) {
        self.made = false;
    }

    /// The scratch file, with room for so many bytes; a new one unless work is resumed.
    pub(crate) fn open_scratch(&self, bytes: u64) -> Result<DiskFile, PreprocessError> {
        let refuse = |what| Err(PreprocessError::CannotResume { path: self.scratch.clone(), what });
        let open = || -> io::Result<(DiskFile, u64)> {
            let disk = self.file.disk();
            let file = if self.resumes {
                disk.open_to_write(&self.scratch)?
            } else {
                disk.create_new(&self.scratch)?
            };
            if !self.resumes && bytes > 0 {
                file.take_blocks(bytes)?;
            }
            let length = file.length()?;
            Ok((file, length))
        };
        match open() {
            Ok((_, length)) if length != bytes => {
                refuse("this file has another length than it had")
            }
            Err(source) if self.resumes && source.kind() == io::ErrorKind::NotFound => {
                refuse("this file is not there; was it begun with another --scratch folder?")
            }
            opened => opened.map(|(file, _)| file).map_err(|source| PreprocessError::ScratchFile {
                path: self.scratch.clone(),
                source,
            }),
        }
    }

    /// Gives the finished store its name, in one step, and removes what was needed on the way.
    pub(crate) fn finish(&mut self) -> Result<(), PreprocessError> {
        let ours = [&self.index, &self.scratch].map(|file| identity(file));
        let disk = self.file.disk();
        let rename = || {
            disk.rename(&self.partial, &self.path)?;
            disk.sync_folder(&folder_of(&self.path))
        };
        rename().map_err(|source| at(&self.path, source))?;
        self.made = false;
        // With its name the store has left the lock to others, whose files may have the same names.
        for (file, ours) in [&self.index, &self.scratch].into_iter().zip(ours) {
            if ours.is_some() && identity(file) == ours {
                remove(disk, file).map_err(|source| at(file, source))?;
            }
        }
        Ok(())
    }
}

fn at(file: &Path, source: io::Error) -> PreprocessError {
    PreprocessError::Output { path: file.to_owned(), source }
}

/// Opens or makes a file and locks it, unless another process has it.
fn lock(disk: &Disk, path: &Path) -> Result<DiskFile, PreprocessError> {
    let io = |source| at(path, source);
    loop {
        let file = disk.open_or_create(path).map_err(io)?;
        match file.file().try_lock() {
            Ok(()) => {}
            Err(fs::TryLockError::WouldBlock) => {
                return Err(PreprocessError::Busy { path: path.to_owned() });
            }
            Err(fs::TryLockError::Error(source)) => return Err(io(source)),
        }
        // Who had it before may have renamed or removed it meanwhile.
        let locked = file.file().metadata().map_err(io)?;
        if identity(path) == Some((locked.dev(), locked.ino())) {
            return Ok(file);
        }
    }
}

/// What tells a file from another of its name.
fn identity(path: &Path) -> Option<(u64, u64)> {
    fs::metadata(path).ok().map(|file| (file.dev(), file.ino()))
}

/// Removes a file that may not be there.
fn remove(disk: &Disk, path: &Path) -> io::Result<()> {
    match disk.remove(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
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
    use octree_store::{Operation, Watch};
    use std::sync::Arc;

    fn prepare(path: &Path, start: Start) -> Result<Output, PreprocessError> {
        Output::prepare(&Disk::default(), path, &["in".into()], None, start)
    }

    #[test]
    fn what_is_not_finished_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.octavo");
        let output = prepare(&path, Start::Fresh).unwrap();
        fs::write(&output.partial, "half").unwrap();
        for bytes in [0, 100] {
            let scratch = output.open_scratch(bytes).unwrap();
            assert_eq!(scratch.length().unwrap(), bytes);
            fs::remove_file(&output.scratch).unwrap();
        }
        output.open_scratch(100).unwrap();
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
        let mut output = prepare(&path, Start::Replace).unwrap();
        fs::write(&output.partial, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old", "until the new one is whole");
        output.finish().unwrap();
        drop(output);
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");

        let itself = [folder.path().join("./a.octavo")];
        assert!(matches!(
            Output::prepare(&Disk::default(), &path, &itself, None, Start::Replace),
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
        let first = prepare(&other, Start::Resume).unwrap();
        assert!(first.resumes);
        for start in [Start::Fresh, Start::Replace, Start::Resume] {
            assert!(matches!(prepare(&other, start), Err(PreprocessError::Busy { .. })));
        }
        drop(first);
        assert!(left.iter().all(|file| file.exists()), "what was resumed is not ours to remove");
        let replacing = prepare(&other, Start::Replace).unwrap();
        assert!(!replacing.resumes);
        assert_eq!(fs::metadata(&left[0]).unwrap().len(), 0);
        drop(replacing);
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

    /// Another's work of the same name, begun at the moment in which the lock is given up with the name.
    #[derive(Debug)]
    struct Another;

    impl Watch for Another {
        fn before(&self, operation: Operation<'_>) -> io::Result<()> {
            if let Operation::SyncFolder(folder) = operation {
                let index = folder.join("a.octavo.index");
                // It must not get the number of the file that was there.
                fs::rename(&index, folder.join("old"))?;
                fs::write(index, "another's")?;
            }
            Ok(())
        }
    }

    #[test]
    fn anothers_work_of_the_same_name_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.octavo");
        let disk = Disk::watched(Arc::new(Another));
        let mut output = Output::prepare(&disk, &path, &["in".into()], None, Start::Fresh).unwrap();
        for file in [&output.index, &output.scratch] {
            fs::write(file, "ours").unwrap();
        }
        output.finish().unwrap();
        assert!(!output.scratch.exists());
        assert_eq!(fs::read_to_string(&output.index).unwrap(), "another's");
    }

    #[test]
    fn who_has_the_lock_has_the_file_of_that_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.octavo");
        // Each removes the file when it lets go, while others wait for it or have just opened it.
        let had: u32 = std::thread::scope(|scope| {
            let workers = [(); 4].map(|()| {
                scope.spawn(|| {
                    let mut had = 0;
                    for _ in 0..3000 {
                        let Ok(output) = prepare(&path, Start::Replace) else { continue };
                        let file = output.file.file().metadata().unwrap();
                        assert_eq!(identity(&output.partial), Some((file.dev(), file.ino())));
                        had += 1;
                    }
                    had
                })
            });
            workers.into_iter().map(|worker| worker.join().unwrap()).sum()
        });
        assert!(had > 100, "{had}");
    }

    #[test]
    fn outputs_of_one_name_have_scratch_of_their_own() {
        let names = ["a/x.octavo", "b/x.octavo"]
            .map(|path| scratch_path(Path::new(path), Some(Path::new("s"))));
        assert_ne!(names[0], names[1]);
        assert!(names[0].starts_with("s"));
    }
}
