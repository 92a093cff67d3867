//! The node record: 120 bytes that say all the store knows of one brick (FORMAT.md, "Node record").

use crate::encoding::{Coding, Compression, Filter};
use crate::error_sum::ErrorSum;
use crate::key::NodeKey;
use std::ops::Range;
use twox_hash::XxHash3_64;

/// What a brick is. A node without a record is *absent*; a record or payload that fails its
/// checksum is *damaged* and comes as an error, and so does a brick that is *lost*.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum BrickState {
    /// Its samples lie in a payload.
    Stored = 1,
    /// Every sample equals `brick_min`; there is no payload.
    Uniform = 2,
    /// Filtered out: it decodes to the metadata's `empty_value`; there is no payload.
    Empty = 3,
    /// Its samples could not be saved when the store was salvaged: to read it is an error. What its record
    /// says of ranges and bounds holds.
    Lost = 4,
}

impl BrickState {
    /// The word used in reports: `stored`, `uniform`, `empty`, `lost`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stored => "stored",
            Self::Uniform => "uniform",
            Self::Empty => "empty",
            Self::Lost => "lost",
        }
    }

    fn from_id(id: u8) -> Option<Self> {
        let all = [Self::Stored, Self::Uniform, Self::Empty, Self::Lost];
        all.into_iter().find(|state| *state as u8 == id)
    }
}

/// Where a payload lies: a byte range of a payload stream.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct PayloadPlace {
    /// The stream; stores built apart keep their streams when they are merged.
    pub stream: u16,
    /// First byte within the stream.
    pub offset: u64,
    /// Bytes; 0 where the brick has no payload.
    pub length: u32,
}

/// All the store knows of one brick. Values are in source units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeRecord {
    /// The node.
    pub key: NodeKey,
    /// Stored, uniform, empty or lost.
    pub state: BrickState,
    /// What the payload's words are (of a stored brick).
    pub coding: Coding,
    /// Bits a sample's word uses before compression; 0 without a payload.
    pub bits: u8,
    /// How the payload's bytes are arranged before compression.
    pub filter: Filter,
    /// How the payload's bytes are compressed.
    pub compression: Compression,
    /// Which of its eight children exist: bit `x + 2y + 4z`.
    pub child_mask: u8,
    /// Where its payload lies.
    pub place: PayloadPlace,
    /// XXH3-128 of the payload's bytes; 0 without a payload.
    pub payload_checksum: u128,
    /// Least finite sample, overlap included; what a quantised 0 decodes to. An empty brick keeps
    /// the range of what was dropped.
    pub brick_min: f64,
    /// Greatest finite sample, overlap included.
    pub brick_max: f64,
    /// Least of `brick_min` over the node and all its descendants, and of the empty value where one
    /// of them is empty.
    pub subtree_min: f64,
    /// Greatest of `brick_max` over the node and all its descendants, likewise.
    pub subtree_max: f64,
    /// Quantisation error over the in-volume core voxels; of an empty brick, the error of dropping it.
    pub error: ErrorSum,
    /// Bound on the RMS of (level-0 voxel - this level's cell that holds it), before quantisation.
    pub lod_rms_bound: f64,
    /// Bound on the largest such deviation.
    pub lod_amax_bound: f64,
}

impl NodeRecord {
    /// Bytes of a record in the store.
    pub const BYTES: usize = 120;

