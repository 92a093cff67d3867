//! The digest: a hash of what a store says, whatever way it came to say it.
//!
//! BLAKE3 over the metadata that describes the volume (without time, path and program), then every
//! node record in key order without its place. A record holds the XXH3-128 checksum of its payload,
//! so the payloads are covered too. Two stores with one digest give a reader the same samples;
//! thread count, page layout and resumed conversions do not show in it.

use crate::metadata::Metadata;
use crate::record::NodeRecord;

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

    /// The digest of these records under this metadata, as 64 hexadecimal digits.
    pub fn finish(self, metadata: &Metadata) -> String {
        let content = Metadata {
            complete: true,
            digest: String::new(),
            source: crate::SourceDescription::default(),
            created_by: String::new(),
            created_unix_secs: 0,
            ..metadata.clone()
        };
        let mut hasher = blake3::Hasher::new();
        hasher.update(&serde_json::to_vec(&content).expect("metadata has string keys"));
        hasher.update(self.records.finalize().as_bytes());
        hasher.finalize().to_hex().to_string()
    }
}
