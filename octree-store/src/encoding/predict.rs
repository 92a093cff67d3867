//! Words as differences from what their neighbours predict: small where a volume is smooth.
//!
//! Arithmetic is modulo the word, so every bit of every type comes back; differences are stored zigzag.
//! The Lorenzo predictor is the difference along x of the difference along y of the difference along z;
//! outside the brick is 0. The mean of three neighbours adds a third of the noise's variance where Lorenzo's adds
//! seven times it; undoing it, each word waits for the one before.

use super::filter::Prediction;
use super::words::Word;
use crate::error::Damage;
use multiversion::multiversion;

/// The side of a cube of so many words.
pub(super) fn side_of(count: usize) -> Option<usize> {
    let side = (count as f64).cbrt().round() as usize;
    (count > 0 && side.pow(3) == count).then_some(side)
}

/// Writes what is stored of `words`.
pub(super) fn residuals<W: Word>(words: &[W], prediction: Prediction, residuals: &mut [W]) {
    match (prediction, side_of(words.len())) {
        (Prediction::None, _) => residuals.copy_from_slice(words),
        (Prediction::Lorenzo, Some(side)) => {
            for row in 0..side * side {
                lorenzo_row(words, side, row, &mut residuals[row * side..][..side]);
            }
        }
        (Prediction::Mean, Some(side)) => {
            for row in 0..side * side {
                mean_row(words, side, row, &mut residuals[row * side..][..side]);
            }
        }
        (Prediction::Previous | Prediction::Lorenzo | Prediction::Mean, _) => {
            differences(words, residuals);
        }
    }
}

