//! The source of a store, whole in memory, for the reference.

use super::check_dims;
use crate::commands::{RawArgs, SeriesArgs, print_notes};
use octree_store::{Sample, SampleBuffer, Store, with_sample_type};
use preprocess::Volume;
use render_check::reference::SourceVolume;
use std::path::Path;

/// Reads the volume that a store was made of; it is taken to be spaced as the store.
pub(in crate::commands) fn read_source(
    path: &Path,
    raw: &RawArgs,
    series: &SeriesArgs,
    store: &Store,
) -> anyhow::Result<SourceVolume> {
    let mut options = raw.source_options(Some(series));
    if path.extension().is_some_and(|extension| extension == "raw") {
        options.dims_xyz = options.dims_xyz.or(Some(store.geometry().dims_xyz()));
        options.sample_type = options.sample_type.or(Some(store.metadata().sample_type));
    }
    let volume = Volume::open(path, &options)?;
    if let Volume::Source(source) = &volume {
        print_notes(source);
    }
    let dims_xyz = volume.dims_xyz();
    check_dims(store, dims_xyz)?;
    let samples = with_sample_type!(volume.sample_type(), T => read::<T>(&volume)?);
    Ok(SourceVolume { dims_xyz, spacing_xyz: store.metadata().spacing_xyz, samples })
}

fn read<T: Sample>(volume: &Volume) -> anyhow::Result<SampleBuffer> {
    let [width, height, depth] = volume.dims_xyz().map(|n| n as usize);
    let mut samples = vec![T::default(); width * height * depth];
    let mut slices = volume.slices::<T>()?;
    for slice in samples.chunks_exact_mut(width * height) {
        slices.next(slice)?;
    }
    Ok(T::wrap(samples))
}
