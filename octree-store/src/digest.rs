//! The digest: a hash of what a store says, whatever way it came to say it.
//!
//! BLAKE3 over the metadata that describes the volume (without time, path and program), then every
//! node record in key order without its place. A record holds the XXH3-128 checksum of its payload,
//! so the payloads are covered too. Two stores with one digest give a reader the same samples;
//! thread count, page layout and resumed conversions do not show in it.

use crate::record::NodeRecord;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::value::RawValue;
use std::fmt;

/// A digest in the making: records are to be added in key order.
#[derive(Debug, Default)]
pub struct Digest {
    records: blake3::Hasher,
}

impl Digest {
    /// Adds the next record.
    pub fn add(&mut self, record: &NodeRecord) {
        self.records.update(&record.content_bytes());
    }

    /// The digest of these records under the metadata of this JSON, as 64 hexadecimal digits.
    ///
    /// # Errors
    /// When the JSON is no object.
    pub fn finish(self, metadata_json: &[u8]) -> Result<String, serde_json::Error> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(content_of(metadata_json)?.as_bytes());
        hasher.update(self.records.finalize().as_bytes());
        Ok(hasher.finalize().to_hex().to_string())
    }
}

/// What takes the place of the values that do not count.
const PASSED_OVER: [(&str, &str); 5] = [
    ("complete", "true"),
    ("digest", r#""""#),
    ("source", r#"{"path":"","bytes":0,"sample_type":null}"#),
    ("created_by", r#""""#),
    ("created_unix_secs", "0"),
];

/// The text of the metadata that counts: as it is stored, byte for byte, so that keys which this version does
/// not know count too.
fn content_of(json: &[u8]) -> Result<String, serde_json::Error> {
    let Entries(entries) = serde_json::from_slice(json)?;
    let mut content = String::with_capacity(json.len());
    for (key, value) in entries {
        let value = match PASSED_OVER.iter().find(|(name, _)| *name == key) {
            Some((_, instead)) => instead,
            None => value.get(),
        };
        content.push(if content.is_empty() { '{' } else { ',' });
        content.push_str(&serde_json::to_string(&key)?);
        content.push(':');
        content.push_str(value);
    }
    content.push('}');
    Ok(content)
}

/// The keys and values of a JSON object in their order, the values as they stand.
struct Entries<'a>(Vec<(String, &'a RawValue)>);

impl<'de> Deserialize<'de> for Entries<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Object;
        impl<'de> Visitor<'de> for Object {
            type Value = Entries<'de>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a JSON object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Entries(entries))
            }
        }
        deserializer.deserialize_map(Object)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::Encoding;
    use crate::geometry::Geometry;
    use crate::metadata::Metadata;
    use crate::sample::SampleType;

    #[test]
    fn what_does_not_describe_the_volume_does_not_count_and_all_else_does() {
        let geometry = Geometry::new([40, 30, 20], 8, 1).unwrap();
        let plain = Metadata::new(&geometry, SampleType::F32, Encoding::Lossless);
        let digest = |metadata: &Metadata| Digest::default().finish(&metadata.to_json()).unwrap();
        let mut told = plain.clone();
        told.complete = true;
        told.digest = "d".into();
        told.source.path = r#"a "name" with {,}"#.into();
        told.created_by = "a program".into();
        told.created_unix_secs = 7;
        assert_eq!(digest(&told), digest(&plain));
        let other = Metadata { empty_value: 0.1, ..plain.clone() };
        assert_ne!(digest(&other), digest(&plain));
        // Version 0 hashed the JSON as it came from the struct.
        let content = Metadata { complete: true, ..plain.clone() }.to_json();
        assert_eq!(content_of(&told.to_json()).unwrap().as_bytes(), content);
        // A key of a later version counts too.
        let mut later = plain.to_json();
        later.pop();
        later.extend_from_slice(br#","later":{"b":1,"a":[2.50]}}"#);
        assert!(content_of(&later).unwrap().ends_with(r#","later":{"b":1,"a":[2.50]}}"#));
    }
}
