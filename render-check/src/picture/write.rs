//! Pictures as files. A PNG holds what it shows as text beside the pixels, so that it can be made again.

use super::{Picture, Shown};
use std::io::{self, Write};

/// Bits of a colour's component.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Bits {
    /// One byte.
    #[default]
    Eight,
    /// Two bytes.
    Sixteen,
}

/// The key of the text that says what a picture shows.
const KEY: &str = "octavo:view";

/// Writes a PNG; `view` is JSON of what it shows.
///
/// # Errors
/// When writing fails.
pub fn write_png(out: impl Write, shown: &Shown, bits: Bits, view: &str) -> io::Result<()> {
    let parts = shown.pixels.iter().flatten();
    let bytes: Vec<u8> = match bits {
        Bits::Eight => parts.map(|c| (c * 255.0).round() as u8).collect(),
        Bits::Sixteen => parts.flat_map(|c| ((c * 65535.0).round() as u16).to_be_bytes()).collect(),
    };
    encode(out, shown.size, png::ColorType::Rgb, bits, view, &bytes)
}

/// Writes distances from the eye as 32-bit little-endian floats; infinite where there is nothing.
///
/// # Errors
/// When writing fails.
pub fn write_depth_raw(mut out: impl Write, picture: &Picture) -> io::Result<()> {
    let bytes: Vec<u8> = picture.depths.iter().flat_map(|d| d.to_le_bytes()).collect();
    out.write_all(&bytes)
}

/// Writes distances from the eye as a 16-bit grey PNG: from 0, the nearest, to 65534, the farthest; 65535 where there is nothing.
/// The text says which distances those are.
///
/// # Errors
/// When writing fails.
pub fn write_depth_png(out: impl Write, picture: &Picture) -> io::Result<()> {
    let finite = || picture.depths.iter().copied().filter(|d| d.is_finite());
    let nearest = finite().fold(f32::INFINITY, f32::min);
    let farthest = finite().fold(f32::NEG_INFINITY, f32::max);
    let width = f64::from(farthest - nearest).max(f64::MIN_POSITIVE);
    let grey = |d: &f32| {
        if !d.is_finite() {
            return u16::MAX;
        }
        (f64::from(d - nearest) / width * 65534.0).round() as u16
    };
    let bytes: Vec<u8> = picture.depths.iter().flat_map(|d| grey(d).to_be_bytes()).collect();
    let text = if nearest.is_finite() {
        serde_json::json!({ "nearest": nearest, "farthest": farthest })
    } else {
        serde_json::json!({ "nearest": null, "farthest": null })
    };
    let color = png::ColorType::Grayscale;
    encode(out, picture.size, color, Bits::Sixteen, &text.to_string(), &bytes)
}

fn encode(
    out: impl Write,
    size: [u32; 2],
    color: png::ColorType,
    bits: Bits,
    view: &str,
    bytes: &[u8],
) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, size[0], size[1]);
    encoder.set_color(color);
    encoder.set_depth(match bits {
        Bits::Eight => png::BitDepth::Eight,
        Bits::Sixteen => png::BitDepth::Sixteen,
    });
    encoder.add_itxt_chunk(KEY.to_owned(), view.to_owned())?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    Ok(writer.finish()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_comes_back_with_what_it_shows() {
        let pixels = (0..12).map(|i| [i as f32 / 11.0, 0.5, 1.0]).collect();
        let shown = Shown { size: [4, 3], pixels };
        for (bits, most) in [(Bits::Eight, 255.0), (Bits::Sixteen, 65535.0)] {
            let mut file = Vec::new();
            write_png(&mut file, &shown, bits, r#"{"mode":"dvr"}"#).unwrap();
            let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
            let text = &reader.info().utf8_text[0];
            assert_eq!(
                (text.keyword.as_str(), text.get_text().unwrap().as_str()),
                (KEY, r#"{"mode":"dvr"}"#)
            );
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            let wide = bits == Bits::Sixteen;
            for (i, c) in shown.pixels.iter().flatten().enumerate() {
                let found = if wide {
                    f32::from(u16::from_be_bytes([bytes[2 * i], bytes[2 * i + 1]]))
                } else {
                    f32::from(bytes[i])
                };
                assert!((found / most - c).abs() <= 0.5001 / most);
            }
        }
    }

    #[test]
    fn depths_of_nothing_and_of_one_distance_are_written() {
        for depths in [vec![f32::INFINITY; 4], vec![3.0; 4], vec![1.0, 2.0, f32::INFINITY, 3.0]] {
            let picture = Picture { size: [2, 2], colors: vec![[0.0; 4]; 4], depths };
            let mut file = Vec::new();
            write_depth_png(&mut file, &picture).unwrap();
            assert!(file.len() > 60);
        }
    }
}
