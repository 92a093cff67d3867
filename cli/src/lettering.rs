//! plotters' pictures with this program's letters.
//!
//! plotters' own choices of a font library are an unmaintained one and one that asks the system for its fonts; without
//! one it can neither measure text nor draw it into pixels. [`Lettered`] does both, and leaves all else to the backend within.

use crate::text::{Face, Letters};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind,
};

/// What becomes of text on a kind of picture. The size of letters is their line's height ([`Letters::new`]).
pub(crate) trait Lettering: DrawingBackend {
    /// Width and height of a line before it is turned, in pixels.
    fn size_of(letters: &Letters, size: f64, text: &str) -> (u32, u32);

    /// Draws a line at its anchor.
    fn write<S: BackendTextStyle>(
        &mut self,
        letters: &Letters,
        text: &str,
        style: &S,
        anchor: BackendCoord,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>>;
}

impl Lettering for BitMapBackend<'_> {
    fn size_of(letters: &Letters, _: f64, text: &str) -> (u32, u32) {
        letters.box_of(text)
    }

    fn write<S: BackendTextStyle>(
        &mut self,
        letters: &Letters,
        text: &str,
        style: &S,
        (x0, y0): BackendCoord,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        let (width, height) = letters.box_of(text);
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => width as i32 / 2,
            HPos::Right => width as i32,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => height as i32 / 2,
            VPos::Bottom => height as i32,
        };
        let (turn, colour) = (style.transform(), style.color());
        let mut drawn = Ok(());
        letters
            .draw(text, |x, y, coverage| {
                let (x, y) = turn.transform(x - left, y - top);
                let alpha = colour.alpha * f64::from(coverage);
                // What lies outside the picture, the picture leaves out.
                let pixel = self.draw_pixel((x0 + x, y0 + y), BackendColor { alpha, ..colour });
                if drawn.is_ok() {
                    drawn = pixel;
                }
            })
            .map_err(damaged)?;
        drawn
    }
}

impl Lettering for SVGBackend<'_> {
    /// Readers draw with a font of their own, and an em of size / 1.24 as plotters writes it. That is the height here;
    /// the width is that of letters 6 % larger, for fonts that are wider than ours.
    fn size_of(letters: &Letters, size: f64, text: &str) -> (u32, u32) {
        (letters.width(text) as u32, (size / 1.24) as u32)
    }

    fn write<S: BackendTextStyle>(
        &mut self,
        _: &Letters,
        text: &str,
        style: &S,
        anchor: BackendCoord,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.draw_text(text, style, anchor)
    }
}

/// A picture with letters.
pub(crate) struct Lettered<B>(pub(crate) B);

/// The letters of a style: `monospace`, or without serifs; upright and of plain weight.
fn letters_of<S: BackendTextStyle>(style: &S) -> anyhow::Result<Letters> {
    let face = match style.family() {
        FontFamily::Monospace => Face::Mono,
        _ => Face::Sans,
    };
    Letters::new(face, style.size())
}

fn damaged<E: std::error::Error + Send + Sync>(error: anyhow::Error) -> DrawingErrorKind<E> {
    DrawingErrorKind::FontError(error.into())
}

impl<B: Lettering> DrawingBackend for Lettered<B> {
    type ErrorType = B::ErrorType;

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        anchor: BackendCoord,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        let letters = letters_of(style).map_err(damaged)?;
        self.0.write(&letters, text, style, anchor)
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Self::ErrorType>> {
        let letters = letters_of(style).map_err(damaged)?;
        Ok(B::size_of(&letters, style.size(), text))
    }

    fn get_size(&self) -> (u32, u32) {
        self.0.get_size()
    }

