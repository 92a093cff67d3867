//! `octavo completions`: a script that completes commands and flags.

use super::Octavo;
use crate::exit::Answer;
use clap::{Args, CommandFactory};
use clap_complete::Shell;
use std::io::{self, Write};

/// Print a completion script for a shell
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  octavo completions bash > /etc/bash_completion.d/octavo")]
pub(super) struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Octavo::command(), "octavo", &mut script);
        io::stdout().write_all(&script)?;
        Ok(Answer::Done)
    }
}
