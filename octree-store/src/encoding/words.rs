//! Samples and codes as unsigned words, so that what arranges them need not know what they mean.

use super::bit_planes::{bit_planes, from_bit_planes};
use super::filter::{Arrangement, Filter, Prediction};
use super::predict;
use crate::error::Damage;
use bytemuck::Pod;
use multiversion::multiversion;

/// An unsigned integer that holds a code, or the bits of a sample.
pub(crate) trait Word: Pod + Default + Eq + std::fmt::Debug {
    /// Its bits.
    const BITS: u8 = 8 * size_of::<Self>() as u8;
    /// Sum modulo 2^BITS.
    fn plus(self, other: Self) -> Self;
    /// Difference modulo 2^BITS.
    fn minus(self, other: Self) -> Self;
    /// Differences around 0 as small numbers: 0, -1, 1, -2, … as 0, 1, 2, 3, …
    fn zigzag(self) -> Self;
    /// The reverse of [`Word::zigzag`].
    fn unzigzag(self) -> Self;
    /// A third of the sum of three words, to the nearest.
    fn mean(words: [Self; 3]) -> Self;
    /// Byte `index`, the least significant first.
    fn byte(self, index: usize) -> u8;
    /// The word with nothing but this byte.
    fn of_byte(byte: u8, index: usize) -> Self;
    /// Its low 16 bits.
    fn to_u16(self) -> u16;
    /// The word of a code that fits.
    fn of_u16(code: u16) -> Self;
}

macro_rules! words {
    ($($unsigned:ident $signed:ident $wide:ident;)*) => {$(
        #[allow(
            clippy::cast_lossless, clippy::unnecessary_cast, trivial_numeric_casts,
            reason = "one text for four types: for some the cast is infallible or no cast"
        )]
        impl Word for $unsigned {
            #[inline(always)]
            fn plus(self, other: Self) -> Self { self.wrapping_add(other) }
            #[inline(always)]
            fn minus(self, other: Self) -> Self { self.wrapping_sub(other) }
            #[inline(always)]
            fn zigzag(self) -> Self {
                (self << 1) ^ ((self as $signed) >> ($unsigned::BITS - 1)) as Self
            }
            #[inline(always)]
            fn unzigzag(self) -> Self { (self >> 1) ^ (self & 1).wrapping_neg() }
            #[inline(always)]
            fn mean([a, b, c]: [Self; 3]) -> Self {
                ((a as $wide + b as $wide + c as $wide + 1) / 3) as Self
            }
            #[inline(always)]
            fn byte(self, index: usize) -> u8 { (self >> (8 * index)) as u8 }
            #[inline(always)]
            fn of_byte(byte: u8, index: usize) -> Self { (byte as Self) << (8 * index) }
            #[inline(always)]
            fn to_u16(self) -> u16 { self as u16 }
            #[inline(always)]
            fn of_u16(code: u16) -> Self { code as Self }
        }
    )*};
}

words! { u8 i8 u16; u16 i16 u32; u32 i32 u64; u64 i64 u128; }

/// Runs an expression with a name standing for the word that is as wide as a sample type.
macro_rules! with_word {
    ($sample:ty, $word:ident => $body:expr) => {
        match size_of::<$sample>() {
            1 => {
                type $word = u8;
                $body
            }
            2 => {
                type $word = u16;
                $body
            }
            4 => {
                type $word = u32;
                $body
            }
            _ => {
                type $word = u64;
                $body
            }
        }
    };
}
pub(crate) use with_word;

/// Planes of a filter's bit planes: of words as they are only those that `bits` need.
fn planes<W: Word>(bits: u8, filter: Filter) -> usize {
    usize::from(if filter.prediction == Prediction::None { bits.min(W::BITS) } else { W::BITS })
}

/// Bytes that `count` words take when they are arranged.
pub(crate) fn arranged_bytes<W: Word>(count: usize, bits: u8, filter: Filter) -> usize {
    match filter.arrangement {
        Arrangement::BitPlanes => planes::<W>(bits, filter) * count.div_ceil(8),
        Arrangement::InOrder | Arrangement::BytePlanes => count * size_of::<W>(),
    }
}

/// Arranges words of `bits` bits into `bytes`. `residuals` is a buffer.
pub(super) fn arrange<W: Word>(
    words: &[W],
    bits: u8,
    filter: Filter,
    residuals: &mut Vec<u64>,
    bytes: &mut Vec<u8>,
) {
    bytes.resize(arranged_bytes::<W>(words.len(), bits, filter), 0);
    let words = match filter.prediction {
        Prediction::None => words,
        prediction => {
            let residuals = buffer(residuals, words.len());
            predict::residuals(words, prediction, residuals);
            residuals
        }
    };
    match filter.arrangement {
        Arrangement::InOrder => in_order(words, bytes),
        Arrangement::BytePlanes => byte_planes(words, bytes),
        Arrangement::BitPlanes => bit_planes(words, bytes),
    }
}

