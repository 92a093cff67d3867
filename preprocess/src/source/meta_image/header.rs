//! MetaImage headers as text: `Key = value` lines, the last of which says where the voxels are.
//!
//! After MetaIO, the library of ITK that defines the format,
//! <https://itk.org/Wiki/MetaIO/Documentation>, and ITK's own reading of it: `CenterOfRotation` and
//! `AnatomicalOrientation` change nothing there, nor here.

use super::MetaImageError;
use octree_store::SampleType;
use std::collections::BTreeMap;

/// A longer header is none.
pub(super) const LONGEST_HEADER: u64 = 1 << 24;

/// Where voxels are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Data {
    /// Behind the header, from this byte on.
    Local { at: u64 },
    /// In a file of their own.
    File(String),
    /// In several files, by name, each of which holds so many of the dimensions.
    List { names: Vec<String>, file_dims: usize },
    /// In several files, numbered from the first to the last in steps.
    Numbered { pattern: String, first: i64, last: Option<i64>, step: i64 },
}

/// A header's values.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) stored: SampleType,
    pub(super) dims: Vec<u64>,
    pub(super) channels: u64,
    pub(super) binary: bool,
    pub(super) big_endian: bool,
    pub(super) compressed: bool,
    /// Bytes before the voxels in their file; `None`: the voxels are the file's last bytes.
    pub(super) skip_bytes: Option<u64>,
    pub(super) spacing: Vec<f64>,
    pub(super) origin: Vec<f64>,
    /// Directions of the axes, one after the other; or none at all.
    pub(super) directions: Vec<f64>,
    pub(super) unit: Option<String>,
    pub(super) data: Data,
}

/// The keys that are looked at, each with its other names.
const KEYS: [&[&str]; 14] = [
    &["ObjectType"],
    &["NDims"],
    &["DimSize"],
    &["ElementType"],
    &["ElementNumberOfChannels"],
    &["BinaryData"],
    &["BinaryDataByteOrderMSB", "ElementByteOrderMSB"],
    &["CompressedData"],
    &["HeaderSize"],
    &["ElementSpacing"],
    &["ElementSize"],
    &["Offset", "Origin", "Position"],
    &["TransformMatrix", "Orientation", "Rotation"],
    &["DistanceUnits"],
];
const DATA_FILE: &str = "ElementDataFile";

/// The first characters of a text, printable.
pub(super) fn shown(text: &str) -> String {
    let shown: String = text.chars().take(60).flat_map(char::escape_debug).collect();
    if text.chars().nth(60).is_some() { format!("{shown}...") } else { shown }
}

/// Whether these are a MetaImage file's first bytes, as ITK and others write them.
pub(super) fn is_magic(bytes: &[u8]) -> bool {
    let line = bytes.split(|&byte| byte == b'\n').next().unwrap_or_default();
    ["ObjectType", "NDims", "Comment"].into_iter().any(|key| {
        line.strip_prefix(key.as_bytes()).is_some_and(|rest| rest.trim_ascii().starts_with(b"="))
    })
}

impl Header {
    /// Reads a header from a file's first bytes, of which there are at most [`LONGEST_HEADER`].
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, MetaImageError> {
        let mut values = BTreeMap::new();
        let mut at = 0;
        let mut lines = bytes.split_inclusive(|&byte| byte == b'\n').enumerate();
        let data_file = loop {
            let Some((number, raw)) = lines.next() else {
                return Err(if bytes.len() as u64 >= LONGEST_HEADER {
                    MetaImageError::Endless { limit: LONGEST_HEADER }
                } else {
                    MetaImageError::KeyMissing { key: DATA_FILE }
                });
            };
            at += raw.len() as u64;
            let text = String::from_utf8_lossy(raw);
            let text = text.trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let Some((key, value)) = text.split_once(['=', ':']) else {
                return Err(MetaImageError::Line { line: number + 1, text: shown(text) });
            };
            let (key, value) = (key.trim(), value.trim());
            if key.eq_ignore_ascii_case(DATA_FILE) {
                break value.to_owned();
            }
            let known =
                KEYS.iter().find(|names| names.iter().any(|name| name.eq_ignore_ascii_case(key)));
            if let Some([key, ..]) = known
                && values.insert(*key, value.to_owned()).is_some_and(|before| before != value)
            {
                return Err(MetaImageError::Twice { key });
            }
        };
        let rest = lines.map(|(_, raw)| String::from_utf8_lossy(raw).trim().to_owned());
        Self::from_values(&values, &data_file, at, rest)
    }

