//! What tifffile writes into a file's description: the shape of the array, as JSON, and the names of its
//! axes where they were given.

use super::super::SourceError;
use super::pages::{Axis, PageOrder};
use serde::Deserialize;
use std::path::Path;

/// A tifffile description.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct Shaped {
    shape: Vec<u64>,
    axes: Option<String>,
}

impl Shaped {
    /// Reads a description, if it is tifffile's.
    pub(super) fn parse(description: &str) -> Option<Self> {
        let shaped: Self = serde_json::from_str(description.trim_end_matches('\0')).ok()?;
        (shaped.shape.len() >= 2 && !shaped.shape.contains(&0)).then_some(shaped)
    }

    /// How pages of a size follow each other: the array's axes before the last two, which are y and x. Axes of
    /// one may stand behind these. `None` where the array has no pages of this size.
    pub(super) fn order(
        &self,
        path: &Path,
        [x, y]: [u64; 2],
    ) -> Result<Option<PageOrder>, SourceError> {
        let mut shape = self.shape.as_slice();
        let leading = loop {
            match shape {
                [leading @ .., height, width] if [*height, *width] == [y, x] => break leading,
                [rest @ .., 1] => shape = rest,
                _ => return Ok(None),
            }
        };
        let letters: Vec<char> = self.axes.iter().flat_map(|axes| axes.chars()).collect();
        let many: Vec<(usize, u64)> =
            leading.iter().copied().enumerate().filter(|(_, size)| *size > 1).collect();
        if let [] | [_] = many.as_slice() {
            return Ok(Some(PageOrder::slices(many.first().map_or(1, |&(_, size)| size))));
        }
        let mut axes = Vec::new();
        for &(at, size) in many.iter().rev() {
            let axis = match letters.get(at) {
                Some('Z') => Axis::Z,
                Some('C') => Axis::Channel,
                Some('T') => Axis::Time,
                _ => return Err(self.unknown(path)),
            };
            axes.push((axis, size));
        }
        for axis in [Axis::Z, Axis::Channel, Axis::Time] {
            if axes.len() < 3 && !axes.iter().any(|(other, _)| *other == axis) {
                axes.push((axis, 1));
            }
        }
        match axes.as_slice() {
            &[a, b, c] if a.0 != b.0 && a.0 != c.0 && b.0 != c.0 => {
                Ok(Some(PageOrder { axes: [a, b, c] }))
            }
            _ => Err(self.unknown(path)),
        }
    }

    fn unknown(&self, path: &Path) -> SourceError {
        let dims = self.shape.iter().rev().copied().collect();
        SourceError::TooManyDimensions { path: path.to_owned(), dims }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order_of(description: &str, dims_xy: [u64; 2]) -> Option<PageOrder> {
        Shaped::parse(description).unwrap().order(Path::new("a.tif"), dims_xy).ok().flatten()
    }

    fn order(description: &str) -> Option<PageOrder> {
        order_of(description, [4, 5])
    }

    #[test]
    fn the_last_two_axes_are_those_of_a_page() {
        let slices = |count| Some(PageOrder::slices(count));
        for (shape, dims_xy, expected) in [
            ("[7, 1, 1]", [1, 7], slices(1)),
            ("[7, 1, 1]", [1, 1], slices(7)),
            ("[33, 1, 1]", [1, 33], slices(1)),
            ("[1, 7, 1, 1]", [7, 1], slices(1)),
            ("[3, 7, 1, 1]", [7, 3], slices(1)),
            ("[7, 5, 4, 1]", [4, 5], slices(7)),
            ("[7, 5, 4]", [5, 4], None),
            ("[1, 1]", [2, 2], None),
        ] {
            let description = format!(r#"{{"shape": {shape}}}"#);
            assert_eq!(order_of(&description, dims_xy), expected, "{shape} {dims_xy:?}");
        }
    }

    #[test]
    fn shapes_say_how_pages_follow_each_other() {
        assert_eq!(order(r#"{"shape": [7, 5, 4]}"#), Some(PageOrder::slices(7)));
        assert_eq!(order(r#"{"shape": [1, 7, 1, 5, 4]}"#), Some(PageOrder::slices(7)));
        assert_eq!(
            order(r#"{"shape": [3, 7, 5, 4], "axes": "TZYX"}"#).unwrap().axes,
            [(Axis::Z, 7), (Axis::Time, 3), (Axis::Channel, 1)]
        );
        for unclear in [
            r#"{"shape": [3, 7, 5, 4]}"#,
            r#"{"shape": [3, 7, 5, 4], "axes": "ZZYX"}"#,
            r#"{"shape": [2, 3, 7, 9, 5, 4], "axes": "TZCTYX"}"#,
        ] {
            assert_eq!(order(unclear), None, "{unclear}");
        }
        assert_eq!(Shaped::parse("a scan"), None);
    }
}
