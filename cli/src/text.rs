//! Lines of text as coverage of pixels, and how much room they take.
//!
//! The fonts are this program's own (DejaVu), so that a picture looks the same everywhere. Outlines and widths are
//! read by skrifa; each glyph is filled by exact area, at the fraction of a pixel where it stands. Letters are set
//! side by side with the font's kerning, from left to right; nothing here shapes scripts that need more.

use ab_glyph_rasterizer::{Point, Rasterizer, point};
use anyhow::anyhow;
use skrifa::charmap::Charmap;
use skrifa::instance::{LocationRef, Size};
use skrifa::metrics::GlyphMetrics;
use skrifa::outline::{DrawSettings, OutlinePen};
use skrifa::raw::TableProvider;
use skrifa::raw::tables::kern::{Subtable, SubtableKind};
use skrifa::{FontRef, GlyphId, MetadataProvider, OutlineGlyphCollection};

/// A font within this program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Face {
    Sans,
    Mono,
}

/// A face at a size. Lengths are pixels, y points down, and a line's box begins at its left top corner.
pub(crate) struct Letters {
    font: FontRef<'static>,
    glyph_of: Charmap<'static>,
    metrics: GlyphMetrics<'static>,
    outlines: OutlineGlyphCollection<'static>,
    pixels_per_unit: f32,
    /// Rows of a line's box above its baseline, and beneath.
    rows: [u32; 2],
}

impl Letters {
    /// `size`: pixels from the highest ascent to the lowest descent; of one that is no positive number nothing is seen.
    ///
    /// # Errors
    /// When the font in this program is damaged.
    pub(crate) fn new(face: Face, size: f64) -> anyhow::Result<Self> {
        let font = FontRef::new(match face {
            Face::Sans => dejavu::sans::regular(),
            Face::Mono => dejavu::sans_mono::regular(),
        })
        .map_err(damaged)?;
        let whole = font.metrics(Size::unscaled(), LocationRef::default());
        // `max` takes the number where the size is none.
        let pixels_per_unit = (size.max(0.0) as f32) / (whole.ascent - whole.descent);
        Ok(Self {
            glyph_of: font.charmap(),
            metrics: font.glyph_metrics(Size::unscaled(), LocationRef::default()),
            outlines: font.outline_glyphs(),
            pixels_per_unit,
            rows: [whole.ascent, -whole.descent].map(|part| (part * pixels_per_unit).ceil() as u32),
            font,
        })
    }

    /// How wide a line is, to where a next letter would stand.
    pub(crate) fn width(&self, text: &str) -> f32 {
        self.placed(text).last().map_or(0.0, |(glyph, left)| left + self.advance(glyph))
    }

    /// Width and height of a line's box in whole pixels.
    pub(crate) fn box_of(&self, text: &str) -> (u32, u32) {
        (self.width(text).ceil() as u32, self.rows[0] + self.rows[1])
    }

    /// Calls `put(x, y, coverage)` for each pixel that a letter covers, by more than 0 and at most 1. A pixel comes
    /// more than once where letters touch; and where a letter hangs over its own width, x may lie beside the box.
    ///
    /// # Errors
    /// When the font in this program is damaged.
    pub(crate) fn draw(
        &self,
        text: &str,
        mut put: impl FnMut(i32, i32, f32),
    ) -> anyhow::Result<()> {
        self.placed(text).try_for_each(|(glyph, left)| self.draw_glyph(glyph, left, &mut put))
    }

    /// The glyphs of a line, and where each begins.
    fn placed(&self, text: &str) -> impl Iterator<Item = (GlyphId, f32)> {
        let mut end = 0.0;
        let mut before = None;
        text.chars().map(move |letter| {
            // What the font does not have is shown as its missing glyph.
            let glyph = self.glyph_of.map(letter).unwrap_or_default();
            let left = end + before.map_or(0.0, |before| self.kerning(before, glyph));
            end = left + self.advance(glyph);
            before = Some(glyph);
            (glyph, left)
        })
    }

    fn advance(&self, glyph: GlyphId) -> f32 {
        self.metrics.advance_width(glyph).unwrap_or(0.0) * self.pixels_per_unit
    }

