//! Repairing a store from its source: damaged bricks are made anew, by the walk that made them once.
//!
//! Where only payloads are damaged they are put right in place: their records' checksums say whether what was
//! made is what was there. Where records or the index are damaged too, the store is written anew beside itself
//! and takes its own name at the end; then every brick that is whole must fit the source, and what was made anew
//! must give the digest that the store had. So a store is never worse than before, whenever this is interrupted.

use crate::again::Again;
use crate::convert::{BrickEncoder, BrickOutput, ConvertOptions, Output, Start, Tree};
use crate::downsample::Core;
use crate::error::PreprocessError;
use crate::progress::Progress;
use crate::source::Source;
use crate::verify_against::{Against, AgainstScratch};
use crate::walk::{Octet, Sink, Visited, Visitor};
use octree_store::encoding::EncodeScratch;
use octree_store::verify::{DamagedNode, verify};
use octree_store::{
    BrickScratch, BrickState, Damage, Mender, NodeKey, NodeRecord, SALVAGED_OF, Sample, Store,
    StoreError, StoreWriter, with_sample_type,
};
use std::collections::HashMap;
use std::ops::Range;

/// Payload after which what was written is committed, so that its records do not wait in memory.
const COMMIT_BYTES: u64 = 64 << 20;

/// What was done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Repair {
    /// The bricks that were made anew, in key order, and what had been wrong with them.
    pub repaired: Vec<DamagedNode>,
    /// What had been wrong with the first page, the index or the metadata, if anything was.
    pub around: Option<String>,
    /// Bricks that are whole and were held against the source; none where payloads were put right in place.
    pub bricks_compared: u64,
    /// Whether the file was kept, and bytes in it put right.
    pub in_place: bool,
    /// The digest that the store had when it was whole.
    pub digest_before: String,
    /// The store's digest now.
    pub digest: String,
}

/// Makes the damaged bricks of a store anew from its source. The store is one opened by
/// [`Store::open_remains`]; of `how`, threads, memory, scratch and `start` are used.
///
/// # Errors
/// [`PreprocessError::Misfit`] where the store was not made from this source; when a file cannot be read or
/// written, other work on the store is unfinished, or `progress` asks to stop.
pub fn repair(
    store: &Store,
    source: Source,
    how: &ConvertOptions,
    progress: &dyn Progress,
) -> Result<Repair, PreprocessError> {
    let start = if how.start == Start::Replace { Start::Replace } else { Start::Mend };
    // A link stays what it is: what it leads to is repaired.
    let io = |source| PreprocessError::Output { path: store.path().to_owned(), source };
    let path = store.path().canonicalize().map_err(io)?;
    let mut place = Output::prepare(store.disk(), &path, &source.files, None, start)?;
    let again = Again::new(store, source, how)?;
    let survey = verify(store, || !progress.should_stop())?.ok_or(PreprocessError::Cancelled)?;
    let metadata = store.metadata();
    let salvaged_of = metadata.options.get(SALVAGED_OF).and_then(serde_json::Value::as_str);
    let mut repair = Repair {
        around: store.fault_around_records().or(survey.metadata),
        repaired: survey.damaged,
        bricks_compared: 0,
        in_place: true,
        digest_before: salvaged_of.unwrap_or(&metadata.digest).to_owned(),
        digest: metadata.digest.clone(),
    };
    let payloads_alone = repair.repaired.iter().all(|node| node.damage == Damage::PayloadChecksum);
    if repair.around.is_none() && payloads_alone && lie_apart(store, &repair.repaired)? {
        let all = with_sample_type!(metadata.sample_type, T => {
            put_right::<T>(store, &again, &repair.repaired, progress)
        });
        // Another version may pack the same samples otherwise: then all is written anew.
        if all? {
            return Ok(repair);
        }
    }
    repair.in_place = false;
    // Who could not read the store must not be able to read the new one.
    let permissions = std::fs::metadata(&path).map_err(io)?.permissions();
    place.file()?.file().set_permissions(permissions).map_err(io)?;
    with_sample_type!(metadata.sample_type, T => {
        write_anew::<T>(store, &again, &mut repair, &place, progress)?;
    });
    place.finish()?;
    Ok(repair)
}

/// Whether the places of damaged payloads, whose records are whole, are no other payload's too. What was made to harm
/// may have a record whose checksum is right and that lies about its place.
fn lie_apart(store: &Store, damaged: &[DamagedNode]) -> Result<bool, StoreError> {
    let bytes_of = |record: &NodeRecord| {
        let begin = record.place.offset;
        begin..begin.saturating_add(record.place.length.into())
    };
    let mut places: Vec<(Range<u64>, NodeKey)> = records_of(store, damaged)?
        .into_iter()
        .map(|(key, record)| (bytes_of(&record), key))
        .collect();
    places.sort_unstable_by_key(|(bytes, _)| bytes.start);
    let mut apart = places.is_sorted_by(|(a, _), (b, _)| a.end <= b.start);
    for level in store.geometry().levels() {
        store.visit_level(level, |record| {
            let own = bytes_of(record);
            let begun = places.partition_point(|(bytes, _)| bytes.start < own.end);
            // Those that lie apart end in the order in which they begin.
            let mut shared =
                places[..begun].iter().rev().take_while(|(bytes, _)| bytes.end > own.start);
            apart = apart && (own.is_empty() || shared.all(|(_, key)| *key == record.key));
            apart
        })?;
    }
    Ok(apart)
}

