//! Numbers in source units, for people: volumes of 1e-5 a micrometre and of 1e300 are read as well as those of
//! a scanner's counts.

/// As few digits as read back to the same number; in powers of ten where zeros would fill the line.
pub(crate) fn exact(value: f64) -> String {
    match value.abs() {
        plain if plain == 0.0 || (1e-4..1e15).contains(&plain) => format!("{value}"),
        _ => format!("{value:e}"),
    }
}

/// So many decimals; in powers of ten where these would hide the number, or it would be long.
pub(crate) fn rounded(value: f64, decimals: usize) -> String {
    match value.abs() {
        plain if plain == 0.0 || (1e-3..1e9).contains(&plain) => format!("{value:.decimals$}"),
        _ => format!("{value:.3e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neither_small_nor_large_numbers_are_hidden_or_long() {
        for (value, in_full, short) in [
            (0.0, "0", "0.0000"),
            (2.0, "2", "2.0000"),
            (0.890_676_917_680_751_6, "0.8906769176807516", "0.8907"),
            (-526.871, "-526.871", "-526.8710"),
            (0.001_25, "0.00125", "0.0013"),
            (5.880_247_044_842_69e-8, "5.88024704484269e-8", "5.880e-8"),
            (-1.7e308, "-1.7e308", "-1.700e308"),
            (4e9, "4000000000", "4.000e9"),
            (f64::from_bits(1), "5e-324", "4.941e-324"),
        ] {
            assert_eq!((exact(value).as_str(), rounded(value, 4).as_str()), (in_full, short));
            assert_eq!(exact(value).parse(), Ok(value));
        }
    }
}
