//! A frame's pixels: native ones, run lengths (DICOM PS3.5, annex G), and JPEG.

use super::DicomError;
use super::data_set::{EXPLICIT_BIG, Fragment, IMPLICIT_LITTLE, PixelData};
use jpeg_decoder::{Decoder, PixelFormat};

/// How pixels are coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coding {
    Native,
    Rle,
    Jpeg,
}

/// The coding that a transfer syntax names, where it is one that is read.
pub(super) fn coding(uid: &str) -> Result<Coding, DicomError> {
    let name = match uid {
        IMPLICIT_LITTLE | "1.2.840.10008.1.2.1" | EXPLICIT_BIG => return Ok(Coding::Native),
        "1.2.840.10008.1.2.5" => return Ok(Coding::Rle),
        "1.2.840.10008.1.2.4.50"
        | "1.2.840.10008.1.2.4.51"
        | "1.2.840.10008.1.2.4.57"
        | "1.2.840.10008.1.2.4.70" => return Ok(Coding::Jpeg),
        "1.2.840.10008.1.2.4.80" | "1.2.840.10008.1.2.4.81" => "JPEG-LS",
        "1.2.840.10008.1.2.4.90"
        | "1.2.840.10008.1.2.4.91"
        | "1.2.840.10008.1.2.4.92"
        | "1.2.840.10008.1.2.4.93" => "JPEG 2000",
        "1.2.840.10008.1.2.4.201" | "1.2.840.10008.1.2.4.202" | "1.2.840.10008.1.2.4.203" => {
            "High-Throughput JPEG 2000"
        }
        "1.2.840.10008.1.2.4.110" | "1.2.840.10008.1.2.4.111" | "1.2.840.10008.1.2.4.112" => {
            "JPEG XL"
        }
        _ if uid.starts_with("1.2.840.10008.1.2.4.10") => "a film",
        _ => "coded in a way that is not known here",
    };
    let remedy = match name {
        "JPEG-LS" => "'dcmdjpls IN OUT' of DCMTK or 'gdcmconv --raw IN OUT' of GDCM",
        "JPEG 2000" => "'gdcmconv --raw IN OUT' of GDCM",
        "High-Throughput JPEG 2000" | "JPEG XL" => "the program that wrote it, or pydicom",
        "a film" => "the program that wrote it: its frames are no volume",
        _ => "'dcmconv +te IN OUT' of DCMTK or 'gdcmconv --raw IN OUT' of GDCM",
    };
    Err(DicomError::TransferSyntax { uid: uid.to_owned(), name, remedy })
}

/// What the pixels of an image are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelFormatBits {
    pub(super) columns: u64,
    pub(super) rows: u64,
    /// 8, 16 or 32.
    pub(super) allocated: u32,
    pub(super) stored: u32,
    /// Bits above the highest stored one's place are no part of the value; below the lowest neither.
    pub(super) high: u32,
    pub(super) signed: bool,
    pub(super) big_endian: bool,
}

impl PixelFormatBits {
    /// Bytes of one pixel.
    pub(super) fn bytes(&self) -> usize {
        self.allocated as usize / 8
    }

    /// Bytes of one frame.
    pub(super) fn frame_bytes(&self) -> u64 {
        self.columns * self.rows * self.bytes() as u64
    }

    /// The least and the greatest value.
    pub(super) fn range(&self) -> (i64, i64) {
        let bits = self.stored;
        if self.signed { (-1 << (bits - 1), (1 << (bits - 1)) - 1) } else { (0, (1 << bits) - 1) }
    }

    /// Whether pixels are samples as they stand.
    pub(super) fn is_plain(&self) -> bool {
        self.stored == self.allocated && !(self.big_endian && self.allocated > 8)
    }

    /// The value of a pixel.
    #[inline]
    pub(super) fn value(&self, pixel: &[u8]) -> i64 {
        let raw = if self.big_endian {
            pixel.iter().fold(0_u64, |raw, &byte| raw << 8 | u64::from(byte))
        } else {
            pixel.iter().rev().fold(0_u64, |raw, &byte| raw << 8 | u64::from(byte))
        };
        // Up to the top, so that the sign comes along on the way down.
        let top = raw << (63 - self.high);
        if self.signed {
            (top as i64) >> (64 - self.stored)
        } else {
            (top >> (64 - self.stored)) as i64
        }
    }
}

