//! The plots as SVG, by plotters.
//!
//! Colours are names in disguise: the page's style sheet gives ink and grid their colour by the value
//! that stands here, so that one picture serves light and dark.

use super::axis::{Axis, Scale};
use super::report::{Report, short};
use anyhow::anyhow;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use preprocess::tradeoff::{LevelReading, RungReading};

const SIZE: (u32, u32) = (720, 460);
/// Letters and axes; the style sheet's `--ink`.
pub(super) const INK: RGBColor = RGBColor(0x22, 0x22, 0x23);
/// Lines of the grid; the style sheet's `--grid`.
pub(super) const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdc);
const LETTER: u32 = 14;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// A picture with words for those who do not see it.
#[derive(Debug)]
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) svg: String,
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
fn label_of(rung: &RungReading) -> String {
    rung.name
        .replace("max-error=", "E=")
        .replace("without empty", "drop")
        .replace("small assembled", "assembled")
}

/// A figure of a rung: its name, its axis in words, and how that is divided.
type Figure = (&'static str, &'static str, Scale, fn(&RungReading) -> Option<f64>);

/// All plots, in the page's order.
pub(super) fn all(report: &Report) -> anyhow::Result<Vec<Plot>> {
    register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular())
        .map_err(|_| anyhow!("the font in this program is damaged"))?;
    let errors: [Figure; 3] = [
        ("AMAX", "largest error (AMAX), source units", Scale::Log, |r| positive(r.amax)),
        ("RMS", "root mean square error (RMS), source units", Scale::Log, |r| positive(r.rms)),
        ("PSNR", "PSNR, dB", Scale::Linear, |r| r.psnr_db),
    ];
    let costs: [Figure; 3] = [
        ("bits a voxel", "bits a voxel, whole file", Scale::FromZero, |r| {
            Some(r.file_bits_per_voxel)
        }),
        ("conversion speed", "conversion, MB/s", Scale::FromZero, |r| Some(r.encode_mb_per_sec)),
        ("decoding speed", "decoding cores on one thread, MB/s", Scale::FromZero, |r| {
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

/// A mark's shape says how much work went into small payloads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    Triangle,
    Circle,
    Square,
    /// The overlap is assembled.
    Cross,
}

impl Shape {
    fn of(rung: &RungReading) -> Self {
        match rung.effort {
            _ if !rung.stored_overlap => Self::Cross,
            "fast" => Self::Triangle,
            "small" => Self::Square,
            _ => Self::Circle,
        }
    }
}

/// Draws a picture, and puts title and description into it.
fn picture(
    title: &str,
    description: &str,
    draw: impl FnOnce(&Area<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<Plot> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        draw(&area)?;
        area.present().map_err(|error| anyhow!("drawing failed: {error}"))?;
    }
    let id: String =
        title.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    let (open, rest) = svg
        .split_once('>')
        .ok_or_else(|| anyhow!("drawing failed: the picture has no beginning"))?;
    // The page scales the picture: its size is in the view box.
    let open = open.replace(&format!("width=\"{}\" height=\"{}\" ", SIZE.0, SIZE.1), "");
    let svg = format!(
        "{open} role=\"img\" aria-labelledby=\"t-{id} d-{id}\"><title id=\"t-{id}\">{}</title>\
         <desc id=\"d-{id}\">{}</desc>{rest}",
        super::html::escaped(title),
        super::html::escaped(description)
    );
    Ok(Plot { title: title.to_owned(), svg })
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
    picture(title, &description, |area| {
        let mut chart = frame(area, &axes, [x.0, y.0])?;
        let places: Vec<_> =
            points.iter().map(|point| (axes[0].at(point.at[0]), axes[1].at(point.at[1]))).collect();
        let pixels: Vec<_> = places.iter().map(|place| chart.backend_coord(place)).collect();
        for (point, place) in points.iter().zip(&places) {
            mark(&mut chart, *place, point.shape, point.colour)?;
        }
        let labels: Vec<_> = points
            .iter()
            .zip(&pixels)
            .map(|(point, at)| (point.label.clone(), *at, point.colour))
            .collect();
        write_labels(area, &labels, chart.plotting_area().get_pixel_range())
    })
}

/// Axes, grid, and the columns of values without a place.
fn frame<'a, 'b>(
    area: &'a Area<'b>,
    [x, y]: &[Axis; 2],
    words: [&str; 2],
) -> anyhow::Result<Chart<'a, 'b>> {
    let failed = |error| anyhow!("drawing failed: {error}");
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_right(16)
        .x_label_area_size(46)
        .y_label_area_size(76)
        .build_cartesian_2d(x.low..x.high, y.low..y.high)
        .map_err(failed)?;
    for axis in 0..2 {
        let column = if axis == 0 { x.edge } else { y.edge };
        if let Some([begin, end, _]) = column {
            let corners = if axis == 0 {
                [(begin, y.low), (end, y.high)]
            } else {
                [(x.low, begin), (x.high, end)]
            };
            chart
                .draw_series([Rectangle::new(corners, GRID.mix(0.45).filled())])
                .map_err(failed)?;
        }
    }
    let line = |chart: &mut Chart<'a, 'b>, ends: Vec<(f64, f64)>, colour: RGBColor| {
        chart.draw_series([PathElement::new(ends, colour.stroke_width(1))]).map(drop)
    };
    for (at, _) in &x.marks {
        line(&mut chart, vec![(*at, y.low), (*at, y.high)], GRID).map_err(failed)?;
    }
    for (at, _) in &y.marks {
        line(&mut chart, vec![(x.low, *at), (x.high, *at)], GRID).map_err(failed)?;
    }
    let corner = vec![(x.low, y.high), (x.low, y.low), (x.high, y.low)];
    line(&mut chart, corner, INK).map_err(failed)?;
    let style = |h, v| ("sans-serif", LETTER).into_font().color(&INK).pos(Pos::new(h, v));
    for (at, mark) in &x.marks {
        let (px, py) = chart.backend_coord(&(*at, y.low));
        let text = Text::new(mark.clone(), (px, py + 6), style(HPos::Center, VPos::Top));
        area.draw(&text).map_err(failed)?;
    }
    for (at, mark) in &y.marks {
        let (px, py) = chart.backend_coord(&(x.low, *at));
        let text = Text::new(mark.clone(), (px - 6, py), style(HPos::Right, VPos::Center));
        area.draw(&text).map_err(failed)?;
    }
    let (xs, ys) = chart.plotting_area().get_pixel_range();
    let middle = i32::midpoint(xs.start, xs.end);
    let below = (middle, SIZE.1 as i32 - 10);
    let text = Text::new(words[0].to_owned(), below, style(HPos::Center, VPos::Bottom));
    area.draw(&text).map_err(failed)?;
    let turned = ("sans-serif", LETTER)
        .into_font()
        .transform(FontTransform::Rotate270)
        .color(&INK)
        .pos(Pos::new(HPos::Center, VPos::Top));
    let left = (6, i32::midpoint(ys.start, ys.end));
    area.draw(&Text::new(words[1].to_owned(), left, turned)).map_err(failed)?;
    Ok(chart)
}

fn mark(
    chart: &mut Chart<'_, '_>,
    at: (f64, f64),
    shape: Shape,
    colour: RGBColor,
) -> anyhow::Result<()> {
    let failed = |error| anyhow!("drawing failed: {error}");
    match shape {
        Shape::Circle => {
            chart.draw_series([Circle::new(at, 5, colour.filled())]).map_err(failed)?;
        }
        Shape::Triangle => {
            chart.draw_series([TriangleMarker::new(at, 7, colour.filled())]).map_err(failed)?;
        }
        Shape::Cross => {
            chart.draw_series([Cross::new(at, 5, colour.stroke_width(3))]).map_err(failed)?;
        }
        Shape::Square => {
            let square = EmptyElement::at(at) + Rectangle::new([(-5, -5), (5, 5)], colour.filled());
            chart.draw_series([square]).map_err(failed)?;
        }
    }
    Ok(())
}

/// A box of pixels: left, top, right, bottom.
type Box4 = [i32; 4];

fn overlap(a: Box4, b: Box4) -> i32 {
    let width = (a[2].min(b[2]) - a[0].max(b[0])).max(0);
    let height = (a[3].min(b[3]) - a[1].max(b[1])).max(0);
    width * height
}

/// Writes labels beside their points, where they cover least of other labels and points; a thin line
/// leads to one that stands farther off.
fn write_labels(
    area: &Area<'_>,
    labels: &[(String, (i32, i32), RGBColor)],
    (xs, ys): (std::ops::Range<i32>, std::ops::Range<i32>),
) -> anyhow::Result<()> {
    let failed = |error| anyhow!("drawing failed: {error}");
    let style = ("sans-serif", 12).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Top));
    let mut taken: Vec<Box4> =
        labels.iter().map(|(_, (x, y), _)| [x - 6, y - 6, x + 6, y + 6]).collect();
    for (text, (x, y), colour) in labels {
        let (width, height) = area.estimate_text_size(text, &style).map_err(failed)?;
        let (width, height) = (width as i32 + 2, height as i32);
        let mut best: Option<(i32, Box4)> = None;
        for distance in [9, 18, 30, 44, 60, 78] {
            for turn in 0..12 {
                let angle = f64::from(turn) * std::f64::consts::TAU / 12.0;
                let (dx, dy) = (angle.cos(), angle.sin());
                let reach = f64::from(distance);
                // The label's nearest side lies at that distance, whatever the direction.
                let cx = f64::from(*x) + dx * (reach + f64::from(width) / 2.0 * dx.abs().ceil());
                let cy = f64::from(*y) + dy * (reach + f64::from(height) / 2.0);
                let left = cx as i32 - width / 2;
                let top = cy as i32 - height / 2;
                let place = [left, top, left + width, top + height];
                let inside = left >= xs.start + 2
                    && left + width <= SIZE.0 as i32 - 2
                    && top >= ys.start
                    && top + height <= ys.end - 2;
                if !inside {
                    continue;
                }
                let covered: i32 = taken.iter().map(|other| overlap(place, *other)).sum();
                let cost = 4 * covered + distance;
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, place));
                }
            }
        }
        let [left, top, right, bottom] =
            best.map_or([*x + 9, *y - height / 2, *x + 9 + width, *y + height / 2], |(_, at)| at);
        let near = ((*x).clamp(left, right), (*y).clamp(top, bottom));
        if (near.0 - x).abs().max((near.1 - y).abs()) > 14 {
            let line = PathElement::new(vec![(*x, *y), near], colour.mix(0.6).stroke_width(1));
            area.draw(&line).map_err(failed)?;
        }
        area.draw(&Text::new(text.clone(), (left, top), style.clone())).map_err(failed)?;
        taken.push([left, top, right, bottom]);
    }
    Ok(())
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
    picture(&title, &description, |area| {
        let failed = |error| anyhow!("drawing failed: {error}");
        let axes = [x, y];
        let words = [
            "level; solid lines measured, dashed lines the stored bound",
            "deviation, source units",
        ];
        let mut chart = frame(area, &axes, words)?;
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
        write_labels(area, &labels, chart.plotting_area().get_pixel_range())
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
        register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular()).ok();
        let points = [
            point("exact", [None, Some(9.0)]),
            point("a < b", [Some(0.5), Some(3.0)]),
            point("c", [Some(40.0), Some(2.0)]),
        ];
        let axes = [("error", Scale::Log, "0"), ("bits", Scale::FromZero, "none")];
        let plot = scatter("Bits & error", &points, axes).unwrap();
        assert!(plot.svg.contains(">Bits &amp; error</title>"), "{}", plot.svg);
        assert!(plot.svg.contains("a &lt; b: 0.5, 3"));
        assert_eq!(plot.svg.matches("<circle").count(), 3);
        assert!(!plot.svg.replace("http://www.w3.org/2000/svg", "").contains("http"));
    }
}