    fn from_values(
        values: &BTreeMap<&'static str, String>,
        data_file: &str,
        at: u64,
        lines: impl Iterator<Item = String>,
    ) -> Result<Self, MetaImageError> {
        let get = |key| values.get(key).map(String::as_str);
        let need = |key: &'static str| get(key).ok_or(MetaImageError::KeyMissing { key });
        let wrong = |key, expected| MetaImageError::Value {
            key,
            expected,
            found: shown(get(key).unwrap_or("")),
        };
        if get("ObjectType").is_some_and(|kind| !kind.eq_ignore_ascii_case("Image")) {
            return Err(wrong("ObjectType", "Image"));
        }
        let stored = sample_type(need("ElementType")?)?;
        let dimensions: usize = need("NDims")?
            .parse()
            .ok()
            .filter(|dimensions| (1..=10).contains(dimensions))
            .ok_or_else(|| wrong("NDims", "a number from 1 to 10"))?;
        let dims: Vec<u64> = need("DimSize")?
            .split_whitespace()
            .map(|size| size.parse().ok().filter(|&size| size > 0))
            .collect::<Option<_>>()
            .filter(|dims: &Vec<u64>| dims.len() == dimensions)
            .ok_or_else(|| wrong("DimSize", "a number of at least 1 for each of NDims axes"))?;
        let flag = |key, default| match get(key) {
            None => Ok(default),
            // MetaIO looks at the first letter alone.
            Some(text) => match text.as_bytes().first() {
                Some(b'T' | b't' | b'1') => Ok(true),
                Some(b'F' | b'f' | b'0') => Ok(false),
                _ => Err(wrong(key, "True or False")),
            },
        };
        let numbers = |key, count: usize| -> Result<Vec<f64>, MetaImageError> {
            let Some(text) = get(key) else { return Ok(Vec::new()) };
            text.split_whitespace()
                .map(|word| word.parse().ok())
                .collect::<Option<Vec<f64>>>()
                .filter(|numbers| numbers.len() == count)
                .ok_or_else(|| wrong(key, "one number for each axis (a matrix has NDims x NDims)"))
        };
        let whole = |key: &'static str, expected| {
            get(key).map(|text| text.parse().map_err(|_| wrong(key, expected))).transpose()
        };
        let channels: u64 =
            whole("ElementNumberOfChannels", "a number of at least 1")?.unwrap_or(1);
        if channels == 0 {
            return Err(wrong("ElementNumberOfChannels", "a number of at least 1"));
        }
        let skip_bytes = match get("HeaderSize") {
            Some("-1") => None,
            _ => Some(whole("HeaderSize", "a number of bytes, or -1")?.unwrap_or(0)),
        };
        let binary = flag("BinaryData", true)?;
        let compressed = flag("CompressedData", false)?;
        if compressed && !binary {
            return Err(MetaImageError::CompressedText);
        }
        let mut spacing = numbers("ElementSpacing", dimensions)?;
        if spacing.is_empty() {
            spacing = numbers("ElementSize", dimensions)?;
        }
        Ok(Self {
            stored,
            channels,
            binary,
            big_endian: flag("BinaryDataByteOrderMSB", false)?,
            compressed,
            skip_bytes,
            spacing,
            origin: numbers("Offset", dimensions)?,
            directions: numbers("TransformMatrix", dimensions * dimensions)?,
            unit: get("DistanceUnits").map(str::to_owned),
            data: data(data_file, at, dims.len(), lines)?,
            dims,
        })
    }
}

/// What `ElementDataFile` says; `lines` are those after it.
fn data(
    text: &str,
    at: u64,
    dimensions: usize,
    lines: impl Iterator<Item = String>,
) -> Result<Data, MetaImageError> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let wrong = || MetaImageError::Value {
        key: DATA_FILE,
        expected: "LOCAL, a name, LIST [DIMENSIONS], or PATTERN [FIRST [LAST [STEP]]]",
        found: shown(text),
    };
    match words.as_slice() {
        [] => Err(wrong()),
        [local] if local.eq_ignore_ascii_case("LOCAL") => Ok(Data::Local { at }),
        ["LIST", rest @ ..] => {
            let file_dims = match rest {
                [] => dimensions.saturating_sub(1),
                [dims] => dims
                    .trim_end_matches(['D', 'd'])
                    .parse()
                    .ok()
                    .filter(|dims| (1..=dimensions).contains(dims))
                    .ok_or_else(wrong)?,
                _ => return Err(wrong()),
            };
            Ok(Data::List { names: lines.filter(|line| !line.is_empty()).collect(), file_dims })
        }
        [pattern, numbers @ ..] if pattern.contains('%') && numbers.len() <= 3 => {
            let numbers: Option<Vec<i64>> = numbers.iter().map(|word| word.parse().ok()).collect();
            let numbers = numbers.ok_or_else(wrong)?;
            Ok(Data::Numbered {
                pattern: (*pattern).to_owned(),
                first: numbers.first().copied().unwrap_or(1),
                last: numbers.get(1).copied(),
                step: numbers.get(2).copied().unwrap_or(1),
            })
        }
        _ => Ok(Data::File(text.to_owned())),
    }
}

fn sample_type(name: &str) -> Result<SampleType, MetaImageError> {
    Ok(match name {
        "MET_CHAR" => SampleType::I8,
        "MET_UCHAR" => SampleType::U8,
        "MET_SHORT" => SampleType::I16,
        "MET_USHORT" => SampleType::U16,
        // MetaIO's long has 4 bytes, whatever the machine's has.
        "MET_INT" | "MET_LONG" => SampleType::I32,
        "MET_UINT" | "MET_ULONG" => SampleType::U32,
        "MET_FLOAT" => SampleType::F32,
        "MET_DOUBLE" => SampleType::F64,
        "MET_LONG_LONG" => return Err(MetaImageError::Type { name: "64-bit signed integers" }),
        "MET_ULONG_LONG" => return Err(MetaImageError::Type { name: "64-bit unsigned integers" }),
        _ => {
            return Err(MetaImageError::Value {
                key: "ElementType",
                expected: "MET_UCHAR, MET_CHAR, MET_USHORT, MET_SHORT, MET_UINT, MET_INT, MET_FLOAT or \
                    MET_DOUBLE",
                found: shown(name),
            });
        }
    })
}
