//! Lines of text upon a picture.

use anyhow::anyhow;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

/// Red, green and blue of pixels, rows from the top.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) size: [u32; 2],
    pub(super) bytes: Vec<u8>,
}

const FONT: &str = "octavo-mono";
/// Size of letters where there is room, and height of their lines, in pixels.
const FULL: f64 = 13.0;
const LINE: f64 = 16.0;
const MARGIN: f64 = 8.0;

/// Makes the font known. Before the first [`write()`].
///
/// # Errors
/// When the font in this program is damaged.
pub(super) fn prepare() -> anyhow::Result<()> {
    register_font(FONT, FontStyle::Normal, dejavu::sans_mono::regular())
        .map_err(|_| anyhow!("the font in this program is damaged"))
}

/// Writes lines from the top left corner, light upon a darkened ground.
///
/// # Errors
/// When drawing fails.
pub(super) fn write(canvas: &mut Canvas, lines: &[String]) -> anyhow::Result<()> {
    let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
    if longest == 0 {
        return Ok(());
    }
    let [width, height] = canvas.size.map(|side| side as usize);
    let fits = (height as f64 / (lines.len() as f64 * LINE + 2.0 * MARGIN))
        .min(width as f64 / (longest as f64 * 0.602 * FULL + 2.0 * MARGIN));
    // As large as there is room for, and as can be read.
    let size = (FULL * fits).clamp(6.0, FULL);
    let line = LINE * size / FULL;
    // DejaVu Sans Mono is 0.602 of its size wide.
    let across = ((longest as f64 * 0.602 * size + 2.0 * MARGIN) as usize).min(width);
    let down = ((lines.len() as f64 * line + 2.0 * MARGIN) as usize).min(height);
    for row in canvas.bytes.chunks_exact_mut(3 * width).take(down) {
        row[..3 * across].iter_mut().for_each(|part| *part /= 3);
    }
    let area = BitMapBackend::with_buffer(&mut canvas.bytes, (canvas.size[0], canvas.size[1]))
        .into_drawing_area();
    let style = (FONT, size).into_font().color(&WHITE);
    for (number, text) in lines.iter().enumerate() {
        let top = MARGIN + number as f64 * line;
        let at = (MARGIN as i32, top as i32);
        if top + line > height as f64 {
            break;
        }
        area.draw_text(text, &style, at)
            .map_err(|error| anyhow!("drawing text failed: {error}"))?;
    }
    area.present().map_err(|error| anyhow!("drawing text failed: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_light_upon_a_darkened_ground_and_stays_within_the_picture() {
        prepare().unwrap();
        let grey =
            |size: [u32; 2]| Canvas { size, bytes: vec![120; (size[0] * size[1] * 3) as usize] };
        let mut canvas = grey([200, 100]);
        write(&mut canvas, &["Hello".to_owned()]).unwrap();
        let bright = canvas.bytes.iter().filter(|part| **part > 200).count();
        assert!(bright > 60, "{bright}");
        assert_eq!(canvas.bytes[3..6], [40; 3]);
        assert_eq!(canvas.bytes[3 * 199..3 * 200], [120; 3]);
        assert!(canvas.bytes[3 * 200 * 50..].iter().all(|part| *part == 120));
        for size in [[1, 1], [3, 90], [90, 3]] {
            let lines: Vec<String> = (0..40).map(|n| format!("line {n} that is long")).collect();
            write(&mut grey(size), &lines).unwrap();
        }
        let mut untouched = grey([9, 9]);
        write(&mut untouched, &[]).unwrap();
        assert!(untouched.bytes.iter().all(|part| *part == 120));
    }
}
