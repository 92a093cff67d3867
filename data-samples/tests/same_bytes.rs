//! A phantom is the same in whatever way, order, byte order, file or thread it is computed.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io;

use data_samples::{
    ByteOrder, Kind, Phantom, PhantomError, SampleType, WriteError, write_raw, write_raw_file,
};
use sha2::{Digest, Sha256};

/// More than two batches of the writer in `u16`, and no side a multiple of anything.
const DIMS_XYZ: [usize; 3] = [333, 251, 107];

fn kinds() -> [Kind; 5] {
    [
        Kind::micro_ct(1),
        Kind::Ramp { slope_xyz: [1.0, 2.5, -0.75] },
        Kind::Sphere { radius_voxels: 40.0, inside: 200.0, outside: 20.0 },
        Kind::HotVoxel { at_xyz: None, hot: 200.0, background: 20.0 },
        Kind::Constant { value: 100.0 },
    ]
}

fn raw(phantom: &Phantom, sample_type: SampleType, order: ByteOrder) -> Vec<u8> {
    let mut bytes = Vec::new();
    let count = write_raw(phantom, sample_type, order, &mut bytes).unwrap();
    assert_eq!(count, bytes.len() as u64);
    bytes
}

/// The start of the SHA-256 of the little-endian bytes as u8, u16 and f32; those of the analytic
/// kinds were computed by another program. A change here is a change of what every earlier
/// measurement was made on: say so where the figures stand.
#[test]
fn the_bytes_are_the_known_ones() {
    let expected = [
        ("micro-ct", ["91812621", "00ac4995", "653cda9c"]),
        ("ramp", ["aba7aa5a", "3c183118", "7121f295"]),
        ("sphere", ["1ab727cc", "1d2cbdcf", "e6e10d35"]),
        ("hot-voxel", ["1fe9e3c5", "19ec160f", "d1ade01f"]),
        ("constant", ["2d8a9886", "d89bae9d", "e087b2e3"]),
    ];
    let got = kinds().map(|kind| {
        let phantom = Phantom::new(kind.clone(), [61, 47, 33]).unwrap();
        let sums = SampleType::ALL.map(|sample_type| {
            let sum = Sha256::digest(raw(&phantom, sample_type, ByteOrder::Little));
            format!("{:02x}{:02x}{:02x}{:02x}", sum[0], sum[1], sum[2], sum[3])
        });
        (kind.name(), sums)
    });
    for ((name, got), (_, expected)) in got.into_iter().zip(expected) {
        assert_eq!(got, expected, "{name}");
    }
}

#[test]
fn a_large_volume_far_out_has_its_known_voxels() {
    let phantom = Phantom::new(Kind::micro_ct(2010), [20_000, 20_000, 20_000]).unwrap();
    let at = [[0, 0, 0], [10_000, 10_000, 1_400], [19_999, 9_000, 12_345], [11_111, 9_999, 13_001]];
    let got = at.map(|[x, y, z]| phantom.voxel::<u16>(x, y, z).unwrap());
    assert_eq!(got, [1663, 17798, 2618, 37650]);
}

#[test]
fn streamed_and_in_memory_are_the_same() {
    for kind in kinds() {
        let phantom = Phantom::new(kind, DIMS_XYZ).unwrap();
        let streamed = raw(&phantom, SampleType::U16, ByteOrder::Little);
        let in_memory = phantom.volume::<u16>().into_iter().flat_map(u16::to_le_bytes);
        assert!(in_memory.eq(streamed), "{:?}", phantom.kind());
    }
}

#[test]
fn slices_and_rows_taken_alone_and_backwards_are_the_same() {
    let dims = [70, 41, 30];
    for kind in kinds() {
        let phantom = Phantom::new(kind, dims).unwrap();
        let whole = phantom.volume::<u16>();
        let mut slice = vec![0; dims[0] * dims[1]];
        let mut row = vec![0; dims[0]];
        for (z, expected) in whole.chunks(slice.len()).enumerate().rev() {
            phantom.slice(z, &mut slice).unwrap();
            assert!(slice == expected, "{:?} z = {z}", phantom.kind());
            for (y, expected) in expected.chunks(dims[0]).enumerate().rev() {
                phantom.row(y, z, &mut row).unwrap();
                assert!(row == expected, "{:?} y = {y}, z = {z}", phantom.kind());
            }
        }
    }
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let phantom = Phantom::new(Kind::micro_ct(3), DIMS_XYZ).unwrap();
    let sums = [1, 2, 7].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        Sha256::digest(pool.install(|| raw(&phantom, SampleType::U16, ByteOrder::Little)))
    });
    assert!(sums[0] == sums[1] && sums[1] == sums[2]);
}

