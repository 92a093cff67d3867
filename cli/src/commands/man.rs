//! `octavo man`: the manual pages.

use super::{Octavo, write_whole};
use crate::exit::Answer;
use clap::{Args, CommandFactory};
use clap_mangen::Man as Page;
use std::io::{self, Write};
use std::path::PathBuf;

/// Print the manual, or write a page for each command into a folder
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  octavo man | man -l -\n  octavo man -o /usr/local/share/man/man1"
)]
pub(super) struct Man {
    /// Write octavo.1, octavo-convert.1 and so on into this folder
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Replace existing pages
    #[arg(long)]
    force: bool,
}

impl Man {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        let mut root = Octavo::command();
        root.build();
        let Some(folder) = self.output else {
            let mut page = Vec::new();
            Page::new(root).render(&mut page)?;
            io::stdout().write_all(&page)?;
            return Ok(Answer::Done);
        };
        let commands: Vec<_> = root.get_subcommands().cloned().collect();
        for command in commands {
            let page = Page::new(command);
            write_whole(&folder.join(page.get_filename()), self.force, |mut file| {
                page.render(&mut file)
            })?;
        }
        let page = Page::new(root);
        write_whole(&folder.join("octavo.1"), self.force, |mut file| page.render(&mut file))?;
        Ok(Answer::Done)
    }
}