/// Where a frame's bytes are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum FramePlace {
    /// One run of bytes, as they are.
    Native { offset: u64 },
    /// Fragments of a coded frame.
    Coded(Vec<Fragment>),
}

/// The places of native frames, where there are enough bytes for them.
pub(super) fn native_frames(
    pixels: PixelData,
    format: &PixelFormatBits,
    frames: u64,
    file_length: u64,
) -> Result<Vec<FramePlace>, DicomError> {
    let needed = format.frame_bytes().saturating_mul(frames);
    let length = pixels.length.unwrap_or(0);
    if pixels.offset.saturating_add(needed) > file_length {
        let what = "the file ends before the last pixel";
        return Err(DicomError::Damaged { at: file_length, what });
    }
    if length < needed {
        let what = "there are fewer pixels than Rows, Columns and NumberOfFrames say";
        return Err(DicomError::Damaged { at: pixels.offset, what });
    }
    let frame = |index| FramePlace::Native { offset: pixels.offset + index * format.frame_bytes() };
    Ok((0..frames).map(frame).collect())
}

fn undecodable(what: impl Into<String>) -> DicomError {
    DicomError::Pixels { what: what.into() }
}

/// Decodes a frame of run lengths to little-endian pixels: one segment for each byte of a pixel, the
/// most significant first.
pub(super) fn decode_rle(
    coded: &[u8],
    format: &PixelFormatBits,
    out: &mut [u8],
) -> Result<(), DicomError> {
    let word = |index: usize| {
        let bytes = coded.get(4 * index..).and_then(<[u8]>::first_chunk::<4>);
        bytes.map(|bytes| u32::from_le_bytes(*bytes) as usize)
    };
    let size = format.bytes();
    if word(0) != Some(size) || coded.len() < 64 {
        return Err(undecodable(
            "it has another number of run-length segments than a pixel has bytes",
        ));
    }
    for segment in 0..size {
        let start = word(1 + segment).unwrap_or(0);
        let end = if segment + 1 < size { word(2 + segment).unwrap_or(0) } else { coded.len() };
        let runs = coded
            .get(start..end)
            .filter(|_| start >= 64)
            .ok_or_else(|| undecodable("a run-length segment lies outside of the data"))?;
        let place = size - 1 - segment;
        unpack_bits(runs, out.iter_mut().skip(place).step_by(size))?;
    }
    Ok(())
}

/// Runs and literals, until all places are filled.
fn unpack_bits<'a>(
    mut runs: &[u8],
    mut out: impl ExactSizeIterator<Item = &'a mut u8>,
) -> Result<(), DicomError> {
    while out.len() > 0 {
        let short = || undecodable("a run-length segment ends before the last pixel");
        let (&head, rest) = runs.split_first().ok_or_else(short)?;
        runs = rest;
        match head {
            0..=127 => {
                let count = usize::from(head) + 1;
                let (literals, rest) = runs.split_at_checked(count).ok_or_else(short)?;
                runs = rest;
                out.by_ref().zip(literals).for_each(|(out, &byte)| *out = byte);
            }
            // 128 says nothing.
            128 => {}
            129.. => {
                let (&byte, rest) = runs.split_first().ok_or_else(short)?;
                runs = rest;
                out.by_ref().take(257 - usize::from(head)).for_each(|out| *out = byte);
            }
        }
    }
    Ok(())
}

