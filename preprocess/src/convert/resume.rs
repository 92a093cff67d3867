//! What a conversion keeps so that it can be gone on with: which source, which options, how far.
//!
//! It stands in the work index beside the records of the same commit. The source is known by its files'
//! sizes, times and a sample of their bytes; the windows' slots by a checksum for each parent's core.

use super::ConvertOptions;
use super::plan::ConversionPlan;
use super::tree::Beneath;
use crate::error::PreprocessError;
use crate::source::Source;
use crate::value_stats::VolumeValues;
use crate::walk::{block_checksum, octets_in_row};
use octree_store::{DiskFile, Geometry, NodeKey, Sample};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::hash::Hasher;
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::Path;
use twox_hash::XxHash3_64;

/// Samples of a source's bytes, spread over all files.
const SAMPLES: u64 = 64;
/// Bytes of a sample.
const SAMPLE_BYTES: u64 = 4096;

/// How far a conversion is, and of what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    /// The program that wrote it: another version may work in another order.
    version: String,
    /// Everything that shapes the store's content.
    content: String,
    fingerprint: Fingerprint,
    /// Octets that are durable.
    pub(super) octets: u64,
    /// Bricks in them.
    pub(super) bricks: u64,
    /// Voxels of them that the upscaler clamped.
    pub(super) clamped: u64,
    pub(super) values: VolumeValues,
}

impl State {
    /// The state before the first octet.
    pub(super) fn new(
        source: &Source,
        plan: &ConversionPlan,
        options: &ConvertOptions,
    ) -> io::Result<Self> {
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").into(),
            content: options.content(source, plan),
            fingerprint: Fingerprint::of(source)?,
            octets: 0,
            bricks: 0,
            clamped: 0,
            values: VolumeValues::default(),
        })
    }

    /// The state after so many octets and bricks of such values, so many of them clamped.
    pub(super) fn at(&self, octets: u64, bricks: u64, clamped: u64, values: &VolumeValues) -> Self {
        Self { octets, bricks, clamped, values: values.clone(), ..self.clone() }
    }

    pub(super) fn to_bytes(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("it has string keys")
    }

    /// The state of these bytes, if it is of the same work as this one.
    pub(super) fn found(&self, bytes: &[u8], work: &Path) -> Result<Self, PreprocessError> {
        let refuse =
            |what: &'static str| PreprocessError::CannotResume { path: work.to_owned(), what };
        let found: Self = serde_json::from_slice(bytes)
            .map_err(|_| refuse("its state cannot be read: another version of octavo left it"))?;
        if found.version != self.version {
            return Err(refuse("another version of octavo began it"));
        }
        if found.fingerprint != self.fingerprint {
            let Fingerprint { bytes, modified, .. } = found.fingerprint;
            return Err(refuse(match &self.fingerprint {
                now if now.bytes != bytes => "the source's size or files have changed since",
                now if now.modified != modified => "the source has been modified since",
                _ => "the source's content has changed since",
            }));
        }
        if found.content != self.content {
            return Err(refuse("it was begun with other options"));
        }
        Ok(found)
    }
}

/// What tells a source from another, or from what it was.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Fingerprint {
    /// Of the files' names and sizes.
    bytes: u64,
    /// Of the times at which they were modified.
    modified: u64,
    /// Of samples of their bytes.
    content: u64,
}

impl Fingerprint {
    fn of(source: &Source) -> io::Result<Self> {
        let mut bytes = XxHash3_64::new();
        let mut modified = XxHash3_64::new();
        let mut content = XxHash3_64::new();
        let mut lengths = Vec::with_capacity(source.files.len());
        for path in &source.files {
            let metadata = std::fs::metadata(path)?;
            bytes.write(path.as_os_str().as_encoded_bytes());
            bytes.write(&metadata.len().to_le_bytes());
            modified.write(&metadata.mtime().to_le_bytes());
            modified.write(&metadata.mtime_nsec().to_le_bytes());
            lengths.push(metadata.len());
        }
        let all: u64 = lengths.iter().sum();
        let mut buffer = [0; SAMPLE_BYTES as usize];
        let (mut index, mut before) = (0, 0);
        for sample in 0..SAMPLES {
            // The first and the last bytes are among the samples.
            let last = all.saturating_sub(SAMPLE_BYTES);
            let at = (u128::from(last) * u128::from(sample) / u128::from(SAMPLES - 1)) as u64;
            while index < lengths.len() && before + lengths[index] <= at {
                before += lengths[index];
                index += 1;
            }
            let Some(path) = source.files.get(index) else { break };
            let offset = at - before;
            let count = (lengths[index] - offset).min(SAMPLE_BYTES) as usize;
            File::open(path)?.read_exact_at(&mut buffer[..count], offset)?;
            content.write(&buffer[..count]);
        }
        Ok(Self { bytes: bytes.finish(), modified: modified.finish(), content: content.finish() })
    }
}

