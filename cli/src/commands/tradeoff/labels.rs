//! Labels beside points, so that each can be read.
//!
//! Each label tries places around its point and takes the one that covers least of marks and other labels, the
//! nearest of these; a few rounds, so that the first ones make room for the last.

use super::drawing::{Area, INK, Layout};
use anyhow::anyhow;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

/// A box of pixels: left, top, right, bottom.
type Box4 = [i32; 4];

/// A label, its point, and the point's colour.
pub(super) type Label = (String, (i32, i32), RGBColor);

const ROUNDS: usize = 4;

fn overlap(a: Box4, b: Box4) -> i32 {
    let width = (a[2].min(b[2]) - a[0].max(b[0])).max(0);
    let height = (a[3].min(b[3]) - a[1].max(b[1])).max(0);
    width * height
}

/// The best place within `room` for a label of that size at a point.
fn place((x, y): (i32, i32), (width, height): (i32, i32), room: Box4, taken: &[Box4]) -> Box4 {
    let mut best: Option<(i32, Box4)> = None;
    for distance in [9, 14, 20, 28, 38, 50, 64, 80, 98] {
        for turn in 0..16 {
            let angle = f64::from(turn) * std::f64::consts::TAU / 16.0;
            let (dx, dy) = (angle.cos(), angle.sin());
            let reach = f64::from(distance);
            // The label's nearest side lies at that distance, whatever the direction.
            let left = f64::from(x) + dx * (reach + f64::from(width) / 2.0);
            let top = f64::from(y) + dy * (reach + f64::from(height) / 2.0);
            let (left, top) = (left as i32 - width / 2, top as i32 - height / 2);
            let at = [left, top, left + width, top + height];
            let inside =
                at[0] >= room[0] && at[1] >= room[1] && at[2] <= room[2] && at[3] <= room[3];
            let covered: i32 = taken.iter().map(|other| overlap(at, *other)).sum();
            let cost = 20 * covered + distance;
            if inside && best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, at));
            }
        }
    }
    best.map_or([x + 9, y - height / 2, x + 9 + width, y + height - height / 2], |(_, at)| at)
}

/// Where labels of these sizes go: no order of theirs, and no place outside `room`.
fn places(points: &[(i32, i32)], sizes: &[(i32, i32)], room: Box4) -> Vec<Box4> {
    let marks: Vec<Box4> = points.iter().map(|(x, y)| [x - 7, y - 7, x + 7, y + 7]).collect();
    let mut placed: Vec<Option<Box4>> = vec![None; points.len()];
    for _ in 0..ROUNDS {
        for i in 0..points.len() {
            placed[i] = None;
            let taken: Vec<Box4> = marks.iter().chain(placed.iter().flatten()).copied().collect();
            placed[i] = Some(place(points[i], sizes[i], room, &taken));
        }
    }
    placed.into_iter().flatten().collect()
}

/// Writes labels beside their points; a thin line leads to one that stands farther off.
pub(super) fn write_labels(
    layout: &Layout,
    area: &Area<'_>,
    labels: &[Label],
    (xs, ys): (Range<i32>, Range<i32>),
) -> anyhow::Result<()> {
    let failed = |error| anyhow!("drawing failed: {error}");
    let style =
        ("sans-serif", layout.label).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Top));
    let mut sizes = Vec::with_capacity(labels.len());
    for (text, ..) in labels {
        let (width, height) = area.estimate_text_size(text, &style).map_err(failed)?;
        sizes.push((width as i32 + 4, height as i32 + 1));
    }
    let points: Vec<_> = labels.iter().map(|(_, at, _)| *at).collect();
    let room = [xs.start + 2, ys.start, layout.size.0 as i32 - 2, ys.end - 2];
    let places = places(&points, &sizes, room);
    for ((_, (x, y), colour), [left, top, right, bottom]) in labels.iter().zip(&places) {
        let near = ((*x).clamp(*left, *right), (*y).clamp(*top, *bottom));
        if (near.0 - x).abs().max((near.1 - y).abs()) > 13 {
            let line = PathElement::new(vec![(*x, *y), near], colour.mix(0.6).stroke_width(1));
            area.draw(&line).map_err(failed)?;
        }
    }
    for ((text, ..), [left, top, ..]) in labels.iter().zip(&places) {
        area.draw(&Text::new(text.clone(), (left + 2, *top), style.clone())).map_err(failed)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_crowded_points_cover_neither_each_other_nor_points() {
        // Two dozen points within 120 x 60 pixels, as the ways without an error lie; names of 60 x 12.
        let points: Vec<_> = (0..24).map(|i| (200 + 20 * (i % 6), 150 + 15 * (i / 6))).collect();
        let room = [0, 0, 720, 460];
        let places = places(&points, &vec![(60, 12); points.len()], room);
        assert_eq!(places.len(), points.len());
        for (i, a) in places.iter().enumerate() {
            assert!(a[0] >= room[0] && a[1] >= room[1] && a[2] <= room[2] && a[3] <= room[3]);
            let others: i32 = places[..i].iter().map(|b| overlap(*a, *b)).sum();
            assert_eq!(others, 0, "label {i} at {a:?}");
        }
    }
}
