//! The order of a series of files: by the one number in which their names differ, every number there.

use super::StackError;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// A file's name without its ending, cut into text and numbers: text, number, text, … text.
#[derive(Debug, PartialEq, Eq)]
struct Name {
    texts: Vec<String>,
    numbers: Vec<String>,
}

impl Name {
    fn of(path: &Path) -> Self {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut name = Self { texts: vec![String::new()], numbers: Vec::new() };
        let mut in_number = false;
        for char in stem.chars() {
            let digit = char.is_ascii_digit();
            match (digit, in_number) {
                (true, false) => name.numbers.push(char.into()),
                (true, true) => name.numbers.last_mut().into_iter().for_each(|n| n.push(char)),
                (false, true) => name.texts.push(char.into()),
                (false, false) => name.texts.last_mut().into_iter().for_each(|t| t.push(char)),
            }
            in_number = digit;
        }
        if in_number {
            name.texts.push(String::new());
        }
        name
    }

    /// The name with another number at `place`, written as wide.
    fn with_number(&self, place: usize, number: u128, ending: &str) -> String {
        let mut out = self.texts[0].clone();
        for (i, text) in self.texts.iter().skip(1).enumerate() {
            let own = &self.numbers[i];
            if i == place {
                let number = format!("{number:0width$}", width = own.len());
                out.push_str(&number);
            } else {
                out.push_str(own);
            }
            out.push_str(text);
        }
        out + ending
    }
}

/// Numbers of any length, by value; of equal ones the shorter first.
fn compare_numbers(a: &str, b: &str) -> Ordering {
    let [short_a, short_b] = [a, b].map(|number| number.trim_start_matches('0'));
    short_a
        .len()
        .cmp(&short_b.len())
        .then_with(|| short_a.cmp(short_b))
        .then_with(|| a.len().cmp(&b.len()))
}

/// Natural order: `slice2` before `slice10`.
fn compare(a: &Name, b: &Name) -> Ordering {
    for i in 0.. {
        let (Some(text_a), Some(text_b)) = (a.texts.get(i), b.texts.get(i)) else { break };
        let numbers = match (a.numbers.get(i), b.numbers.get(i)) {
            (Some(a), Some(b)) => compare_numbers(a, b),
            (a, b) => a.cmp(&b),
        };
        let order = text_a.cmp(text_b).then(numbers);
        if order != Ordering::Equal {
            return order;
        }
    }
    a.texts.len().cmp(&b.texts.len())
}

/// Puts files in order. Unless `allow_gaps` is set, their names must differ in one number alone, and
/// the numbers must follow each other at one distance.
pub(super) fn arrange(files: Vec<PathBuf>, allow_gaps: bool) -> Result<Vec<PathBuf>, StackError> {
    let mut named: Vec<(Name, PathBuf)> =
        files.into_iter().map(|path| (Name::of(&path), path)).collect();
    named.sort_by(|(a, path_a), (b, path_b)| compare(a, b).then_with(|| path_a.cmp(path_b)));
    if !allow_gaps && named.len() > 1 {
        check(&named)?;
    }
    Ok(named.into_iter().map(|(_, path)| path).collect())
}

fn check(named: &[(Name, PathBuf)]) -> Result<(), StackError> {
    let (first, first_path) = &named[0];
    let no_series = |other: &PathBuf| {
        let (first, other) = (first_path.clone(), other.clone());
        StackError::NoSeries { first, other }
    };
    let mut place = None;
    for (name, path) in &named[1..] {
        if name.texts != first.texts {
            return Err(no_series(path));
        }
        let numbers = name.numbers.iter().zip(&first.numbers).enumerate();
        for (i, _) in numbers.filter(|(_, (number, first))| number != first) {
            if *place.get_or_insert(i) != i {
                return Err(no_series(path));
            }
        }
    }
    // Names that differ in their endings alone.
    let Some(place) = place else { return Err(same(&named[0], &named[1])) };
    let number = |(name, path): &(Name, PathBuf)| {
        name.numbers[place].parse::<u128>().map_err(|_| no_series(path))
    };
    let numbers: Vec<u128> = named.iter().map(number).collect::<Result<_, _>>()?;
    if let Some(i) = numbers.windows(2).position(|pair| pair[0] == pair[1]) {
        return Err(same(&named[i], &named[i + 1]));
    }
    let step = |pair: &[u128]| pair[1] - pair[0];
    let least = numbers.windows(2).map(step).min().unwrap_or(1);
    let mut missing = 0;
    let mut gap = None;
    for (i, pair) in numbers.windows(2).enumerate() {
        if step(pair) != least {
            missing += (step(pair) / least).max(2) - 1;
            gap = gap.or(Some(i));
        }
    }
    let Some(gap) = gap else { return Ok(()) };
    let ((name, before), (_, after)) = (&named[gap], &named[gap + 1]);
    let ending = before.extension().map(|end| format!(".{}", end.to_string_lossy()));
    Err(StackError::Gap {
        name: name.with_number(place, numbers[gap] + least, &ending.unwrap_or_default()),
        before: before.clone(),
        after: after.clone(),
        missing: u64::try_from(missing).unwrap_or(u64::MAX),
    })
}

