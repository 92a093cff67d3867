//! What a person is told in the terminal.

use super::report::{Report, short};
use std::io::{self, Write};
use std::path::Path;

pub(super) fn print(report: &Report, folder: &Path) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(
        out,
        "{:<28} {:>8} {:>9} {:>9} {:>7} {:>8} {:>8} {:>8}",
        "", "bits a", "", "", "PSNR", "convert", "decode", "random"
    )?;
    writeln!(
        out,
        "{:<28} {:>8} {:>9} {:>9} {:>7} {:>8} {:>8} {:>8}",
        "", "voxel", "RMS", "AMAX", "dB", "MB/s", "MB/s", "us"
    )?;
    for rung in &report.rungs {
        writeln!(
            out,
            "{:<28} {:>8.2} {:>9} {:>9} {:>7} {:>8.0} {:>8.0} {:>8.1}",
            rung.name,
            rung.file_bits_per_voxel,
            short(rung.rms),
            short(rung.amax),
            rung.psnr_db.map_or("-".to_owned(), |psnr| format!("{psnr:.1}")),
            rung.encode_mb_per_sec,
            rung.decode_mb_per_sec_one_thread,
            rung.random_read_micros
        )?;
    }
    writeln!(out)?;
    for wish in &report.wishes {
        match &wish.command {
            Some(command) => writeln!(out, "{}:\n  {command}", wish.words())?,
            None => writeln!(out, "{}: none of these", wish.words())?,
        }
    }
    if let Some(view) = &report.view {
        let [width, height] = view.size;
        writeln!(out, "\na view of {width} x {height} pixels by {}:", view.adapter)?;
        writeln!(
            out,
            "  {:>14} {:>6} {:>8} {:>8} {:>8} {:>7}",
            "pixels a voxel", "step", "ms", "bricks", "MB", "PSNR dB"
        )?;
        for picture in &view.pictures {
            writeln!(
                out,
                "  {:>14} {:>6} {:>8.1} {:>8} {:>8.2} {:>7}",
                picture.accuracy,
                picture.step_voxels,
                picture.frame_ms,
                picture.bricks,
                picture.bytes as f64 / 1e6,
                picture.psnr_db.map_or("-".to_owned(), |psnr| format!("{psnr:.1}"))
            )?;
        }
    }
    writeln!(
        out,
        "\n{:.1} % of the volume measured; decoding on one thread; reports in {}",
        100.0 * report.sample.fraction,
        folder.display()
    )
}