/// Undoes [`residuals`] in place.
///
/// # Errors
/// When so many words cannot have been predicted in this way.
pub(super) fn restore<W: Word>(words: &mut [W], prediction: Prediction) -> Result<(), Damage> {
    match (prediction, side_of(words.len())) {
        (Prediction::None, _) => {}
        (Prediction::Previous, _) => sums(words),
        (Prediction::Lorenzo, Some(side)) => lorenzo_sums(words, side),
        (Prediction::Mean, Some(side)) => mean_sums(words, side),
        (Prediction::Lorenzo | Prediction::Mean, None) => {
            return Err(Damage::Tree { what: "its filter, which is one for cubes" });
        }
    }
    Ok(())
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn differences<W: Word>(words: &[W], residuals: &mut [W]) {
    let Some((first, rest)) = residuals.split_first_mut() else { return };
    *first = words[0].zigzag();
    for (residual, pair) in rest.iter_mut().zip(words.windows(2)) {
        *residual = pair[1].minus(pair[0]).zigzag();
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn sums<W: Word>(words: &mut [W]) {
    for word in words.iter_mut() {
        *word = word.unzigzag();
    }
    let mut sum = W::default();
    for word in words {
        sum = sum.plus(*word);
        *word = sum;
    }
}

/// The row before row `row` along y, and along z, and along both; `None` outside the brick.
fn rows_before(side: usize, row: usize) -> [Option<usize>; 3] {
    let (y, z) = (!row.is_multiple_of(side), row >= side);
    [y.then(|| row - 1), z.then(|| row - side), (y && z).then(|| row - side - 1)]
}

/// What is stored of row `row` (counted along y, then z) of a cube.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn lorenzo_row<W: Word>(words: &[W], side: usize, row: usize, residuals: &mut [W]) {
    let at = |row: usize| &words[row * side..][..side];
    residuals.copy_from_slice(at(row));
    let [y, z, yz] = rows_before(side, row);
    for before in [y, z].into_iter().flatten() {
        for (residual, word) in residuals.iter_mut().zip(at(before)) {
            *residual = residual.minus(*word);
        }
    }
    if let Some(before) = yz {
        for (residual, word) in residuals.iter_mut().zip(at(before)) {
            *residual = residual.plus(*word);
        }
    }
    let mut before = W::default();
    for residual in residuals {
        let word = *residual;
        *residual = word.minus(before).zigzag();
        before = word;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn lorenzo_sums<W: Word>(words: &mut [W], side: usize) {
    for row in 0..side * side {
        let (done, rest) = words.split_at_mut(row * side);
        let row_words = &mut rest[..side];
        for word in row_words.iter_mut() {
            *word = word.unzigzag();
        }
        let mut sum = W::default();
        for word in row_words.iter_mut() {
            sum = sum.plus(*word);
            *word = sum;
        }
        let at = |row: usize| &done[row * side..][..side];
        let [y, z, yz] = rows_before(side, row);
        for before in [y, z].into_iter().flatten() {
            for (word, before) in row_words.iter_mut().zip(at(before)) {
                *word = word.plus(*before);
            }
        }
        if let Some(before) = yz {
            for (word, before) in row_words.iter_mut().zip(at(before)) {
                *word = word.minus(*before);
            }
        }
    }
}

/// The rows along y and z that row `row` is predicted from: the one that exists stands for the other; `None` for
/// the first row of all.
fn rows_beside(side: usize, row: usize) -> Option<[usize; 2]> {
    let [y, z, _] = rows_before(side, row);
    Some([y.or(z)?, z.or(y)?])
}

/// What is stored of row `row` (counted along y, then z) of a cube.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub(super) fn mean_row<W: Word>(words: &[W], side: usize, row: usize, residuals: &mut [W]) {
    let at = |row: usize| &words[row * side..][..side];
    let Some([y, z]) = rows_beside(side, row) else { return differences(at(row), residuals) };
    let (y, z) = (at(y), at(z));
    let mut before = y[0];
    for (residual, ((word, y), z)) in residuals.iter_mut().zip(at(row).iter().zip(y).zip(z)) {
        *residual = word.minus(W::mean([before, *y, *z])).zigzag();
        before = *word;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn mean_sums<W: Word>(words: &mut [W], side: usize) {
    for row in 0..side * side {
        let (done, rest) = words.split_at_mut(row * side);
        let row_words = &mut rest[..side];
        let Some([y, z]) = rows_beside(side, row) else {
            sums(row_words);
            continue;
        };
        let (y, z) = (&done[y * side..][..side], &done[z * side..][..side]);
        let mut before = y[0];
        for (word, (y, z)) in row_words.iter_mut().zip(y.iter().zip(z)) {
            before = W::mean([before, *y, *z]).plus(word.unzigzag());
            *word = before;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The formula: a word minus its prediction from the seven neighbours before it.
    fn twin(words: &[u16], side: usize) -> Vec<u16> {
        let at = |x: i64, y: i64, z: i64| {
            let inside = x >= 0 && y >= 0 && z >= 0;
            if inside {
                i64::from(words[((z as usize * side) + y as usize) * side + x as usize])
            } else {
                0
            }
        };
        let n = side as i64;
        let mut residuals = Vec::new();
        for (z, y, x) in
            (0..n).flat_map(|z| (0..n).flat_map(move |y| (0..n).map(move |x| (z, y, x))))
        {
            let predicted = at(x - 1, y, z) + at(x, y - 1, z) + at(x, y, z - 1)
                - at(x - 1, y - 1, z)
                - at(x - 1, y, z - 1)
                - at(x, y - 1, z - 1)
                + at(x - 1, y - 1, z - 1);
            residuals.push(((at(x, y, z) - predicted) as u16).zigzag());
        }
        residuals
    }

    /// FORMAT.md's words of the mean, a word at a time.
    fn mean_twin(words: &[u16], side: usize) -> Vec<u16> {
        let at = |x: usize, y: usize, z: usize| u32::from(words[(z * side + y) * side + x]);
        let mut residuals = Vec::new();
        for (i, word) in words.iter().enumerate() {
            let (x, y, z) = (i % side, i / side % side, i / side / side);
            let along_y = (y > 0).then(|| at(x, y - 1, z));
            let along_z = (z > 0).then(|| at(x, y, z - 1));
            let beside = along_y.or(along_z).zip(along_z.or(along_y));
            let predicted = match (beside, (x > 0).then(|| at(x - 1, y, z))) {
                (None, before) => before.unwrap_or(0),
                (Some((b, c)), before) => (before.unwrap_or(b) + b + c + 1) / 3,
            };
            residuals.push(word.wrapping_sub(predicted as u16).zigzag());
        }
        residuals
    }

    proptest! {
        #[test]
        fn the_mean_is_the_formula_of_three_neighbours(
            bits in proptest::collection::vec(any::<u16>(), 343), side in 1_usize..=7,
        ) {
            let words = &bits[..side.pow(3)];
            let mut stored = vec![0; words.len()];
            residuals(words, Prediction::Mean, &mut stored);
            prop_assert_eq!(&stored, &mean_twin(words, side));
        }

        #[test]
        fn lorenzo_is_the_formula_of_seven_neighbours(
            bits in proptest::collection::vec(any::<u16>(), 343), side in 1_usize..=7,
        ) {
            let words = &bits[..side.pow(3)];
            let mut stored = vec![0; words.len()];
            residuals(words, Prediction::Lorenzo, &mut stored);
            prop_assert_eq!(stored, twin(words, side));
        }
    }

    #[test]
    fn a_ramp_along_any_axis_is_predicted() {
        let words: Vec<u16> =
            (0..512).map(|i| 1000 + 3 * (i % 8) + 50 * (i / 8 % 8) + 7 * (i / 64)).collect();
        let mut stored = vec![9; 512];
        residuals(&words, Prediction::Lorenzo, &mut stored);
        let inside = |i: &usize| [i % 8, i / 8 % 8, i / 64].iter().all(|at| *at > 0);
        assert!((0..512).filter(inside).all(|i| stored[i] == 0));
    }

    #[test]
    fn only_cubes_have_a_side() {
        assert_eq!([1, 8, 46_656, 32_768, 2_515_456].map(side_of), [1, 2, 36, 32, 136].map(Some));
        assert_eq!([0, 2, 46_655, 46_657].map(side_of), [None; 4]);
    }
}
