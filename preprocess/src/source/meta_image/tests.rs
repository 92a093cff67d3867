//! MetaImage's rules, one by one.

use super::header::{Data, Header};
use super::*;
use proptest::prelude::*;

const SMALL: &str = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT";

fn parse(text: &str) -> Result<Header, MetaImageError> {
    Header::parse(text.as_bytes())
}

/// [`SMALL`] with more lines, before the last one.
fn with(lines: &str) -> Result<Header, MetaImageError> {
    parse(&format!("{SMALL}\n{lines}\nElementDataFile = a.raw\n"))
}

fn data(text: &str) -> Result<Data, MetaImageError> {
    parse(&format!("{SMALL}\nElementDataFile = {text}")).map(|header| header.data)
}

#[test]
fn keys_have_other_names_and_the_header_ends_with_the_data_file() {
    let header = with("Position = 1 2 3\nRotation = 1 0 0 0 1 0 0 0 1\nElementByteOrderMSB = True");
    let header = header.unwrap();
    assert_eq!((header.origin.len(), header.directions.len(), header.big_endian), (3, 9, true));
    let text =
        format!("{}\r\n\r\nElementDataFile = LOCAL\r\nvoxels: x", SMALL.replace('\n', "\r\n"));
    let header = parse(&text).unwrap();
    assert_eq!(header.data, Data::Local { at: text.len() as u64 - 9 });
    assert_eq!(parse(SMALL), Err(MetaImageError::KeyMissing { key: "ElementDataFile" }));
    assert!(matches!(with("what is this"), Err(MetaImageError::Line { line: 5, .. })));
    assert_eq!(with("NDims = 2"), Err(MetaImageError::Twice { key: "NDims" }));
    assert!(with("# a comment\nComment = hello: you\nModality = MET_MOD_CT").is_ok());
}

#[test]
fn voxels_are_binary_or_text_and_bytes_before_them_are_passed_over() {
    let header = with("BinaryData = False\nHeaderSize = -1").unwrap();
    assert_eq!((header.binary, header.skip_bytes), (false, None));
    assert_eq!(with("HeaderSize = 12").unwrap().skip_bytes, Some(12));
    assert!(matches!(with("HeaderSize = -2"), Err(MetaImageError::Value { .. })));
    assert!(with("CompressedData = True\nCompressedDataSize = 7").unwrap().compressed);
    assert_eq!(
        with("CompressedData = True\nBinaryData = False"),
        Err(MetaImageError::CompressedText)
    );
    assert!(matches!(with("CompressedData = maybe"), Err(MetaImageError::Value { .. })));
}

#[test]
fn spacing_may_be_the_elements_size() {
    assert_eq!(with("ElementSize = 1 2 3").unwrap().spacing, [1.0, 2.0, 3.0]);
    let both = with("ElementSize = 1 2 3\nElementSpacing = 4 5 6").unwrap();
    assert_eq!(both.spacing, [4.0, 5.0, 6.0]);
    for wrong in ["ElementSpacing = 1 2", "ElementSpacing = 1 2 x", "TransformMatrix = 1 0 0"] {
        assert!(matches!(with(wrong), Err(MetaImageError::Value { .. })), "{wrong}");
    }
}

