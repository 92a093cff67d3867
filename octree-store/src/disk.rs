//! The files that stores are made of, and the names they get: one place where all reading and writing passes, so
//! that a test can make any of it fail.
//!
//! A [`DiskFile`] is a [`File`] that knows its path. Where nobody watches, it costs a comparison a call.

use rustix::fs::{FallocateFlags, OFlags, fallocate};
use rustix::io::Errno;
use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;
use std::sync::Arc;

/// What is about to be done.
#[derive(Debug, Clone, Copy)]
pub enum Operation<'a> {
    /// A new file gets this name.
    Create(&'a Path),
    /// Bytes of a file are read.
    Read {
        /// The file.
        path: &'a Path,
        /// The first byte.
        offset: u64,
        /// How many.
        bytes: usize,
    },
    /// Bytes of a file are written.
    Write {
        /// The file.
        path: &'a Path,
        /// Where the first goes.
        offset: u64,
        /// The bytes.
        bytes: &'a [u8],
    },
    /// A file is cut off or made longer, by zeros.
    SetLength {
        /// The file.
        path: &'a Path,
        /// Its new length.
        bytes: u64,
    },
    /// What was written to a file is made durable.
    Sync(&'a Path),
    /// What was done to the names in a folder is made durable.
    SyncFolder(&'a Path),
    /// A file gets another name, in one step.
    Rename {
        /// Its name.
        from: &'a Path,
        /// Its new name, whose file goes.
        to: &'a Path,
    },
    /// A name goes.
    Remove(&'a Path),
}

/// One who is asked before everything that is done, and may forbid it.
pub trait Watch: fmt::Debug + Send + Sync {
    /// Returns the error with which the operation is to fail, where it is.
    ///
    /// # Errors
    /// Whatever the operation is to fail with.
    fn before(&self, operation: Operation<'_>) -> io::Result<()>;
}

/// Where files lie: the file system, or, in a test, one that is watched.
#[derive(Debug, Clone, Default)]
pub struct Disk(Option<Arc<dyn Watch>>);

impl PartialEq for Disk {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

impl Disk {
    /// The file system, watched.
    pub fn watched(watch: Arc<dyn Watch>) -> Self {
        Self(Some(watch))
    }

    fn before(&self, operation: Operation<'_>) -> io::Result<()> {
        match &self.0 {
            None => Ok(()),
            Some(watch) => watch.before(operation),
        }
    }

    fn open_with(&self, path: &Path, options: &OpenOptions) -> io::Result<DiskFile> {
        Ok(DiskFile { file: options.open(path)?, path: path.into(), disk: self.clone() })
    }

    /// Opens a file that is there, for reading.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn open(&self, path: &Path) -> io::Result<DiskFile> {
        self.open_with(path, OpenOptions::new().read(true))
    }

    /// Opens a file that is there, for reading and writing.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn open_to_write(&self, path: &Path) -> io::Result<DiskFile> {
        self.open_with(path, OpenOptions::new().read(true).write(true))
    }

    /// Makes a file that is not there, for reading and writing.
    ///
    /// # Errors
    /// When it is there or cannot be made.
    pub fn create_new(&self, path: &Path) -> io::Result<DiskFile> {
        self.before(Operation::Create(path))?;
        self.open_with(path, OpenOptions::new().read(true).write(true).create_new(true))
    }

    /// Opens a file for reading and writing, or makes it.
    ///
    /// # Errors
    /// When it can be neither opened nor made.
    pub fn open_or_create(&self, path: &Path) -> io::Result<DiskFile> {
        if !path.exists() {
            self.before(Operation::Create(path))?;
        }
        let mut options = OpenOptions::new();
        self.open_with(path, options.read(true).write(true).create(true).truncate(false))
    }

    /// Gives a file another name, in one step; the file of that name goes.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.before(Operation::Rename { from, to })?;
        fs::rename(from, to)
    }

    /// Removes a file.
    ///
    /// # Errors
    /// When it is not there, or the system refuses.
    pub fn remove(&self, path: &Path) -> io::Result<()> {
        self.before(Operation::Remove(path))?;
        fs::remove_file(path)
    }

    /// Makes durable what was done to the names in a folder.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn sync_folder(&self, path: &Path) -> io::Result<()> {
        self.before(Operation::SyncFolder(path))?;
        File::open(path)?.sync_all()
    }
}

/// A file of a disk.
#[derive(Debug)]
pub struct DiskFile {
    file: File,
    path: Box<Path>,
    disk: Disk,
}

impl From<File> for DiskFile {
    /// A file that nobody watches.
    fn from(file: File) -> Self {
        Self { file, path: Path::new("").into(), disk: Disk::default() }
    }
}

impl DiskFile {
    /// The file itself: for locks and maps, and not for writing.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// The disk that it lies on.
    pub fn disk(&self) -> &Disk {
        &self.disk
    }

    /// The file once more.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn try_clone(&self) -> io::Result<Self> {
        let Self { file, path, disk } = self;
        Ok(Self { file: file.try_clone()?, path: path.clone(), disk: disk.clone() })
    }

    /// The file once more, opened for direct writing: of whole pages from aligned places in memory, past the page
    /// cache.
    ///
    /// # Errors
    /// When the file system cannot do that.
    pub fn open_direct(&self) -> io::Result<Self> {
        let flags = OFlags::DIRECT.bits().cast_signed();
        self.disk.open_with(&self.path, OpenOptions::new().write(true).custom_flags(flags))
    }

    /// Bytes in the file.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn length(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Fills `out` with the bytes from `offset` on.
    ///
    /// # Errors
    /// When there are not so many, or they cannot be read.
    pub fn read_exact_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        let (path, bytes) = (&*self.path, out.len());
        self.disk.before(Operation::Read { path, offset, bytes })?;
        self.file.read_exact_at(out, offset)
    }

    /// Writes all bytes from `offset` on.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn write_all_at(&self, bytes: &[u8], offset: u64) -> io::Result<()> {
        self.disk.before(Operation::Write { path: &self.path, offset, bytes })?;
        self.file.write_all_at(bytes, offset)
    }

    /// Cuts the file off, or makes it longer by zeros.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn set_len(&self, bytes: u64) -> io::Result<()> {
        self.disk.before(Operation::SetLength { path: &self.path, bytes })?;
        self.file.set_len(bytes)
    }

    /// Makes the file one of `bytes` zeros whose blocks are all taken.
    ///
    /// # Errors
    /// When there is no room for it.
    pub fn take_blocks(&self, bytes: u64) -> io::Result<()> {
        self.disk.before(Operation::SetLength { path: &self.path, bytes })?;
        match fallocate(&self.file, FallocateFlags::empty(), 0, bytes) {
            // Some network file systems cannot: then the zeros are written.
            Err(Errno::OPNOTSUPP | Errno::NOSYS) => {
                io::copy(&mut io::Read::take(io::repeat(0), bytes), &mut &self.file).map(drop)
            }
            taken => Ok(taken?),
        }
    }

    /// Makes durable what was written, and the file's length.
    ///
    /// # Errors
    /// When the system cannot.
    pub fn sync_data(&self) -> io::Result<()> {
        self.disk.before(Operation::Sync(&self.path))?;
        self.file.sync_data()
    }

    /// Makes durable what was written, and all that the file system keeps of the file.
    ///
    /// # Errors
    /// When the system cannot.
    pub fn sync_all(&self) -> io::Result<()> {
        self.disk.before(Operation::Sync(&self.path))?;
        self.file.sync_all()
    }
}
