//! One place through which all redb calls go: a panic inside becomes an error.
//!
//! redb asserts on pages that make no sense; a damaged work index must not take the program down that goes on
//! with it, nor print to its stderr.

use crate::error::StoreError;
use std::cell::Cell;
use std::io;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::Once;

/// What a guarded call can fail with.
#[derive(Debug)]
pub(super) enum Failure {
    /// The system refused to read or write.
    Io(io::Error),
    /// Another process has the file.
    InUse,
    /// The file was not closed, and needs a writer to put it in order.
    NeedsRepair,
    /// redb found the file to be wrong, or panicked over it.
    Corrupt(String),
}

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Runs `call`; its errors and panics become a [`Failure`].
pub(super) fn guard<R, E: Into<redb::Error>>(
    call: impl FnOnce() -> Result<R, E>,
) -> Result<R, Failure> {
    silence_guarded_panics();
    let outer = GUARDED.replace(true);
    let result = panic::catch_unwind(AssertUnwindSafe(call));
    GUARDED.set(outer);
    match result {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(error.into().into()),
        Err(panic) => {
            let words = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("without a message");
            Err(Failure::Corrupt(format!("redb stopped: {words}")))
        }
    }
}

/// Wraps the panic hook once, so that it stays silent where a panic becomes an error.
fn silence_guarded_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                previous(info);
            }
        }));
    });
}

impl Failure {
    /// The failure of a file.
    pub(super) fn at(self, path: &Path) -> StoreError {
        let path = path.to_owned();
        match self {
            Self::Io(source) => StoreError::Io { path, source },
            Self::InUse => StoreError::InUse { path },
            Self::NeedsRepair => StoreError::Incomplete { path },
            Self::Corrupt(what) => StoreError::Database { path, what },
        }
    }
}

impl From<redb::Error> for Failure {
    fn from(error: redb::Error) -> Self {
        match error {
            redb::Error::Io(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                Self::Corrupt("the file is cut short".into())
            }
            redb::Error::Io(error) if error.kind() != io::ErrorKind::InvalidData => Self::Io(error),
            redb::Error::DatabaseAlreadyOpen => Self::InUse,
            redb::Error::RepairAborted => Self::NeedsRepair,
            other => Self::Corrupt(other.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use redb::StorageError;

    #[test]
    fn a_panic_becomes_an_error() {
        let result = guard(|| -> Result<(), StorageError> { panic!("page {} makes no sense", 7) });
        assert!(matches!(result, Err(Failure::Corrupt(what)) if what.contains("page 7")));
    }

    #[test]
    fn errors_of_the_system_are_told_from_damage() {
        let full = || Err::<(), _>(StorageError::Io(io::ErrorKind::StorageFull.into()));
        assert!(
            matches!(guard(full), Err(Failure::Io(error)) if error.kind() == io::ErrorKind::StorageFull)
        );
        let wrong = || Err::<(), _>(StorageError::Corrupted("x".into()));
        assert!(matches!(guard(wrong), Err(Failure::Corrupt(_))));
    }
}
