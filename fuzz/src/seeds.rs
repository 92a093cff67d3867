//! What fuzzing begins with: small files of every kind, those of `data-samples` and some that are made here.

use crate::files::folder;
use octree_store::{
    Effort, Encoding, Geometry, NodeKey, OverlapAtRest, SampleType, encode_samples,
};
use preprocess::{ConvertOptions, NoProgress, Source, SourceOptions, convert};
use std::path::{Path, PathBuf};

/// The largest file that is a seed.
const LARGEST: u64 = 64 << 10;

/// The seeds of a parser; `others` is a folder with more volume files, if there is one.
pub fn seeds(name: &str, others: Option<&Path>) -> Vec<Vec<u8>> {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data-samples");
    let ending = |endings: &[&str]| {
        let mut found = Vec::new();
        for root in [Some(samples.as_path()), others].into_iter().flatten() {
            files_in(root, endings, &mut found);
        }
        found.sort();
        found.iter().map(|path| std::fs::read(path).unwrap()).collect::<Vec<_>>()
    };
    match name {
        "raw_name" => ["_4x4x4_u8", "_4x2x4_u16_be", "scan_16x16x1_i8", "_2x2x2_f64", "-1x0x3_f32", "_99999999999x9x9_u8"]
            .map(|name| name.as_bytes().to_vec())
            .into(),
        "nifti" => ending(&["nii", "hdr", "gz"]),
        "nrrd" => ending(&["nrrd", "nhdr"]),
        "metaimage" => ending(&["mha", "mhd"]),
        "tiff" => ending(&["tif", "tiff"]),
        "dicom" => vec![dicom(16, 8, 6), dicom(8, 16, 3)],
        "png_slices" => [(png::BitDepth::Eight, 48), (png::BitDepth::Sixteen, 96)].map(|(depth, bytes)| png_pair(depth, bytes)).into(),
        "store" => stores(),
        "payload" => payloads(),
        "node_record" => records(),
        "transfer" => [
            r#"{"points":[{"value":0,"color":[0,0,0],"extinction":0},{"value":900,"color":[1,0.9,0.8],"extinction":2.5}]}"#,
            r#"{"colormap":"viridis","range":[0,900],"points":[{"value":0,"extinction":0},{"value":900,"extinction":1}]}"#,
            r#"{"points":[{"value":-1e300,"color":[1,1,1],"extinction":1e300},{"value":-1e300,"color":[0,1,0],"extinction":0}]}"#,
        ]
        .map(|json| json.as_bytes().to_vec())
        .into(),
        "camera" => [
            r#"{"projection":"perspective","position":[80,60,-200],"target":[50,47,80],"up":[0,-1,0],"fov_y_deg":40}"#,
            r#"{"projection":"orthographic","position":[50,47,-10],"target":[50,47,80],"up":[0,-1,0],"height":120}"#,
            r#"{"projection":"matrix","clip_from_world":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0.5,1]]}"#,
        ]
        .map(|json| json.as_bytes().to_vec())
        .into(),
        "http" => [
            "\0{\"keys\":[[0,0,0,0],[1,0,0,0],[9,9,9,9]]}",
            concat!(
                "\x01{\"cameras\":[{\"projection\":\"perspective\",\"position\":[80,60,-200],\"target\":[10,9,8],\"up\":[0,-1,0],",
                "\"fov_y_deg\":40}],\"size\":[64,48],\"accuracy\":1,\"budget\":100,\"have\":[]}"
            ),
            "\x02v1/a/info",
            "\x02v1/a/nodes?first=0&count=5",
            "\x02v1/a/bricks/0/0/0/0?form=codes",
            "\x02v1/a/slices/x/3?level=0",
            "\x02zarr2/a/0/0/0/0",
            "\x02zarr3/a/zarr.json",
            "\x02zarr3-5d/a/0/c/0/0/0/0/0",
            "\x02precomputed/a/1_1_1/0-8_0-8_0-8",
        ]
        .map(|text| text.as_bytes().to_vec())
        .into(),
        _ => Vec::new(),
    }
}

/// Small files with one of these endings, in a folder and those within it.
fn files_in(folder: &Path, endings: &[&str], found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        if path.is_dir() {
            files_in(&path, endings, found);
        } else if endings.contains(&ending) && entry.metadata().is_ok_and(|m| m.len() <= LARGEST) {
            found.push(path);
        }
    }
}

