//! The compressions of strips and tiles, each as a reader of what it holds.

use super::TiffError;
use flate2::read::ZlibDecoder;
use std::io::{self, Read};
use weezl::{BitOrder, LzwStatus};

/// Bytes that a decoder holds.
const DECODER_BYTES: u64 = 512 << 10;

/// Bytes that zstd's decoder holds beside its buffers, and the most of one of its blocks.
const ZSTD_BYTES: u64 = 160 << 10;
const ZSTD_BLOCK_BYTES: u64 = 128 << 10;

/// The largest window of zstd's common levels (2^23), which is always allowed, and that of its highest.
const ZSTD_WINDOW_LOGS: [u32; 2] = [23, 27];

/// Steps of the LZW decoder that neither take nor give a byte, one after the other.
const MOST_IDLE_STEPS: u32 = 16;

/// How strips and tiles are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
}

impl Compression {
    /// What the tag Compression says.
    pub(super) fn of_tag(number: u64) -> Result<Self, TiffError> {
        let name = match number {
            1 => return Ok(Self::None),
            5 => return Ok(Self::Lzw),
            8 | 32946 => return Ok(Self::Deflate),
            32773 => return Ok(Self::PackBits),
            34926 | 50000 => return Ok(Self::Zstd),
            2 => "CCITT RLE",
            3 => "fax group 3",
            4 => "fax group 4",
            6 | 7 => "JPEG",
            33003 | 33005 | 34712 => "JPEG 2000",
            34887 => "LERC",
            34925 | 50003 => "LZMA",
            34927 | 50001 => "WebP",
            50002 | 52546 => "JPEG XL",
            _ => "of an unknown kind",
        };
        Err(TiffError::Compression { found: format!("{name} ({number})") })
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "no compression",
            Self::Lzw => "LZW",
            Self::Deflate => "deflate",
            Self::PackBits => "PackBits",
            Self::Zstd => "zstd",
        }
    }

    /// The most bytes that one stored byte can become, or somewhat more.
    pub(super) fn most_expansion(self) -> u64 {
        match self {
            Self::None => 1,
            // A code of 12 bits stands for at most 3839 bytes.
            Self::Lzw => 4096,
            Self::Deflate => 1032,
            Self::PackBits => 64,
            // A block of 4 bytes repeats one byte up to 128 Ki times.
            Self::Zstd => 1 << 16,
        }
    }

    /// Reads what `stored` holds; a window of zstd may have up to 2^`window_log` bytes.
    pub(super) fn reader(self, stored: &[u8], window_log: u32) -> io::Result<Box<dyn Read + '_>> {
        Ok(match self {
            Self::None => Box::new(stored),
            Self::Lzw => Box::new(Lzw::new(stored)?),
            Self::Deflate => Box::new(ZlibDecoder::new(stored)),
            Self::PackBits => Box::new(PackBits { stored, run: 0, repeated: None }),
            Self::Zstd => {
                let mut decoder = zstd::Decoder::with_buffer(stored)?.single_frame();
                decoder.window_log_max(window_log)?;
                Box::new(decoder)
            }
        })
    }

    /// Whether the last byte is followed by a checksum.
    pub(super) fn has_checksum(self) -> bool {
        matches!(self, Self::Deflate | Self::Zstd)
    }

    /// Bytes of memory that a reader of what `stored` holds, of `length` bytes, takes where it is asked for
    /// `at_once` bytes at a time.
    pub(super) fn decoder_bytes(self, stored: &[u8], length: u64, at_once: u64) -> u64 {
        match self {
            Self::None => 0,
            Self::Zstd => ZSTD_BYTES + zstd_buffers(stored, length, at_once),
            _ => DECODER_BYTES,
        }
    }
}

/// The window that a file like this frame may need, as a power of two.
pub(super) fn zstd_window_log(frame: &[u8]) -> u32 {
    let [common, highest] = ZSTD_WINDOW_LOGS;
    zstd_window(frame).min(1 << highest).next_power_of_two().ilog2().max(common)
}