    /// The record's bytes, its checksum last. See FORMAT.md.
    pub fn to_bytes(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[KEY].copy_from_slice(&self.key.to_u64().to_le_bytes());
        bytes[STATE] = self.state as u8;
        bytes[CODING] = self.coding as u8;
        bytes[BITS] = self.bits;
        bytes[FILTER] = self.filter.id();
        bytes[COMPRESSION] = self.compression as u8;
        bytes[CHILD_MASK] = self.child_mask;
        bytes[STREAM].copy_from_slice(&self.place.stream.to_le_bytes());
        bytes[OFFSET].copy_from_slice(&self.place.offset.to_le_bytes());
        bytes[LENGTH].copy_from_slice(&self.place.length.to_le_bytes());
        bytes[VOXELS].copy_from_slice(&(self.error.voxels as u32).to_le_bytes());
        bytes[PAYLOAD_CHECKSUM].copy_from_slice(&self.payload_checksum.to_le_bytes());
        for (range, value) in [
            (BRICK_MIN, self.brick_min),
            (BRICK_MAX, self.brick_max),
            (SUBTREE_MIN, self.subtree_min),
            (SUBTREE_MAX, self.subtree_max),
            (ERROR_SQUARES, self.error.squares),
            (ERROR_AMAX, self.error.amax),
            (LOD_RMS, self.lod_rms_bound),
            (LOD_AMAX, self.lod_amax_bound),
        ] {
            bytes[range].copy_from_slice(&value.to_le_bytes());
        }
        let checksum = XxHash3_64::oneshot(&bytes[..RECORD_CHECKSUM.start]);
        bytes[RECORD_CHECKSUM].copy_from_slice(&checksum.to_le_bytes());
        bytes
    }

    /// Whether these bytes could be a record's: quickly, and right of all that are.
    pub(crate) fn may_be(bytes: &[u8]) -> bool {
        bytes.len() == Self::BYTES
            && BrickState::from_id(bytes[STATE]).is_some()
            && Coding::from_id(bytes[CODING]).is_some()
            && Compression::from_id(bytes[COMPRESSION]).is_some()
    }

    /// The record of these bytes, or `None` where they are not a whole, undamaged record.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let u64_at =
            |range: Range<usize>| Some(u64::from_le_bytes(bytes.get(range)?.try_into().ok()?));
        let u32_at =
            |range: Range<usize>| Some(u32::from_le_bytes(bytes.get(range)?.try_into().ok()?));
        let f64_at = |range: Range<usize>| Some(f64::from_bits(u64_at(range)?));
        if bytes.len() != Self::BYTES
            || XxHash3_64::oneshot(&bytes[..RECORD_CHECKSUM.start]) != u64_at(RECORD_CHECKSUM)?
        {
            return None;
        }
        Some(Self {
            key: NodeKey::from_u64(u64_at(KEY)?)?,
            state: BrickState::from_id(bytes[STATE])?,
            coding: Coding::from_id(bytes[CODING])?,
            bits: bytes[BITS],
            filter: Filter::from_id(bytes[FILTER])?,
            compression: Compression::from_id(bytes[COMPRESSION])?,
            child_mask: bytes[CHILD_MASK],
            place: PayloadPlace {
                stream: u16::from_le_bytes(bytes[STREAM].try_into().ok()?),
                offset: u64_at(OFFSET)?,
                length: u32_at(LENGTH)?,
            },
            payload_checksum: u128::from_le_bytes(bytes[PAYLOAD_CHECKSUM].try_into().ok()?),
            brick_min: f64_at(BRICK_MIN)?,
            brick_max: f64_at(BRICK_MAX)?,
            subtree_min: f64_at(SUBTREE_MIN)?,
            subtree_max: f64_at(SUBTREE_MAX)?,
            error: ErrorSum {
                voxels: u64::from(u32_at(VOXELS)?),
                squares: f64_at(ERROR_SQUARES)?,
                amax: f64_at(ERROR_AMAX)?,
            },
            lod_rms_bound: f64_at(LOD_RMS)?,
            lod_amax_bound: f64_at(LOD_AMAX)?,
        })
    }

    /// The record's bytes without its place and its own checksum: what the digest hashes.
    pub(crate) fn content_bytes(&self) -> [u8; RECORD_CHECKSUM.start] {
        let placeless = PayloadPlace { length: self.place.length, ..PayloadPlace::default() };
        let bytes = Self { place: placeless, ..*self }.to_bytes();
        let mut content = [0; RECORD_CHECKSUM.start];
        content.copy_from_slice(&bytes[..RECORD_CHECKSUM.start]);
        content
    }
}

