//! Stores and their parts: a read gives what was written or an error that names the brick; what is called whole can be read.

use crate::files::{file, folder};
use octree_store::encoding::{Coding, Compression, Filter};
use octree_store::verify::verify;
use octree_store::{
    BrickScratch, BrickState, Encoding, Geometry, Metadata, NodeKey, NodeRecord, SampleType, Store,
    StoreError, StoreWriter, encode_samples, salvage, with_sample_type,
};
use std::path::Path;
use twox_hash::{XxHash3_64, XxHash3_128};

/// Bytes before the payloads, and what parts begin at a multiple of.
const FIRST_PAGE: usize = 4096;
/// Bricks that are read at most.
const BRICKS: usize = 64;
/// Samples of a brick that is read.
const SAMPLES: usize = 1 << 16;

/// A whole file, as it is and with all its checksums made right, as one who means harm would make them.
pub fn store(bytes: &[u8]) {
    open_and_read(bytes);
    if let Some(sealed) = sealed(bytes) {
        open_and_read(&sealed);
    }
}

/// A store's bytes with checksums of the first page, the metadata, the records and the payloads that fit them; none where parts do not lie in the file.
fn sealed(bytes: &[u8]) -> Option<Vec<u8>> {
    let field = |at: usize| Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?) as usize);
    let (payload_bytes, index_offset, index_bytes) = (field(16)?, field(24)?, field(32)?);
    let page = FIRST_PAGE.checked_add(payload_bytes)?.checked_next_multiple_of(FIRST_PAGE)?;
    let index_end = index_offset.checked_add(index_bytes)?;
    let last_page = index_end.checked_next_multiple_of(FIRST_PAGE)?;
    if index_offset < page || last_page > bytes.len() {
        return None;
    }
    let mut whole = bytes.to_vec();
    for (begin, end) in [(page, index_offset), (last_page, bytes.len())] {
        let frame = &mut whole[begin..end];
        let used = frame.iter().rposition(|byte| *byte != 0)? + 1;
        let version = u32::from_le_bytes(*frame.get(4..)?.first_chunk()?);
        let sum = XxHash3_64::oneshot_with_seed(u64::from(version), frame.get(16..used)?);
        frame[8..16].copy_from_slice(&sum.to_le_bytes());
    }
    for at in (index_offset..index_end).step_by(NodeRecord::BYTES) {
        let record = whole.get(at..at + NodeRecord::BYTES)?;
        let offset = u64::from_le_bytes(*record[16..].first_chunk()?) as usize;
        let length = u32::from_le_bytes(*record[24..].first_chunk()?) as usize;
        let begin = FIRST_PAGE.saturating_add(offset);
        let payload = whole.get(begin..begin.saturating_add(length)).filter(|_| length > 0);
        let sum = payload.map_or(0, XxHash3_128::oneshot);
        whole[at + 32..at + 48].copy_from_slice(&sum.to_le_bytes());
        let sum = XxHash3_64::oneshot(&whole[at..at + NodeRecord::BYTES - 8]);
        whole[at + NodeRecord::BYTES - 8..at + NodeRecord::BYTES]
            .copy_from_slice(&sum.to_le_bytes());
    }
    let sum = XxHash3_64::oneshot(&whole[..40]);
    whole[40..48].copy_from_slice(&sum.to_le_bytes());
    Some(whole)
}

fn open_and_read(bytes: &[u8]) {
    let (folder, path) = file("a.octavo", bytes);
    if let Ok(remains) = Store::open_remains(&path)
        && is_small(&remains)
    {
        save(&remains, folder.path());
    }
    let Ok(store) = Store::open(&path) else { return };
    if !is_small(&store) {
        return;
    }
    let geometry = *store.geometry();
    let whole = matches!(verify(&store, || true), Ok(Some(report)) if report.is_ok());
    let mut keys: Vec<NodeKey> = Vec::new();
    for level in geometry.levels() {
        let [nx, ny, nz] = geometry.grid_at(level);
        let places = (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / nx / ny]);
        keys.extend(places.map(|place| NodeKey::new(level, place)));
    }
    for key in keys.into_iter().take(BRICKS) {
        match store.read_brick_samples(key) {
            Ok((record, samples)) => {
                assert_eq!(record.key, key);
                assert_eq!(samples.len(), geometry.brick_samples());
            }
            Err(error) => assert!(!whole, "verify said that all is whole: {error}"),
        }
    }
}

