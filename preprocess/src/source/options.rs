//! What a user says of an input that the input does not say itself.

use octree_store::SampleType;

/// What the user said of the input.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SourceOptions {
    /// A raw file's dimensions in voxels.
    pub dims_xyz: Option<[u64; 3]>,
    /// A raw file's sample type.
    pub sample_type: Option<SampleType>,
    /// Whether a raw file is big-endian.
    pub big_endian: bool,
    /// A raw file's bytes before the first voxel.
    pub skip: Option<u64>,
    /// The 3-D volume of a series, from 0.
    pub time: Option<u64>,
    /// The channel, from 0.
    pub channel: Option<u64>,
    /// The UID of the DICOM series, where there are several.
    pub series: Option<String>,
    /// Whether slices may be missing or lie unevenly, or have names whose order is not certain.
    pub allow_gaps: bool,
}

impl SourceOptions {
    /// Whether anything is said that only a raw file needs.
    pub(super) fn any_raw(&self) -> bool {
        self.dims_xyz.is_some()
            || self.sample_type.is_some()
            || self.big_endian
            || self.skip.is_some()
    }
}
