//! Histograms as charts: PNG and SVG by plotters, and in the terminal by textplots.

use crate::lettering::Lettered;
use anyhow::{anyhow, bail};
use plotters::prelude::*;
use preprocess::histogram::Histogram;
use std::fmt::Write;
use std::path::Path;
use textplots::{Chart, Plot, Shape};

const SIZE: (u32, u32) = (960, 540);

/// What a file name's ending asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Png,
    Svg,
}

impl Kind {
    pub(crate) fn of_name(path: &Path) -> anyhow::Result<Self> {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        match ending.to_str() {
            Some("png") => Ok(Self::Png),
            Some("svg") => Ok(Self::Svg),
            _ => bail!("{}: its name must end in .png or .svg", path.display()),
        }
    }
}

/// Draws a histogram; the counts' axis is logarithmic, since air outnumbers all else.
pub(crate) fn histogram(histogram: &Histogram, title: &str, kind: Kind) -> anyhow::Result<Vec<u8>> {
    match kind {
        Kind::Svg => {
            let mut text = String::new();
            let picture = SVGBackend::with_string(&mut text, SIZE);
            draw(&Lettered(picture).into_drawing_area(), histogram, title)?;
            Ok(text.into_bytes())
        }
        Kind::Png => {
            let mut pixels = vec![0; (SIZE.0 * SIZE.1 * 3) as usize];
            let picture = BitMapBackend::with_buffer(&mut pixels, SIZE);
            draw(&Lettered(picture).into_drawing_area(), histogram, title)?;
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, SIZE.0, SIZE.1);
            encoder.set_color(png::ColorType::Rgb);
            let mut writer = encoder.write_header()?;
            writer.write_image_data(&pixels)?;
            writer.finish()?;
            Ok(bytes)
        }
    }
}

fn draw<B: DrawingBackend>(
    area: &DrawingArea<B, plotters::coord::Shift>,
    histogram: &Histogram,
    title: &str,
) -> anyhow::Result<()> {
    let failed = |error: DrawingAreaErrorKind<B::ErrorType>| anyhow!("drawing failed: {error}");
    let most = histogram.counts.iter().copied().max().unwrap_or(1).max(1);
    let (low, high) = (histogram.edges[0], histogram.edges[histogram.counts.len()]);
    // Of an axis whose length is no number the chart would look for marks for ever.
    if !(high - low).is_finite() {
        bail!(
            "a range from {low:e} to {high:e} is too wide to be drawn: --json and --csv have its numbers"
        );
    }
    area.fill(&WHITE).map_err(failed)?;
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 22))
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(76)
        .build_cartesian_2d(low..high, (0.5..most as f64 * 1.5).log_scale())
        .map_err(failed)?;
    chart
        .configure_mesh()
        .x_desc("value")
        .y_desc("voxels")
        .label_style(("sans-serif", 14))
        .draw()
        .map_err(failed)?;
    let bars = histogram.edges.windows(2).zip(&histogram.counts).filter(|(_, count)| **count > 0);
    chart
        .draw_series(bars.map(|(edges, &count)| {
            Rectangle::new(
                [(edges[0], 0.5), (edges[1], count as f64)],
                RGBColor(48, 92, 140).filled(),
            )
        }))
        .map_err(failed)?;
    area.present().map_err(failed)
}

/// A histogram in characters: log10 of the counts over the values.
pub(crate) fn in_terminal(histogram: &Histogram) -> String {
    let low = histogram.edges[0] as f32;
    let high = histogram.edges[histogram.counts.len()] as f32;
    let points: Vec<(f32, f32)> = histogram
        .edges
        .windows(2)
        .zip(&histogram.counts)
        .map(|(edges, &count)| {
            (f64::midpoint(edges[0], edges[1]) as f32, (count.max(1) as f32).log10())
        })
        .collect();
    let mut text = String::from("log10 of voxels over values\n");
    let bars = Shape::Bars(&points);
    let mut chart = Chart::new(120, 40, low, high);
    let chart = chart.lineplot(&bars);
    chart.axis();
    chart.figures();
    let _ = writeln!(text, "{chart}");
    text
}
