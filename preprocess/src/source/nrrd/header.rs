//! NRRD headers as text: lines into fields, fields into numbers.
//!
//! After Teem's definition of the format, <https://teem.sourceforge.net/nrrd/format.html>: versions
//! NRRD0001 to NRRD0005 differ in the fields that they may have, so all are read alike.

use super::NrrdError;
use octree_store::SampleType;
use std::collections::BTreeMap;

/// A longer header is none.
pub(super) const LONGEST_HEADER: u64 = 1 << 24;

/// How voxels are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    Text,
    Gzip,
    Bzip2,
}

/// Where voxels are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Data {
    /// Behind the header, from this byte on.
    Attached { at: u64 },
    /// In a file of their own.
    File(String),
    /// In several files, by name; each may hold so many of the dimensions.
    List { names: Vec<String>, subdim: Option<usize> },
    /// In several files, numbered from the first to the last in steps.
    Numbered { pattern: String, first: i64, last: i64, step: i64, subdim: Option<usize> },
}

/// A header's fields, as it gives them: fastest axis first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) stored: SampleType,
    pub(super) sizes: Vec<u64>,
    pub(super) encoding: Encoding,
    pub(super) big_endian: bool,
    pub(super) line_skip: u64,
    /// `None`: the data are the file's last bytes.
    pub(super) byte_skip: Option<u64>,
    pub(super) data: Data,
    /// Lower case; one an axis, or none at all.
    pub(super) kinds: Vec<String>,
    pub(super) spacings: Vec<f64>,
    pub(super) thicknesses: Vec<f64>,
    /// Where each axis begins and ends, NaN where it does not say so; one an axis, or none at all.
    pub(super) axis_mins: Vec<f64>,
    pub(super) axis_maxs: Vec<f64>,
    /// Lower case: `node` where an axis begins and ends at samples, else at the borders of their cells.
    pub(super) centers: Vec<String>,
    /// The names of each axis's unit.
    pub(super) units: Vec<String>,
    /// Lower case.
    pub(super) space: Option<String>,
    pub(super) space_units: Vec<String>,
    /// One an axis, `None` for one that lies in no space; or none at all.
    pub(super) directions: Vec<Option<Vec<f64>>>,
    pub(super) origin: Option<Vec<f64>>,
}

/// The fields that are looked at; spaces in names do not matter.
const FIELDS: [&str; 20] = [
    "type",
    "dimension",
    "sizes",
    "encoding",
    "endian",
    "line skip",
    "byte skip",
    "data file",
    "kinds",
    "spacings",
    "thicknesses",
    "axis mins",
    "axis maxs",
    "centers",
    "units",
    "space",
    "space dimension",
    "space units",
    "space directions",
    "space origin",
];

/// The first characters of a text, printable.
pub(super) fn shown(text: &str) -> String {
    let shown: String = text.chars().take(60).flat_map(char::escape_debug).collect();
    if text.chars().nth(60).is_some() { format!("{shown}...") } else { shown }
}

fn compact(name: &str) -> String {
    name.chars().filter(|c| !c.is_whitespace()).flat_map(char::to_lowercase).collect()
}

/// Whether these are an NRRD file's first bytes.
pub(super) fn is_magic(bytes: &[u8]) -> bool {
    matches!(bytes, [b'N', b'R', b'R', b'D', b'0', b'0', b'0', b'1'..=b'9', ..])
}

impl Header {
    /// Reads a header from a file's first bytes, of which there are at most [`LONGEST_HEADER`].
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, NrrdError> {
        let mut fields: BTreeMap<&'static str, String> = BTreeMap::new();
        let mut at = 0;
        let mut files = Vec::new();
        for (number, raw) in bytes.split_inclusive(|&byte| byte == b'\n').enumerate() {
            let ended = raw.ends_with(b"\n");
            at += raw.len() as u64;
            let text = String::from_utf8_lossy(raw);
            let text = text.trim_end_matches(['\n', '\r']);
            if number == 0 {
                if !is_magic(raw) || text.trim_end().len() != 8 || text.as_bytes()[7] > b'5' {
                    return Err(NrrdError::Magic { found: shown(text) });
                }
            } else if fields.get("data file").is_some_and(|value| is_list(value)) {
                // A list ends with the file.
                files.extend(Some(text.trim().to_owned()).filter(|name| !name.is_empty()));
            } else if text.is_empty() && ended {
                return Self::from_fields(&fields, at, files);
            } else if let Some((field, value)) = field(number + 1, text)?
                && fields.insert(field, value).is_some()
            {
                return Err(NrrdError::Twice { field });
            }
        }
        // Only a header without voxels may end with the file.
        if bytes.is_empty() {
            return Err(NrrdError::Magic { found: String::new() });
        }
        if !fields.contains_key("data file") || at >= LONGEST_HEADER {
            return Err(NrrdError::Endless { limit: LONGEST_HEADER });
        }
        Self::from_fields(&fields, at, files)
    }

