//! Why a TIFF file is no volume that can be read.

use octree_store::SampleType;
use std::fmt;
use thiserror::Error;

/// What to do about a page that is stored in a way that is not read.
const SAVE_ANEW: &str = "save it anew without compression, or with LZW, deflate, PackBits or zstd, for \
    instance by 'tiffcp -c zip IN OUT'";

/// The part of a TIFF file that an error is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TiffPlace {
    /// The file.
    Whole,
    /// A page, from 0.
    Page(u64),
    /// The page that is this slice of the volume, from 0.
    Slice(u64),
}

impl fmt::Display for TiffPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Page(page) => write!(f, "page {page} (counted from 0): "),
            Self::Slice(z) => write!(f, "slice {z} (counted from 0): "),
        }
    }
}

/// Why a TIFF file cannot be used.
#[derive(Debug, Error)]
pub enum TiffError {
    /// Rows and columns that do not begin at the top left.
    #[error(
        "its Orientation is {found}: its rows or columns are mirrored or exchanged, which some programs heed and \
         others do not; save it anew with 1, or if its pixels stand as they should, set it by \
         'tiffset -s 274 1 FILE'"
    )]
    Orientation {
        /// The tag's value.
        found: u64,
    },
    /// The file does not begin as TIFF files do.
    #[error("this is no TIFF file: it begins with {found:02x?}")]
    NotTiff {
        /// Its first bytes.
        found: Vec<u8>,
    },
    /// Something lies outside the file.
    #[error(
        "{what} would lie at byte {offset}, {length} bytes long, and the file has {file_length}: it \
        is cut short or damaged"
    )]
    Outside {
        /// What it is.
        what: &'static str,
        /// Where it would be.
        offset: u64,
        /// Its bytes.
        length: u64,
        /// The file's bytes.
        file_length: u64,
    },
    /// The list of pages comes back to itself.
    #[error("its list of pages runs in a circle: it is damaged")]
    PageLoop,
    /// There is no page of full resolution.
    #[error("it has no page that is a picture of full resolution")]
    NoPages,
    /// A tag that must be there is not, or says nothing that can be used.
    #[error("its tag {name} is missing or damaged")]
    Tag {
        /// The tag's name.
        name: &'static str,
    },
    /// A tag's number is one that a volume cannot have.
    #[error("its {name} is {found}, {expected}")]
    Value {
        /// The tag's name.
        name: &'static str,
        /// Its value.
        found: u64,
        /// What was expected.
        expected: &'static str,
    },
    /// The page is not grey.
    #[error(
        "it is a picture in colour ({found}), and a volume's slices are grey: save it as a grey \
        picture, or one channel of it"
    )]
    Colour {
        /// Which.
        found: String,
    },
    /// Samples of a type that is not read.
    #[error(
        "its samples are {found}, and only 8-, 16- and 32-bit integers and 32- and 64-bit floats are \
        read: save it as one of them"
    )]
    Samples {
        /// What they are.
        found: String,
    },
    /// A compression that is not read.
    #[error("its compression is {found}, which is not read: {SAVE_ANEW}")]
    Compression {
        /// Its name and number.
        found: String,
    },
    /// A predictor that is not read, or not with these samples or this compression.
    #[error("its predictor {predictor} with {with} is not read: {SAVE_ANEW}")]
    Predictor {
        /// The number.
        predictor: u64,
        /// The samples or the compression.
        with: String,
    },
    /// A page that is not like the first.
    #[error("it has {} x {} pixels of {found}, and the first slice has {} x {} of {first}: a volume's slices are \
        all alike", found_xy[0], found_xy[1], first_xy[0], first_xy[1])]
    Unlike {
        /// Pixels of this page.
        found_xy: [u64; 2],
        /// Its sample type.
        found: SampleType,
        /// Pixels of the first.
        first_xy: [u64; 2],
        /// Its sample type.
        first: SampleType,
    },
    /// A strip or tile holds less than its part of the picture.
    #[error(
        "its {kind} {index} has {found} bytes, which cannot hold {needed} decoded ones: it is cut short or \
        damaged"
    )]
    ShortChunk {
        /// `strip` or `tile`.
        kind: &'static str,
        /// Its number, from 0.
        index: u64,
        /// Its stored bytes.
        found: u64,
        /// The bytes that its part of the picture has.
        needed: u64,
    },
    /// A strip or tile cannot be decoded.
    #[error("its {kind} {index} cannot be decompressed: {what}")]
    Decompression {
        /// `strip` or `tile`.
        kind: &'static str,
        /// Its number, from 0.
        index: u64,
        /// The decoder's words.
        what: String,
    },
    /// The metadata speak of other pages than the file has.
    #[error(
        "its {metadata} metadata speak of {slices} slices, {channels} channels and {times} times, and it \
        has {pages} pages: the others may be in other files (give their folder or a quoted pattern), or it is \
        cut short"
    )]
    PageCount {
        /// Whose metadata.
        metadata: &'static str,
        /// Slices.
        slices: u64,
        /// Channels.
        channels: u64,
        /// Times.
        times: u64,
        /// Pages of full resolution.
        pages: u64,
    },
    /// The OME metadata name no page of this file for a slice.
    #[error(
        "its OME metadata name no page of this file for slice {z} of channel {channel} at time {time}: it \
        may be in another file of the set"
    )]
    NoPlane {
        /// The slice.
        z: u64,
        /// The channel.
        channel: u64,
        /// The time.
        time: u64,
    },
    /// The OME metadata are no XML.
    #[error("its OME metadata cannot be read: {what}")]
    OmeXml {
        /// The parser's words.
        what: String,
    },
    /// The OME metadata lack an attribute.
    #[error("its OME metadata lack a usable {name}")]
    OmeAttribute {
        /// The attribute.
        name: &'static str,
    },
    /// A file of a series that is a volume itself.
    #[error("it has {pages} pages, and each file of a series must be one slice: convert it alone")]
    ManyPages {
        /// Pages of full resolution.
        pages: u64,
    },
    /// The file is not what it was when the volume was opened.
    #[error("it has changed since it was opened")]
    Changed,
}
