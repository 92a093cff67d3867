//! Enlarged volumes as stores: the same voxels whoever asks, sources of all kinds, stopped work.

use crate::support::{bits, index, scan, small_bricks, voxels};
use crate::upscale::{all, enlarged, enlarged_counting, plain, raw};
use flate2::Compression;
use flate2::write::GzEncoder;
use octree_store::{Encoding, Region, Sample, Store};
use preprocess::source::nifti_header::{NiftiDatatype, NiftiHeader, NiftiUnit};
use preprocess::{
    ConvertOptions, CubicKernel, Detail, NoProgress, PreprocessError, Source, SourceError,
    SourceOptions, Upscale, convert, verify_against,
};
use std::io::Write;
use std::path::Path;

/// The voxels of level 0 of a store.
fn stored<T: Sample>(path: &Path) -> Vec<T> {
    let store = Store::open(path).unwrap();
    let dims = store.geometry().dims_xyz();
    store.read_region(0, Region::whole(dims)).unwrap()
}

#[test]
fn a_voxel_has_the_same_bits_in_every_brick_slice_thread_and_budget() {
    let dims = [23, 17, 30];
    let source_voxels = scan::<u16>(dims, 5);
    let detail = Some(Detail { amplitude: 0.5, seed: 11 });
    for upscale in [
        plain(4, CubicKernel::CatmullRom),
        Upscale::new(4, CubicKernel::CatmullRom, detail).unwrap(),
        Upscale::new(3, CubicKernel::Mitchell, detail).unwrap(),
        Upscale::new(8, CubicKernel::BSpline, detail).unwrap(),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let open = || raw(folder.path(), dims, &source_voxels).upscale(upscale).unwrap();
        let (expected, clamped) = enlarged_counting(dims, &source_voxels, upscale);
        let too_small = open().limit_slices(9, 1000);
        let Err(PreprocessError::MemoryTooSmall { needed, .. }) = too_small else {
            panic!("1000 bytes were enough");
        };
        for (threads, memory) in [(9, needed), (3, needed + 200_000), (2, 1 << 30)] {
            let mut source = open();
            source.limit_slices(threads, memory).unwrap();
            assert!(all::<u16>(&source) == expected, "{threads} threads in {memory} bytes");
            assert_eq!(source.clamped_voxels(), Some(clamped));
        }
        for (core, overlap, threads) in [(8, 0, 1), (32, 2, 3), (48, 4, 2), (128, 1, 2)] {
            let options = ConvertOptions {
                brick_core: core,
                brick_overlap: overlap,
                threads,
                encoding: Encoding::Lossless,
                ..ConvertOptions::default()
            };
            let path = folder.path().join(format!("{core}.octavo"));
            let done = convert(&open(), &path, &options, &NoProgress).unwrap();
            assert!(stored::<u16>(&path) == expected, "bricks of {core} + {overlap}");
            assert_eq!(done.clamped_voxels, Some(clamped), "each voxel counts once");
            assert_eq!(done.metadata.options["upscale"], upscale.factor());
        }
    }
}

