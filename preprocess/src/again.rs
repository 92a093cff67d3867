//! The walk by which a store was made, once more: over the same source, with the store's own options.

use crate::convert::{ConversionPlan, ConvertOptions, ValueRules};
use crate::error::PreprocessError;
use crate::source::Source;
use crate::source::map::unnamed_file;
use crate::upscale::Upscale;
use crate::walk::{Buffers, Earlier, Sink, Visitor, walk};
use octree_store::{DiskFile, Effort, OverlapAtRest, Region, Sample, Store, StoreError};
use std::sync::Arc;

/// What is walked, and how the store was made of it.
#[derive(Debug)]
pub(crate) struct Again {
    source: Source,
    pub(crate) options: ConvertOptions,
    pub(crate) plan: ConversionPlan,
    pub(crate) rules: ValueRules,
    /// Nothing is to be resumed: unnamed scratch will do.
    scratch: Arc<DiskFile>,
}

impl Again {
    /// Of the file from which a store was made; of `how`, threads, memory and scratch are used.
    pub(crate) fn new(
        store: &Store,
        source: Source,
        how: &ConvertOptions,
    ) -> Result<Self, PreprocessError> {
        let metadata = store.metadata();
        let source = match roi(store) {
            Some(region) => source.crop(region)?,
            None => source,
        };
        let source = match Upscale::recorded(&metadata.options)? {
            Some(upscale) => source.upscale(upscale)?,
            None => source,
        };
        if source.dims_xyz != metadata.dims_xyz {
            return Err(PreprocessError::DifferentDims {
                a: metadata.dims_xyz,
                b: source.dims_xyz,
            });
        }
        let (stored, asked) = (metadata.sample_type, source.sample_type());
        if stored != asked {
            return Err(StoreError::SampleType { stored, asked }.into());
        }
        let effort = metadata.options.get("effort").and_then(serde_json::Value::as_str);
        let efforts = [Effort::Fast, Effort::Balanced, Effort::Small];
        let folder = how.scratch.clone().unwrap_or_else(std::env::temp_dir);
        let options = ConvertOptions {
            brick_core: metadata.brick_core,
            brick_overlap: metadata.brick_overlap,
            encoding: metadata.encoding,
            effort: efforts.into_iter().find(|e| Some(e.name()) == effort).unwrap_or_default(),
            overlap_at_rest: if metadata.stored_overlap {
                OverlapAtRest::Stored
            } else {
                OverlapAtRest::Assembled
            },
            downsample: metadata.downsample,
            scratch: Some(folder.clone()),
            ..how.clone()
        };
        let plan = ConversionPlan::new(&source, store.path(), &options)?;
        let scratch = unnamed_file(&folder, plan.slots_bytes).map_err(PreprocessError::Scratch)?;
        let rules = ValueRules {
            nan_value: metadata.options.get("nan_value").and_then(serde_json::Value::as_f64),
            empty_below: metadata.empty_below,
            empty_value: metadata.empty_value,
        };
        Ok(Self { source, options, plan, rules, scratch: Arc::new(scratch) })
    }

    /// Walks all of it; samples are `T`.
    pub(crate) fn walk<T: Sample, V: Visitor<T>>(
        &self,
        visitor: &V,
        sink: &mut dyn Sink<V::Output>,
    ) -> Result<(), PreprocessError> {
        let Self { source, plan, scratch, .. } = self;
        let pool = crate::pool(plan.threads)?;
        let earlier = Earlier { octets: 0, scratch: Arc::clone(scratch) };
        let buffers = Buffers::default();
        walk(source, &plan.geometry, &pool, &plan.walk, visitor, &buffers, &earlier, sink)
    }
}

/// The region of the source that a store was made of, if not the whole.
fn roi(store: &Store) -> Option<Region> {
    let value = store.metadata().options.get("roi")?.clone();
    let [min, max]: [[u64; 3]; 2] = serde_json::from_value(value).ok()?;
    Some(Region { min, max })
}
