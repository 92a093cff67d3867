//! The bundled volumes are the ones that the manifest names, and not too many.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::path::Path;

fn files_below(folder: &Path, found: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files_below(&path, found);
        } else {
            let name = path.strip_prefix(data_samples::folder()).unwrap();
            found.insert(name.to_str().unwrap().to_owned());
        }
    }
}

#[test]
fn every_file_has_its_checksum_in_the_manifest_and_none_is_missing() {
    let manifest = std::fs::read_to_string(data_samples::sample_path("MANIFEST.tsv")).unwrap();
    let mut named = BTreeSet::new();
    let mut bytes = 0;
    for line in manifest.lines().skip(1) {
        let fields: Vec<&str> = line.split('\t').collect();
        assert_eq!(fields.len(), 8, "{line}");
        assert!(!fields[6].is_empty(), "a licence: {line}");
        let file = std::fs::read(data_samples::sample_path(fields[0])).unwrap();
        let named_sum: Vec<u8> = (0..32)
            .map(|i| u8::from_str_radix(&fields[7][2 * i..2 * i + 2], 16).unwrap())
            .collect();
        assert_eq!(Sha256::digest(&file).as_slice(), named_sum, "{}", fields[0]);
        bytes += file.len();
        named.insert(fields[0].to_owned());
    }
    assert!(bytes <= 12_000_000, "{bytes} bytes of samples");
    let mut present = BTreeSet::new();
    for folder in ["nifti-suite", "headers", "damaged", "tiff-suite", "tiff-slices"] {
        files_below(&data_samples::folder().join(folder), &mut present);
    }
    assert!(present.is_subset(&named), "not in the manifest: {:?}", present.difference(&named));
    assert!(named.contains("tooth.nii.gz"));
}
