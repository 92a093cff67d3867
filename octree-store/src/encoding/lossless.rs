//! The `lossless` encoding: the samples' own little-endian bytes, byte-shuffled so that LZ4 finds
//! the slowly changing high bytes side by side.

use crate::sample::Sample;
use multiversion::multiversion;

/// The shuffled bytes of `samples`: byte 0 of every sample, then byte 1 of every sample, …
pub fn shuffle<T: Sample>(samples: &[T], bytes: &mut Vec<u8>) {
    bytes.resize(size_of_val(samples), 0);
    shuffle_into(samples, bytes);
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn shuffle_into<T: Sample>(samples: &[T], bytes: &mut [u8]) {
    for (byte, plane) in bytes.chunks_exact_mut(samples.len().max(1)).enumerate() {
        for (out, sample) in plane.iter_mut().zip(samples) {
            *out = sample.to_le_array().as_ref()[byte];
        }
    }
}

/// The reverse of [`shuffle`]; `bytes` holds `samples.len()` samples.
pub fn unshuffle<T: Sample>(bytes: &[u8], samples: &mut [T]) {
    assert_eq!(bytes.len(), size_of_val(samples));
    unshuffle_from(bytes, samples);
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn unshuffle_from<T: Sample>(bytes: &[u8], samples: &mut [T]) {
    let count = samples.len();
    for (index, sample) in samples.iter_mut().enumerate() {
        let mut le = T::Bytes::default();
        for (byte, out) in le.as_mut().iter_mut().enumerate() {
            *out = bytes[byte * count + index];
        }
        *sample = T::from_le_slice(le.as_ref());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bytes_are_grouped_by_significance() {
        let mut bytes = Vec::new();
        shuffle(&[0x1122_u16, 0x3344], &mut bytes);
        assert_eq!(bytes, [0x22, 0x44, 0x11, 0x33]);
    }

    proptest! {
        #[test]
        fn every_bit_comes_back(bits in proptest::collection::vec(any::<u64>(), 0..64)) {
            let samples: Vec<f64> = bits.iter().map(|&b| f64::from_bits(b)).collect();
            let mut bytes = Vec::new();
            shuffle(&samples, &mut bytes);
            let mut back = vec![0.0_f64; samples.len()];
            unshuffle(&bytes, &mut back);
            prop_assert!(back.iter().zip(&bits).all(|(v, &b)| v.to_bits() == b));
        }
    }
}
