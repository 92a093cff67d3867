//! What a raw file's name says: `NAME_XxYxZ_TYPE.raw`.

use octree_store::SampleType;
use std::path::Path;

/// Dimensions and type that a raw file's name carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawName {
    /// Voxels along x, y, z.
    pub dims_xyz: [u64; 3],
    /// The type of the samples.
    pub sample_type: SampleType,
    /// Whether the type ends in `be`.
    pub big_endian: bool,
}

impl RawName {
    /// Reads a name like `tooth_103x94x161_u16.raw`; the type may be long (`uint16`) and may name its
    /// byte order (`uint16be`). `None` where the name has another shape.
    pub fn parse(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let name = name.strip_suffix(".raw")?;
        let (rest, sample_type) = name.rsplit_once('_')?;
        let dims = rest.rsplit_once('_').map_or(rest, |(_, dims)| dims);
        let mut sizes = dims.split('x').map(|size| {
            // `parse` alone would take a sign.
            size.bytes().all(|b| b.is_ascii_digit()).then(|| size.parse::<u64>().ok()).flatten()
        });
        let dims_xyz = [sizes.next()??, sizes.next()??, sizes.next()??];
        if sizes.next().is_some() {
            return None;
        }
        let little = sample_type.strip_suffix("le");
        let big = sample_type.strip_suffix("be");
        let sample_type = little.or(big).unwrap_or(sample_type).parse().ok()?;
        Some(Self { dims_xyz, sample_type, big_endian: big.is_some() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(name: &str) -> Option<RawName> {
        RawName::parse(Path::new(name))
    }

    #[test]
    fn names_as_people_write_them() {
        let tooth =
            RawName { dims_xyz: [103, 94, 161], sample_type: SampleType::U16, big_endian: false };
        assert_eq!(parse("data/my_tooth_103x94x161_u16.raw"), Some(tooth));
        assert_eq!(parse("tooth_103x94x161_uint16.raw"), Some(tooth));
        assert_eq!(parse("tooth_103x94x161_uint16le.raw"), Some(tooth));
        assert_eq!(parse("TOOTH_103X94X161_U16.RAW"), Some(tooth));
        assert_eq!(parse("103x94x161_u16be.raw"), Some(RawName { big_endian: true, ..tooth }));
        for other in [
            "tooth.raw",
            "a_1x2_u8.raw",
            "a_1x2x3x4_u8.raw",
            "a_1x2x3_u9.raw",
            "a_+1x2x3_u8.raw",
            "a_1x2x3_u8.bin",
        ] {
            assert_eq!(parse(other), None, "{other}");
        }
    }

    proptest! {
        #[test]
        fn any_name_is_taken_or_refused(name in "\\PC{0,40}") {
            parse(&format!("{name}.raw"));
        }

        #[test]
        fn what_is_written_is_read(dims in any::<[u64; 3]>(), index in 0_usize..8) {
            let sample_type = SampleType::ALL[index];
            let [x, y, z] = dims;
            let name = parse(&format!("a_{x}x{y}x{z}_{sample_type}.raw"));
            prop_assert_eq!(name, Some(RawName { dims_xyz: dims, sample_type, big_endian: false }));
        }
    }
}
