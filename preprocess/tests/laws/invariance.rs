//! One volume, one digest: whatever the threads, the memory, the file format, the byte order.

use crate::support::{Converted, converted, scan, small_bricks};
use flate2::Compression;
use flate2::write::GzEncoder;
use octree_store::{
    Effort, Encoding, LengthUnit, Region, Sample, SampleType, Store, with_sample_type,
};
use preprocess::source::nifti_header::{NiftiDatatype, NiftiHeader, NiftiUnit};
use preprocess::{
    ConvertOptions, NoProgress, PreprocessError, Source, SourceOptions, convert, verify_against,
};
use std::io::Write;
use std::path::Path;

fn digest(source: &Path, options: &ConvertOptions, how: &SourceOptions) -> String {
    let folder = tempfile::tempdir().unwrap();
    let mut source = Source::open(source, how).unwrap();
    // What the formats say of space differs; what they say of voxels must not.
    (source.spacing_xyz, source.unit, source.affine) = ([1.0; 3], LengthUnit::Mm, None);
    let done = convert(&source, &folder.path().join("a.octavo"), options, &NoProgress).unwrap();
    done.metadata.digest
}

fn scan_made<T: Sample>(encoding: Encoding) -> Converted<T> {
    let dims = [50, 41, 70];
    converted(dims, scan::<T>(dims, 6), &small_bricks(encoding))
}

#[test]
fn the_digest_does_not_depend_on_threads() {
    for encoding in [Encoding::Quantised8, Encoding::Lossless] {
        let made = scan_made::<u16>(encoding);
        for threads in [1, 2, 7] {
            let options = ConvertOptions { threads, ..small_bricks(encoding) };
            assert_eq!(
                digest(&made.raw, &options, &SourceOptions::default()),
                made.conversion.metadata.digest,
                "{threads} threads"
            );
        }
        let floats = scan_made::<f32>(encoding);
        for threads in [1, 7] {
            let options = ConvertOptions { threads, ..small_bricks(encoding) };
            assert_eq!(
                digest(&floats.raw, &options, &SourceOptions::default()),
                floats.conversion.metadata.digest
            );
        }
    }
}

#[test]
fn the_digest_does_not_depend_on_memory_and_too_little_names_the_least() {
    let made = scan_made::<u16>(Encoding::Quantised8);
    let tight = |memory_bytes| ConvertOptions {
        memory_bytes,
        threads: 2,
        ..small_bricks(Encoding::Quantised8)
    };
    let source = Source::open(&made.raw, &SourceOptions::default()).unwrap();
    let refused = convert(&source, &made.folder.path().join("b.octavo"), &tight(1), &NoProgress);
    let Err(PreprocessError::MemoryTooSmall { needed, .. }) = refused else {
        panic!("one byte was enough");
    };
    let least = digest(&made.raw, &tight(needed), &SourceOptions::default());
    assert_eq!(least, made.conversion.metadata.digest);
}

#[test]
fn the_digest_tells_different_content_apart() {
    let made = scan_made::<u16>(Encoding::Quantised8);
    let mut others = vec![made.conversion.metadata.digest.clone()];
    others.push(scan_made::<u16>(Encoding::Lossless).conversion.metadata.digest);
    let mut voxels = made.voxels.clone();
    voxels[1234] ^= 0x100;
    let changed = converted(made.dims, voxels, &small_bricks(Encoding::Quantised8));
    others.push(changed.conversion.metadata.digest);
    let core = ConvertOptions { brick_core: 16, ..small_bricks(Encoding::Quantised8) };
    others.push(digest(&made.raw, &core, &SourceOptions::default()));
    let count = others.len();
    others.sort();
    others.dedup();
    assert_eq!(others.len(), count);
}

