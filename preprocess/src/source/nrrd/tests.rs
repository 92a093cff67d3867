//! NRRD's rules, one by one.

use super::super::world;
use super::super::world::World;
use super::axes::Axes;
use super::header::{Data, Encoding, Header};
use super::*;
use octree_store::{LengthUnit, SampleType};
use proptest::prelude::*;

/// A header of these lines, after the magic, ended by an empty line.
fn parse(lines: &str) -> Result<Header, NrrdError> {
    Header::parse(format!("NRRD0005\n{lines}\n\n").as_bytes())
}

const SMALL: &str = "type: short\ndimension: 3\nsizes: 4 3 2\nencoding: raw\nendian: little";

/// [`SMALL`] with more lines.
fn with(lines: &str) -> Result<Header, NrrdError> {
    parse(&format!("{SMALL}\n{lines}"))
}

fn sorted(lines: &str) -> Result<Axes, NrrdError> {
    Axes::of(&parse(&format!("type: uchar\nencoding: raw\n{lines}")).unwrap())
}

#[test]
fn fields_comments_and_keys_are_told_apart() {
    let header = with("# a comment: type: double\nkey:=type: double\nunknown: 7").unwrap();
    assert_eq!((header.stored, &header.sizes[..]), (SampleType::I16, &[4, 3, 2][..]));
    assert!(matches!(with("no colon"), Err(NrrdError::Line { line: 7, .. })));
    assert_eq!(with("Type: short"), Err(NrrdError::Twice { field: "type" }));
}

#[test]
fn every_version_up_to_5_is_read() {
    for version in 1..=5 {
        assert!(Header::parse(format!("NRRD000{version}\n{SMALL}\n\n").as_bytes()).is_ok());
    }
    for magic in ["NRRD0006", "NRRD00.1", "nrrd0001", "NRRD00011", ""] {
        let header = Header::parse(format!("{magic}\n{SMALL}\n\n").as_bytes());
        assert!(matches!(header, Err(NrrdError::Magic { .. })), "{magic}");
    }
}

#[test]
fn numbers_of_files_at_the_ends_of_all_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nhdr");
    for numbers in [
        "0 -9223372036854775808 -1",
        "-9223372036854775808 9223372036854775807 1",
        "0 9223372036854775807 1",
        "0 -9223372036854775808 -2",
    ] {
        std::fs::write(&path, format!("NRRD0005\n{SMALL}\ndata file: a%d.raw {numbers}\n"))
            .unwrap();
        let error = Source::open(&path, &SourceOptions::default()).unwrap_err();
        assert!(error.to_string().contains("a.nhdr"), "{numbers}: {error}");
    }
}

#[test]
fn lines_may_end_as_windows_ends_them() {
    let text = format!("NRRD0004\n{SMALL}\n\nvoxels").replace('\n', "\r\n");
    let header = Header::parse(text.as_bytes()).unwrap();
    assert_eq!(header.data, Data::Attached { at: text.len() as u64 - 6 });
}

#[test]
fn types_go_by_all_their_names() {
    let stored = |name: &str| parse(&SMALL.replace("short", name)).map(|header| header.stored);
    for (names, expected) in [
        ("signed char,int8,int8_t", SampleType::I8),
        ("uchar,unsigned char,uint8,uint8_t,UNSIGNED  char", SampleType::U8),
        ("short,short int,signed short,signed short int,int16,int16_t", SampleType::I16),
        ("ushort,unsigned short,unsigned short int,uint16,uint16_t", SampleType::U16),
        ("int,signed int,int32,int32_t", SampleType::I32),
        ("uint,unsigned int,uint32,uint32_t", SampleType::U32),
        ("float", SampleType::F32),
        ("double", SampleType::F64),
    ] {
        for name in names.split(',') {
            assert_eq!(stored(name), Ok(expected), "{name}");
        }
    }
    for name in ["long long", "int64", "unsigned long long int", "uint64_t", "block"] {
        assert!(matches!(stored(name), Err(NrrdError::Type { .. })), "{name}");
    }
    assert!(matches!(stored("half"), Err(NrrdError::Field { field: "type", .. })));
}

#[test]
fn encodings_go_by_all_their_names() {
    let encoding = |name: &str| parse(&SMALL.replace("raw", name)).map(|header| header.encoding);
    for (names, expected) in [
        ("raw,RAW", Encoding::Raw),
        ("txt,text,ascii,ASCII", Encoding::Text),
        ("gz,gzip", Encoding::Gzip),
        ("bz2,bzip2", Encoding::Bzip2),
    ] {
        for name in names.split(',') {
            assert_eq!(encoding(name), Ok(expected), "{name}");
        }
    }
    assert_eq!(encoding("hex"), Err(NrrdError::Encoding { name: "hex" }));
    assert!(matches!(encoding("zip"), Err(NrrdError::Field { field: "encoding", .. })));
}

