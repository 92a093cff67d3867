//! Writes the seeds of every parser: `seeds FOLDER [MORE]`; FOLDER gets a folder a parser, MORE has further volume files.

#![allow(clippy::unwrap_used, reason = "what cannot be written ends it")]

use std::path::PathBuf;

fn main() {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let Some(folder) = arguments.next() else {
        eprintln!("seeds FOLDER [MORE]");
        std::process::exit(2);
    };
    let more = arguments.next();
    for (name, _) in fuzz::ORACLES {
        let folder = folder.join(name);
        std::fs::create_dir_all(&folder).unwrap();
        for (number, seed) in fuzz::seeds(name, more.as_deref()).into_iter().enumerate() {
            std::fs::write(folder.join(format!("seed-{number:03}")), seed).unwrap();
        }
    }
}
