//! Numbers written as text, as a stream of little-endian samples.

use octree_store::{Sample, SampleType, with_sample_type};
use std::io::{self, BufRead, Read};

/// A longer word is no number.
const LONGEST_WORD: usize = 512;

/// Reads white-space separated numbers and gives their samples' bytes.
#[derive(Debug)]
pub(crate) struct Numbers<R> {
    text: R,
    sample_type: SampleType,
    word: Vec<u8>,
    /// Bytes of the last number that have not been asked for yet.
    rest: Vec<u8>,
}

impl<R: BufRead> Numbers<R> {
    pub(crate) fn new(text: R, sample_type: SampleType) -> Self {
        Self { text, sample_type, word: Vec::new(), rest: Vec::new() }
    }

    /// The next word, or `None` at the end.
    fn next_word(&mut self) -> io::Result<Option<&str>> {
        self.word.clear();
        loop {
            let buffer = self.text.fill_buf()?;
            if buffer.is_empty() {
                break;
            }
            let start = if self.word.is_empty() {
                buffer.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(buffer.len())
            } else {
                0
            };
            let word = &buffer[start..];
            let length = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
            if self.word.len() + length > LONGEST_WORD {
                return Err(invalid("a word is too long for a number"));
            }
            self.word.extend_from_slice(&word[..length]);
            let ended = length < word.len();
            self.text.consume(start + length);
            if ended {
                break;
            }
        }
        if self.word.is_empty() {
            return Ok(None);
        }
        std::str::from_utf8(&self.word).map(Some).map_err(|_| invalid("a word is no number"))
    }

    /// Puts the next number's bytes into `rest`; false at the end.
    fn next_number(&mut self) -> io::Result<bool> {
        let sample_type = self.sample_type;
        let Some(word) = self.next_word()? else { return Ok(false) };
        let (least, greatest) = sample_type.limits();
        let bytes = if sample_type.is_integer() {
            let value: i64 =
                word.parse().map_err(|_| invalid(format!("'{word}' is no whole number")))?;
            if !(least..=greatest).contains(&(value as f64)) {
                return Err(invalid(format!("{value} does not fit {sample_type}")));
            }
            with_sample_type!(sample_type, T => {
                T::from_f64(value as f64).to_le_array().as_ref().to_vec()
            })
        } else if sample_type == SampleType::F32 {
            let value: f32 = word.parse().map_err(|_| invalid(format!("'{word}' is no number")))?;
            value.to_le_bytes().to_vec()
        } else {
            let value: f64 = word.parse().map_err(|_| invalid(format!("'{word}' is no number")))?;
            value.to_le_bytes().to_vec()
        };
        self.rest = bytes;
        Ok(true)
    }
}

fn invalid(what: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.into())
}

impl<R: BufRead> Read for Numbers<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while filled < out.len() {
            if self.rest.is_empty() && !self.next_number()? {
                break;
            }
            let count = self.rest.len().min(out.len() - filled);
            out[filled..filled + count].copy_from_slice(&self.rest[..count]);
            self.rest.drain(..count);
            filled += count;
        }
        Ok(filled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(text: &str, sample_type: SampleType) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        // A tiny buffer, so that words straddle it.
        let text = io::BufReader::with_capacity(3, text.as_bytes());
        Numbers::new(text, sample_type).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    #[test]
    fn numbers_become_samples() {
        assert_eq!(bytes(" 1\t-2\n\n 300 ", SampleType::I16).unwrap(), [1, 0, 254, 255, 44, 1]);
        let expected: Vec<u8> =
            [1.5_f32, -0.25, f32::NAN].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(bytes("1.5 -2.5e-1 nan", SampleType::F32).unwrap(), expected);
        assert_eq!(bytes("", SampleType::U8).unwrap(), Vec::<u8>::new());
    }

    #[test]
    fn what_is_no_number_of_the_type_is_refused() {
        for (text, sample_type) in [
            ("256", SampleType::U8),
            ("1.5", SampleType::I32),
            ("x", SampleType::F64),
            ("\u{e9}", SampleType::F32),
        ] {
            assert_eq!(bytes(text, sample_type).unwrap_err().kind(), io::ErrorKind::InvalidData);
        }
        assert!(bytes(&"1".repeat(600), SampleType::F64).is_err());
    }
}
