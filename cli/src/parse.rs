//! Values as people write them on the command line.

use octree_store::{LengthUnit, Region};
use parse_size::Config;

/// `512MiB`, `2GB`, `1000000`: bytes.
pub(crate) fn size(text: &str) -> Result<u64, String> {
    let config = Config::new().with_decimal();
    config.parse_size(text).map_err(|error| format!("{error}: write a size like 512MiB or 2GB"))
}

/// `X,Y,Z`: three whole numbers.
pub(crate) fn triple(text: &str) -> Result<[u64; 3], String> {
    three(text, |part| part.parse().ok())
        .ok_or_else(|| format!("expected three whole numbers X,Y,Z and found '{text}'"))
}

/// `X,Y,Z`: three sizes above 0.
pub(crate) fn spacing(text: &str) -> Result<[f64; 3], String> {
    three(text, |part| part.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0))
        .ok_or_else(|| format!("expected three sizes X,Y,Z above 0 and found '{text}'"))
}

/// An error bound, or another number that is not below 0.
pub(crate) fn error_bound(text: &str) -> Result<f64, String> {
    text.trim()
        .parse()
        .ok()
        .filter(|v: &f64| v.is_finite() && *v >= 0.0)
        .ok_or_else(|| format!("expected a number of 0 or more and found '{text}'"))
}

/// `LO,HI`: two numbers, the second above the first.
pub(crate) fn window(text: &str) -> Result<[f64; 2], String> {
    let parsed = text
        .split_once(',')
        .and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]));
    parsed
        .filter(|[low, high]: &[f64; 2]| low < high && (high - low).is_finite())
        .ok_or_else(|| format!("expected LO,HI with LO below HI and found '{text}'"))
}

/// `x0:x1,y0:y1,z0:z1`: a half-open box of voxels.
pub(crate) fn region(text: &str) -> Result<Region, String> {
    let bounds = three(text, |part| {
        let (low, high) = part.split_once(':')?;
        Some((low.trim().parse::<u64>().ok()?, high.trim().parse::<u64>().ok()?))
    });
    bounds
        .filter(|bounds| bounds.iter().all(|(low, high)| low < high))
        .map(|bounds| Region { min: bounds.map(|(low, _)| low), max: bounds.map(|(_, high)| high) })
        .ok_or_else(|| {
            format!("expected a region x0:x1,y0:y1,z0:z1, each x1 above x0, and found '{text}'")
        })
}

/// `m`, `mm`, `um` or `nm`.
pub(crate) fn unit(text: &str) -> Result<LengthUnit, String> {
    [LengthUnit::M, LengthUnit::Mm, LengthUnit::Um, LengthUnit::Nm]
        .into_iter()
        .find(|unit| unit.name() == text)
        .ok_or_else(|| format!("unknown unit '{text}': use m, mm, um or nm"))
}

fn three<V>(text: &str, parse: impl Fn(&str) -> Option<V>) -> Option<[V; 3]> {
    let parts: Option<Vec<V>> = text.split(',').map(|part| parse(part.trim())).collect();
    parts?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_decimal_or_binary_as_they_say() {
        assert_eq!(size("512MiB"), Ok(512 << 20));
        assert_eq!(size("2GB"), Ok(2_000_000_000));
        assert_eq!(size("123"), Ok(123));
        assert!(size("-1").is_err() && size("many").is_err());
    }

    #[test]
    fn triples_and_regions_are_whole() {
        assert_eq!(triple("1, 2,3"), Ok([1, 2, 3]));
        assert!(triple("1,2").is_err() && triple("1,2,3,4").is_err() && triple("1,-2,3").is_err());
        let expected = Region { min: [0, 5, 7], max: [4, 6, 9] };
        assert_eq!(region("0:4,5:6,7:9"), Ok(expected));
        assert!(region("4:4,5:6,7:9").is_err() && region("0:4,5:6").is_err());
        assert_eq!(window("-1,2.5"), Ok([-1.0, 2.5]));
        assert!(window("2,1").is_err() && window("nan,1").is_err());
        assert_eq!(error_bound(" 2.5"), Ok(2.5));
        assert!(["-1", "nan", "inf", "", "x"].iter().all(|bad| error_bound(bad).is_err()));
        assert!(spacing("0,1,1").is_err() && spacing("1,1,inf").is_err());
    }
}