#[test]
fn efforts_give_the_same_samples_and_say_so() {
    for encoding in [Encoding::Quantised8, Encoding::Lossless] {
        let mut made = Vec::new();
        for effort in [Effort::Balanced, Effort::Fast, Effort::Small] {
            let dims = [50, 41, 70];
            let options = ConvertOptions { effort, ..small_bricks(encoding) };
            let store = converted(dims, scan::<u16>(dims, 6), &options);
            let metadata = store.store.metadata();
            let named = metadata.options.get("effort").and_then(|name| name.as_str());
            assert_eq!(named.unwrap_or("balanced"), effort.name());
            let source = Source::open(&store.raw, &SourceOptions::default()).unwrap();
            let how = ConvertOptions::default();
            let report = verify_against(&store.store, source, &how, &NoProgress).unwrap();
            assert_eq!(report.damaged, []);
            let read = store.store.read_region::<u16>(0, Region::whole(dims)).unwrap();
            made.push((read, metadata.payload_bytes, metadata.levels[0].rms));
        }
        assert!(made.iter().all(|(read, _, rms)| *read == made[0].0 && *rms == made[0].2));
        assert!(made[2].1 < made[0].1 && made[0].1 <= made[1].1, "small is the smallest");
    }
}

#[test]
fn byte_order_header_bytes_and_names_make_no_difference() {
    for sample_type in SampleType::ALL {
        with_sample_type!(sample_type, T => {
            let made = scan_made::<T>(Encoding::Quantised8);
            let mut bytes = vec![0xab; 33];
            for voxel in &made.voxels {
                let mut big = voxel.to_le_array();
                big.reverse();
                bytes.extend_from_slice(big.as_ref());
            }
            let other = made.folder.path().join("other.raw");
            std::fs::write(&other, bytes).unwrap();
            let how = SourceOptions {
                dims_xyz: Some(made.dims),
                sample_type: Some(sample_type),
                big_endian: true,
                skip: Some(33),
                ..SourceOptions::default()
            };
            let options = small_bricks(Encoding::Quantised8);
            assert_eq!(digest(&other, &options, &how), made.conversion.metadata.digest);
        });
    }
}

fn nifti(made: &Converted<u16>) -> Vec<u8> {
    let header = NiftiHeader::for_volume(
        made.dims,
        NiftiDatatype::U16,
        [1.0; 3],
        NiftiUnit::Millimetre,
        None,
    )
    .unwrap();
    [header.to_bytes(), octree_store::to_le_bytes(&made.voxels)].concat()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn nii_and_nii_gz_and_raw_give_one_digest() {
    let made = scan_made::<u16>(Encoding::Quantised8);
    let options = small_bricks(Encoding::Quantised8);
    let file = nifti(&made);
    let (plain, zipped) = (made.folder.path().join("a.nii"), made.folder.path().join("a.nii.gz"));
    std::fs::write(&plain, &file).unwrap();
    std::fs::write(&zipped, gzip(&file)).unwrap();
    assert_eq!(
        digest(&plain, &options, &SourceOptions::default()),
        made.conversion.metadata.digest
    );
    assert_eq!(
        digest(&zipped, &options, &SourceOptions::default()),
        made.conversion.metadata.digest
    );
    // A gzip file of several members is one stream.
    let (one, two) = file.split_at(file.len() / 3);
    std::fs::write(&zipped, [gzip(one), gzip(two)].concat()).unwrap();
    assert_eq!(
        digest(&zipped, &options, &SourceOptions::default()),
        made.conversion.metadata.digest
    );
}

#[test]
fn a_region_of_interest_is_the_volume_cut_before() {
    let made = scan_made::<u16>(Encoding::Lossless);
    let roi = Region { min: [3, 10, 20], max: [47, 41, 55] };
    let cut_dims = roi.dims_xyz();
    let whole = made.store.read_region::<u16>(0, roi).unwrap();
    let cut = converted(cut_dims, whole, &small_bricks(Encoding::Lossless));
    for gz in [false, true] {
        let path = made.folder.path().join(if gz { "c.nii.gz" } else { "c.nii" });
        let file = nifti(&made);
        std::fs::write(&path, if gz { gzip(&file) } else { file }).unwrap();
        let source = Source::open(&path, &SourceOptions::default()).unwrap().crop(roi).unwrap();
        let out = made.folder.path().join(format!("roi{gz}.octavo"));
        convert(&source, &out, &small_bricks(Encoding::Lossless), &NoProgress).unwrap();
        let store = Store::open(&out).unwrap();
        assert_eq!(
            store.read_region::<u16>(0, Region::whole(cut_dims)).unwrap(),
            cut.voxels,
            "gz {gz}"
        );
        assert_eq!(store.metadata().levels, cut.store.metadata().levels);
    }
}