    fn kerning(&self, left: GlyphId, right: GlyphId) -> f32 {
        let units = self.font.kern().ok().and_then(|table| {
            table.subtables().flatten().filter(Subtable::is_horizontal).find_map(
                |pairs| match pairs.kind() {
                    Ok(SubtableKind::Format0(pairs)) => pairs.kerning(left, right),
                    _ => None,
                },
            )
        });
        units.unwrap_or(0) as f32 * self.pixels_per_unit
    }

    fn draw_glyph(
        &self,
        glyph: GlyphId,
        left: f32,
        mut put: impl FnMut(i32, i32, f32),
    ) -> anyhow::Result<()> {
        let (Some(bounds), Some(outline)) = (self.metrics.bounds(glyph), self.outlines.get(glyph))
        else {
            return Ok(());
        };
        let scale = self.pixels_per_unit;
        let first = [(left + bounds.x_min * scale).floor(), (-bounds.y_max * scale).floor()];
        let end = [(left + bounds.x_max * scale).ceil(), (-bounds.y_min * scale).ceil()];
        let [width, height] = [0, 1].map(|axis| (end[axis] - first[axis]) as usize);
        if width == 0 || height == 0 {
            return Ok(());
        }
        let mut pen = Pen {
            raster: Rasterizer::new(width, height),
            origin: point(left - first[0], -first[1]),
            scale,
            begin: Point::default(),
            at: Point::default(),
        };
        let unscaled = DrawSettings::unhinted(Size::unscaled(), LocationRef::default());
        outline.draw(unscaled, &mut pen).map_err(damaged)?;
        let [x0, y0] = first.map(|side| side as i32);
        pen.raster.for_each_pixel_2d(|x, y, coverage| {
            if coverage > 0.0 {
                put(x0 + x as i32, self.rows[0] as i32 + y0 + y as i32, coverage.min(1.0));
            }
        });
        Ok(())
    }
}

fn damaged(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("the font in this program is damaged: {error}")
}

/// Fills an outline in the font's units, whose y points up.
struct Pen {
    raster: Rasterizer,
    origin: Point,
    scale: f32,
    begin: Point,
    at: Point,
}

impl Pen {
    fn pixel(&self, x: f32, y: f32) -> Point {
        point(self.origin.x + x * self.scale, self.origin.y - y * self.scale)
    }
}

