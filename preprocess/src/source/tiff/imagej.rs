//! What ImageJ writes into a file's description: lines of `key=value` below `ImageJ=VERSION`.
//!
//! Read as its own `FileOpener.decodeDescriptionString` and `FileInfo` do: the resolution tags are
//! pixels per `unit`, `spacing` is the distance of slices in the same unit.

use super::ifd::Ifd;
use super::length::{VoxelSize, in_unit, unit_of_word};
use super::pages::{Axis, PageOrder};
use octree_store::LengthUnit;

/// An ImageJ description.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct ImageJ {
    images: u64,
    channels: Option<u64>,
    slices: Option<u64>,
    frames: Option<u64>,
    spacing: Option<f64>,
    unit: Option<String>,
    calibration: Option<[f64; 2]>,
}

impl ImageJ {
    /// Reads a description, if it is ImageJ's.
    pub(super) fn parse(description: &str) -> Option<Self> {
        if !description.starts_with("ImageJ=") {
            return None;
        }
        let value = |key: &str| {
            let mut lines = description.lines();
            lines.find_map(|line| line.strip_prefix(key)?.strip_prefix('=')).map(str::trim)
        };
        let count = |key| value(key)?.parse::<u64>().ok().filter(|&count| count > 0);
        let number = |key| value(key)?.parse::<f64>().ok().filter(|number| number.is_finite());
        let calibration = number("c0").zip(number("c1")).map(|(c0, c1)| [c0, c1]);
        Some(Self {
            images: count("images").unwrap_or(1),
            channels: count("channels"),
            slices: count("slices"),
            frames: count("frames"),
            spacing: number("spacing").filter(|&spacing| spacing != 0.0).map(f64::abs),
            unit: value("unit").filter(|unit| !unit.is_empty()).map(str::to_owned),
            // A straight line with other numbers than 0 and 1; other functions have more.
            calibration: calibration.filter(|&line| line != [0.0, 1.0]),
        })
    }

    /// How pages follow each other: channels fastest, then slices, then frames.
    pub(super) fn order(&self) -> PageOrder {
        let named = [self.channels, self.slices, self.frames];
        let [channels, slices, frames] = if named == [None; 3] {
            [1, self.images, 1]
        } else {
            named.map(|size| size.unwrap_or(1))
        };
        PageOrder { axes: [(Axis::Channel, channels), (Axis::Z, slices), (Axis::Time, frames)] }
    }

    /// The size of a voxel.
    pub(super) fn voxel_size(&self, ifd: &Ifd<'_>) -> VoxelSize {
        let scale = match ifd.number_or(296, "ResolutionUnit", 1) {
            _ if self.unit.is_some() => self.unit.as_deref().and_then(unit_of_word),
            Ok(2) => unit_of_word("inch"),
            Ok(3) => unit_of_word("cm"),
            _ => None,
        };
        let sizes = [282, 283].map(|tag| ifd.inverse_fraction(tag));
        if scale.is_none() && (sizes == [None; 2] || sizes == [Some(1.0); 2]) {
            if let Some(z) = self.spacing.filter(|&z| z != 1.0) {
                let spacing_xyz = [1.0, 1.0, z];
                return VoxelSize { spacing_xyz, ..VoxelSize::unknown() };
            }
            return VoxelSize::unknown();
        }
        let mut notes = Vec::new();
        let x = sizes[0].unwrap_or(1.0);
        let y = sizes[1].unwrap_or(x);
        let z = self.spacing.unwrap_or_else(|| {
            notes.push(
                "it does not say how far apart slices are: as far as pixels along x is assumed \
                 (--spacing gives another)"
                    .into(),
            );
            x
        });
        let Some(scale) = scale else {
            let said = self.unit.as_ref().map_or("it names no unit of length".into(), |unit| {
                format!("its unit of length is '{unit}', which is not known")
            });
            notes.push(format!("{said}: mm is assumed (--unit gives another)"));
            return VoxelSize { spacing_xyz: [x, y, z], unit: LengthUnit::default(), notes };
        };
        let spacing_xyz = [x, y, z].map(|length| in_unit(length, scale, scale.1));
        VoxelSize { spacing_xyz, unit: scale.1, notes }
    }

    /// What the user should know of the values.
    pub(super) fn value_note(&self) -> Option<String> {
        let [c0, c1] = self.calibration?;
        Some(format!(
            "ImageJ shows its values v as {c0} + {c1} v: here they are kept as they are stored"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hyperstack_says_how_its_pages_follow_each_other() {
        let text = "ImageJ=1.53t\nimages=24\nchannels=2\nslices=4\nframes=3\nhyperstack=true\n\
            unit=\\u00B5m\nspacing=-2.5\nc0=-32768.0\nc1=1.0\n";
        let meta = ImageJ::parse(text).unwrap();
        let order = meta.order();
        assert_eq!(order.axes, [(Axis::Channel, 2), (Axis::Z, 4), (Axis::Time, 3)]);
        assert_eq!(order.volume(1, 2).collect::<Vec<_>>(), [17, 19, 21, 23]);
        assert_eq!((meta.spacing, meta.images), (Some(2.5), 24));
        assert!(meta.value_note().unwrap().contains("-32768 + 1 v"));
    }

    #[test]
    fn a_plain_stack_is_slices() {
        let meta = ImageJ::parse("ImageJ=1.11a\nimages=7\n").unwrap();
        assert_eq!(meta.order().volume(0, 0).count(), 7);
        assert_eq!(ImageJ::parse("OME or other"), None);
        assert_eq!(
            ImageJ::parse("ImageJ=\nimages=0\nspacing=nan").unwrap().order().pages(),
            Some(1)
        );
    }
}