/// Bytes of the buffers that decode a zstd frame: a block of what is stored, and the window with the blocks
/// beside it, filled no further than there is content. A frame that says how long it is needs none where all
/// of it is asked for at once.
fn zstd_buffers(frame: &[u8], length: u64, at_once: u64) -> u64 {
    let content = zstd::zstd_safe::get_frame_content_size(frame).ok().flatten();
    if content.is_some_and(|content| content <= at_once) {
        return 0;
    }
    let window = zstd_window(frame).min(1 << zstd_window_log(frame));
    let block = window.min(ZSTD_BLOCK_BYTES);
    let filled = content.unwrap_or(u64::MAX).min(length.saturating_add(block));
    block + (window + 2 * block).min(filled)
}

/// The window that a zstd frame asks for (RFC 8878, section 3.1.1.1).
fn zstd_window(frame: &[u8]) -> u64 {
    let Some(&[descriptor, window]) = frame.get(4..6) else { return 0 };
    if descriptor & 0x20 == 0 {
        let base = 1_u64 << (10 + (window >> 3));
        return base + base / 8 * u64::from(window & 7);
    }
    // A single segment: the window is the content, whose size follows.
    let dictionary_bytes = [0, 1, 2, 4][usize::from(descriptor & 3)];
    let size_bytes = 1_usize << (descriptor >> 6);
    let size = frame.get(5 + dictionary_bytes..5 + dictionary_bytes + size_bytes).unwrap_or(&[]);
    size.iter().rev().fold(0, |size, &byte| size << 8 | u64::from(byte)) + 256
}

fn invalid(what: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// LZW as TIFF has it: high bits first, codes widened one early.
struct Lzw<'a> {
    decoder: weezl::decode::Decoder,
    stored: &'a [u8],
}

impl<'a> Lzw<'a> {
    fn new(stored: &'a [u8]) -> io::Result<Self> {
        // Every stream begins with the code 256 in 9 bits; before 1989 these came low bits first.
        if matches!(stored, [0, second, ..] if second & 1 == 1) {
            return Err(invalid("LZW of the kind before TIFF 5.0 (low bits first) is not read"));
        }
        let decoder = weezl::decode::Configuration::with_tiff_size_switch(BitOrder::Msb, 8)
            .with_yield_on_full_buffer(true)
            .build();
        Ok(Self { decoder, stored })
    }
}

impl Read for Lzw<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        // The decoder may take a step or two that only its own buffer shows, but not ever so many.
        let mut idle = 0;
        while filled < out.len() && idle < MOST_IDLE_STEPS {
            let result = self.decoder.decode_bytes(self.stored, &mut out[filled..]);
            self.stored = &self.stored[result.consumed_in..];
            filled += result.consumed_out;
            match result.status {
                Ok(LzwStatus::Done | LzwStatus::NoProgress) => break,
                Ok(LzwStatus::Ok) if result.consumed_in == 0 && result.consumed_out == 0 => {
                    idle += 1;
                }
                Ok(LzwStatus::Ok) => idle = 0,
                Err(error) => return Err(io::Error::new(io::ErrorKind::InvalidData, error)),
            }
        }
        Ok(filled)
    }
}

/// Runs of bytes, literal and repeated.
struct PackBits<'a> {
    stored: &'a [u8],
    /// Bytes left of the present run.
    run: usize,
    /// The byte that is repeated, or none where the run is literal.
    repeated: Option<u8>,
}

impl PackBits<'_> {
    /// Begins the next run; false at the end.
    fn begin_run(&mut self) -> io::Result<bool> {
        loop {
            let Some((&head, rest)) = self.stored.split_first() else { return Ok(false) };
            self.stored = rest;
            match head.cast_signed() {
                -128 => {}
                literal @ 0.. => {
                    (self.run, self.repeated) = (literal as usize + 1, None);
                    return Ok(true);
                }
                repeat => {
                    let (&byte, rest) = rest.split_first().ok_or(io::ErrorKind::UnexpectedEof)?;
                    self.stored = rest;
                    (self.run, self.repeated) = (1 + repeat.unsigned_abs() as usize, Some(byte));
                    return Ok(true);
                }
            }
        }
    }
}

