//! File names with a number in them, written as C's `printf` would: `slice%03d.raw`.

/// A name with one place for a number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct NumberedName {
    before: String,
    after: String,
    width: usize,
    zeros: bool,
}

/// A name wider than this is none.
const WIDEST: usize = 64;

impl NumberedName {
    /// Reads a pattern: one of `%d`, `%i`, `%u`, with a width and a leading zero where wanted; `%%` is a
    /// percent sign. `None` where there is no such place, or more than one.
    pub(super) fn parse(pattern: &str) -> Option<Self> {
        let mut texts = vec![String::new()];
        let mut form = None;
        let mut rest = pattern;
        while let Some((text, tail)) = rest.split_once('%') {
            texts.last_mut()?.push_str(text);
            if let Some(tail) = tail.strip_prefix('%') {
                texts.last_mut()?.push('%');
                rest = tail;
                continue;
            }
            let letter = tail.find(|c: char| !c.is_ascii_digit())?;
            let (digits, tail) = tail.split_at(letter);
            rest = tail.strip_prefix(['d', 'i', 'u'])?;
            let width = if digits.is_empty() { 0 } else { digits.parse().ok()? };
            if width > WIDEST || form.replace((width, digits.starts_with('0'))).is_some() {
                return None;
            }
            texts.push(String::new());
        }
        texts.last_mut()?.push_str(rest);
        let (width, zeros) = form?;
        let [before, after] = texts.try_into().ok()?;
        Some(Self { before, after, width, zeros })
    }

    /// The name with this number.
    pub(super) fn name(&self, number: i64) -> String {
        let Self { before, after, width, zeros } = self;
        let width = *width;
        if *zeros {
            format!("{before}{number:0width$}{after}")
        } else {
            format!("{before}{number:width$}{after}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn name(pattern: &str, number: i64) -> Option<String> {
        NumberedName::parse(pattern).map(|name| name.name(number))
    }

    #[test]
    fn numbers_are_written_as_printf_would() {
        assert_eq!(name("a%03d.raw", 7).as_deref(), Some("a007.raw"));
        assert_eq!(name("a%d.raw", 7).as_deref(), Some("a7.raw"));
        assert_eq!(name("a%3u", 7).as_deref(), Some("a  7"));
        assert_eq!(name("100%%_%02i_%%.raw", 1234).as_deref(), Some("100%_1234_%.raw"));
        assert_eq!(name("a%04d", -7).as_deref(), Some("a-007"));
    }

    #[test]
    fn other_patterns_are_none() {
        for pattern in ["a.raw", "a%", "a%03", "a%s", "%d%d", "%999d", "%%", "%-3d", "%.3d"] {
            assert_eq!(NumberedName::parse(pattern), None, "{pattern}");
        }
    }

    proptest! {
        #[test]
        fn any_pattern_is_taken_or_refused(pattern in "[%0-9ad\\PC]{0,12}", number in any::<i64>()) {
            if let Some(name) = name(&pattern, number) {
                prop_assert!(name.len() <= pattern.len() + WIDEST + 20);
            }
        }
    }
}
