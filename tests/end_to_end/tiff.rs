//! TIFF and PNG, as tifffile and Pillow write them: every sample, size and unit, and every refusal.

use crate::readers::python;
use crate::support::{Bench, sample};
use octree_store::{Sample, with_sample_type};
use preprocess::{Source, SourceOptions};
use serde::Deserialize;
use std::path::Path;

/// What `tests/readers/tiffs.py` says of a file.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Expected {
    Refused {
        file: String,
        refused: Vec<String>,
    },
    Volume {
        file: String,
        raw: String,
        dims_xyz: [u64; 3],
        dtype: String,
        spacing_xyz: Option<[f64; 3]>,
        unit: Option<String>,
        channel: Option<u64>,
        time: Option<u64>,
    },
}

/// All samples, little-endian.
fn bytes(source: &Source) -> Vec<u8> {
    let [x, y, z] = source.dims_xyz;
    let mut out = Vec::new();
    with_sample_type!(source.sample_type(), T => {
        let mut slices = source.slices().unwrap();
        let mut slice = vec![T::default(); (x * y) as usize];
        for _ in 0..z {
            slices.next(&mut slice).unwrap();
            for sample in &slice {
                out.extend_from_slice(sample.to_le_array().as_ref());
            }
        }
    });
    out
}

fn check(expected: &Expected) {
    match expected {
        Expected::Refused { file, refused } => {
            let error = Source::open(file, &SourceOptions::default()).expect_err(file).to_string();
            for words in refused {
                assert!(error.contains(words) && error.contains(file), "no '{words}' in: {error}");
            }
        }
        Expected::Volume { file, raw, dims_xyz, dtype, spacing_xyz, unit, channel, time } => {
            let options =
                SourceOptions { channel: *channel, time: *time, ..SourceOptions::default() };
            let source = Source::open(file, &options).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(
                (source.dims_xyz, source.sample_type().name()),
                (*dims_xyz, dtype.as_str()),
                "{file}"
            );
            assert!(bytes(&source) == std::fs::read(raw).unwrap(), "{file}");
            if let Some(spacing_xyz) = spacing_xyz {
                let close = source
                    .spacing_xyz
                    .iter()
                    .zip(spacing_xyz)
                    .all(|(got, v)| (got / v - 1.0).abs() < 1e-6);
                assert!(close, "{file}: {:?}", source.spacing_xyz);
                assert_eq!(Some(source.unit.name()), unit.as_deref(), "{file}");
            }
        }
    }
}

#[test]
fn what_tifffile_writes_and_reads_is_read_alike() {
    let bench = Bench::new();
    let suite = sample("tiff-suite");
    python("tiffs.py", &[bench.folder().to_str().unwrap(), &suite]);
    let expected = std::fs::read(bench.path("expected.json")).unwrap();
    let expected: Vec<Expected> = serde_json::from_slice(&expected).unwrap();
    assert!(expected.len() > 1000, "{}", expected.len());
    expected.iter().for_each(check);
}

#[test]
fn what_pillow_writes_as_png_is_read_alike() {
    let bench = Bench::new();
    python("pngs.py", &[bench.folder().to_str().unwrap()]);
    let expected = std::fs::read(bench.path("expected.json")).unwrap();
    let expected: Vec<Expected> = serde_json::from_slice(&expected).unwrap();
    expected.iter().for_each(check);
}

#[test]
fn a_folder_of_bone_converts_and_comes_back() {
    let bench = Bench::new();
    let folder = sample("tiff-slices");
    for input in [folder.clone(), format!("{folder}/*.tif")] {
        let report =
            bench.ok(&format!("convert {input} -o b.octavo --encoding lossless --json --force"));
        let report = report.json();
        assert_eq!(report["dims_xyz"], serde_json::json!([200, 200, 8]));
        assert_eq!(report["source"]["path"], input.as_str());
        bench.ok(&format!("verify b.octavo --against {input}"));
    }
    bench.ok("extract b.octavo -o b.raw");
    python("same_stack.py", &[&folder, bench.path("b.raw").to_str().unwrap()]);
}

/// Every bundled file, cut and changed: read or refused by name, and quickly.
#[test]
fn damaged_tiff_files_are_read_or_refused() {
    let bench = Bench::new();
    let mut refused = 0;
    let mut tried = 0;
    let mut files: Vec<_> = walk(Path::new(&sample("tiff-suite")));
    files.retain(|file| std::fs::metadata(file).unwrap().len() < 6000);
    assert!(files.len() > 30);
    for file in files {
        let whole = std::fs::read(&file).unwrap();
        for trial in 0..60 {
            let mut bytes = whole.clone();
            if trial % 2 == 0 {
                bytes.truncate(whole.len() * trial / 60);
            } else {
                // Directories are at either end; most damage is done there.
                let place = trial * trial % 500 % whole.len();
                let place = if trial % 3 == 0 { place } else { whole.len() - 1 - place };
                bytes[place] ^= [0xff, 0x80, 0x01][trial % 3];
            }
            let path = bench.write("d.tif", &bytes);
            tried += 1;
            let read = Source::open(&path, &SourceOptions::default()).and_then(|source| {
                let [x, y, _] = source.dims_xyz;
                if x * y > 1 << 22 {
                    return Ok(());
                }
                with_sample_type!(source.sample_type(), T => {
                    source.slices()?.next(&mut vec![T::default(); (x * y) as usize])
                })
            });
            if let Err(error) = read {
                assert!(error.to_string().contains("d.tif"), "{error}");
                refused += 1;
            }
        }
    }
    assert!(refused * 2 > tried, "{refused} of {tried}");
}

fn walk(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { files.extend(walk(&path)) } else { files.push(path) }
    }
    files.sort();
    files
}
