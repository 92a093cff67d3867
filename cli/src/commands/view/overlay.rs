//! Lines of text upon a picture.

use crate::text::{Face, Letters};

/// Red, green and blue of pixels, rows from the top.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) size: [u32; 2],
    pub(super) bytes: Vec<u8>,
}

impl Canvas {
    /// Makes a pixel that much white, from 0 to 1; one outside the picture is none.
    fn lighten(&mut self, x: i32, y: i32, share: f32) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        let [width, height] = self.size.map(|side| side as usize);
        if x < width && y < height {
            for part in &mut self.bytes[3 * (y * width + x)..][..3] {
                *part += (f32::from(255 - *part) * share).round() as u8;
            }
        }
    }
}

/// Size of letters where there is room, and height of their lines, in pixels.
const FULL: f64 = 13.0;
const LINE: f64 = 16.0;
const MARGIN: f64 = 8.0;

/// Writes lines from the top left corner, light upon a darkened ground.
///
/// # Errors
/// When the font in this program is damaged.
pub(super) fn write(canvas: &mut Canvas, lines: &[String]) -> anyhow::Result<()> {
    let letters = Letters::new(Face::Mono, FULL)?;
    let widest = lines.iter().map(|line| f64::from(letters.width(line))).fold(0.0, f64::max);
    if widest == 0.0 {
        return Ok(());
    }
    let [width, height] = canvas.size.map(|side| side as usize);
    let fits = (height as f64 / (lines.len() as f64 * LINE + 2.0 * MARGIN))
        .min(width as f64 / (widest + 2.0 * MARGIN));
    // As large as there is room for, and as can be read.
    let size = (FULL * fits).clamp(6.0, FULL);
    let letters = Letters::new(Face::Mono, size)?;
    let line = LINE * size / FULL;
    let across = ((widest * size / FULL + 2.0 * MARGIN) as usize).min(width);
    let down = ((lines.len() as f64 * line + 2.0 * MARGIN) as usize).min(height);
    for row in canvas.bytes.chunks_exact_mut(3 * width).take(down) {
        row[..3 * across].iter_mut().for_each(|part| *part /= 3);
    }
    for (number, text) in lines.iter().enumerate() {
        let top = MARGIN + number as f64 * line;
        if top + line > height as f64 {
            break;
        }
        letters.draw(text, |x, y, coverage| {
            canvas.lighten(MARGIN as i32 + x, top as i32 + y, coverage);
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_light_upon_a_darkened_ground_and_stays_within_the_picture() {
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