/// Decodes a JPEG frame, lossless or not, to little-endian pixels.
pub(super) fn decode_jpeg(
    coded: &[u8],
    format: &PixelFormatBits,
    out: &mut [u8],
) -> Result<(), DicomError> {
    let mut decoder = Decoder::new(coded);
    decoder.set_max_decoding_buffer_size(out.len());
    decoder.read_info().map_err(|error| undecodable(error.to_string()))?;
    let info = decoder.info().ok_or_else(|| undecodable("it has no JPEG header"))?;
    let size = match info.pixel_format {
        PixelFormat::L8 => 1,
        PixelFormat::L16 => 2,
        PixelFormat::RGB24 | PixelFormat::CMYK32 => {
            return Err(undecodable("the JPEG image holds colours"));
        }
    };
    if (u64::from(info.width), u64::from(info.height)) != (format.columns, format.rows)
        || size > format.bytes()
    {
        return Err(undecodable(format!(
            "the JPEG image is {} x {} pixels of {size} bytes",
            info.width, info.height
        )));
    }
    let decoded = decoder.decode().map_err(|error| undecodable(error.to_string()))?;
    if decoded.len() != out.len() / format.bytes() * size {
        return Err(undecodable("the JPEG image ends before the last pixel"));
    }
    for (out, pixel) in out.chunks_exact_mut(format.bytes()).zip(decoded.chunks_exact(size)) {
        out.fill(0);
        // The decoder gives 16-bit pixels in the machine's order.
        match *pixel {
            [low, high] if cfg!(target_endian = "little") => out[..2].copy_from_slice(&[low, high]),
            [high, low] => out[..2].copy_from_slice(&[low, high]),
            _ => out[..1].copy_from_slice(pixel),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bits(allocated: u32, stored: u32, high: u32, signed: bool) -> PixelFormatBits {
        let (columns, rows, big_endian) = (2, 2, false);
        PixelFormatBits { columns, rows, allocated, stored, high, signed, big_endian }
    }

    #[test]
    fn only_the_stored_bits_make_the_value() {
        // Overlays once lay in the upper bits.
        assert_eq!(bits(16, 12, 11, false).value(&[0xff, 0xf7]), 0x7ff);
        assert_eq!(bits(16, 12, 11, true).value(&[0xff, 0x0f]), -1);
        assert_eq!(bits(16, 12, 15, false).value(&[0xf0, 0xff]), 0xfff);
        assert_eq!(bits(8, 8, 7, true).value(&[0x80]), -128);
        assert_eq!(bits(32, 32, 31, false).value(&[0xff; 4]), i64::from(u32::MAX));
        let big = PixelFormatBits { big_endian: true, ..bits(16, 16, 15, true) };
        assert_eq!(big.value(&[0xff, 0xfe]), -2);
        assert_eq!(bits(16, 12, 11, true).range(), (-2048, 2047));
        assert_eq!(bits(16, 16, 15, false).range(), (0, 65535));
    }

    /// A frame of one-byte pixels: the header of 64 bytes, then the runs.
    fn frame(runs: &[u8]) -> Vec<u8> {
        let mut frame = vec![0; 64];
        (frame[0], frame[4]) = (1, 64);
        frame.extend_from_slice(runs);
        frame
    }

    #[test]
    fn runs_and_literals_are_unpacked() {
        let format = bits(8, 8, 7, false);
        let mut out = [0; 4];
        decode_rle(&frame(&[128, 1, 7, 8, 255, 9]), &format, &mut out).unwrap();
        assert_eq!(out, [7, 8, 9, 9]);
        for short in [&[][..], &[1, 7], &[254], &[254, 9]] {
            assert!(decode_rle(&frame(short), &format, &mut out).is_err(), "{short:?}");
        }
    }

    #[test]
    fn codings_that_are_not_read_are_named() {
        assert_eq!(coding("1.2.840.10008.1.2.4.70"), Ok(Coding::Jpeg));
        for (uid, expected) in
            [("1.2.840.10008.1.2.4.90", "JPEG 2000"), ("1.2.840.10008.1.2.4.80", "JPEG-LS")]
        {
            let refused = coding(uid);
            assert!(
                matches!(&refused, Err(DicomError::TransferSyntax { name, .. }) if *name == expected)
            );
        }
    }

    proptest! {
        #[test]
        fn no_coded_bytes_bring_the_program_down(
            coded in prop::collection::vec(any::<u8>(), 0..200),
            headed in any::<bool>(),
        ) {
            let coded = if headed { frame(&coded) } else { coded };
            let _ = decode_rle(&coded, &bits(8, 8, 7, false), &mut [0; 4]);
            let _ = decode_rle(&coded, &bits(16, 16, 15, false), &mut [0; 8]);
            let _ = decode_jpeg(&coded, &bits(8, 8, 7, false), &mut [0; 4]);
        }
    }
}
