//! What every plot is drawn of: the picture, its axes and grid, its marks.
//!
//! Colours are names in disguise: the page's style sheet gives ink and grid their colour by the value
//! that stands here, so that one picture serves light and dark. But two sizes are drawn of each plot: letters
//! of one that fits a wide page would be too small to read on a phone.

use super::axis::Axis;
use crate::lettering::Lettered;
use anyhow::anyhow;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use preprocess::tradeoff::RungReading;

/// Letters and axes; the style sheet's `--ink`.
pub(super) const INK: RGBColor = RGBColor(0x22, 0x22, 0x23);
/// Lines of the grid; the style sheet's `--grid`.
pub(super) const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdc);

pub(super) type Area<'a> = DrawingArea<Lettered<SVGBackend<'a>>, Shift>;
pub(super) type Chart<'a, 'b> =
    ChartContext<'a, Lettered<SVGBackend<'b>>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// A size of picture; the style sheet shows the one that fits.
#[derive(Debug)]
pub(super) struct Layout {
    /// The class by which the style sheet knows it.
    pub(super) class: &'static str,
    pub(super) size: (u32, u32),
    /// Pixels for what stands left of the vertical axis.
    left: u32,
    /// Size of letters at axes, and at points: 1.24 times what the picture says.
    letter: u32,
    pub(super) label: u32,
    /// Whether points have their names, or numbers of a list in the page.
    pub(super) names: bool,
}

/// For pages of 40 rem and more: 594 pixels of a screen of 1280.
const WIDE: Layout =
    Layout { class: "wide", size: (720, 540), left: 84, letter: 18, label: 17, names: true };
/// For phones, about as many pixels as there are.
const NARROW: Layout =
    Layout { class: "narrow", size: (340, 380), left: 64, letter: 14, label: 14, names: false };

/// Both sizes.
pub(super) const LAYOUTS: [Layout; 2] = [WIDE, NARROW];

/// A mark's shape says how much work went into small payloads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Triangle,
    Circle,
    Square,
    /// The overlap is assembled.
    Cross,
}

impl Shape {
    pub(super) fn of(rung: &RungReading) -> Self {
        match rung.effort {
            _ if !rung.stored_overlap => Self::Cross,
            "fast" => Self::Triangle,
            "small" => Self::Square,
            _ => Self::Circle,
        }
    }
}

/// Draws a picture, and puts title and description into it.
pub(super) fn picture(
    layout: &Layout,
    title: &str,
    description: &str,
    draw: impl FnOnce(&Area<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<String> {
    let mut svg = String::new();
    {
        let picture = SVGBackend::with_string(&mut svg, layout.size);
        let area = Lettered(picture).into_drawing_area();
        draw(&area)?;
        area.present().map_err(|error| anyhow!("drawing failed: {error}"))?;
    }
    let id: String = format!("{} {title}", layout.class)
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
        .collect();
    let (open, rest) = svg
        .split_once('>')
        .ok_or_else(|| anyhow!("drawing failed: the picture has no beginning"))?;
    // The page scales the picture: its size is in the view box.
    let open =
        open.replace(&format!("width=\"{}\" height=\"{}\" ", layout.size.0, layout.size.1), "");
    Ok(format!(
        "{open} class=\"{}\" role=\"img\" aria-labelledby=\"t-{id} d-{id}\"><title id=\"t-{id}\">{}</title>\
         <desc id=\"d-{id}\">{}</desc>{rest}",
        layout.class,
        super::html::escaped(title),
        super::html::escaped(description)
    ))
}

/// Axes, grid, and the columns of values without a place.
pub(super) fn frame<'a, 'b>(
    layout: &Layout,
    area: &'a Area<'b>,
    [x, y]: &[Axis; 2],
    words: [&str; 2],
) -> anyhow::Result<Chart<'a, 'b>> {
    let failed = |error| anyhow!("drawing failed: {error}");
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_right(14)
        .x_label_area_size(50)
        .y_label_area_size(layout.left)
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
    let style = |h, v| ("sans-serif", layout.letter).into_font().color(&INK).pos(Pos::new(h, v));
    let mut taken: Vec<[i32; 2]> = Vec::new();
    // The column at the edge is the last mark, and must have its word.
    for (at, mark) in x.marks.iter().rev() {
        let (px, py) = chart.backend_coord(&(*at, y.low));
        let style = style(HPos::Center, VPos::Top);
        let half = area.estimate_text_size(mark, &style).map_err(failed)?.0 as i32 / 2 + 2;
        let room = [px - half, px + half];
        // A mark that has no room keeps its line alone.
        if taken.iter().all(|other| room[1] <= other[0] || room[0] >= other[1]) {
            area.draw(&Text::new(mark.clone(), (px, py + 6), style)).map_err(failed)?;
            taken.push(room);
        }
    }
    for (at, mark) in &y.marks {
        let (px, py) = chart.backend_coord(&(x.low, *at));
        let text = Text::new(mark.clone(), (px - 6, py), style(HPos::Right, VPos::Center));
        area.draw(&text).map_err(failed)?;
    }
    let (xs, ys) = chart.plotting_area().get_pixel_range();
    let middle = i32::midpoint(xs.start, xs.end);
    let below = (middle, layout.size.1 as i32 - 8);
    let text = Text::new(words[0].to_owned(), below, style(HPos::Center, VPos::Bottom));
    area.draw(&text).map_err(failed)?;
    let turned = ("sans-serif", layout.letter)
        .into_font()
        .transform(FontTransform::Rotate270)
        .color(&INK)
        .pos(Pos::new(HPos::Center, VPos::Top));
    let left = (2, i32::midpoint(ys.start, ys.end));
    area.draw(&Text::new(words[1].to_owned(), left, turned)).map_err(failed)?;
    Ok(chart)
}

pub(super) fn mark(
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
