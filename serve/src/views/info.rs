//! What a dataset is, in short and in full.

use crate::catalog::Entry;
use crate::statistics::widened;
use octree_store::Metadata;
use serde_json::{Value, json};

/// The source's range of values, or the type's where the source had no finite one. Its ends differ.
pub(crate) fn range(metadata: &Metadata) -> [f64; 2] {
    let (least, greatest) = metadata.sample_type.limits();
    let range = [metadata.value_min.unwrap_or(least), metadata.value_max.unwrap_or(greatest)];
    widened(range, metadata.sample_type)
}

/// One line of the list of datasets.
pub(crate) fn listed(name: &str, entry: &Entry) -> Value {
    match entry {
        Entry::Broken(problem) => json!({"name": name, "problem": problem.detail()}),
        Entry::Open(dataset) => {
            let metadata = &dataset.metadata;
            json!({
                "name": name,
                "pinned_name": format!("{name}@{}", dataset.version()),
                "digest": metadata.digest,
                "dims_xyz": metadata.dims_xyz,
                "spacing_xyz": metadata.spacing_xyz,
                "unit": metadata.unit.name(),
                "sample_type": metadata.sample_type,
                "encoding": metadata.encoding,
                "levels": metadata.levels.len(),
                "file_bytes": dataset.file_bytes,
            })
        }
    }
}