#[test]
fn the_byte_order_must_be_said_where_it_matters() {
    let without = SMALL.replace("\nendian: little", "");
    assert_eq!(parse(&without), Err(NrrdError::FieldMissing { field: "endian" }));
    for good in [without.replace("short", "uchar"), without.replace("raw", "ascii")] {
        assert!(parse(&good).is_ok(), "{good}");
    }
    assert!(parse(&SMALL.replace("little", "Big")).unwrap().big_endian);
}

#[test]
fn sizes_and_dimension_belong_together() {
    for (from, to) in [
        ("4 3 2", "4 3"),
        ("4 3 2", "4 3 0"),
        ("4 3 2", "4 -3 2"),
        ("4 3 2", "4 99999999999999999999 2"),
        ("dimension: 3", "dimension: 0"),
        ("dimension: 3", "dimension: x"),
        ("dimension: 3", "dimension: 17"),
    ] {
        assert!(matches!(parse(&SMALL.replace(from, to)), Err(NrrdError::Field { .. })), "{to}");
    }
    for field in ["type", "dimension", "sizes", "encoding"] {
        let lines = SMALL.lines().filter(|line| !line.starts_with(field));
        let lines = lines.collect::<Vec<_>>().join("\n");
        assert_eq!(parse(&lines), Err(NrrdError::FieldMissing { field }));
    }
    for lines in ["kinds: domain", "spacings: 1 2", "space directions: (1,0,0)", "space origin: 1"]
    {
        assert!(matches!(with(lines), Err(NrrdError::Field { .. })), "{lines}");
    }
}

#[test]
fn skips_are_numbers_and_minus_one_is_for_raw_data() {
    let header = with("line skip: 2\nbyte skip: 7").unwrap();
    assert_eq!((header.line_skip, header.byte_skip), (2, Some(7)));
    assert_eq!(with("byteskip: -1").unwrap().byte_skip, None);
    assert!(matches!(with("byte skip: -5"), Err(NrrdError::Field { .. })));
    let gzip = format!("{}\nbyte skip: -1", SMALL.replace("raw", "gzip"));
    assert_eq!(parse(&gzip), Err(NrrdError::SkipFromEnd));
}

#[test]
fn data_are_behind_the_header_or_in_files() {
    let data = |lines: &str| with(lines).map(|header| header.data);
    let file = |name: &str| Ok(Data::File(name.to_owned()));
    assert_eq!(data("data file: my scan 7%.raw"), file("my scan 7%.raw"));
    assert_eq!(data("datafile: ./a.raw"), file("./a.raw"));
    let numbered = |subdim| {
        let pattern = "a%03d.raw".to_owned();
        Ok(Data::Numbered { pattern, first: 1, last: 9, step: 2, subdim })
    };
    assert_eq!(data("data file: a%03d.raw 1 9 2"), numbered(None));
    assert_eq!(data("data file: a%03d.raw 1 9 2 2"), numbered(Some(2)));
    let list =
        |subdim| Ok(Data::List { names: vec!["a.raw".to_owned(), "b c.raw".to_owned()], subdim });
    assert_eq!(data("data file: LIST\na.raw\nb c.raw"), list(None));
    assert_eq!(data("data file: LIST 2\r\na.raw\r\nb c.raw\r"), list(Some(2)));
    for wrong in ["data file: LIST 0", "data file: a%d 1 x 1", "data file:"] {
        assert!(matches!(data(wrong), Err(NrrdError::Field { .. })), "{wrong}");
    }
    // Without voxels, a header may end with the file.
    let ended = Header::parse(format!("NRRD0001\n{SMALL}\ndata file: a.raw").as_bytes());
    assert_eq!(ended.unwrap().data, Data::File("a.raw".into()));
    let endless = Header::parse(format!("NRRD0001\n{SMALL}").as_bytes());
    assert!(matches!(endless, Err(NrrdError::Endless { .. })));
}