impl OutlinePen for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.begin = self.pixel(x, y);
        self.at = self.begin;
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let to = self.pixel(x, y);
        self.raster.draw_line(self.at, to);
        self.at = to;
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let (by, to) = (self.pixel(x1, y1), self.pixel(x, y));
        self.raster.draw_quad(self.at, by, to);
        self.at = to;
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let (by, then, to) = (self.pixel(x1, y1), self.pixel(x2, y2), self.pixel(x, y));
        self.raster.draw_cubic(self.at, by, then, to);
        self.at = to;
    }

    fn close(&mut self) {
        self.raster.draw_line(self.at, self.begin);
        self.at = self.begin;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const FACES: [Face; 2] = [Face::Sans, Face::Mono];
    const SIZES: [f64; 6] = [1.0, 6.0, 13.0, 14.0, 22.0, 97.3];

    /// Coverage by row and column.
    fn drawn(letters: &Letters, text: &str) -> BTreeMap<(i32, i32), f32> {
        let mut pixels = BTreeMap::new();
        letters
            .draw(text, |x, y, coverage| {
                assert!(coverage > 0.0 && coverage <= 1.0, "{text}: {coverage}");
                *pixels.entry((y, x)).or_insert(0.0) += coverage;
            })
            .unwrap();
        pixels
    }

    fn printable() -> impl Iterator<Item = char> {
        (' '..='~').chain("ÄÖÜßéµ°²³×·–…".chars())
    }

    #[test]
    fn a_line_is_as_wide_as_its_parts_and_their_kerning() {
        for (face, size) in FACES.iter().flat_map(|face| SIZES.map(|size| (*face, size))) {
            let letters = Letters::new(face, size).unwrap();
            let mut line = String::new();
            let mut before = None;
            for letter in printable() {
                let glyph = letters.glyph_of.map(letter).unwrap();
                let pair = before.map_or(0.0, |before| letters.kerning(before, glyph));
                let parts = letters.width(&line) + pair + letters.width(&letter.to_string());
                line.push(letter);
                let whole = letters.width(&line);
                assert!((whole - parts).abs() <= 1e-5 * whole, "{line}: {whole}, {parts}");
                before = Some(glyph);
            }
        }
        let letters = Letters::new(Face::Sans, 20.0).unwrap();
        assert!(letters.width("AV") < letters.width("A") + letters.width("V"));
        // 1233 of 2048 units of an em, and an em is 1 of 1.164 parts of a line.
        let mono = Letters::new(Face::Mono, 1164.0625).unwrap();
        assert!((mono.width("iiWW") - 4.0 * 602.05).abs() < 0.1, "{}", mono.width("iiWW"));
    }

    #[test]
    fn coverage_lies_within_the_box_and_grows_with_the_square_of_the_size() {
        for (face, size) in FACES.iter().flat_map(|face| SIZES.map(|size| (*face, size))) {
            let letters = Letters::new(face, size).unwrap();
            for letter in printable() {
                // A letter may hang over its own width, but not over a neighbour's on both sides.
                let text = format!("n{letter}n");
                let (width, height) = letters.box_of(&text);
                assert!(f64::from(height) >= size && f64::from(height) < size + 2.0);
                for (y, x) in drawn(&letters, &text).into_keys() {
                    let within = x >= 0 && x < width as i32 && y >= 0 && y < height as i32;
                    assert!(within, "{face:?} {size} {letter:?}: ({x}, {y}) of {width} x {height}");
                }
            }
        }
        // Exact areas: their sum is the same share of the size's square, wherever pixels lie.
        let share = |size: f64| {
            let letters = Letters::new(Face::Sans, size).unwrap();
            f64::from(drawn(&letters, "HEILT 147").values().sum::<f32>()) / (size * size)
        };
        let exact = share(1000.0);
        for size in [5.0, 6.3, 9.9, 14.0, 31.7] {
            assert!((share(size) / exact - 1.0).abs() < 1e-3, "{size}: {} of {exact}", share(size));
        }
    }

    #[test]
    fn letters_stand_upright_on_their_baseline() {
        let letters = Letters::new(Face::Sans, 40.0).unwrap();
        let (_, height) = letters.box_of("L");
        let pixels = drawn(&letters, "L");
        let baseline = letters.rows[0] as i32;
        assert_eq!(baseline, 32, "0.928 of 1.164 parts of 40");
        // An L has its bar at the foot, and to the right of its stem.
        let row = |y: i32| pixels.keys().filter(|(at, _)| *at == y).count();
        assert!(row(baseline - 1) > 2 * row(baseline - 10));
        assert_eq!((baseline..height as i32).map(row).sum::<usize>(), 0);
        let stem = pixels.keys().filter(|(y, _)| *y == baseline - 10).map(|(_, x)| *x);
        assert!(stem.max().unwrap() < pixels.keys().map(|(_, x)| *x).max().unwrap() / 2);
    }

    #[test]
    fn a_letter_that_the_font_lacks_is_its_missing_glyph_and_blanks_are_bare() {
        for face in FACES {
            let letters = Letters::new(face, 30.0).unwrap();
            let missing = drawn(&letters, "\u{10ffff}");
            assert!(missing.len() > 50, "{}", missing.len());
            assert_eq!(missing, drawn(&letters, "\u{e0fff}"));
            assert_ne!(missing, drawn(&letters, "A"));
            for blank in ["", " ", "\u{a0}  "] {
                assert!(drawn(&letters, blank).is_empty());
            }
            assert_eq!(letters.width(""), 0.0);
        }
    }

    #[test]
    fn of_a_size_that_is_no_positive_number_nothing_is_seen() {
        for size in [0.0, -0.0, -12.0, f64::NAN, f64::NEG_INFINITY] {
            let letters = Letters::new(Face::Sans, size).unwrap();
            assert_eq!(letters.box_of("Octavo"), (0, 0), "{size}");
            assert!(drawn(&letters, "Octavo").is_empty(), "{size}");
        }
    }
}