fn is_small(store: &Store) -> bool {
    store.geometry().bricks() <= 4096 && store.geometry().brick_samples() <= SAMPLES
}

/// Salvages what is left: of the new store all can be read but what is said to be lost.
fn save(remains: &Store, folder: &Path) {
    let [path, work] = ["saved.octavo", "saved.work"].map(|name| folder.join(name));
    let writer = StoreWriter::create(&path, &work, Vec::new()).unwrap();
    let salvaged = salvage(remains, writer, || true).unwrap().unwrap();
    let saved = Store::open(&path).unwrap();
    let report = verify(&saved, || true).unwrap().unwrap();
    let [lost, damaged] = [&salvaged.lost, &report.damaged]
        .map(|nodes| nodes.iter().map(|node| node.key).collect::<Vec<NodeKey>>());
    assert_eq!(lost, damaged);
}

/// A brick's payload with a checksum that is right, as one who means harm would make it. Six bytes choose how it is said to be coded.
pub fn payload(bytes: &[u8]) {
    let Some((&[sort, coding, bits, filter, compression, core], payload)) =
        bytes.split_first_chunk()
    else {
        return;
    };
    let types =
        [SampleType::U8, SampleType::U16, SampleType::I32, SampleType::F32, SampleType::F64];
    let sample_type = types[usize::from(sort) % types.len()];
    let core = 8 + 2 * u32::from(core % 5);
    let geometry = Geometry::new([u64::from(core); 3], core, 1).unwrap();
    let key = NodeKey::new(0, [0; 3]);
    let folder = folder();
    let [path, work] = ["a.octavo", "a.work"].map(|name| folder.path().join(name));
    let encoding = match coding % 3 {
        0 => Encoding::Quantised8,
        1 => Encoding::Lossless,
        _ => Encoding::max_error(2.0).unwrap(),
    };
    with_sample_type!(sample_type, T => {
        let samples = vec![T::default(); geometry.brick_samples()];
        let (mut record, _) = encode_samples(key, &samples, encoding);
        record.state = BrickState::Stored;
        let parts = (Coding::from_id(1 + coding % 3), Filter::from_id(filter), Compression::from_id(compression % 3));
        let (Some(coding), Some(filter), Some(compression)) = parts else { return };
        (record.coding, record.filter, record.compression, record.bits) = (coding, filter, compression, bits);
        record.place.length = payload.len() as u32;
        record.payload_checksum = XxHash3_128::oneshot(payload);
        let Ok(mut writer) = StoreWriter::create(&path, &work, Vec::new()) else { return };
        if writer.append(&mut [record], payload, Vec::new()).is_err() {
            return;
        }
        if writer.finish(Metadata::new(&geometry, sample_type, encoding)).is_err() {
            return;
        }
    });
    let Ok(store) = Store::open(&path) else { return };
    let mut scratch = BrickScratch::default();
    let record = store.node(key).unwrap();
    assert_eq!(store.read_payload(&record, &mut scratch).unwrap(), payload);
    with_sample_type!(sample_type, T => {
        let mut samples = vec![T::default(); geometry.brick_samples()];
        match store.read_brick(key, &mut scratch, &mut samples) {
            Ok(_) | Err(StoreError::Damaged { .. }) => {}
            Err(other) => panic!("{other}"),
        }
    });
    // What renderers are given goes another way.
    match store.upload_brick(&record, &mut scratch) {
        Ok(_) | Err(StoreError::Damaged { .. }) => {}
        Err(other) => panic!("{other}"),
    }
}

/// A node's record; with its checksum made right, so that what follows it is reached.
pub fn node_record(bytes: &[u8]) {
    let first = NodeRecord::from_bytes(bytes);
    if let Some(record) = first {
        assert_eq!(record.to_bytes()[..], *bytes);
    }
    let Some(body) = bytes.get(..NodeRecord::BYTES - 8) else { return };
    let mut whole = body.to_vec();
    whole.extend(XxHash3_64::oneshot(body).to_le_bytes());
    if let Some(record) = NodeRecord::from_bytes(&whole) {
        assert_eq!(
            record.to_bytes()[..],
            whole[..],
            "a record says all that its bytes say: {record:?}"
        );
    }
}