    fn ensure_prepared(&mut self) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.ensure_prepared()
    }

    fn present(&mut self) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.present()
    }

    fn draw_pixel(
        &mut self,
        at: BackendCoord,
        colour: BackendColor,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.draw_pixel(at, colour)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.draw_line(from, to, style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        left_top: BackendCoord,
        right_bottom: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.draw_rect(left_top, right_bottom, style, fill)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.draw_path(path, style)
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        centre: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.draw_circle(centre, radius, style, fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.fill_polygon(corners, style)
    }

    fn blit_bitmap(
        &mut self,
        at: BackendCoord,
        size: (u32, u32),
        pixels: &[u8],
    ) -> Result<(), DrawingErrorKind<Self::ErrorType>> {
        self.0.blit_bitmap(at, size, pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::style::text_anchor::Pos;

    const SIDE: i32 = 160;
    // The E lies within its own width, which a T does not.
    const TEXT: &str = "Eq 7/8";

    /// The darkness of a square picture with a line of text, from its left top corner.
    fn written(turn: FontTransform, pos: Pos, anchor: (i32, i32)) -> Vec<u8> {
        let mut bytes = vec![255; (3 * SIDE * SIDE) as usize];
        let picture = BitMapBackend::with_buffer(&mut bytes, (SIDE as u32, SIDE as u32));
        let area = Lettered(picture).into_drawing_area();
        let style = ("sans-serif", 20).into_font().transform(turn).color(&BLACK).pos(pos);
        area.draw_text(TEXT, &style, anchor).unwrap();
        area.present().unwrap();
        drop(area);
        bytes.iter().step_by(3).map(|part| 255 - part).collect()
    }

    /// The first and last column and row with any ink.
    fn extent(dark: &[u8]) -> [i32; 4] {
        let inked = || (0..SIDE * SIDE).filter(|at| dark[*at as usize] > 0);
        let columns = || inked().map(|at| at % SIDE);
        let rows = || inked().map(|at| at / SIDE);
        [
            columns().min().unwrap(),
            rows().min().unwrap(),
            columns().max().unwrap(),
            rows().max().unwrap(),
        ]
    }

    fn left_top() -> Pos {
        Pos::new(HPos::Left, VPos::Top)
    }

    #[test]
    fn turned_text_is_the_turned_picture() {
        let middle = (SIDE / 2, SIDE / 2);
        let level = written(FontTransform::None, left_top(), middle);
        assert!(level.iter().filter(|dark| **dark > 200).count() > 50);
        let dark = |picture: &[u8], [x, y]: [i32; 2]| picture[(y * SIDE + x) as usize];
        for turn in [FontTransform::Rotate90, FontTransform::Rotate180, FontTransform::Rotate270] {
            let turned = written(turn.clone(), left_top(), middle);
            for y in 1..SIDE {
                for x in 1..SIDE {
                    let (across, down) = (x - middle.0, y - middle.1);
                    // Clockwise, around the pixel of the anchor.
                    let at = match turn {
                        FontTransform::Rotate90 => [middle.0 - down, middle.1 + across],
                        FontTransform::Rotate180 => [middle.0 - across, middle.1 - down],
                        _ => [middle.0 + down, middle.1 - across],
                    };
                    assert_eq!(dark(&level, [x, y]), dark(&turned, at), "({x}, {y})");
                }
            }
        }
    }

    #[test]
    fn an_anchor_is_the_side_or_the_middle_of_the_lines_box() {
        let (width, height) = Letters::new(Face::Sans, 20.0).unwrap().box_of(TEXT);
        let middle = (SIDE / 2, SIDE / 2);
        let first = extent(&written(FontTransform::None, left_top(), middle));
        assert!(first[0] >= middle.0 && first[2] < middle.0 + width as i32, "{first:?}");
        assert!(first[1] >= middle.1 && first[3] < middle.1 + height as i32, "{first:?}");
        let across = [(HPos::Left, 0), (HPos::Center, width / 2), (HPos::Right, width)];
        let down = [(VPos::Top, 0), (VPos::Center, height / 2), (VPos::Bottom, height)];
        for (h_pos, left) in across {
            for (v_pos, up) in down {
                let pos = Pos::new(h_pos, v_pos);
                let moved = extent(&written(FontTransform::None, pos, middle));
                let by = [left, up, left, up].map(|part| part as i32);
                assert_eq!(moved, [0, 1, 2, 3].map(|side| first[side] - by[side]));
            }
        }
    }

    #[test]
    fn text_past_an_edge_is_cut_there() {
        let whole = written(FontTransform::None, left_top(), (60, 60));
        for (dx, dy) in [(-85, 0), (70, 0), (0, -70), (0, 90), (-80, -72), (9999, -9999)] {
            let cut = written(FontTransform::None, left_top(), (60 + dx, 60 + dy));
            for y in 0..SIDE {
                for x in 0..SIDE {
                    let (from_x, from_y) = (x - dx, y - dy);
                    let inside = (0..SIDE).contains(&from_x) && (0..SIDE).contains(&from_y);
                    let before = if inside { whole[(from_y * SIDE + from_x) as usize] } else { 0 };
                    assert_eq!(cut[(y * SIDE + x) as usize], before, "({x}, {y}) by ({dx}, {dy})");
                }
            }
        }
    }

    #[test]
    fn a_picture_measures_what_it_draws_and_text_in_a_vector_picture_stays_text() {
        let style = ("sans-serif", 20).into_font().color(&BLACK);
        let mut bytes = vec![255; 3 * 100 * 100];
        let bitmap = Lettered(BitMapBackend::with_buffer(&mut bytes, (100, 100)));
        let letters = Letters::new(Face::Sans, 20.0).unwrap();
        assert_eq!(bitmap.estimate_text_size(TEXT, &style).unwrap(), letters.box_of(TEXT));
        let mono = ("monospace", 20).into_font().color(&BLACK);
        let [narrow, wide] =
            ["iii", "WWW"].map(|text| bitmap.estimate_text_size(text, &mono).unwrap());
        assert_eq!(narrow, wide);
        drop(bitmap);
        let mut svg = String::new();
        let mut vector = Lettered(SVGBackend::with_string(&mut svg, (100, 100)));
        assert_eq!(vector.estimate_text_size(TEXT, &style).unwrap().1, 16);
        vector.draw_text(TEXT, &style, (5, 5)).unwrap();
        vector.present().unwrap();
        drop(vector);
        assert!(svg.contains("<text") && svg.contains(TEXT), "{svg}");
    }
}