/// The reverse of [`arrange`].
///
/// # Errors
/// When the filter is one that so many words cannot have.
///
/// # Panics
/// When there are not [`arranged_bytes`].
pub(crate) fn restore<W: Word>(
    bytes: &[u8],
    bits: u8,
    filter: Filter,
    words: &mut [W],
) -> Result<(), Damage> {
    assert_eq!(bytes.len(), arranged_bytes::<W>(words.len(), bits, filter));
    match filter.arrangement {
        Arrangement::InOrder => from_in_order(bytes, words),
        Arrangement::BytePlanes => from_byte_planes(bytes, words),
        Arrangement::BitPlanes => from_bit_planes(bytes, words),
    }
    predict::restore(words, filter.prediction)
}

/// `count` words of a buffer that serves words of any width.
pub(crate) fn buffer<W: Word>(buffer: &mut Vec<u64>, count: usize) -> &mut [W] {
    buffer.resize(buffer.len().max((count * size_of::<W>()).div_ceil(8)), 0);
    &mut bytemuck::cast_slice_mut(buffer)[..count]
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn in_order<W: Word>(words: &[W], bytes: &mut [u8]) {
    for (bytes, word) in bytes.chunks_exact_mut(size_of::<W>()).zip(words) {
        for (index, byte) in bytes.iter_mut().enumerate() {
            *byte = word.byte(index);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn from_in_order<W: Word>(bytes: &[u8], words: &mut [W]) {
    for (bytes, word) in bytes.chunks_exact(size_of::<W>()).zip(words) {
        *word = bytes
            .iter()
            .enumerate()
            .fold(W::default(), |word, (index, byte)| word.plus(W::of_byte(*byte, index)));
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn byte_planes<W: Word>(words: &[W], bytes: &mut [u8]) {
    for (index, plane) in bytes.chunks_exact_mut(words.len().max(1)).enumerate() {
        for (byte, word) in plane.iter_mut().zip(words) {
            *byte = word.byte(index);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn from_byte_planes<W: Word>(bytes: &[u8], words: &mut [W]) {
    for (index, plane) in bytes.chunks_exact(words.len().max(1)).enumerate() {
        if index == 0 {
            for (word, byte) in words.iter_mut().zip(plane) {
                *word = W::of_byte(*byte, 0);
            }
        } else {
            for (word, byte) in words.iter_mut().zip(plane) {
                *word = word.plus(W::of_byte(*byte, index));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bytes_are_grouped_by_significance() {
        let mut bytes = Vec::new();
        let words = [0x1122_u16, 0x3344];
        let filter = |arrangement| Filter { prediction: Prediction::None, arrangement };
        let byte_planes = filter(Arrangement::BytePlanes);
        arrange(&words, 16, byte_planes, &mut Vec::new(), &mut bytes);
        assert_eq!(bytes, [0x22, 0x44, 0x11, 0x33]);
        arrange(&words, 16, filter(Arrangement::InOrder), &mut Vec::new(), &mut bytes);
        assert_eq!(bytes, [0x22, 0x11, 0x44, 0x33]);
    }

    #[test]
    fn zigzag_folds_differences_and_unfolds_every_word() {
        assert_eq!([0_u8, 255, 1, 254, 127, 128].map(Word::zigzag), [0, 1, 2, 3, 254, 255]);
        for word in 0..=u16::MAX {
            assert_eq!(word.zigzag().unzigzag(), word);
        }
    }

    fn assert_every_filter_is_undone<W: Word>(words: &[W]) {
        let used = words.iter().map(|w| {
            (0..size_of::<W>())
                .rfind(|&i| w.byte(i) > 0)
                .map_or(0, |i| 8 * i as u8 + (8 - w.byte(i).leading_zeros() as u8))
        });
        let bits = used.max().unwrap_or(0).max(1);
        let (mut buffer, mut bytes) = (Vec::new(), Vec::new());
        for filter in Filter::all() {
            if filter.prediction.is_for_cubes() && predict::side_of(words.len()).is_none() {
                let mut words = words.to_vec();
                let bytes = vec![0; arranged_bytes::<W>(words.len(), bits, filter)];
                assert!(restore(&bytes, bits, filter, &mut words).is_err());
                continue;
            }
            arrange(words, bits, filter, &mut buffer, &mut bytes);
            let mut back = vec![W::default(); words.len()];
            restore(&bytes, bits, filter, &mut back).unwrap();
            assert_eq!(back, words, "{filter:?}");
        }
    }

    proptest! {
        #[test]
        fn every_filter_is_undone_for_every_width(
            bits in proptest::collection::vec(any::<u64>(), 0..1100), shift in 0_u32..63, side in 0_usize..10,
        ) {
            let cube = bits.len().min(side.pow(3));
            for bits in [&bits[..], &bits[..cube]] {
                assert_every_filter_is_undone::<u64>(&bits.iter().map(|b| b >> shift).collect::<Vec<_>>());
                assert_every_filter_is_undone::<u32>(&bits.iter().map(|b| (b >> shift) as u32).collect::<Vec<_>>());
                assert_every_filter_is_undone::<u16>(&bits.iter().map(|b| (b >> shift) as u16).collect::<Vec<_>>());
                assert_every_filter_is_undone::<u8>(&bits.iter().map(|b| (b >> shift) as u8).collect::<Vec<_>>());
            }
        }
    }
}