#[test]
fn axes_are_sorted_by_kind_direction_and_spacing() {
    let axes = sorted("dimension: 4\nsizes: 5 4 3 2").unwrap();
    assert_eq!((axes.dims_xyz, axes.space), ([5, 4, 3], vec![0, 1, 2]));
    assert!(axes.outer[0].time && axes.outer[0].count == 2);
    let axes = sorted("dimension: 4\nsizes: 2 5 4 3\nkinds: vector domain domain domain").unwrap();
    assert_eq!((axes.dims_xyz, axes.outer.len()), ([5, 4, 3], 0));
    assert!(axes.inner.is_some_and(|inner| inner.count == 2 && !inner.time));
    let axes = sorted(
        "dimension: 4\nsizes: 2 5 4 3\nspace dimension: 3\nspace directions: none (1,0,0) (0,1,0) (0,0,1)",
    );
    assert!(axes.unwrap().inner.is_some_and(|inner| inner.count == 2));
    let axes = sorted("dimension: 4\nsizes: 2 5 4 3\nspacings: NaN 1 1 1").unwrap();
    assert_eq!((axes.dims_xyz, axes.inner.map(|inner| inner.count)), ([5, 4, 3], Some(2)));
    let axes = sorted("dimension: 4\nsizes: 5 4 3 2\nkinds: space space space list").unwrap();
    assert!(!axes.outer[0].time);
    let axes = sorted("dimension: 3\nsizes: 3 5 4\nkinds: RGB-color domain domain").unwrap();
    assert_eq!((axes.dims_xyz, axes.space), ([5, 4, 1], vec![1, 2]));
    assert!(axes.inner.is_some_and(|inner| axes::is_colour(&inner.kind)));
    let axes = sorted("dimension: 1\nsizes: 5").unwrap();
    assert_eq!(axes.dims_xyz, [5, 1, 1]);
    let axes = sorted("dimension: 4\nsizes: 5 1 4 3\nkinds: domain list domain domain").unwrap();
    assert_eq!((axes.dims_xyz, axes.inner, axes.outer), ([5, 4, 3], None, vec![]));
    let between = sorted("dimension: 4\nsizes: 5 2 4 3\nkinds: domain list domain domain");
    assert!(matches!(between, Err(NrrdError::AxisBetween { axis: 1, .. })), "{between:?}");
}

#[test]
fn every_space_becomes_right_anterior_superior() {
    let world = |lines: &str| {
        let header = with(lines).unwrap();
        World::of_nrrd(&header, &Axes::of(&header).unwrap())
    };
    let lines = "space directions: (2,0,0) (0,3,0) (0,0,4)\nspace origin: (10,20,30)";
    for (space, [x, y]) in [
        ("right-anterior-superior", [1.0, 1.0]),
        ("LAS", [-1.0, 1.0]),
        ("left-posterior-superior", [-1.0, -1.0]),
        ("Left-Posterior-Superior-Time", [-1.0, -1.0]),
        ("scanner-xyz", [1.0, 1.0]),
    ] {
        let found = world(&format!("space: {space}\n{lines}"));
        assert_eq!(found.spacing_xyz, [2.0, 3.0, 4.0]);
        let expected = [
            [2.0 * x, 0.0, 0.0, 10.0 * x],
            [0.0, 3.0 * y, 0.0, 20.0 * y],
            [0.0, 0.0, 4.0, 30.0],
            [0.0, 0.0, 0.0, 1.0],
        ];
        assert_eq!(found.affine, Some(expected), "{space}");
    }
    let found = world(&format!("space: RAS\nspace units: \"cm\" \"cm\" \"cm\"\n{lines}"));
    assert_eq!((found.unit, found.spacing_xyz), (LengthUnit::Mm, [20.0, 30.0, 40.0]));
    assert_eq!(found.affine.map(|rows| rows[0]), Some([20.0, 0.0, 0.0, 100.0]));
    let found = world("spacings: 1 -2 3\nunits: \"um\" \"um\" \"um\"");
    assert_eq!((found.unit, found.spacing_xyz), (LengthUnit::Um, [1.0, 2.0, 3.0]));
    assert_eq!((found.affine, found.notes.len()), (None, 0));
    let found = world("spacings: 1 NaN 0\nthicknesses: 5 6 7\nunits: \"um\" \"um\" \"mm\"");
    assert_eq!((found.unit, found.spacing_xyz), (LengthUnit::Mm, [1.0, 6.0, 7.0]));
    assert_eq!(found.notes.len(), 3);
    // Teem's rule: from border to border of SIZES cells, or from the first sample to the last.
    let header =
        with("axis mins: 0 10 0\naxis maxs: 8 -6 NaN\ncenterings: cell node cell").unwrap();
    let [x, y, _] = [0, 1, 2].map(|axis| header.sizes[axis] as f64);
    let found = World::of_nrrd(&header, &Axes::of(&header).unwrap());
    assert_eq!(found.spacing_xyz, [8.0 / x, 16.0 / (y - 1.0), 1.0]);
    assert_eq!(found.affine, None);
    let found = world("axis mins: 0 0 0\naxis maxs: 8 8 8\nspacings: 3 NaN 3");
    assert_eq!(found.spacing_xyz, [3.0, 8.0 / y, 3.0], "spacings come first, and cells are usual");
    assert!(with("axis mins: 0 0").is_err());
    let found = world("space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,nan)");
    assert_eq!(found.affine, None);
    assert_eq!(world::length([3.0, 4.0, 12.0]), 13.0);
}