/// A hash of samples' bits (FNV-1a).
fn hash<T: Sample>(samples: &[T]) -> u64 {
    let bytes = octree_store::to_le_bytes(samples);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[test]
fn the_bits_are_the_same_on_every_machine() {
    // Whole numbers, as sines differ between systems' libraries.
    fn hash_of<T: Sample>(upscale: Upscale) -> u64 {
        let dims = [19, 14, 11];
        let noise = voxels(dims, |at| T::from_f64((bits(1, at) >> 48) as f64));
        hash(&enlarged(dims, &noise, upscale))
    }
    let detail = Some(Detail { amplitude: 0.7, seed: 42 });
    let hashes = Upscale::FACTORS.map(|factor| {
        let upscale = Upscale::new(factor, CubicKernel::CatmullRom, detail).unwrap();
        [hash_of::<u16>(upscale), hash_of::<f32>(upscale), hash_of::<f64>(upscale)]
    });
    // Plain code, AVX2 and AVX-512 gave these alike.
    let known = [
        [0x93ca_44d1_778b_daf4, 0x8876_91bd_52bb_9331, 0xf421_e09b_88fb_a701],
        [0x2230_9e46_d405_6569, 0x0769_f926_85b2_f3df, 0xe928_f1c3_4cc1_8743],
        [0x6ab0_0370_7620_8bac, 0x1225_dfaf_8cac_8cb0, 0x95a1_661d_f708_751a],
        [0xe90f_599b_92f0_b448, 0xd396_f916_7930_42c4, 0x8847_c8c4_3114_75f2],
    ];
    assert_eq!(hashes, known);
}

#[test]
fn sources_that_must_be_decoded_give_the_same_store() {
    let dims = [20, 13, 41];
    let source_voxels = scan::<u16>(dims, 6);
    let folder = tempfile::tempdir().unwrap();
    let detail = Some(Detail { amplitude: 0.25, seed: 3 });
    let upscale = Upscale::new(2, CubicKernel::CatmullRom, detail).unwrap();
    let header =
        NiftiHeader::for_volume(dims, NiftiDatatype::U16, [1.0; 3], NiftiUnit::Millimetre, None);
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(&header.unwrap().to_bytes()).unwrap();
    gzip.write_all(&octree_store::to_le_bytes(&source_voxels)).unwrap();
    let packed = folder.path().join("a.nii.gz");
    std::fs::write(&packed, gzip.finish().unwrap()).unwrap();
    let open = |plain: bool| {
        let mut source = if plain {
            raw(folder.path(), dims, &source_voxels)
        } else {
            Source::open(&packed, &SourceOptions::default()).unwrap()
        };
        source.affine = None;
        source.upscale(upscale).unwrap()
    };
    let expected = enlarged(dims, &source_voxels, upscale);
    assert!(all::<u16>(&open(false)) == expected);
    let digests = [true, false].map(|plain| {
        let path = folder.path().join(format!("{plain}.octavo"));
        let options = small_bricks(Encoding::Quantised8);
        convert(&open(plain), &path, &options, &NoProgress).unwrap().metadata.digest
    });
    assert_eq!(digests[0], digests[1]);
}

#[test]
fn a_store_is_verified_against_the_source_that_it_was_enlarged_from() {
    let dims = [14, 9, 12];
    let folder = tempfile::tempdir().unwrap();
    let voxels = scan::<i16>(dims, 9);
    let detail = Some(Detail { amplitude: 0.3, seed: u64::MAX });
    let upscale = Upscale::new(3, CubicKernel::Mitchell, detail).unwrap();
    let region = Region { min: [2, 0, 1], max: [12, 9, 11] };
    let source = raw(folder.path(), dims, &voxels).crop(region).unwrap().upscale(upscale).unwrap();
    assert!(matches!(
        raw(folder.path(), dims, &voxels).upscale(upscale).unwrap().crop(region),
        Err(SourceError::EnlargedRegion { .. })
    ));
    let path = folder.path().join("a.octavo");
    let options = ConvertOptions { roi: Some(region), ..small_bricks(Encoding::Quantised8) };
    let done = convert(&source, &path, &options, &NoProgress).unwrap();
    let store = Store::open(&path).unwrap();
    let against = |voxels: &[i16]| {
        let source = raw(folder.path(), dims, voxels);
        verify_against(&store, source, &ConvertOptions::default(), &NoProgress).unwrap()
    };
    let report = against(&voxels);
    assert!(report.damaged.is_empty() && report.rms == done.metadata.levels[0].rms);
    let mut changed = voxels.clone();
    changed[index(dims, [6, 4, 5])] ^= 0x100;
    assert!(!against(&changed).damaged.is_empty());
}

#[test]
fn too_large_a_volume_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a_33554432x1x1_u8.raw");
    std::fs::File::create(&path).unwrap().set_len(1 << 25).unwrap();
    let open = || Source::open(&path, &SourceOptions::default()).unwrap();
    assert!(open().upscale(plain(2, CubicKernel::CatmullRom)).is_ok());
    let refused = open().upscale(plain(4, CubicKernel::CatmullRom));
    assert!(matches!(refused, Err(SourceError::Geometry { .. })));
}

/// A progress that stops the work after so many bricks.
struct StopsAt(std::sync::atomic::AtomicU64);

impl preprocess::Progress for StopsAt {
    fn bricks_done(&self, bricks: u64) {
        let left = self.0.load(std::sync::atomic::Ordering::Relaxed);
        self.0.store(left.saturating_sub(bricks), std::sync::atomic::Ordering::Relaxed);
    }
    fn should_stop(&self) -> bool {
        self.0.load(std::sync::atomic::Ordering::Relaxed) == 0
    }
}

#[test]
fn stopped_work_is_gone_on_with_to_the_same_store_and_count() {
    let dims = [15, 14, 24];
    let folder = tempfile::tempdir().unwrap();
    let ends = voxels(dims, |at| if bits(7, at) >> 63 == 0 { 0 } else { 255_u8 });
    let detail = Some(Detail { amplitude: 0.5, seed: 2 });
    let upscale = Upscale::new(4, CubicKernel::CatmullRom, detail).unwrap();
    let file = raw(folder.path(), dims, &ends).files[0].clone();
    let open =
        |upscale| Source::open(&file, &SourceOptions::default()).unwrap().upscale(upscale).unwrap();
    let options =
        ConvertOptions { commit_source_bytes: 10_000, ..small_bricks(Encoding::Quantised8) };
    let whole = convert(&open(upscale), &folder.path().join("w.octavo"), &options, &NoProgress);
    let whole = whole.unwrap();
    assert!(whole.clamped_voxels > Some(1000));
    for stop in [40, 300, 700] {
        let path = folder.path().join(format!("{stop}.octavo"));
        let stopped = convert(&open(upscale), &path, &options, &StopsAt(stop.into()));
        assert!(matches!(stopped, Err(PreprocessError::Kept { .. })), "{stopped:?}");
        let resume = ConvertOptions { start: preprocess::Start::Resume, ..options.clone() };
        let other = Detail { amplitude: 0.5, seed: 3 };
        let other = Upscale::new(4, CubicKernel::CatmullRom, Some(other)).unwrap();
        let refused = convert(&open(other), &path, &resume, &NoProgress);
        assert!(matches!(refused, Err(PreprocessError::CannotResume { .. })), "another seed");
        let done = convert(&open(upscale), &path, &resume, &NoProgress).unwrap();
        assert!(done.resumed_bricks > 0);
        assert_eq!(done.metadata.digest, whole.metadata.digest);
        assert_eq!(done.clamped_voxels, whole.clamped_voxels);
    }
}
