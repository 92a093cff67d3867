//! Which plots there are, and what they show.

use super::axis::{Axis, Scale};
use super::drawing::{Area, LAYOUTS, Layout, Shape, frame, mark, picture};
use super::labels::write_labels;
use super::report::{Report, short};
use super::view::ViewReading;
use anyhow::anyhow;
use plotters::prelude::*;
use preprocess::tradeoff::{LevelReading, RungReading};

/// A picture of every size, with words for those who do not see it.
#[derive(Debug)]
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) svgs: Vec<String>,
}

impl Plot {
    fn draw(
        title: &str,
        description: &str,
        draw: impl Fn(&Layout, &Area<'_>) -> anyhow::Result<()>,
    ) -> anyhow::Result<Self> {
        let svgs = LAYOUTS
            .iter()
            .map(|layout| picture(layout, title, description, |area| draw(layout, area)));
        Ok(Self { title: title.to_owned(), svgs: svgs.collect::<anyhow::Result<_>>()? })
    }
}

/// A mark's colour says what became of the samples.
fn colour_of(rung: &RungReading) -> RGBColor {
    match rung.encoding.as_str() {
        _ if rung.empty_below.is_some() => RGBColor(0xa0, 0x5a, 0xc0),
        "lossless" => RGBColor(0x1f, 0x8a, 0x4c),
        "u8" => RGBColor(0x2b, 0x7b, 0xd6),
        _ => RGBColor(0xe0, 0x6c, 0x1c),
    }
}

/// What the colours and shapes mean, for the page.
pub(super) const LEGEND: [(&str, RGBColor); 4] = [
    ("lossless", RGBColor(0x1f, 0x8a, 0x4c)),
    ("u8", RGBColor(0x2b, 0x7b, 0xd6)),
    ("max-error", RGBColor(0xe0, 0x6c, 0x1c)),
    ("empty bricks dropped", RGBColor(0xa0, 0x5a, 0xc0)),
];

/// `max-error=5 small` is long beside a point.
pub(super) fn label_of(rung: &RungReading) -> String {
    rung.name
        .replace("max-error=", "E=")
        .replace("without empty", "drop")
        .replace("small assembled", "assembled")
}

/// A figure of a rung: its name, its axis in words, and how that is divided.
type Figure = (&'static str, &'static str, Scale, fn(&RungReading) -> Option<f64>);

/// All plots, in the page's order.
pub(super) fn all(report: &Report) -> anyhow::Result<Vec<Plot>> {
    let errors: [Figure; 3] = [
        ("AMAX", "largest error (AMAX), source units", Scale::Log, |r| positive(r.amax)),
        ("RMS", "root mean square error (RMS), source units", Scale::Log, |r| positive(r.rms)),
        ("PSNR", "PSNR, dB", Scale::Linear, |r| r.psnr_db),
    ];
    let costs: [Figure; 3] = [
        ("bits a voxel", "bits a voxel, whole file", Scale::Log, |r| Some(r.file_bits_per_voxel)),
        ("conversion speed", "conversion, MB/s", Scale::Log, |r| Some(r.encode_mb_per_sec)),
        ("decoding speed", "decoding cores on one thread, MB/s", Scale::Log, |r| {
            Some(r.decode_mb_per_sec_one_thread)
        }),
    ];
    let mut plots = Vec::new();
    for (cost, cost_axis, cost_scale, cost_of) in costs {
        for (error, error_axis, error_scale, error_of) in errors {
            let points: Vec<Point> = report
                .rungs
                .iter()
                .map(|rung| Point {
                    label: label_of(rung),
                    colour: colour_of(rung),
                    shape: Shape::of(rung),
                    at: [error_of(rung), cost_of(rung)],
                })
                .collect();
            let title = format!("{} over {error}", capital(cost));
            let edge = if error_scale == Scale::Log { "0" } else { "exact" };
            let axes = [(error_axis, error_scale, edge), (cost_axis, cost_scale, "none")];
            plots.push(scatter(&title, &points, axes)?);
        }
    }
    plots.push(by_level("RMS", report, |level| (level.deviation_rms, level.rms_bound))?);
    plots.push(by_level("AMAX", report, |level| (level.deviation_amax, level.amax_bound))?);
    Ok(plots)
}

/// What a picture's time buys.
pub(super) fn of_view(reading: &ViewReading) -> anyhow::Result<Plot> {
    let accuracies: Vec<f64> = {
        let mut all: Vec<_> = reading.pictures.iter().map(|picture| picture.accuracy).collect();
        all.dedup();
        all
    };
    let points: Vec<Point> = reading
        .pictures
        .iter()
        .map(|picture| {
            let place = accuracies.iter().position(|accuracy| *accuracy == picture.accuracy);
            Point {
                label: picture.name(),
                colour: LEGEND[place.unwrap_or(0) % LEGEND.len()].1,
                shape: Shape::Circle,
                at: [positive(picture.frame_ms), picture.psnr_db],
            }
        })
        .collect();
    let axes = [
        ("milliseconds a frame", Scale::Log, "0"),
        ("PSNR against the source, dB", Scale::Linear, "exact"),
    ];
    scatter("PSNR over time a frame; points are named by pixels a voxel and step", &points, axes)
}

fn positive(value: f64) -> Option<f64> {
    (value > 0.0).then_some(value)
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

struct Point {
    label: String,
    colour: RGBColor,
    shape: Shape,
    at: [Option<f64>; 2],
}

fn scatter(
    title: &str,
    points: &[Point],
    [x, y]: [(&str, Scale, &str); 2],
) -> anyhow::Result<Plot> {
    let axis_of = |axis: usize, (_, scale, edge): (&str, Scale, &str)| {
        let values: Vec<_> = points.iter().map(|point| point.at[axis]).collect();
        Axis::new(&values, scale, edge)
    };
    let axes = [axis_of(0, x), axis_of(1, y)];
    let words = |value: Option<f64>, edge: &str| value.map_or(edge.to_owned(), short);
    let described: Vec<_> = points
        .iter()
        .map(|p| format!("{}: {}, {}", p.label, words(p.at[0], x.2), words(p.at[1], y.2)))
        .collect();
    let description = format!("{} and {} of each way: {}.", x.0, y.0, described.join("; "));
    Plot::draw(title, &description, |layout, area| {
        let mut chart = frame(layout, area, &axes, [x.0, y.0])?;
        let places: Vec<_> =
            points.iter().map(|point| (axes[0].at(point.at[0]), axes[1].at(point.at[1]))).collect();
        let pixels: Vec<_> = places.iter().map(|place| chart.backend_coord(place)).collect();
        for (point, place) in points.iter().zip(&places) {
            mark(&mut chart, *place, point.shape, point.colour)?;
        }
        let labels: Vec<_> = (1..)
            .zip(points.iter().zip(&pixels))
            .map(|(number, (point, at))| {
                let name = if layout.names { point.label.clone() } else { format!("{number}") };
                (name, *at, point.colour)
            })
            .collect();
        write_labels(layout, area, &labels, chart.plotting_area().get_pixel_range())
    })
}

/// The rungs whose levels are drawn: each way to store samples once, the coarsest and the finest bound.
fn drawn_by_level(report: &Report) -> Vec<&RungReading> {
    let plain = || {
        report.rungs.iter().filter(|rung| rung.effort == "balanced" && rung.empty_below.is_none())
    };
    let named = |name: &str| plain().find(|rung| rung.encoding == name);
    let bounded = plain().filter(|rung| rung.encoding.starts_with("max-error"));
    let coarsest = bounded.max_by(|a, b| a.amax.total_cmp(&b.amax));
    [named("lossless"), named("u8"), coarsest].into_iter().flatten().collect()
}

fn by_level(
    measure: &str,
    report: &Report,
    of: fn(&LevelReading) -> (f64, f64),
) -> anyhow::Result<Plot> {
    let rungs = drawn_by_level(report);
    let title = format!("Deviation from full resolution by level, {measure}");
    let figures = || rungs.iter().flat_map(|rung| rung.levels.iter().map(of));
    let values: Vec<_> =
        figures().flat_map(|(measured, bound)| [positive(measured), positive(bound)]).collect();
    let top = rungs.first().map_or(0, |rung| rung.levels.len().saturating_sub(1));
    let y = Axis::new(&values, Scale::Log, "0");
    let x = Axis::counting(top);
    let described: Vec<_> = rungs
        .iter()
        .map(|rung| {
            let levels: Vec<_> = rung
                .levels
                .iter()
                .map(|level| {
                    let (measured, bound) = of(level);
                    format!("level {} {} of at most {}", level.level, short(measured), short(bound))
                })
                .collect();
            format!("{}: {}", label_of(rung), levels.join(", "))
        })
        .collect();
    let description =
        format!("Measured, and the bound that the store states. {}.", described.join("; "));
    let axes = [x, y];
    Plot::draw(&title, &description, |layout, area| {
        let failed = |error| anyhow!("drawing failed: {error}");
        let words = ["level; dashed lines are the stored bound", "deviation, source units"];
        let mut chart = frame(layout, area, &axes, words)?;
        let mut labels = Vec::new();
        for rung in &rungs {
            let colour = colour_of(rung);
            let line = |pick: fn((f64, f64)) -> f64| -> Vec<(f64, f64)> {
                rung.levels
                    .iter()
                    .map(|level| (f64::from(level.level), axes[1].at(positive(pick(of(level))))))
                    .collect()
            };
            let (measured, bound) = (line(|pair| pair.0), line(|pair| pair.1));
            chart
                .draw_series(DashedLineSeries::new(bound, 6, 4, colour.stroke_width(2)))
                .map_err(failed)?;
            chart
                .draw_series([PathElement::new(measured.clone(), colour.stroke_width(2))])
                .map_err(failed)?;
            for at in &measured {
                mark(&mut chart, *at, Shape::Circle, colour)?;
            }
            // At full resolution the ways lie farthest apart.
            if let Some(first) = measured.first() {
                labels.push((label_of(rung), chart.backend_coord(first), colour));
            }
        }
        write_labels(layout, area, &labels, chart.plotting_area().get_pixel_range())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(label: &str, at: [Option<f64>; 2]) -> Point {
        Point { label: label.into(), colour: LEGEND[0].1, shape: Shape::Circle, at }
    }

    #[test]
    fn a_picture_says_what_it_shows_and_asks_for_nothing_else() {
        let points = [
            point("exact", [None, Some(9.0)]),
            point("a < b", [Some(0.5), Some(3.0)]),
            point("c", [Some(40.0), Some(2.0)]),
        ];
        let axes = [("error", Scale::Log, "0"), ("bits", Scale::FromZero, "none")];
        let plot = scatter("Bits & error", &points, axes).unwrap();
        assert_eq!(plot.svgs.len(), 2);
        for svg in &plot.svgs {
            assert!(svg.contains(">Bits &amp; error</title>"), "{svg}");
            assert!(svg.contains("a &lt; b: 0.5, 3"));
            assert_eq!(svg.matches("<circle").count(), 3);
            assert!(
                svg.contains("\n0\n</text>"),
                "the column of what has no error has its word: {svg}"
            );
            assert!(!svg.replace("http://www.w3.org/2000/svg", "").contains("http"));
        }
    }
}
