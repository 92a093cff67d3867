//! Exit codes: 0 done; 1 the command worked and the answer is no; 2 wrong usage or unusable input;
//! 3 the environment failed.

use octree_store::StoreError;
use preprocess::{PreprocessError, SourceError};
use render_check::RenderError;
use std::io;
use std::process::ExitCode;

/// What a command found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    /// It did what was asked.
    Done,
    /// It worked, and the answer is no.
    No,
}

/// Says what went wrong, on stderr, and gives the exit code.
pub(crate) fn code_of(result: anyhow::Result<Answer>) -> ExitCode {
    match result {
        Ok(Answer::Done) => ExitCode::SUCCESS,
        Ok(Answer::No) => ExitCode::from(1),
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("octavo: {}", message(&error));
            ExitCode::from(code_of_error(&error))
        }
    }
}

/// The exit code of an error.
pub(crate) fn code_of_error(error: &anyhow::Error) -> u8 {
    if is_environment(error) { 3 } else { 2 }
}

/// Our own errors say all that their causes say; others are told with their causes.
pub(crate) fn message(error: &anyhow::Error) -> String {
    let own = error.is::<PreprocessError>()
        || error.is::<SourceError>()
        || error.is::<StoreError>()
        || error.is::<RenderError>();
    let said = if own { error.to_string() } else { format!("{error:#}") };
    let full = |error: &io::Error| {
        matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
    };
    let full = error.chain().any(|cause| cause.downcast_ref::<io::Error>().is_some_and(full));
    // Messages on scratch space say so already.
    if full && !said.contains("free ") {
        return format!("{said}: free some space there, or write to another disk");
    }
    said
}

/// Whoever read our output has seen enough.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let io = cause.downcast_ref::<io::Error>();
        let viuer = cause.downcast_ref::<viuer::ViuError>();
        io.is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
            || matches!(viuer, Some(viuer::ViuError::Io(error)) if error.kind() == io::ErrorKind::BrokenPipe)
    })
}

fn is_environment(error: &anyhow::Error) -> bool {
    if let Some(error) = error.downcast_ref::<PreprocessError>() {
        error.is_environment()
    } else if let Some(error) = error.downcast_ref::<StoreError>() {
        error.is_environment()
    } else if let Some(error) = error.downcast_ref::<SourceError>() {
        error.is_environment()
    } else if let Some(error) = error.downcast_ref::<RenderError>() {
        error.is_environment()
    } else {
        error.is::<io::Error>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn a_full_disk_is_the_environments_fault_and_a_missing_file_the_users() {
        let failed = |kind: io::ErrorKind| {
            PreprocessError::from(StoreError::Io { path: "a".into(), source: kind.into() })
        };
        assert!(is_environment(&failed(io::ErrorKind::StorageFull).into()));
        let said = message(&failed(io::ErrorKind::StorageFull).into());
        assert!(said.starts_with("a: ") && said.ends_with("write to another disk"), "{said}");
        assert!(!is_environment(&failed(io::ErrorKind::PermissionDenied).into()));
        assert!(!is_environment(&SourceError::Missing { path: "a".into() }.into()));
        let written: Result<(), _> = Err(io::Error::from(io::ErrorKind::StorageFull));
        assert!(is_environment(&written.context("a.png").unwrap_err()));
    }
}