#[test]
fn a_slice_in_space_gets_a_third_axis() {
    let lines = "type: uchar\nencoding: raw\ndimension: 2\nsizes: 4 3\nspace: RAS\n\
        space directions: (0,2,0) (0,0,3)\nspace origin: (1,1,1)";
    let header = parse(lines).unwrap();
    let world = World::of_nrrd(&header, &Axes::of(&header).unwrap());
    assert_eq!(world.spacing_xyz, [2.0, 3.0, 1.0]);
    assert_eq!(world.affine.map(|rows| rows[0]), Some([0.0, 0.0, 1.0, 1.0]));
}

/// Words of which headers are made, so that chance finds more than the first check.
fn header_text() -> impl Strategy<Value = Vec<u8>> {
    let words = prop::sample::select(vec![
        "NRRD0001\n",
        "type: ",
        "short",
        "uchar",
        "dimension: ",
        "sizes: ",
        "encoding: ",
        "raw",
        "gzip",
        "ascii",
        "endian: ",
        "little",
        "data file: ",
        "LIST",
        "a%03d ",
        "kinds: ",
        "domain ",
        "list ",
        "space directions: ",
        "(1,0,0)",
        "none ",
        "space: ",
        "byte skip: ",
        "line skip: ",
        "-1",
        "1 ",
        "2 ",
        "9999999999999 ",
        "\n",
        "\n\n",
        "\r\n",
        ":=",
        "#",
        "\"mm\"",
        "(",
        ")",
        "%",
        "spacings: ",
        "NaN ",
    ]);
    let word = prop_oneof![
        9 => words.prop_map(|word| word.as_bytes().to_vec()),
        1 => prop::collection::vec(any::<u8>(), 0..6),
    ];
    prop::collection::vec(word, 0..60).prop_map(|words| words.concat())
}

proptest! {
    #[test]
    fn no_header_brings_the_program_down(text in header_text(), fields in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.nrrd");
        let mut bytes = if fields { format!("NRRD0004\n{SMALL}\n").into_bytes() } else { vec![] };
        bytes.extend(&text);
        std::fs::write(&path, &bytes).unwrap();
        match open(&path, &SourceOptions::default()) {
            Ok(source) => {
                let voxels: u64 = source.dims_xyz.iter().product();
                // bzip2 and deflate pack well, but there is a limit.
                prop_assert!(voxels / 2048 <= bytes.len() as u64 * 1024);
            }
            Err(error) => prop_assert!(error.to_string().contains("a.nrrd"), "{error}"),
        }
    }
}

/// Reads all of a file.
fn read_all(path: &Path) -> Result<(), SourceError> {
    let source = Source::open(path, &SourceOptions::default())?;
    let mut slices = source.slices()?;
    let mut slice = vec![0_i16; (source.dims_xyz[0] * source.dims_xyz[1]) as usize];
    (0..source.dims_xyz[2]).try_for_each(|_| slices.next(&mut slice))
}

#[test]
fn a_file_that_is_cut_anywhere_is_refused_by_name() {
    use flate2::{Compression, write::GzEncoder};
    use std::io::Write;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.nrrd");
    let voxels: Vec<u8> = (0..48_u8).collect();
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&voxels).unwrap();
    for (encoding, data) in [("raw", voxels.clone()), ("gzip", gzip.finish().unwrap())] {
        let mut whole = format!("NRRD0001\n{SMALL}\n\n").replace("raw", encoding).into_bytes();
        whole.extend(data);
        std::fs::write(&path, &whole).unwrap();
        read_all(&path).unwrap();
        for keep in 0..whole.len() {
            std::fs::write(&path, &whole[..keep]).unwrap();
            let error = read_all(&path).unwrap_err();
            assert!(error.to_string().contains("cut.nrrd"), "{encoding} {keep}: {error}");
        }
        for place in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[place] ^= 0x11;
            std::fs::write(&path, &damaged).unwrap();
            // Some bytes do no harm; none may do more than that.
            if let Ok(source) = Source::open(&path, &SourceOptions::default())
                && source.sample_type() == SampleType::I16
            {
                let _ = read_all(&path);
            }
        }
    }
}