    fn from_fields(
        fields: &BTreeMap<&'static str, String>,
        at: u64,
        files: Vec<String>,
    ) -> Result<Self, NrrdError> {
        let get = |field| fields.get(field).map(String::as_str);
        let need = |field: &'static str| get(field).ok_or(NrrdError::FieldMissing { field });
        let stored = sample_type(need("type")?)?;
        let wrong = |field, expected| NrrdError::Field {
            field,
            expected,
            found: shown(get(field).unwrap_or("")),
        };
        let dimension: usize = need("dimension")?
            .parse()
            .ok()
            .filter(|dimension| (1..=16).contains(dimension))
            .ok_or_else(|| wrong("dimension", "a number from 1 to 16"))?;
        let per_axis = |field, count: usize| -> Result<(), NrrdError> {
            if count == dimension { Ok(()) } else { Err(wrong(field, "one entry for each axis")) }
        };
        let sizes: Vec<u64> = need("sizes")?
            .split_whitespace()
            .map(|size| size.parse().ok().filter(|&size| size > 0))
            .collect::<Option<_>>()
            .ok_or_else(|| wrong("sizes", "numbers of at least 1"))?;
        per_axis("sizes", sizes.len())?;
        let encoding = encoding(need("encoding")?)?;
        let big_endian = match get("endian").map(str::to_lowercase).as_deref() {
            Some("little") => false,
            Some("big") => true,
            None if stored.bytes() == 1 || encoding == Encoding::Text => false,
            None => return Err(NrrdError::FieldMissing { field: "endian" }),
            Some(_) => return Err(wrong("endian", "little or big")),
        };
        let (line_skip, byte_skip) = skips(get("line skip"), get("byte skip"), encoding)?;
        let words = |field, lower: bool| -> Result<Vec<String>, NrrdError> {
            let Some(value) = get(field) else { return Ok(Vec::new()) };
            let value = if lower { value.to_lowercase() } else { value.to_owned() };
            Ok(value.split_whitespace().map(str::to_owned).collect())
        };
        let kinds = words("kinds", true)?;
        let numbers = |field| -> Result<Vec<f64>, NrrdError> {
            words(field, true)?
                .iter()
                .map(|word| word.parse())
                .collect::<Result<Vec<f64>, _>>()
                .map_err(|_| wrong(field, "numbers, or NaN"))
        };
        let spacings = numbers("spacings")?;
        let thicknesses = numbers("thicknesses")?;
        let [axis_mins, axis_maxs] = [numbers("axis mins")?, numbers("axis maxs")?];
        let centers = words("centers", true)?;
        let directions = match get("space directions") {
            Some(text) => vectors(text)
                .ok_or_else(|| wrong("space directions", "vectors (x,y,z), or none"))?,
            None => Vec::new(),
        };
        let origin = get("space origin")
            .map(|text| match vectors(text).as_deref() {
                Some([Some(origin)]) => Ok(origin.clone()),
                _ => Err(wrong("space origin", "a vector (x,y,z)")),
            })
            .transpose()?;
        for (field, count) in [
            ("kinds", kinds.len()),
            ("spacings", spacings.len()),
            ("thicknesses", thicknesses.len()),
            ("axis mins", axis_mins.len()),
            ("axis maxs", axis_maxs.len()),
            ("centers", centers.len()),
            ("space directions", directions.len()),
        ] {
            if count > 0 {
                per_axis(field, count)?;
            }
        }
        let data = match get("data file") {
            None => Data::Attached { at },
            Some(text) => data_file(text, files).ok_or_else(|| {
                wrong("data file", "a name, LIST, or PATTERN FIRST LAST STEP [SUBDIM]")
            })?,
        };
        Ok(Self {
            stored,
            sizes,
            encoding,
            big_endian,
            line_skip,
            byte_skip,
            data,
            kinds,
            spacings,
            thicknesses,
            axis_mins,
            axis_maxs,
            centers,
            units: quoted(get("units").unwrap_or("")),
            space: get("space").map(str::to_lowercase),
            space_units: quoted(get("space units").unwrap_or("")),
            directions,
            origin,
        })
    }
}

