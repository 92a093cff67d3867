//! From decoded rows to samples: predictors undone, bytes little-endian.

use super::page::Predictor;

/// Turns decoded rows into little-endian samples where they lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct RowFix {
    pub(super) predictor: Predictor,
    pub(super) big_endian: bool,
    /// Bytes of a sample: 1, 2, 4 or 8.
    pub(super) sample_bytes: usize,
}

impl RowFix {
    /// Whether rows are samples already.
    pub(super) fn is_nothing(&self) -> bool {
        self.predictor == Predictor::None && !self.swaps()
    }

    fn swaps(&self) -> bool {
        self.big_endian && self.sample_bytes > 1
    }

    /// Works on one whole row of a strip or tile; `spare` is kept from row to row.
    pub(super) fn fix(&self, row: &mut [u8], spare: &mut Vec<u8>) {
        if self.predictor == Predictor::Float {
            return undo_float(row, self.sample_bytes, spare);
        }
        if self.swaps() {
            row.chunks_exact_mut(self.sample_bytes).for_each(<[u8]>::reverse);
        }
        if self.predictor == Predictor::Horizontal {
            match self.sample_bytes {
                1 => sum_up(row, |[a], [b]| [a.wrapping_add(b)]),
                2 => sum_up(row, |a, b| {
                    u16::from_le_bytes(a).wrapping_add(u16::from_le_bytes(b)).to_le_bytes()
                }),
                4 => sum_up(row, |a, b| {
                    u32::from_le_bytes(a).wrapping_add(u32::from_le_bytes(b)).to_le_bytes()
                }),
                _ => sum_up(row, |a: [u8; 8], b| {
                    u64::from_le_bytes(a).wrapping_add(u64::from_le_bytes(b)).to_le_bytes()
                }),
            }
        }
    }
}

/// Adds to each sample the one to its left.
fn sum_up<const N: usize>(row: &mut [u8], add: impl Fn([u8; N], [u8; N]) -> [u8; N]) {
    let mut sum = [0; N];
    for sample in row.as_chunks_mut().0 {
        sum = add(sum, *sample);
        *sample = sum;
    }
}

/// Adobe's predictor for floats (TIFF Technical Note 3): the row's most significant bytes, then the
/// next ones, and so on, in either byte order; each byte less the one before it.
fn undo_float(row: &mut [u8], sample_bytes: usize, spare: &mut Vec<u8>) {
    sum_up(row, |[a], [b]| [a.wrapping_add(b)]);
    spare.clear();
    spare.extend_from_slice(row);
    let samples = row.len() / sample_bytes;
    for (significance, plane) in spare.chunks_exact(samples).enumerate() {
        let at = sample_bytes - 1 - significance;
        for (sample, &byte) in row.chunks_exact_mut(sample_bytes).zip(plane) {
            sample[at] = byte;
        }
    }
}

/// Little-endian 16-bit floats as 32-bit ones, as many as there is room for.
pub(super) fn widen(halves: &[u8], out: &mut [u8]) {
    for (out, half) in out.as_chunks_mut().0.iter_mut().zip(halves.as_chunks().0) {
        *out = f32_of_half(u16::from_le_bytes(*half)).to_le_bytes();
    }
}

/// The value of an IEEE 754 binary16, which binary32 holds exactly.
fn f32_of_half(half: u16) -> f32 {
    let sign = u32::from(half & 0x8000) << 16;
    let mantissa = u32::from(half & 0x3ff);
    let magnitude = match u32::from(half >> 10 & 0x1f) {
        0 => (mantissa as f32 / 16_777_216.0).to_bits(),
        31 => 0x7f80_0000 | mantissa << 13,
        exponent => (exponent + (127 - 15)) << 23 | mantissa << 13,
    };
    f32::from_bits(sign | magnitude)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_what_their_bits_say() {
        for half in 0..=u16::MAX {
            let (exponent, mantissa) = (i32::from(half >> 10 & 31), f64::from(half & 1023));
            let magnitude = match (exponent, half & 1023) {
                (31, 0) => f64::INFINITY,
                (31, _) => f64::NAN,
                (0, _) => mantissa * 2_f64.powi(-24),
                _ => (1024.0 + mantissa) * 2_f64.powi(exponent - 25),
            };
            let expected = if half & 0x8000 == 0 { magnitude } else { -magnitude };
            let found = f64::from(f32_of_half(half));
            assert_eq!(found.is_nan(), expected.is_nan(), "{half:04x}");
            let same = found == expected && found.is_sign_negative() == (half & 0x8000 != 0);
            assert!(found.is_nan() || same, "{half:04x}");
        }
    }

    #[test]
    fn horizontal_differences_add_up_in_either_byte_order() {
        let mut spare = Vec::new();
        let fix = RowFix { predictor: Predictor::Horizontal, big_endian: false, sample_bytes: 2 };
        let mut row = [0xff, 0x00, 0x01, 0x00, 0x00, 0xff];
        fix.fix(&mut row, &mut spare);
        assert_eq!(row, [0xff, 0x00, 0x00, 0x01, 0x00, 0x00]);
        let fix = RowFix { big_endian: true, ..fix };
        let mut row = [0x00, 0xff, 0x00, 0x01, 0xff, 0x00];
        fix.fix(&mut row, &mut spare);
        assert_eq!(row, [0xff, 0x00, 0x00, 0x01, 0x00, 0x00]);
    }

    #[test]
    fn float_prediction_is_undone() {
        let values = [1.5_f32, -2.25, 1e-30, f32::MAX, 0.0];
        // The naive way there: sort the bytes by significance, then take differences from the right.
        let mut coded: Vec<u8> =
            (0..4).flat_map(|i| values.iter().map(move |v| v.to_be_bytes()[i])).collect();
        for i in (1..coded.len()).rev() {
            coded[i] = coded[i].wrapping_sub(coded[i - 1]);
        }
        for big_endian in [false, true] {
            let fix = RowFix { predictor: Predictor::Float, big_endian, sample_bytes: 4 };
            let mut row = coded.clone();
            fix.fix(&mut row, &mut Vec::new());
            let expected: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            assert_eq!(row, expected);
        }
    }
}
