//! `octavo`: volumes become stores, and stores can be looked into.

mod chart;
mod commands;
mod exit;
mod lettering;
mod numbers;
mod parse;
mod picture;
mod progress;
mod text;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    exit::code_of(commands::Octavo::parse().run())
}
