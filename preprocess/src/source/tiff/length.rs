//! The size of a voxel from what files say of it: units as people write them, pixels per inch and
//! per centimetre.

use octree_store::LengthUnit;

/// A length's unit: one of ours, and how many of it make one of theirs.
pub(crate) type Scale = (f64, LengthUnit);

/// The unit that a word names.
pub(crate) fn unit_of_word(word: &str) -> Option<Scale> {
    // ImageJ writes the micro sign as an escape; there are two of it, and Latin-1 read as UTF-8.
    let word = word.trim().replace("\\u00B5", "u").replace("\\u00b5", "u");
    let word = word.replace(['\u{b5}', '\u{3bc}'], "u").replace('\u{c2}', "");
    Some(match word.as_str() {
        "m" | "meter" | "metre" | "meters" | "metres" => (1.0, LengthUnit::M),
        "dm" => (100.0, LengthUnit::Mm),
        "cm" | "centimeter" | "centimetre" | "centimeters" | "centimetres" => {
            (10.0, LengthUnit::Mm)
        }
        "mm" | "millimeter" | "millimetre" | "millimeters" | "millimetres" => (1.0, LengthUnit::Mm),
        "um" | "micron" | "microns" | "micrometer" | "micrometre" | "micrometers"
        | "micrometres" => (1.0, LengthUnit::Um),
        "nm" | "nanometer" | "nanometre" | "nanometers" | "nanometres" => (1.0, LengthUnit::Nm),
        "\u{c5}" | "\u{212b}" | "A" | "angstrom" | "angstroms" => (0.1, LengthUnit::Nm),
        "pm" => (0.001, LengthUnit::Nm),
        "in" | "inch" | "inches" => (25.4, LengthUnit::Mm),
        _ => return None,
    })
}

/// Lengths in `unit`, from one in another unit.
pub(super) fn in_unit(length: f64, (scale, from): Scale, unit: LengthUnit) -> f64 {
    let metres = |unit| match unit {
        LengthUnit::M => 0,
        LengthUnit::Mm => -3,
        LengthUnit::Um => -6,
        LengthUnit::Nm => -9,
    };
    // Powers of ten above 1 are exact, so that 0.5 mm are 500 um and nothing else.
    let power = metres(from) - metres(unit);
    let length = length * scale;
    if power >= 0 { length * 10_f64.powi(power) } else { length / 10_f64.powi(-power) }
}

/// The size of a voxel as far as a file says it, and what the user should know of that.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VoxelSize {
    pub(crate) spacing_xyz: [f64; 3],
    pub(crate) unit: LengthUnit,
    pub(crate) notes: Vec<String>,
}

impl VoxelSize {
    /// What is assumed where nothing is said.
    pub(crate) fn unknown() -> Self {
        let note =
            "it names no size of a voxel: 1 mm is assumed (--spacing and --unit give another)";
        Self { spacing_xyz: [1.0; 3], unit: LengthUnit::default(), notes: vec![note.into()] }
    }

    /// From pixels per `length` of a unit along x and y, and the same distance in z as in x.
    pub(crate) fn of_resolution(pixels_xy: [f64; 2], length: f64, unit: LengthUnit) -> Self {
        let [x, y] = pixels_xy.map(|pixels| length / pixels);
        if ![x, y].iter().all(|v| v.is_finite() && *v > 0.0) {
            return Self::unknown();
        }
        let note = "it does not say how far apart slices are: as far as pixels along x is assumed \
            (--spacing gives another)";
        Self { spacing_xyz: [x, y, x], unit, notes: vec![note.into()] }
    }
}

/// Whether so many pixels an inch are what programs write who know nothing of it.
pub(crate) fn is_screen(pixels_per_inch: f64) -> bool {
    [72.0, 96.0].iter().any(|screen| (pixels_per_inch - screen).abs() < 0.02)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_for_units() {
        for word in ["um", "micron", " \u{b5}m ", "\u{3bc}m", "\\u00B5m", "\u{c2}\u{b5}m"] {
            assert_eq!(unit_of_word(word), Some((1.0, LengthUnit::Um)), "{word}");
        }
        assert_eq!(unit_of_word("inch"), Some((25.4, LengthUnit::Mm)));
        assert_eq!(unit_of_word("cm"), Some((10.0, LengthUnit::Mm)));
        for word in ["pixel", "", "furlong"] {
            assert_eq!(unit_of_word(word), None, "{word}");
        }
    }

    #[test]
    fn lengths_change_units() {
        assert_eq!(in_unit(0.5, (1.0, LengthUnit::Mm), LengthUnit::Um), 500.0);
        assert_eq!(in_unit(2.0, (25.4, LengthUnit::Mm), LengthUnit::Mm), 50.8);
        assert_eq!(in_unit(7.0, (1.0, LengthUnit::Nm), LengthUnit::Um), 0.007);
    }

    #[test]
    fn screens_say_nothing_of_voxels() {
        assert!(is_screen(72.0) && is_screen(95.9866) && !is_screen(300.0));
    }
}