impl Read for PackBits<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while filled < out.len() {
            if self.run == 0 && !self.begin_run()? {
                break;
            }
            let count = self.run.min(out.len() - filled);
            let out = &mut out[filled..filled + count];
            if let Some(byte) = self.repeated {
                out.fill(byte);
            } else {
                let literal = self.stored.split_off(..count).ok_or(io::ErrorKind::UnexpectedEof)?;
                out.copy_from_slice(literal);
            }
            self.run -= count;
            filled += count;
        }
        Ok(filled)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::write::packed;
    use super::*;
    use proptest::prelude::*;

    const ALL: [Compression; 5] = [
        Compression::None,
        Compression::Lzw,
        Compression::Deflate,
        Compression::PackBits,
        Compression::Zstd,
    ];

    proptest! {
        #[test]
        fn what_is_packed_is_read_in_pieces_of_any_size(
            runs in proptest::collection::vec((any::<u8>(), 1_usize..300), 0..60),
            piece in 1_usize..500,
        ) {
            let bytes: Vec<u8> =
                runs.iter().flat_map(|&(byte, count)| std::iter::repeat_n(byte, count)).collect();
            for compression in ALL {
                let packed = packed(compression, &bytes);
                let mut reader = compression.reader(&packed, 27).unwrap();
                let mut got = vec![0; bytes.len()];
                for piece in got.chunks_mut(piece) {
                    reader.read_exact(piece).unwrap();
                }
                prop_assert!(got == bytes, "{:?}", compression);
                prop_assert_eq!(reader.read(&mut [0]).unwrap(), 0);
                let most = packed.len() as u64 * compression.most_expansion();
                prop_assert!(bytes.len() as u64 <= most);
            }
        }

        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            for compression in ALL {
                let most = bytes.len() as u64 * compression.most_expansion();
                if let Ok(reader) = compression.reader(&bytes, 27) {
                    let mut out = Vec::new();
                    let _ = reader.take(1 << 20).read_to_end(&mut out);
                    prop_assert!(out.len() as u64 <= most, "{:?}: {}", compression, out.len());
                }
            }
        }
    }

    #[test]
    fn the_window_of_zstd_is_known_beforehand() {
        let bytes = vec![7; 300_000];
        // A stream of unknown length has its level's window; one of known length that of its content.
        let stream = zstd::encode_all(bytes.as_slice(), 3).unwrap();
        assert_eq!(zstd_window(&stream), 1 << 21);
        let whole = zstd::bulk::compress(&bytes, 3).unwrap();
        assert!((300_000..600_000).contains(&zstd_window(&whole)), "{}", zstd_window(&whole));
    }

    #[test]
    fn memory_of_zstd_is_what_its_frame_asks_for_and_no_more_than_its_content_fills() {
        let bytes = vec![7; 300_000];
        let stream = zstd::encode_all(bytes.as_slice(), 3).unwrap();
        let whole = zstd::bulk::compress(&bytes, 3).unwrap();
        let memory = |frame: &[u8], length, at_once| {
            Compression::Zstd.decoder_bytes(frame, length, at_once) - ZSTD_BYTES
        };
        let block = ZSTD_BLOCK_BYTES;
        assert_eq!(memory(&whole, 300_000, 300_000), 0, "decoded where it belongs");
        assert_eq!(memory(&whole, 300_000, 1 << 16), block + 300_000);
        assert_eq!(memory(&stream, 300_000, 300_000), 2 * block + 300_000);
        assert_eq!(memory(&stream, 1 << 30, 1 << 30), (1 << 21) + 3 * block);
        // A window beyond the common ones is what the frame says, and never beyond the largest.
        let largest = [0x28, 0xb5, 0x2f, 0xfd, 0, 0xff];
        assert_eq!(memory(&largest, u64::MAX, 0), (1 << 27) + 3 * block);
        assert_eq!(memory(&[], 1000, 0), 0);
    }
}