// Each field's bytes, each derived from the one before.
const KEY: Range<usize> = 0..8;
const STATE: usize = KEY.end;
const CODING: usize = STATE + 1;
const BITS: usize = CODING + 1;
const FILTER: usize = BITS + 1;
const COMPRESSION: usize = FILTER + 1;
const CHILD_MASK: usize = COMPRESSION + 1;
const STREAM: Range<usize> = after(CHILD_MASK + 1, 2);
const OFFSET: Range<usize> = after(STREAM.end, 8);
const LENGTH: Range<usize> = after(OFFSET.end, 4);
const VOXELS: Range<usize> = after(LENGTH.end, 4);
const PAYLOAD_CHECKSUM: Range<usize> = after(VOXELS.end, 16);
const BRICK_MIN: Range<usize> = after(PAYLOAD_CHECKSUM.end, 8);
const BRICK_MAX: Range<usize> = after(BRICK_MIN.end, 8);
const SUBTREE_MIN: Range<usize> = after(BRICK_MAX.end, 8);
const SUBTREE_MAX: Range<usize> = after(SUBTREE_MIN.end, 8);
const ERROR_SQUARES: Range<usize> = after(SUBTREE_MAX.end, 8);
const ERROR_AMAX: Range<usize> = after(ERROR_SQUARES.end, 8);
const LOD_RMS: Range<usize> = after(ERROR_AMAX.end, 8);
const LOD_AMAX: Range<usize> = after(LOD_RMS.end, 8);
const RECORD_CHECKSUM: Range<usize> = after(LOD_AMAX.end, 8);
const _: () = assert!(RECORD_CHECKSUM.end == NodeRecord::BYTES);

const fn after(start: usize, bytes: usize) -> Range<usize> {
    start..start + bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn record() -> NodeRecord {
        NodeRecord {
            key: NodeKey::new(3, [5, 6, 7]),
            state: BrickState::Stored,
            coding: Coding::Quantised8,
            bits: 8,
            filter: Filter::NONE,
            compression: Compression::Lz4,
            child_mask: 0b1010_0101,
            place: PayloadPlace { stream: 9, offset: 1 << 40, length: 46656 },
            payload_checksum: u128::MAX / 3,
            brick_min: -1.5,
            brick_max: f64::MAX,
            subtree_min: f64::MIN,
            subtree_max: f64::MAX,
            error: ErrorSum { voxels: 32768, squares: 1e6, amax: 44.0 },
            lod_rms_bound: 12.5,
            lod_amax_bound: 900.0,
        }
    }

    #[test]
    fn bytes_come_back() {
        assert_eq!(NodeRecord::from_bytes(&record().to_bytes()), Some(record()));
        assert!(NodeRecord::may_be(&record().to_bytes()));
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let bytes = record().to_bytes();
        for bit in 0..8 * NodeRecord::BYTES {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(NodeRecord::from_bytes(&damaged), None, "bit {bit}");
        }
    }

    #[test]
    fn the_layout_is_the_one_that_format_md_gives() {
        // Offsets written out by hand from FORMAT.md; the constants above derive theirs.
        let bytes = record().to_bytes();
        assert_eq!(bytes[8..14], [1, 1, 8, 0, 1, 0b1010_0101]);
        assert_eq!(bytes[14..16], 9_u16.to_le_bytes());
        assert_eq!(bytes[16..24], (1_u64 << 40).to_le_bytes());
        assert_eq!(bytes[24..28], 46656_u32.to_le_bytes());
        assert_eq!(bytes[28..32], 32768_u32.to_le_bytes());
        assert_eq!(bytes[48..56], (-1.5_f64).to_le_bytes());
        assert_eq!(bytes[80..88], 1e6_f64.to_le_bytes());
        assert_eq!(bytes[104..112], 900_f64.to_le_bytes());
    }

    #[test]
    fn the_content_forgets_the_place_alone() {
        let moved = PayloadPlace { stream: 1, offset: 77, length: 46656 };
        assert_eq!(
            record().content_bytes(),
            NodeRecord { place: moved, ..record() }.content_bytes()
        );
        let other = NodeRecord { child_mask: 1, ..record() };
        assert_ne!(record().content_bytes(), other.content_bytes());
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..256)) {
            prop_assert_eq!(NodeRecord::from_bytes(&bytes), None);
        }
    }
}