fn same(first: &(Name, PathBuf), other: &(Name, PathBuf)) -> StackError {
    StackError::SameNumber { first: first.1.clone(), other: other.1.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn arranged(names: &[&str], allow_gaps: bool) -> Result<Vec<String>, StackError> {
        let files = names.iter().map(PathBuf::from).collect();
        Ok(arrange(files, allow_gaps)?.iter().map(|path| path.display().to_string()).collect())
    }

    #[test]
    fn ten_comes_after_two() {
        let names = ["s10.tif", "s9.tif", "s11.TIF", "s8.tif"];
        assert_eq!(arranged(&names, false).unwrap(), ["s8.tif", "s9.tif", "s10.tif", "s11.TIF"]);
        let names = ["a2_x007.png", "a2_x003.png", "a2_x005.png"];
        let order = ["a2_x003.png", "a2_x005.png", "a2_x007.png"];
        assert_eq!(arranged(&names, false).unwrap(), order, "a constant step is no gap");
        assert_eq!(arranged(&["only.tif"], false).unwrap(), ["only.tif"]);
    }

    #[test]
    fn what_is_missing_is_named() {
        let error = arranged(&["s_007.tif", "s_008.tif", "s_011.tif"], false).unwrap_err();
        let StackError::Gap { name, missing, .. } = error else { panic!("{error}") };
        assert_eq!((name.as_str(), missing), ("s_009.tif", 2));
        assert!(arranged(&["s_007.tif", "s_008.tif", "s_011.tif"], true).is_ok());
        // Numbers as wide as they are need not keep their width.
        let error = arranged(&["s8", "s9", "s11"], false).unwrap_err();
        let StackError::Gap { name, .. } = error else { panic!("{error}") };
        assert_eq!(name, "s10");
    }

    #[test]
    fn names_that_are_no_series_are_refused() {
        for names in [
            ["t1_z1.tif", "t1_z2.tif", "t2_z1.tif"],
            ["a1.tif", "a2.tif", "b3.tif"],
            ["a1.tif", "a2.tif", "a.tif"],
        ] {
            let error = arranged(&names, false).unwrap_err();
            assert!(matches!(error, StackError::NoSeries { .. }), "{error}");
            assert_eq!(arranged(&names, true).unwrap().len(), 3);
        }
        for names in
            [&["a1.tif", "a01.tif"][..], &["a1.tif", "a1.tiff"], &["s1.tif", "s2.tif", "s02.tif"]]
        {
            let StackError::SameNumber { first, other } = arranged(names, false).unwrap_err()
            else {
                panic!("{names:?}")
            };
            let last = &names[names.len() - 2..];
            assert_eq!([first, other].map(|path| path.display().to_string()), last);
        }
    }

    proptest! {
        #[test]
        fn any_order_of_a_series_is_put_right(
            first in 0_u64..2000, step in 1_u64..5, count in 1_usize..40, width in 0_usize..6, seed in any::<u64>(),
        ) {
            let name = |i: usize| format!("v2_{:0width$}_x.tif", first + i as u64 * step);
            let right: Vec<String> = (0..count).map(name).collect();
            let mut mixed: Vec<&str> = right.iter().map(String::as_str).collect();
            mixed.sort_by_key(|name| name.bytes().fold(seed, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3)));
            prop_assert_eq!(arranged(&mixed, false).unwrap(), right);
        }

        #[test]
        fn any_names_are_arranged_or_refused(names in prop::collection::vec("[a-b0-2.]{0,6}", 1..8)) {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            prop_assert_eq!(arranged(&names, true).unwrap().len(), names.len());
            let _ = arranged(&names, false);
        }
    }
}