/// Puts damaged payloads right in place; false where one comes out otherwise than it was.
fn put_right<T: Sample>(
    store: &Store,
    again: &Again,
    damaged: &[DamagedNode],
    progress: &dyn Progress,
) -> Result<bool, PreprocessError> {
    if damaged.is_empty() {
        return Ok(true);
    }
    let format = again.options.brick_format();
    let encoder = BrickEncoder { format, rules: &again.rules };
    let mut sink = PutRight {
        mender: Mender::open(store)?,
        left: records_of(store, damaged)?,
        others: false,
        progress,
    };
    let walked = again.walk::<T, _>(&Damaged { encoder, keys: damaged }, &mut sink);
    let done = sink.left.is_empty();
    if !done {
        walked?;
    }
    let PutRight { mender, others, .. } = sink;
    mender.finish()?;
    Ok(done && !others)
}

/// The records of damaged bricks, all of them whole.
fn records_of(
    store: &Store,
    damaged: &[DamagedNode],
) -> Result<HashMap<NodeKey, NodeRecord>, StoreError> {
    damaged.iter().map(|node| Ok((node.key, store.node(node.key)?))).collect()
}

/// Encodes the bricks that are damaged, and no others.
struct Damaged<'a> {
    encoder: BrickEncoder<'a>,
    /// In key order.
    keys: &'a [DamagedNode],
}

fn is_among(damaged: &[DamagedNode], key: NodeKey) -> bool {
    damaged.binary_search_by_key(&key, |node| node.key).is_ok()
}

impl<T: Sample> Visitor<T> for Damaged<'_> {
    type Output = Option<BrickOutput>;
    type Scratch = EncodeScratch;

    fn visit(
        &self,
        key: NodeKey,
        core: &Core,
        samples: &mut [T],
        scratch: &mut EncodeScratch,
        payloads: &mut Vec<u8>,
    ) -> Result<Self::Output, PreprocessError> {
        if is_among(self.keys, key) {
            return self.encoder.visit(key, core, samples, scratch, payloads).map(Some);
        }
        if key.level() == 0 {
            self.encoder.rules.apply(samples);
        }
        Ok(None)
    }
}

/// Writes payloads to where they were.
struct PutRight<'a> {
    mender: Mender,
    /// What is still damaged.
    left: HashMap<NodeKey, NodeRecord>,
    /// Whether one came out otherwise than it was.
    others: bool,
    progress: &'a dyn Progress,
}

impl Sink<Option<BrickOutput>> for PutRight<'_> {
    fn take(&mut self, octet: Octet<Option<BrickOutput>>) -> Result<(), PreprocessError> {
        let mut payloads = octet.payloads.as_slice();
        for visited in &octet.bricks {
            self.progress.bricks_done(1);
            let Some(made) = &visited.output else { continue };
            let (payload, rest) = payloads.split_at(made.record.place.length as usize);
            payloads = rest;
            if let Some(record) = self.left.remove(&visited.key) {
                self.others |= !self.mender.write(&record, payload)?;
            }
        }
        // Nothing more is to be done then.
        let stop = self.left.is_empty() || self.progress.should_stop();
        if stop { Err(PreprocessError::Cancelled) } else { Ok(()) }
    }

    fn wait_until_durable(&mut self, _: u64) -> Result<(), PreprocessError> {
        Ok(())
    }
}

/// Writes the store anew: what is whole as it is, what is damaged from the source.
fn write_anew<T: Sample>(
    store: &Store,
    again: &Again,
    repair: &mut Repair,
    place: &Output,
    progress: &dyn Progress,
) -> Result<(), PreprocessError> {
    let format = again.options.brick_format();
    let against = Against { store, rules: again.rules };
    let encoder = BrickEncoder { format, rules: &again.rules };
    let damaged = repair.repaired.as_slice();
    let mut sink = Anew {
        store,
        tree: Tree::new(again.plan.geometry, again.rules.empty_value, HashMap::new()),
        writer: StoreWriter::create_in(place.file()?, &place.partial, &place.index, vec![])?,
        scratch: BrickScratch::default(),
        compared: 0,
        octets: 0,
        progress,
    };
    again.walk::<T, _>(&Compared { encoder, against, damaged }, &mut sink)?;
    let mut metadata = store.metadata().clone();
    metadata.options.remove(SALVAGED_OF);
    repair.bricks_compared = sink.compared;
    repair.digest = sink.writer.finish(metadata)?.digest;
    let ours = concat!("octavo ", env!("CARGO_PKG_VERSION"));
    // Only another version may pack what it makes anew otherwise.
    if repair.digest != repair.digest_before && store.metadata().created_by == ours {
        let what = "what was made anew does not give the digest that it had".into();
        return Err(PreprocessError::Misfit { path: store.path().to_owned(), key: None, what });
    }
    Ok(())
}

