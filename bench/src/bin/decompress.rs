//! How long decompression alone takes, by the libraries that Octavo's sources use.
//!
//! `cargo run --release -p bench --bin decompress -- FILE.nii.gz | FOLDER`
//!
//! A `.gz` file is inflated (flate2 with zlib-rs) by one thread, as its stream allows no more. A TIFF
//! file, or a folder of them, is decoded page by page (the crate `tiff`), a file a task. The bytes
//! are counted and thrown away.

use anyhow::{Context, bail, ensure};
use clap::Parser;
use flate2::bufread::MultiGzDecoder;
use rayon::prelude::*;
use serde::Serialize;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::Instant;
use tiff::decoder::{Decoder, DecodingResult, Limits};

/// Decompress a .gz file or a folder of TIFF files, and nothing else
#[derive(Debug, Parser)]
struct Arguments {
    /// A .gz file, a TIFF file, or a folder of TIFF files
    input: PathBuf,
    /// Threads for the files of a folder
    #[arg(long, default_value_t = 2)]
    threads: usize,
}

/// The line of JSON that is printed.
#[derive(Debug, Serialize)]
struct Report {
    seconds: f64,
    bytes_read: u64,
    bytes_decompressed: u64,
    files: usize,
    threads: usize,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let started = Instant::now();
    let files = files_of(&arguments.input)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.min(files.len()))
        .thread_name(|index| format!("decompress-{index}"))
        .build()?;
    let one = |path: &PathBuf| -> anyhow::Result<[u64; 2]> {
        let read = path.metadata()?.len();
        Ok([read, decompress(path).with_context(|| format!("cannot read {}", path.display()))?])
    };
    let [bytes_read, bytes_decompressed] = pool.install(|| {
        files.par_iter().map(one).try_reduce(|| [0; 2], |a, b| Ok([a[0] + b[0], a[1] + b[1]]))
    })?;
    let report = Report {
        seconds: started.elapsed().as_secs_f64(),
        bytes_read,
        bytes_decompressed,
        files: files.len(),
        threads: pool.current_num_threads(),
    };
    println!("{}", serde_json::to_string(&report)?);
    Ok(())
}

/// The file itself, or a folder's TIFF files.
fn files_of(input: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !input.is_dir() {
        return Ok(vec![input.to_owned()]);
    }
    let mut files = Vec::new();
    for entry in input.read_dir()? {
        let path = entry?.path();
        if path.extension().is_some_and(|ext| ext == "tif" || ext == "tiff") {
            files.push(path);
        }
    }
    ensure!(!files.is_empty(), "{} has no .tif and no .tiff files", input.display());
    files.sort();
    Ok(files)
}

/// Decompresses one file; tells how many bytes came out.
fn decompress(path: &Path) -> anyhow::Result<u64> {
    let reader = BufReader::with_capacity(1 << 20, File::open(path)?);
    match path.extension().and_then(|ext| ext.to_str()) {
        Some("gz") => inflate(reader),
        Some("tif" | "tiff") => decode(reader),
        _ => bail!("only .gz, .tif and .tiff are known"),
    }
}

fn inflate(reader: BufReader<File>) -> anyhow::Result<u64> {
    let mut decoder = MultiGzDecoder::new(reader);
    let mut buffer = vec![0; 1 << 20];
    let mut total = 0;
    loop {
        match decoder.read(&mut buffer)? {
            0 => return Ok(total),
            count => total += count as u64,
        }
    }
}

fn decode(reader: BufReader<File>) -> anyhow::Result<u64> {
    let mut decoder = Decoder::new(reader)?.with_limits(Limits::unlimited());
    let mut page = DecodingResult::U16(Vec::new());
    let mut total = 0;
    loop {
        // A page is decoded into the last one's buffer.
        decoder.read_image_to_buffer(&mut page)?;
        total += page.as_buffer(0).as_bytes().len() as u64;
        if !decoder.more_images() {
            return Ok(total);
        }
        decoder.next_image()?;
    }
}