#[test]
fn types_that_fit_are_read_and_others_named() {
    for (name, expected) in [
        ("MET_CHAR", SampleType::I8),
        ("MET_UCHAR", SampleType::U8),
        ("MET_SHORT", SampleType::I16),
        ("MET_USHORT", SampleType::U16),
        ("MET_INT", SampleType::I32),
        ("MET_UINT", SampleType::U32),
        ("MET_LONG", SampleType::I32),
        ("MET_ULONG", SampleType::U32),
        ("MET_FLOAT", SampleType::F32),
        ("MET_DOUBLE", SampleType::F64),
    ] {
        let text = format!("{}\nElementDataFile = LOCAL\n", SMALL.replace("MET_SHORT", name));
        assert_eq!(parse(&text).unwrap().stored, expected);
    }
    let named = |name: &str| {
        parse(&format!("{}\nElementDataFile = LOCAL\n", SMALL.replace("MET_SHORT", name)))
    };
    assert!(matches!(named("MET_LONG_LONG"), Err(MetaImageError::Type { .. })));
    assert!(matches!(named("MET_STRING"), Err(MetaImageError::Value { .. })));
    assert!(matches!(
        parse(&format!("{}\nElementDataFile = LOCAL\n", SMALL.replace("Image", "Scene"))),
        Err(MetaImageError::Value { key: "ObjectType", .. })
    ));
}

#[test]
fn data_files_are_named_listed_or_numbered() {
    assert_eq!(data("my scan.raw"), Ok(Data::File("my scan.raw".into())));
    assert_eq!(data("Local\n").unwrap(), Data::Local { at: SMALL.len() as u64 + 25 });
    let names = vec!["a.raw".to_owned(), "b.raw".to_owned()];
    assert_eq!(data("LIST\na.raw\nb.raw\n"), Ok(Data::List { names: names.clone(), file_dims: 2 }));
    assert_eq!(data("LIST 3\na.raw\r\n\nb.raw"), Ok(Data::List { names, file_dims: 3 }));
    let numbered =
        |first, last, step| Ok(Data::Numbered { pattern: "a%02d.raw".into(), first, last, step });
    assert_eq!(data("a%02d.raw"), numbered(1, None, 1));
    assert_eq!(data("a%02d.raw 0"), numbered(0, None, 1));
    assert_eq!(data("a%02d.raw 3 5 2"), numbered(3, Some(5), 2));
    for wrong in ["", "LIST 4", "LIST 2 2", "a%d 1 x 1"] {
        assert!(matches!(data(wrong), Err(MetaImageError::Value { .. })), "{wrong}");
    }
}

#[test]
fn the_world_turns_from_left_posterior_to_right_anterior() {
    let header = with("TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 20 30").unwrap();
    // The first axis of the volume runs along +y of the world, the second along -x.
    let affine = affine(&header, [2.0, 3.0, 4.0], 1.0).unwrap();
    let expected = [[0.0, 3.0, 0.0, -10.0], [-2.0, 0.0, 0.0, -20.0], [0.0, 0.0, 4.0, 30.0]];
    assert_eq!(affine[..3], expected);
    assert_eq!(super::affine(&with("ElementSpacing = 1 2 3").unwrap(), [1.0; 3], 1.0), None);
}

fn header_text() -> impl Strategy<Value = Vec<u8>> {
    let words = prop::sample::select(vec![
        "NDims = ",
        "DimSize = ",
        "ElementType = ",
        "MET_UCHAR",
        "MET_DOUBLE",
        "ElementDataFile = ",
        "LOCAL\n",
        "LIST",
        "a%03d.raw ",
        "ElementSpacing = ",
        "CompressedData = True\n",
        "HeaderSize = ",
        "-1 ",
        "1 ",
        "2 ",
        "9999999999 ",
        "\n",
        "\r\n",
        "ElementNumberOfChannels = ",
        "BinaryData = F\n",
        "TransformMatrix = ",
        "Offset = ",
        "=",
        ":",
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
    fn no_header_brings_the_program_down(text in header_text(), keys in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mha");
        let mut bytes = if keys { format!("{SMALL}\n").into_bytes() } else { vec![] };
        bytes.extend(&text);
        std::fs::write(&path, &bytes).unwrap();
        match open(&path, &SourceOptions::default()) {
            Ok(source) => {
                let voxels: u64 = source.dims_xyz.iter().product();
                prop_assert!(voxels / 2048 <= bytes.len() as u64);
            }
            Err(error) => prop_assert!(error.to_string().contains("a.mha"), "{error}"),
        }
    }
}
