//! Volume files: whatever they hold, opening and reading them gives samples or an error, twice the same; and a small volume becomes a lossless
//! store that is whole and equals it.

use crate::files::{file, folder};
use octree_store::{Encoding, Sample, Store, verify::verify, with_sample_type};
use preprocess::{ConvertOptions, NoProgress, Source, SourceOptions, convert, verify_against};
use std::path::Path;

/// Voxels that are read at most.
const READ: u64 = 1 << 21;
/// Voxels of a volume that is converted too.
const CONVERTED: u64 = 1 << 12;

/// Opens and reads what lies at a path.
fn opened(path: &Path) {
    let Ok(source) = Source::open(path, &SourceOptions::default()) else { return };
    let [width, height, depth] = source.dims_xyz;
    assert!(width > 0 && height > 0 && depth > 0, "{:?}", source.dims_xyz);
    let Some(slice) = width.checked_mul(height).filter(|slice| *slice <= READ) else { return };
    let slices = depth.min(READ / slice);
    let read = with_sample_type!(source.sample_type(), T => {
        let first = read::<T>(&source, slice as usize, slices);
        assert_eq!(first, read::<T>(&source, slice as usize, slices), "read twice");
        first.is_some()
    });
    if read && slice.saturating_mul(depth) <= CONVERTED {
        converted(source, path);
    }
}

/// The bits of the first slices; none where they cannot be read.
fn read<T: Sample>(source: &Source, slice: usize, count: u64) -> Option<Vec<u64>> {
    let mut slices = source.slices().ok()?;
    let mut samples = vec![T::default(); slice];
    let mut all = Vec::new();
    for _ in 0..count {
        slices.next(&mut samples).ok()?;
        all.extend(samples.iter().map(|sample| sample.to_f64().to_bits()));
    }
    Some(all)
}

/// A volume that can be read can be kept without loss. Infinite values, or none, have no error that could be measured.
fn converted(source: Source, path: &Path) {
    let folder = folder();
    let output = folder.path().join("a.octavo");
    let how = ConvertOptions {
        encoding: Encoding::Lossless,
        brick_core: 8,
        threads: 1,
        ..ConvertOptions::default()
    };
    if convert(&source, &output, &how, &NoProgress).is_err() {
        return;
    }
    let store = Store::open(&output).unwrap();
    let report = verify(&store, || true).unwrap().unwrap();
    assert!(report.is_ok(), "{}: {report:?}", path.display());
    let against = verify_against(&store, source, &how, &NoProgress).unwrap();
    assert!(against.damaged.is_empty() && against.amax == 0.0, "{against:?}");
}

fn named(name: &str, bytes: &[u8]) {
    let (_folder, path) = file(name, bytes);
    opened(&path);
}

/// A raw file's name: up to 200 bytes of it.
pub fn raw_name(bytes: &[u8]) {
    let kept = |c: char| c != '/' && c != '\0';
    let name: String =
        String::from_utf8_lossy(bytes).chars().filter(|c| kept(*c)).take(60).collect();
    let content: Vec<u8> = (0..4096_u32).map(|i| (i * 37 / 8) as u8).collect();
    named(&format!("a{name}.raw"), &content[..64 * (1 + bytes.len() % 64)]);
}

/// NIfTI and Analyze, plain or compressed.
pub fn nifti(bytes: &[u8]) {
    named(if bytes.starts_with(&[0x1f, 0x8b]) { "a.nii.gz" } else { "a.nii" }, bytes);
}

/// NRRD.
pub fn nrrd(bytes: &[u8]) {
    named("a.nrrd", bytes);
}

/// `MetaImage`.
pub fn metaimage(bytes: &[u8]) {
    named("a.mha", bytes);
}

/// TIFF and `BigTIFF`.
pub fn tiff(bytes: &[u8]) {
    named("a.tif", bytes);
}

/// DICOM: one file.
pub fn dicom(bytes: &[u8]) {
    named("a.dcm", bytes);
}

/// A folder of two slices: PNG or TIFF, by what the bytes are. The first byte says where the second begins.
pub fn png_slices(bytes: &[u8]) {
    let Some((&cut, rest)) = bytes.split_first() else { return };
    let (first, second) = rest.split_at(rest.len() * usize::from(cut) / 255);
    let folder = folder();
    let series = folder.path().join("series");
    std::fs::create_dir(&series).unwrap();
    for (name, slice) in [("s_1.png", first), ("s_2.png", second)] {
        // An empty half is the other one again.
        let slice = if slice.is_empty() { rest } else { slice };
        std::fs::write(series.join(name), slice).unwrap();
    }
    opened(&series);
}
