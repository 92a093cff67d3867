//! PNG files of 8- and 16-bit grey as slices.

use super::super::SourceError;
use super::super::tiff::PageKind;
use super::super::tiff::length::{VoxelSize, is_screen};
use super::Picture;
use super::PngError;
use octree_store::{LengthUnit, SampleType};
use png::{BitDepth, ColorType, Decoder, DecodingError, Reader, Unit};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Looks at a file's header.
pub(super) fn look_at(path: &Path) -> Result<Picture, SourceError> {
    let (reader, bytes) = open(path)?;
    let refuse = |source| SourceError::Png { path: path.to_owned(), source };
    let kind = kind(&reader).map_err(refuse)?;
    let row_bytes = kind.dims_xy[0] * kind.stored.bytes() as u64;
    // Deflate packs 1032 to 1 at best.
    if kind.dims_xy[1].saturating_mul(row_bytes) / 1032 > bytes {
        return Err(refuse(PngError::Short { found: bytes, dims_xy: kind.dims_xy }));
    }
    let voxel_size = match reader.info().pixel_dims {
        Some(pixels) if pixels.unit == Unit::Meter && pixels.xppu > 0 && pixels.yppu > 0 => {
            let [x, y] = [pixels.xppu, pixels.yppu].map(f64::from);
            if is_screen(x * 0.0254) || is_screen((x + 0.5) * 0.0254) {
                VoxelSize::unknown()
            } else {
                VoxelSize::of_resolution([x, y], 1e3, LengthUnit::Mm)
            }
        }
        _ => VoxelSize::unknown(),
    };
    // Rows as they come, the one before, and what the decompressor holds.
    Ok(Picture { kind, voxel_size, decode_bytes: 4 * row_bytes + (1 << 20), bytes })
}

/// Decodes a file of a known kind: its samples, little-endian.
pub(super) fn read(path: &Path, expected: PageKind, out: &mut [u8]) -> Result<(), SourceError> {
    let (mut reader, _) = open(path)?;
    let refuse = |source| SourceError::Png { path: path.to_owned(), source };
    if kind(&reader).map_err(refuse)? != expected {
        return Err(refuse(PngError::Changed));
    }
    reader.next_frame(out).map_err(|error| decoding_error(path, error))?;
    reader.finish().map_err(|error| decoding_error(path, error))?;
    if expected.stored == SampleType::U16 {
        out.as_chunks_mut::<2>().0.iter_mut().for_each(|sample| sample.reverse());
    }
    Ok(())
}

fn open(path: &Path) -> Result<(Reader<BufReader<File>>, u64), SourceError> {
    let io_error = |source| SourceError::Io { path: path.to_owned(), source };
    let file = File::open(path).map_err(io_error)?;
    let bytes = file.metadata().map_err(io_error)?.len();
    let mut decoder = Decoder::new(BufReader::with_capacity(1 << 16, file));
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let reader = decoder.read_info().map_err(|error| decoding_error(path, error))?;
    Ok((reader, bytes))
}

fn kind(reader: &Reader<BufReader<File>>) -> Result<PageKind, PngError> {
    let info = reader.info();
    let stored = match (info.color_type, info.bit_depth) {
        (ColorType::Grayscale, BitDepth::Eight) => SampleType::U8,
        (ColorType::Grayscale, BitDepth::Sixteen) => SampleType::U16,
        (ColorType::Grayscale, other) => return Err(PngError::Bits { bits: other as u8 }),
        (ColorType::Rgb, _) => return Err(PngError::Colour { found: "RGB" }),
        (ColorType::Rgba, _) => return Err(PngError::Colour { found: "RGB with transparency" }),
        (ColorType::Indexed, _) => return Err(PngError::Colour { found: "a palette" }),
        (ColorType::GrayscaleAlpha, _) => {
            return Err(PngError::Colour { found: "grey with transparency" });
        }
    };
    Ok(PageKind { dims_xy: [info.width, info.height].map(u64::from), stored })
}

/// The file's fault where the decoder says so, else the system's.
fn decoding_error(path: &Path, error: DecodingError) -> SourceError {
    let path = path.to_owned();
    match error {
        DecodingError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            SourceError::Io { path, source }
        }
        other => SourceError::Png { path, source: PngError::Decode { what: other.to_string() } },
    }
}