/// Encodes all bricks, and holds those that are whole against the source.
struct Compared<'a> {
    encoder: BrickEncoder<'a>,
    against: Against<'a>,
    damaged: &'a [DamagedNode],
}

/// A brick of the source, and its record where the store has it whole.
struct Pair {
    made: BrickOutput,
    stored: Option<NodeRecord>,
    /// How they differ.
    misfit: Option<Damage>,
}

/// Buffers that a thread keeps.
struct PairScratch<T> {
    encode: EncodeScratch,
    against: AgainstScratch<T>,
}

impl<T> Default for PairScratch<T> {
    fn default() -> Self {
        Self { encode: EncodeScratch::default(), against: AgainstScratch::default() }
    }
}

impl<T: Sample> Visitor<T> for Compared<'_> {
    type Output = Pair;
    type Scratch = PairScratch<T>;

    fn visit(
        &self,
        key: NodeKey,
        core: &Core,
        samples: &mut [T],
        scratch: &mut PairScratch<T>,
        payloads: &mut Vec<u8>,
    ) -> Result<Pair, PreprocessError> {
        let made = self.encoder.visit(key, core, samples, &mut scratch.encode, payloads)?;
        let mut pair = Pair { made, stored: None, misfit: None };
        let stored = match (self.against.store.node(key), is_among(self.damaged, key)) {
            (Ok(known), true) => {
                let range = |record: &NodeRecord| [record.brick_min, record.brick_max];
                let what = "its range is not that of the source's voxels";
                let differs =
                    known.state != BrickState::Lost && range(&known) != range(&pair.made.record);
                pair.misfit = differs.then_some(Damage::Source { what });
                return Ok(pair);
            }
            (Err(StoreError::Damaged { .. }), true) => return Ok(pair),
            (stored, _) => stored?,
        };
        pair.stored = Some(stored);
        // The checksum says it all, unless another version packed the samples.
        let same = NodeRecord {
            place: stored.place,
            child_mask: stored.child_mask,
            subtree_min: stored.subtree_min,
            subtree_max: stored.subtree_max,
            lod_rms_bound: stored.lod_rms_bound,
            lod_amax_bound: stored.lod_amax_bound,
            ..pair.made.record
        };
        if same != stored {
            let measured =
                self.against.visit(key, core, samples, &mut scratch.against, &mut Vec::new())?;
            pair.misfit = measured.damage;
        }
        Ok(pair)
    }
}

/// Writes a store anew.
struct Anew<'a> {
    store: &'a Store,
    tree: Tree,
    writer: StoreWriter,
    scratch: BrickScratch,
    compared: u64,
    octets: u64,
    progress: &'a dyn Progress,
}

impl Sink<Pair> for Anew<'_> {
    fn take(&mut self, octet: Octet<Pair>) -> Result<(), PreprocessError> {
        let misfit = |key, what: String| {
            let path = self.store.path().to_owned();
            Err(PreprocessError::Misfit { path, key: Some(key), what })
        };
        let mut stored = Vec::with_capacity(8);
        let mut bricks = Vec::with_capacity(8);
        for Visited { key, output: Pair { made, stored: whole, misfit: differs }, step } in
            octet.bricks
        {
            if let Some(damage) = differs {
                return misfit(key, damage.to_string());
            }
            stored.push(whole);
            bricks.push(Visited { key, output: made, step });
        }
        let (mut records, _) = self.tree.complete(&bricks);
        let mut payloads = Vec::with_capacity(octet.payloads.len());
        let mut made = octet.payloads.as_slice();
        for (record, stored) in records.iter_mut().zip(stored) {
            let (payload, rest) = made.split_at(record.place.length as usize);
            made = rest;
            let Some(stored) = stored else {
                payloads.extend_from_slice(payload);
                continue;
            };
            let bounds = |record: &NodeRecord| {
                let NodeRecord { subtree_min, subtree_max, lod_rms_bound, lod_amax_bound, .. } =
                    *record;
                [subtree_min, subtree_max, lod_rms_bound, lod_amax_bound]
            };
            if bounds(record) != bounds(&stored) {
                let what = "what it says of the bricks beneath it is not so";
                return misfit(record.key, what.into());
            }
            payloads.extend_from_slice(self.store.read_payload(&stored, &mut self.scratch)?);
            *record = stored;
            self.compared += 1;
        }
        self.progress.bricks_done(records.len() as u64);
        self.writer.append(&mut records, &payloads, Vec::new())?;
        self.octets += 1;
        if self.writer.uncommitted_bytes() >= COMMIT_BYTES {
            self.writer.commit(&[], self.octets)?;
        }
        if self.progress.should_stop() { Err(PreprocessError::Cancelled) } else { Ok(()) }
    }

    fn wait_until_durable(&mut self, _: u64) -> Result<(), PreprocessError> {
        Ok(())
    }
}
