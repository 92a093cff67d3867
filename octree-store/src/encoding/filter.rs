//! How a payload's words are arranged before compression: each as a difference from a prediction or
//! as it is, then in order, by byte, or by bit. FORMAT.md has every byte of it.

/// What a word is predicted from; its difference from that is stored, zigzag.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Prediction {
    /// Words are stored as they are.
    #[default]
    None = 0,
    /// From the word before.
    Previous = 1,
    /// From the seven neighbours that come before it in x, y and z (Ibarria, Lindstrom, Rossignac and
    /// Szymczak 2003, the Lorenzo predictor): differences along x, then y, then z.
    Lorenzo = 2,
    /// From the mean of the words before it in x, y and z: where there is noise on structure, a mean has less
    /// of the noise than the sum that Lorenzo's predictor is.
    Mean = 3,
}

impl Prediction {
    /// Whether it looks along y and z.
    pub(crate) fn is_for_cubes(self) -> bool {
        matches!(self, Self::Lorenzo | Self::Mean)
    }
}

/// The order of a payload's bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Arrangement {
    /// Word after word, little-endian.
    #[default]
    InOrder = 0,
    /// All first bytes of the words, then all second bytes, and so on.
    BytePlanes = 1,
    /// All lowest bits of the words, then all second bits, and so on; no more than the words use.
    BitPlanes = 2,
}

/// How a payload's words are arranged before compression.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Filter {
    /// What is stored of a word.
    pub prediction: Prediction,
    /// In which order.
    pub arrangement: Arrangement,
}

impl Filter {
    /// Words as they are, in order.
    pub const NONE: Self = Self { prediction: Prediction::None, arrangement: Arrangement::InOrder };

    /// Every filter, by id.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..=u8::MAX).filter_map(Self::from_id)
    }

    /// The id in FORMAT.md: arrangement + 16 x prediction.
    pub fn id(self) -> u8 {
        self.arrangement as u8 + 16 * self.prediction as u8
    }

    /// The filter with this id in FORMAT.md.
    pub fn from_id(id: u8) -> Option<Self> {
        let prediction =
            [Prediction::None, Prediction::Previous, Prediction::Lorenzo, Prediction::Mean]
                .into_iter()
                .find(|prediction| *prediction as u8 == id >> 4)?;
        let arrangement = [Arrangement::InOrder, Arrangement::BytePlanes, Arrangement::BitPlanes]
            .into_iter()
            .find(|arrangement| *arrangement as u8 == id & 15)?;
        Some(Self { prediction, arrangement })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_those_of_format_md() {
        let ids: Vec<_> = Filter::all().map(Filter::id).collect();
        assert_eq!(ids, [0, 1, 2, 16, 17, 18, 32, 33, 34, 48, 49, 50]);
        assert_eq!(Filter::from_id(0), Some(Filter::NONE));
        let by_byte = Filter { arrangement: Arrangement::BytePlanes, ..Filter::NONE };
        assert_eq!(Filter::from_id(1), Some(by_byte));
        assert_eq!(Filter::from_id(64), None);
    }
}
