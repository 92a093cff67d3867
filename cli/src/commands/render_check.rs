//! `octavo render-check`: a store proved by its pictures.

use super::render::{DeviceArgs, data_range, read_source, transfer_of};
use super::{RawArgs, SeriesArgs, print_json, write_whole};
use crate::exit::Answer;
use anyhow::Context;
use clap::Args;
use octree_store::Store;
use preprocess::PreprocessError;
use render_check::check::{CheckOptions, Checked, check, looks, page};
use render_check::picture::{Bits, write_png};
use render_check::view::Look;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Hold a store's pictures against its source
///
/// Eleven views (six along axes, three oblique, one inside, one grazing), each opaque, transparent and as a surface, at full
/// resolution. Exit code 1 if any is under the limit.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    octavo render-check tooth.octavo --against tooth.nii.gz\n  \
    octavo render-check tooth.octavo --against tooth.nii.gz -o pictures --backend cpu")]
pub(super) struct RenderCheck {
    /// The store
    store: PathBuf,
    /// The volume that it was made of
    #[arg(long, value_name = "SOURCE")]
    against: PathBuf,
    /// Folder for index.html and the pictures
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Least PSNR of each picture, in dB; surfaces, whose pixels at silhouettes are all or nothing, may have 5 less
    #[arg(long, value_name = "D", default_value_t = 40.0)]
    min_psnr: f64,
    /// Transfer function as JSON: control points, or a colour map by name [default: chosen from the values]
    #[arg(long, value_name = "FILE.json")]
    transfer: Option<PathBuf>,
    /// Distance of samples, in voxels
    #[arg(long, value_name = "VOXELS", default_value_t = 0.5)]
    step: f64,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    raw: RawArgs,
    #[command(flatten)]
    series: SeriesArgs,
    /// Replace existing files
    #[arg(long)]
    force: bool,
    /// Print JSON (schema octavo.render-check/1)
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    schema: &'static str,
    ok: bool,
    min_psnr_db: f64,
    backend: &'static str,
    adapter: String,
    pictures: &'a [Checked],
}

impl RenderCheck {
    pub(super) fn run(self) -> anyhow::Result<Answer> {
        if let Some(page) = self.output.as_ref().map(|folder| folder.join("index.html"))
            && page.exists()
            && !self.force
        {
            return Err(PreprocessError::Exists { path: page }.into());
        }
        let store = Store::open(&self.store)?;
        let metadata = store.metadata().clone();
        let source = read_source(&self.against, &self.raw, &self.series, &store)?;
        let look = Look::new(transfer_of(self.transfer.as_deref(), &store)?, data_range(&store));
        let options = CheckOptions {
            min_psnr_db: self.min_psnr,
            step_voxels: self.step,
            ..CheckOptions::default()
        };
        let looks = looks(&look.transfer, data_range(&store), &options)?;
        let mut renderer = self.device.renderer(store, true)?;
        let mut said = Ok(());
        let checked = check(&mut renderer, &metadata, &source, &looks, &options, |checked| {
            if !self.json && said.is_ok() {
                said = tell(checked);
            }
        })?;
        said?;
        if let Some(folder) = &self.output {
            self.write(folder, &checked)?;
        }
        let ok = checked.iter().all(|checked| checked.ok);
        for problem in checked.last().into_iter().flat_map(|last| &last.problems) {
            eprintln!("octavo: {problem}");
        }
        if self.json {
            print_json(&Report {
                schema: "octavo.render-check/1",
                ok,
                min_psnr_db: self.min_psnr,
                backend: renderer.backend().kind(),
                adapter: renderer.backend().adapter(),
                pictures: &checked,
            })?;
        }
        Ok(if ok { Answer::Done } else { Answer::No })
    }

    fn write(&self, folder: &Path, checked: &[Checked]) -> anyhow::Result<()> {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        for check in checked {
            for (which, shown) in check.pictures.iter().enumerate() {
                write_whole(&folder.join(file_name(check, which)), self.force, |file| {
                    write_png(file, shown, Bits::Eight, "{}")
                })?;
            }
        }
        let title = format!("{} against {}", self.store.display(), self.against.display());
        let html = page(&title, self.min_psnr, checked, file_name);
        write_whole(&folder.join("index.html"), self.force, |file| file.write_all(html.as_bytes()))
    }
}

fn file_name(check: &Checked, which: usize) -> String {
    let view = check.view.replace('-', "_low").replace('+', "_high");
    format!("{view}_{}_{}.png", check.look, ["store", "source", "difference"][which])
}

fn tell(checked: &Checked) -> std::io::Result<()> {
    let psnr = checked.comparison.psnr_db.map_or("same".to_owned(), |db| format!("{db:.1}"));
    let verdict = match checked {
        Checked { ok: true, .. } => "",
        Checked { problems, .. } if !problems.is_empty() => "  the store is damaged",
        Checked { limited: true, .. } => "  below the limit: more --slots would show more",
        _ => "  below the limit",
    };
    writeln!(
        std::io::stdout().lock(),
        "{:9} {:12} PSNR {psnr:>6} dB  SSIM {:.5}  largest {:.4}  mean delta E {:.3}{verdict}",
        checked.view,
        checked.look,
        checked.comparison.ssim,
        checked.comparison.max_abs_diff,
        checked.comparison.mean_delta_e
    )
}
