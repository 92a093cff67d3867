//! The program as its users meet it: arguments, files, JSON, exit codes.

mod bad_input;
mod commands;
mod damage;
mod help;
mod nibabel;
mod samples;
mod sharing;
mod support;