/// A DICOM file of one slice, or of some frames: explicit, little-endian.
fn dicom(columns: u16, rows: u16, frames: u16) -> Vec<u8> {
    let element = |group: u16, element: u16, kind: &str, value: &[u8]| {
        let mut value = value.to_vec();
        if value.len() % 2 == 1 {
            value.push(if kind == "UI" { 0 } else { b' ' });
        }
        let mut bytes = [group.to_le_bytes(), element.to_le_bytes()].concat();
        bytes.extend_from_slice(kind.as_bytes());
        if kind == "OW" {
            bytes.extend([0, 0]);
            bytes.extend((value.len() as u32).to_le_bytes());
        } else {
            bytes.extend((value.len() as u16).to_le_bytes());
        }
        bytes.extend(value);
        bytes
    };
    let short = |n: u16| n.to_le_bytes();
    let syntax = element(2, 0x10, "UI", b"1.2.840.10008.1.2.1");
    let mut bytes = vec![0; 128];
    bytes.extend_from_slice(b"DICM");
    bytes.extend(element(2, 0, "UL", &(syntax.len() as u32).to_le_bytes()));
    bytes.extend(syntax);
    let pixels: Vec<u8> = (0..u32::from(columns) * u32::from(rows) * u32::from(frames) * 2)
        .map(|i| (i * 31 / 4) as u8)
        .collect();
    for part in [
        element(8, 0x16, "UI", b"1.2.840.10008.5.1.4.1.1.2"),
        element(0x18, 0x50, "DS", b"2.5"),
        element(0x20, 0x0e, "UI", b"1.2.3"),
        element(0x28, 2, "US", &short(1)),
        element(0x28, 4, "CS", b"MONOCHROME2"),
        element(0x28, 8, "IS", frames.to_string().as_bytes()),
        element(0x28, 0x10, "US", &short(rows)),
        element(0x28, 0x11, "US", &short(columns)),
        element(0x28, 0x30, "DS", b"0.5\\0.5"),
        element(0x28, 0x100, "US", &short(16)),
        element(0x28, 0x101, "US", &short(16)),
        element(0x28, 0x102, "US", &short(15)),
        element(0x28, 0x103, "US", &short(0)),
        element(0x7fe0, 0x10, "OW", &pixels),
    ] {
        bytes.extend(part);
    }
    bytes
}

/// Two slices of 8 x 6, the first byte saying where the second begins.
fn png_pair(depth: png::BitDepth, bytes: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 8, 6);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    let pixels: Vec<u8> = (0..bytes).map(|i| i.wrapping_mul(29)).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    [vec![255], file].concat()
}

/// A volume of 20 x 9 x 8 that is neither smooth nor noise.
fn volume() -> Vec<u8> {
    (0..20 * 9 * 8_u32)
        .flat_map(|i| ((i % 20 * 300 + i / 180 * 77 + i * 7919 % 61) as u16).to_le_bytes())
        .collect()
}

fn stores() -> Vec<Vec<u8>> {
    let folder = folder();
    let raw = folder.path().join("a_20x9x8_u16.raw");
    std::fs::write(&raw, volume()).unwrap();
    let source = Source::open(&raw, &SourceOptions::default()).unwrap();
    let mut stores = Vec::new();
    for (encoding, effort) in [
        (Encoding::Quantised8, Effort::Balanced),
        (Encoding::Lossless, Effort::Small),
        (Encoding::max_error(5.0).unwrap(), Effort::Small),
    ] {
        for overlap_at_rest in [OverlapAtRest::Stored, OverlapAtRest::Assembled] {
            let how = ConvertOptions {
                brick_core: 8,
                encoding,
                effort,
                overlap_at_rest,
                threads: 1,
                ..ConvertOptions::default()
            };
            let output = folder.path().join(format!("{}.octavo", stores.len()));
            convert(&source, &output, &how, &NoProgress).unwrap();
            stores.push(std::fs::read(output).unwrap());
        }
    }
    stores
}

fn payloads() -> Vec<Vec<u8>> {
    let types =
        [SampleType::U8, SampleType::U16, SampleType::I32, SampleType::F32, SampleType::F64];
    let geometry = Geometry::new([8; 3], 8, 1).unwrap();
    let mut payloads = Vec::new();
    for (sort, sample_type) in (0..).zip(types) {
        for encoding in
            [Encoding::Quantised8, Encoding::Lossless, Encoding::max_error(2.0).unwrap()]
        {
            octree_store::with_sample_type!(sample_type, T => {
                let sample = |i: usize| <T as octree_store::Sample>::from_f64((i % 10 * 9 + i / 100 * 3) as f64);
                let samples: Vec<T> = (0..geometry.brick_samples()).map(sample).collect();
                let (record, payload) = encode_samples(NodeKey::new(0, [0; 3]), &samples, encoding);
                let how = [sort, record.coding as u8 - 1, record.bits, record.filter.id(), record.compression as u8, 0];
                payloads.push([how.to_vec(), payload].concat());
            });
        }
    }
    payloads
}

fn records() -> Vec<Vec<u8>> {
    let samples: Vec<u16> = (0..1000).map(|i| i * 13 % 511).collect();
    [Encoding::Quantised8, Encoding::Lossless, Encoding::max_error(2.0).unwrap()]
        .map(|encoding| {
            encode_samples(NodeKey::new(3, [5, 6, 7]), &samples, encoding).0.to_bytes().to_vec()
        })
        .into()
}
