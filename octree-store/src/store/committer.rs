//! Commits of a store in the making, on a thread of their own: the writer goes on meanwhile.
//!
//! A commit first makes durable what its records speak of (payloads, and what else was named), then
//! writes the records. So a record that is found after a power cut has its payload.

use super::guard::Failure;
use super::tables::{Group, WriteTables};
use crate::disk::DiskFile;
use crate::error::StoreError;
use redb::Database;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;

/// What one commit makes durable.
#[derive(Debug)]
pub(super) struct Commit {
    pub(super) groups: Vec<Group>,
    /// How far the work is.
    pub(super) state: Vec<u8>,
    /// What [`Committer::done`] answers once it is durable.
    pub(super) mark: u64,
}

/// The thread, and the way to and from it.
#[derive(Debug)]
pub(super) struct Committer {
    path: PathBuf,
    jobs: Option<SyncSender<Commit>>,
    done: Receiver<Result<u64, Failure>>,
    thread: Option<JoinHandle<Database>>,
    /// Commits that were asked for and have not been heard of.
    waiting: usize,
    /// The mark of the last commit that is durable.
    mark: u64,
}

impl Committer {
    /// Starts the thread; it syncs `files` before each commit.
    pub(super) fn start(
        database: Database,
        files: Vec<Arc<DiskFile>>,
        path: &Path,
    ) -> Result<Self, StoreError> {
        // One commit at work and one waiting: more would only hold memory.
        let (jobs, inbox) = sync_channel::<Commit>(1);
        let (outbox, done) = sync_channel(4);
        let thread = std::thread::Builder::new()
            .name("commit".into())
            .spawn(move || {
                for job in inbox {
                    let outcome = commit(&database, &files, &job).map(|()| job.mark);
                    let failed = outcome.is_err();
                    if outbox.send(outcome).is_err() || failed {
                        break;
                    }
                }
                database
            })
            .map_err(|source| StoreError::Io { path: path.to_owned(), source })?;
        Ok(Self {
            path: path.to_owned(),
            jobs: Some(jobs),
            done,
            thread: Some(thread),
            waiting: 0,
            mark: 0,
        })
    }

    /// Asks for a commit; waits only while two others are under way.
    pub(super) fn send(&mut self, commit: Commit) -> Result<(), StoreError> {
        self.take_answers()?;
        self.waiting += 1;
        let sent = self.jobs.as_ref().is_some_and(|jobs| jobs.send(commit).is_ok());
        // The thread ends before its time only with an error that it has sent.
        if sent { Ok(()) } else { self.wait() }
    }

    /// The mark of the last commit that is durable, as far as is known.
    pub(super) fn mark(&mut self) -> Result<u64, StoreError> {
        self.take_answers()?;
        Ok(self.mark)
    }

    /// The mark of the last commit that is known to be durable, whatever became of later ones.
    pub(super) fn last_mark(&self) -> u64 {
        self.mark
    }

    fn take_answers(&mut self) -> Result<(), StoreError> {
        loop {
            match self.done.try_recv() {
                Ok(answer) => self.take(answer)?,
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return Ok(()),
            }
        }
    }

    fn take(&mut self, answer: Result<u64, Failure>) -> Result<(), StoreError> {
        self.waiting -= 1;
        self.mark = answer.map_err(|failure| failure.at(&self.path))?;
        Ok(())
    }

    /// Waits until everything that was asked for is durable.
    pub(super) fn wait(&mut self) -> Result<(), StoreError> {
        while self.waiting > 0 {
            match self.done.recv() {
                Ok(answer) => self.take(answer)?,
                Err(_) => return Err(stopped(&self.path)),
            }
        }
        Ok(())
    }

    /// Waits for all commits and gives the database back.
    pub(super) fn finish(mut self) -> Result<Database, StoreError> {
        self.wait()?;
        drop(self.jobs.take());
        let joined = self.thread.take().map(JoinHandle::join);
        joined.and_then(Result::ok).ok_or_else(|| stopped(&self.path))
    }
}

impl Drop for Committer {
    fn drop(&mut self) {
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            // What it could not commit is no loss to one who gives up.
            let _ = thread.join();
        }
    }
}

fn stopped(path: &Path) -> StoreError {
    let what = "the commit thread stopped unexpectedly: this is a bug in octavo".into();
    StoreError::Database { path: path.to_owned(), what }
}

fn commit(database: &Database, files: &[Arc<DiskFile>], job: &Commit) -> Result<(), Failure> {
    for file in files {
        file.sync_data().map_err(Failure::Io)?;
    }
    let transaction = WriteTables::begin(database)?;
    transaction.write_groups(&job.groups)?;
    transaction.set_state(&job.state)?;
    transaction.commit()
}