/// Lines and bytes before the voxels; no bytes where the voxels are the file's last ones.
fn skips(
    lines: Option<&str>,
    bytes: Option<&str>,
    encoding: Encoding,
) -> Result<(u64, Option<u64>), NrrdError> {
    let wrong = |field, expected, found| NrrdError::Field { field, expected, found: shown(found) };
    let lines = lines.map_or(Ok(0), |skip| {
        skip.parse().map_err(|_| wrong("line skip", "a number of lines", skip))
    })?;
    let bytes = match bytes {
        Some("-1") if encoding != Encoding::Raw => return Err(NrrdError::SkipFromEnd),
        Some("-1") => None,
        Some(skip) => {
            let bytes = skip.parse();
            Some(bytes.map_err(|_| wrong("byte skip", "a number of bytes, or -1", skip))?)
        }
        None => Some(0),
    };
    Ok((lines, bytes))
}

fn is_list(data_file: &str) -> bool {
    data_file.split_whitespace().next() == Some("LIST")
}

/// The known field of a line, with its value; `None` for comments, keys and unknown fields.
fn field(line: usize, text: &str) -> Result<Option<(&'static str, String)>, NrrdError> {
    if text.starts_with('#') {
        return Ok(None);
    }
    let Some((name, value)) = text.split_once(':') else {
        return Err(NrrdError::Line { line, text: shown(text) });
    };
    if value.starts_with('=') {
        return Ok(None);
    }
    let name = compact(name);
    let name = if name == "centerings" { "centers" } else { &name };
    let known = FIELDS.into_iter().find(|known| compact(known) == name);
    Ok(known.map(|known| (known, value.trim().to_owned())))
}

/// A field of `data file`; `files` are the lines after it.
fn data_file(text: &str, files: Vec<String>) -> Option<Data> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let subdim = |word: Option<&&str>| match word {
        None => Some(None),
        Some(word) => word.parse().ok().filter(|&subdim: &usize| subdim > 0).map(Some),
    };
    if is_list(text) {
        let list = Data::List { names: files, subdim: subdim(words.get(1))? };
        return (words.len() <= 2).then_some(list);
    }
    if let [pattern, first, last, step, rest @ ..] = words.as_slice()
        && pattern.contains('%')
        && rest.len() <= 1
    {
        return Some(Data::Numbered {
            pattern: (*pattern).to_owned(),
            first: first.parse().ok()?,
            last: last.parse().ok()?,
            step: step.parse().ok()?,
            subdim: subdim(rest.first())?,
        });
    }
    (!text.is_empty()).then(|| Data::File(text.to_owned()))
}

/// Vectors in parentheses, or the word "none".
fn vectors(text: &str) -> Option<Vec<Option<Vec<f64>>>> {
    let mut vectors = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        if let Some(tail) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = tail.trim_start();
            continue;
        }
        let (inside, tail) = rest.strip_prefix('(')?.split_once(')')?;
        let numbers = inside.split(',').map(|number| number.trim().parse().ok());
        vectors.push(Some(numbers.collect::<Option<_>>()?));
        rest = tail.trim_start();
    }
    Some(vectors)
}

/// Texts in quotation marks.
fn quoted(text: &str) -> Vec<String> {
    text.split('"').skip(1).step_by(2).map(str::to_owned).collect()
}

fn encoding(name: &str) -> Result<Encoding, NrrdError> {
    match name.to_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "txt" | "text" | "ascii" => Ok(Encoding::Text),
        "gz" | "gzip" => Ok(Encoding::Gzip),
        "bz2" | "bzip2" => Ok(Encoding::Bzip2),
        "hex" => Err(NrrdError::Encoding { name: "hex" }),
        "zrl" => Err(NrrdError::Encoding { name: "zrl" }),
        _ => Err(NrrdError::Field {
            field: "encoding",
            expected: "raw, gzip, bzip2 or text",
            found: shown(name),
        }),
    }
}

fn sample_type(name: &str) -> Result<SampleType, NrrdError> {
    let words: Vec<String> = name.split_whitespace().map(str::to_lowercase).collect();
    Ok(match words.join(" ").as_str() {
        "signed char" | "int8" | "int8_t" => SampleType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => SampleType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            SampleType::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            SampleType::U16
        }
        "int" | "signed int" | "int32" | "int32_t" => SampleType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => SampleType::U32,
        "float" => SampleType::F32,
        "double" => SampleType::F64,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => {
            return Err(NrrdError::Type { name: "64-bit signed integers" });
        }
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            return Err(NrrdError::Type { name: "64-bit unsigned integers" });
        }
        "block" => return Err(NrrdError::Type { name: "blocks of bytes" }),
        _ => {
            return Err(NrrdError::Field {
                field: "type",
                expected: "a type such as short, uint16 or float",
                found: shown(name),
            });
        }
    })
}