/// What was kept of a parent: what its children add up to, and the checksum of its core.
pub(super) fn kept_bytes(beneath: Beneath, block_checksum: u64) -> Vec<u8> {
    let mut bytes = beneath.to_bytes();
    bytes.extend_from_slice(&block_checksum.to_le_bytes());
    bytes
}

/// What was kept of all parents.
#[derive(Debug, Default)]
pub(super) struct Kept(HashMap<NodeKey, (Beneath, u64)>);

impl Kept {
    /// Reads what [`kept_bytes`] wrote; `None` where it is cut short.
    pub(super) fn read(progress: &[(NodeKey, Vec<u8>)]) -> Option<Self> {
        let each = progress.iter().map(|(parent, bytes)| {
            let (beneath, checksum) = bytes.split_first_chunk::<{ Beneath::BYTES }>()?;
            let checksum = u64::from_le_bytes(checksum.try_into().ok()?);
            Some((*parent, (Beneath::from_bytes(beneath), checksum)))
        });
        each.collect::<Option<_>>().map(Self)
    }

    /// The parents whose own octets are not done.
    pub(super) fn pending(&self, geometry: &Geometry) -> HashMap<NodeKey, Beneath> {
        let done = |key: &NodeKey| {
            key.level() < geometry.top_level() && self.0.contains_key(&key.parent())
        };
        // The order in which they are taken over does not matter: they go into a map again.
        #[allow(clippy::iter_over_hash_type, reason = "from one map into another")]
        self.0.iter().filter(|(key, _)| !done(key)).map(|(key, kept)| (*key, kept.0)).collect()
    }

    /// Checks that the slots of the scratch file hold what the rest of the work will need.
    pub(super) fn check_slots<T: Sample>(
        &self,
        plan: &ConversionPlan,
        scratch: &DiskFile,
        path: &Path,
    ) -> Result<(), PreprocessError> {
        let geometry = &plan.geometry;
        let mut octets_done = vec![0; geometry.levels().count()];
        let mut keys: Vec<_> = self.0.keys().copied().collect();
        // In the order in which they lie in the file, nearly.
        keys.sort_unstable_by_key(|key| (key.level(), key.brick_xyz()[2]));
        for parent in &keys {
            octets_done[usize::from(parent.level() - 1)] += 1;
        }
        let mut block = vec![T::default(); (geometry.core() as usize).pow(3)];
        for parent in keys {
            let level = parent.level();
            let rows_done = octets_done
                .get(usize::from(level))
                .map_or(0, |octets| octets / octets_in_row(geometry, level));
            let chunk = parent.brick_xyz()[2];
            if last_row_needing(geometry, level, chunk) < rows_done {
                continue;
            }
            let place = plan.walk.layouts[usize::from(level - 1)].place_of(parent.brick_xyz());
            scratch
                .read_exact_at(bytemuck::cast_slice_mut(&mut block), place)
                .map_err(|source| PreprocessError::ScratchFile { path: path.to_owned(), source })?;
            if block_checksum(&block) != self.0[&parent].1 {
                let what = "its scratch file is damaged";
                return Err(PreprocessError::CannotResume { path: path.to_owned(), what });
            }
        }
        Ok(())
    }
}

/// The last row of a level's octets that reads its chunk: its own, or the next one's overlap.
fn last_row_needing(geometry: &Geometry, level: u8, chunk: u64) -> u64 {
    let next = u64::from(geometry.overlap() > 0) * (chunk % 2);
    let rows = geometry.grid_at(level)[2].div_ceil(2);
    (chunk / 2 + next).min(rows - 1)
}