#[test]
fn foam_and_noise_do_not_depend_on_how_far_the_volume_reaches() {
    // Only the bodies scale: with a seed, a corner far outside them is the same air.
    let corner = |n| Phantom::new(Kind::micro_ct(5), [n; 3]).unwrap().voxel::<u16>(1, 2, 3);
    assert_eq!(corner(200), corner(3000));
    let of_seed = |seed| Phantom::new(Kind::micro_ct(seed), [40; 3]).unwrap().volume::<u16>();
    assert_ne!(of_seed(5), of_seed(6));
}

#[test]
fn big_endian_is_little_endian_swapped() {
    let phantom = Phantom::new(Kind::micro_ct(1), [40, 30, 20]).unwrap();
    for sample_type in SampleType::ALL {
        let mut big = raw(&phantom, sample_type, ByteOrder::Big);
        big.chunks_mut(sample_type.bytes()).for_each(<[u8]>::reverse);
        assert!(big == raw(&phantom, sample_type, ByteOrder::Little), "{sample_type}");
    }
}

#[test]
fn the_other_types_hold_the_same_scan() {
    let phantom = Phantom::new(Kind::micro_ct(1), [40, 30, 20]).unwrap();
    let scan = phantom.volume::<u16>();
    assert!(phantom.volume::<f32>().into_iter().eq(scan.iter().map(|&v| f32::from(v))));
    assert!(phantom.volume::<u8>().into_iter().map(u16::from).eq(scan.iter().map(|v| v >> 8)));
}

#[test]
fn a_file_holds_the_stream_and_replaces_an_older_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scan.raw");
    std::fs::write(&path, "an older file").unwrap();
    let phantom = Phantom::new(Kind::micro_ct(1), [40, 30, 20]).unwrap();
    let count = write_raw_file(&phantom, SampleType::U16, ByteOrder::Big, &path).unwrap();
    assert_eq!(count, 48_000);
    assert!(std::fs::read(&path).unwrap() == raw(&phantom, SampleType::U16, ByteOrder::Big));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "something is left behind");
}

/// Takes so many bytes and no more.
struct FullAfter(usize);

impl io::Write for FullAfter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(self.0);
        self.0 -= taken;
        if taken == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(taken) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn an_output_that_fills_up_at_any_place_is_an_error() {
    let phantom = Phantom::new(Kind::Constant { value: 1.0 }, DIMS_XYZ).unwrap();
    let whole = phantom.voxel_count() * 2;
    for room in [0, 1, 8 << 20, whole - 1] {
        let result = write_raw(&phantom, SampleType::U16, ByteOrder::Little, &mut FullAfter(room));
        let Err(WriteError::Stream { byte_offset, source }) = result else {
            panic!("{room} bytes of room: {result:?}");
        };
        assert!(byte_offset as usize <= room, "{byte_offset} of {room}");
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
    }
    write_raw(&phantom, SampleType::U16, ByteOrder::Little, &mut FullAfter(whole)).unwrap();
}

#[test]
fn a_value_that_does_not_fit_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scan.raw");
    let phantom = Phantom::new(Kind::Constant { value: 256.0 }, [4; 3]).unwrap();
    let result = write_raw_file(&phantom, SampleType::U8, ByteOrder::Little, &path);
    let value = 256.0;
    assert!(
        matches!(
            result,
            Err(WriteError::Phantom(PhantomError::ValueOutOfRange { value: v, .. })) if v == value
        ),
        "{result:?}"
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_folder_or_device_in_the_way_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let phantom = Phantom::new(Kind::Constant { value: 1.0 }, [4; 3]).unwrap();
    let write = |path| write_raw_file(&phantom, SampleType::U8, ByteOrder::Little, path);
    let result = write(folder.path());
    assert!(matches!(result, Err(WriteError::NotAPlainFile { .. })), "{result:?}");
    let result = write(&folder.path().join("missing/scan.raw"));
    assert!(matches!(result, Err(WriteError::Create { .. })), "{result:?}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
