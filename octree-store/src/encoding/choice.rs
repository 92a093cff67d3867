//! What a user chooses: the encoding, with the error that it may make.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// How samples are to be stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// Eight bits a sample, linear over the brick's range.
    Quantised8,
    /// The source's own type, bit exact.
    Lossless,
    /// The fewest bits a brick whose error is within a bound.
    MaxError(MaxError),
}

impl Encoding {
    /// `max-error=E` for an error in source units; none where it is negative or no finite number.
    pub fn max_error(error: f64) -> Option<Self> {
        MaxError::new(error).map(Self::MaxError)
    }
}

impl fmt::Display for Encoding {
    /// The name used on the command line and in JSON: `u8`, `lossless`, `max-error=E`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Quantised8 => f.write_str("u8"),
            Self::Lossless => f.write_str("lossless"),
            Self::MaxError(error) => write!(f, "max-error={error}"),
        }
    }
}

impl FromStr for Encoding {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "u8" => Ok(Self::Quantised8),
            "lossless" => Ok(Self::Lossless),
            _ => {
                let error = text.strip_prefix("max-error=").ok_or_else(|| {
                    format!("unknown encoding '{text}': use u8, lossless or max-error=E")
                })?;
                error.parse().ok().and_then(Self::max_error).ok_or_else(|| {
                    format!(
                        "'{error}' is no error bound: use a number of 0 or more, in source units"
                    )
                })
            }
        }
    }
}

impl Serialize for Encoding {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Encoding {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// Where the overlap of bricks is while a store rests.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum OverlapAtRest {
    /// In every brick's payload: a brick is one read.
    #[default]
    Stored,
    /// Nowhere: a reader who needs it takes it from the neighbours' cores.
    Assembled,
}

/// A bound on errors, in source units: finite, 0 or more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct MaxError {
    // Its bits, so that encodings can be compared and hashed; -0 is no value of it.
    bits: u64,
}

impl MaxError {
    /// None where the error is negative or no finite number.
    pub fn new(error: f64) -> Option<Self> {
        // Adding 0 turns -0 into 0.
        (error >= 0.0 && error.is_finite()).then(|| Self { bits: (error + 0.0).to_bits() })
    }

    /// The bound.
    pub fn get(self) -> f64 {
        f64::from_bits(self.bits)
    }
}

impl fmt::Display for MaxError {
    /// The shortest number that reads as the same bits.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.get() {
            error if error == 0.0 || (1e-5..1e15).contains(&error) => write!(f, "{error}"),
            error => write!(f, "{error:e}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_are_those_of_the_command_line() {
        for (name, encoding) in [
            ("u8", Some(Encoding::Quantised8)),
            ("lossless", Some(Encoding::Lossless)),
            ("max-error=50", Encoding::max_error(50.0)),
            ("max-error=0", Encoding::max_error(-0.0)),
            ("max-error=0.1", Encoding::max_error(0.1)),
            ("max-error=1e300", Encoding::max_error(1e300)),
            ("max-error=5e-324", Encoding::max_error(f64::from_bits(1))),
        ] {
            let encoding = encoding.unwrap();
            assert_eq!(encoding.to_string(), name);
            assert_eq!(name.parse(), Ok(encoding));
            let json = serde_json::to_string(&encoding).unwrap();
            assert_eq!(json, format!("\"{name}\""));
            assert_eq!(serde_json::from_str::<Encoding>(&json).unwrap(), encoding);
        }
    }

    #[test]
    fn bounds_that_bound_nothing_are_refused() {
        for bad in
            ["max-error=-1", "max-error=nan", "max-error=inf", "max-error=", "max-error", "U8"]
        {
            assert!(bad.parse::<Encoding>().is_err(), "{bad}");
        }
        for bad in [-1.0, f64::NAN, f64::INFINITY, -f64::MIN_POSITIVE] {
            assert_eq!(MaxError::new(bad), None);
        }
    }

    proptest! {
        #[test]
        fn every_bound_comes_back_to_the_bit(bits in any::<u64>()) {
            let bound = f64::from_bits(bits).abs();
            if let Some(error) = MaxError::new(bound) {
                let back: Encoding = Encoding::MaxError(error).to_string().parse().unwrap();
                prop_assert_eq!(back, Encoding::MaxError(error));
                prop_assert_eq!(error.get().to_bits(), bound.to_bits());
            }
        }
    }
}
