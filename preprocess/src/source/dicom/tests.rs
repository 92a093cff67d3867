//! Series made by hand: ordering, values, and files that are damaged.

use super::*;
use proptest::prelude::*;
use tempfile::TempDir;

/// A data set under construction, explicit little-endian; tags must come in order.
#[derive(Clone, Default)]
struct Maker(Vec<u8>);

impl Maker {
    fn with(mut self, tag: u32, representation: [u8; 2], value: &[u8]) -> Self {
        self.0.extend_from_slice(&((tag >> 16) as u16).to_le_bytes());
        self.0.extend_from_slice(&(tag as u16).to_le_bytes());
        self.0.extend_from_slice(&representation);
        if &representation == b"OW" {
            self.0.extend_from_slice(&[0, 0]);
            self.0.extend_from_slice(&(value.len() as u32).to_le_bytes());
        } else {
            self.0.extend_from_slice(&(value.len() as u16).to_le_bytes());
        }
        self.0.extend_from_slice(value);
        self
    }

    fn text(self, tag: u32, representation: [u8; 2], text: &str) -> Self {
        let padded =
            if text.len().is_multiple_of(2) { text.to_owned() } else { format!("{text} ") };
        self.with(tag, representation, padded.as_bytes())
    }

    fn short(self, tag: u32, value: u16) -> Self {
        self.with(tag, *b"US", &value.to_le_bytes())
    }
}

/// What a slice of 3 x 2 pixels says.
#[derive(Clone)]
struct Slice {
    series: &'static str,
    number: i32,
    z: Option<f64>,
    rescale: [&'static str; 2],
    photometric: &'static str,
    stored: u16,
    signed: bool,
    syntax: &'static str,
    pixels: [i16; 6],
}

impl Slice {
    fn new(number: i32, z: f64) -> Self {
        let value = (number * 10) as i16;
        Self {
            series: "1.2.3",
            number,
            z: Some(z),
            rescale: ["1", "0"],
            photometric: "MONOCHROME2",
            stored: 16,
            signed: true,
            syntax: "1.2.840.10008.1.2.1",
            pixels: [0, 1, 2, 3, 4, 5].map(|i| value + i),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut file = vec![0; 128];
        file.extend_from_slice(b"DICM");
        file.extend(Maker::default().text(0x0002_0010, *b"UI", self.syntax).0);
        let mut set = Maker::default().text(0x0020_000E, *b"UI", self.series).text(
            0x0020_0013,
            *b"IS",
            &self.number.to_string(),
        );
        if let Some(z) = self.z {
            set = set.text(0x0020_0032, *b"DS", &format!("-5\\7\\{z}")).text(
                0x0020_0037,
                *b"DS",
                "1\\0\\0\\0\\1\\0",
            );
        }
        let pixels: Vec<u8> = self.pixels.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();
        let set = set
            .short(0x0028_0002, 1)
            .text(0x0028_0004, *b"CS", self.photometric)
            .short(0x0028_0010, 2)
            .short(0x0028_0011, 3)
            .text(0x0028_0030, *b"DS", "0.5\\0.25")
            .short(0x0028_0100, 16)
            .short(0x0028_0101, self.stored)
            .short(0x0028_0102, self.stored - 1)
            .short(0x0028_0103, u16::from(self.signed))
            .text(0x0028_1052, *b"DS", self.rescale[1])
            .text(0x0028_1053, *b"DS", self.rescale[0])
            .with(0x7FE0_0010, *b"OW", &pixels);
        file.extend(set.0);
        file
    }
}

/// A folder of slices, named against their order.
fn folder(slices: &[Slice]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (i, slice) in slices.iter().enumerate() {
        let name = format!("s{:03}.dcm", slices.len() - i);
        std::fs::write(folder.path().join(name), slice.bytes()).unwrap();
    }
    folder
}

fn open(path: &Path) -> Result<Source, SourceError> {
    Source::open(path, &SourceOptions::default())
}

fn open_folder(slices: &[Slice]) -> Result<Source, SourceError> {
    open(folder(slices).path())
}

fn refusal(slices: &[Slice]) -> DicomError {
    match open_folder(slices) {
        Err(SourceError::Dicom { source, .. }) => source,
        other => panic!("{other:?}"),
    }
}

/// All values of a volume.
fn values<T: Sample>(slices: &[Slice]) -> Vec<T> {
    let folder = folder(slices);
    let source = Source::open(folder.path(), &SourceOptions::default()).unwrap();
    let mut stream = source.slices().unwrap();
    let mut all = Vec::new();
    for _ in 0..source.dims_xyz[2] {
        let mut slice = vec![T::default(); 6];
        stream.next(&mut slice).unwrap();
        all.extend(slice);
    }
    all
}

#[test]
fn slices_are_ordered_by_their_places_and_lie_in_the_world() {
    // The numbers run against the places.
    let slices = [Slice::new(3, 0.0), Slice::new(1, 5.0), Slice::new(2, 2.5)];
    let source = open_folder(&slices).unwrap();
    assert_eq!((source.dims_xyz, source.spacing_xyz), ([3, 2, 3], [0.25, 0.5, 2.5]));
    let affine = [[-0.25, 0.0, 0.0, 5.0], [0.0, -0.5, 0.0, -7.0], [0.0, 0.0, 2.5, 0.0]];
    assert_eq!(source.affine.unwrap()[..3], affine);
    assert_eq!((source.unit, source.notes.len(), source.files.len()), (LengthUnit::Mm, 0, 3));
    let values = values::<i16>(&slices);
    assert_eq!([values[0], values[6], values[12]], [30, 20, 10]);
}

#[test]
fn slices_without_places_are_ordered_by_number_and_say_so() {
    let slices = [3, 1, 2].map(|number| Slice { z: None, ..Slice::new(number, 0.0) });
    let source = open_folder(&slices).unwrap();
    assert!(source.notes.iter().any(|note| note.contains("InstanceNumber")), "{:?}", source.notes);
    assert_eq!(source.affine, None);
    let values = values::<i16>(&slices);
    assert_eq!([values[0], values[6], values[12]], [10, 20, 30]);
    let mixed = [Slice::new(1, 0.0), Slice { z: None, ..Slice::new(2, 1.0) }];
    assert!(matches!(refusal(&mixed), DicomError::Differs { .. } | DicomError::Unplaced { .. }));
}

#[test]
fn gaps_and_doubles_are_refused_by_name_unless_they_are_allowed() {
    let slices: Vec<_> = [0.0, 1.0, 2.0, 4.0].map(|z| Slice::new(z as i32, z)).into();
    assert!(matches!(refusal(&slices), DicomError::Gap { .. }));
    let double: Vec<_> = [0.0, 1.0, 1.0, 2.0].map(|z| Slice::new(z as i32, z)).into();
    assert!(matches!(refusal(&double), DicomError::SamePlace { .. }));
    let numbers: Vec<_> =
        [1, 2, 4].map(|number| Slice { z: None, ..Slice::new(number, 0.0) }).into();
    assert!(matches!(refusal(&numbers), DicomError::Gap { .. }));
    let options = SourceOptions { allow_gaps: true, ..SourceOptions::default() };
    for slices in [slices, double, numbers] {
        let source = Source::open(folder(&slices).path(), &options).unwrap();
        assert_eq!(source.dims_xyz[2], slices.len() as u64);
        assert!(!source.notes.is_empty());
    }
}

#[test]
fn values_are_integers_where_they_can_be() {
    let with = |rescale, stored, signed| [Slice { rescale, stored, signed, ..Slice::new(1, 0.0) }];
    for (slices, expected) in [
        (with(["1", "0"], 16, true), SampleType::I16),
        (with(["1", "0"], 16, false), SampleType::U16),
        (with(["1.0", "-1024"], 12, false), SampleType::I16),
        (with(["1", "-1024"], 16, true), SampleType::I32),
        (with(["1", "100"], 12, false), SampleType::U16),
        (with(["1", "0.5"], 12, false), SampleType::F32),
        (with(["2", "0"], 12, false), SampleType::F32),
    ] {
        assert_eq!(open_folder(&slices).unwrap().sample_type(), expected);
    }
    let slices = with(["1", "-1024"], 12, false);
    assert_eq!(values::<i16>(&slices), [10, 11, 12, 13, 14, 15].map(|v| v - 1024));
    let slices = with(["0.5", "-3"], 16, true);
    assert_eq!(open_folder(&slices).unwrap().description.sample_type, Some(SampleType::I16));
    assert_eq!(values::<f32>(&slices)[..2], [2.0, 2.5]);
    // A slope of each slice's own.
    let mut own = [Slice::new(1, 0.0), Slice::new(2, 1.0)];
    own[1].rescale = ["0.25", "1"];
    let values = values::<f32>(&own);
    assert_eq!((values[0], values[6], values[7]), (10.0, 6.0, 6.25));
}

#[test]
fn what_is_no_grey_volume_is_refused() {
    let mut slices = [Slice::new(1, 0.0), Slice::new(2, 1.0)];
    slices[1].series = "1.2.4";
    assert!(matches!(refusal(&slices), DicomError::SeveralSeries { count: 2, .. }));
    let colour = Slice { photometric: "PALETTE COLOR", ..Slice::new(1, 0.0) };
    assert!(matches!(refusal(&[colour]), DicomError::Colour { .. }));
    let jpeg_2000 = Slice { syntax: "1.2.840.10008.1.2.4.90", ..Slice::new(1, 0.0) };
    assert!(matches!(refusal(&[jpeg_2000]), DicomError::TransferSyntax { .. }));
    let inverse = open_folder(&[Slice { photometric: "MONOCHROME1", ..Slice::new(1, 0.0) }]);
    assert!(inverse.unwrap().notes[0].contains("MONOCHROME1"));
}

#[test]
fn a_slice_that_cannot_be_read_is_refused_by_name_and_not_dropped() {
    let slices: Vec<_> = (0..9).map(|z| Slice::new(z, f64::from(z))).collect();
    let folder = folder(&slices);
    let last = folder.path().join("s001.dcm");
    let whole = std::fs::read(&last).unwrap();
    assert_eq!(open(folder.path()).unwrap().dims_xyz[2], 9);
    let zeros_after = |keep: usize| {
        let mut bytes = whole.clone();
        bytes[keep..].fill(0);
        bytes
    };
    let meta = Maker::default().text(0x0002_0010, *b"UI", "1.2.840.10008.1.2.1").0.len();
    for (what, bytes) in [
        ("empty", Vec::new()),
        ("zeros", zeros_after(0)),
        ("zeros after the magic", zeros_after(132)),
        ("zeros after the first group", zeros_after(132 + meta)),
        ("another file", b"a text that someone gave this name".to_vec()),
        ("the magic alone", whole[..132].to_vec()),
        ("the first group alone", whole[..132 + meta].to_vec()),
    ] {
        std::fs::write(&last, bytes).unwrap();
        let error = open(folder.path()).unwrap_err().to_string();
        assert!(error.contains("s001.dcm"), "{what}: {error}");
    }
    std::fs::remove_file(&last).unwrap();
    std::os::unix::fs::symlink("nowhere", &last).unwrap();
    for path in [folder.path().to_owned(), folder.path().join("s*.dcm")] {
        let error = open(&path).unwrap_err();
        assert!(matches!(&error, SourceError::Io { path, .. } if *path == last), "{error}");
    }
    // Under a name that says nothing, too: the link may be to a slice.
    std::fs::rename(&last, folder.path().join("IM0001")).unwrap();
    assert!(open(folder.path()).unwrap_err().to_string().contains("IM0001"));
}

#[test]
fn files_that_are_no_slices_are_left_out_and_said_to_be() {
    let folder = folder(&[Slice::new(1, 0.0), Slice::new(2, 1.0)]);
    assert_eq!(open(folder.path()).unwrap().notes, [""; 0]);
    // A report: DICOM without pixels.
    let mut report = vec![0; 128];
    report.extend_from_slice(b"DICM");
    let meta = Maker::default().text(0x0002_0002, *b"UI", "1.2.840.10008.5.1.4.1.1.88.11").text(
        0x0002_0010,
        *b"UI",
        "1.2.840.10008.1.2.1",
    );
    report.extend(meta.text(0x0020_000E, *b"UI", "1.2.3").0);
    std::fs::write(folder.path().join("report.dcm"), report).unwrap();
    std::fs::write(folder.path().join("readme.txt"), "a text").unwrap();
    std::fs::write(folder.path().join("DICOMDIR"), "a list").unwrap();
    let source = open(folder.path()).unwrap();
    assert_eq!(source.dims_xyz[2], 2);
    assert!(source.notes[0].contains("other files are left out: 2, such as"), "{:?}", source.notes);
    assert!(source.notes[0].contains("readme.txt"), "{:?}", source.notes);
}

#[test]
fn slices_among_pictures_are_refused_as_mixed() {
    for name in ["slice.dcm", "IM0001"] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(name), Slice::new(1, 0.0).bytes()).unwrap();
        std::fs::write(folder.path().join("preview.png"), b"\x89PNG\r\n\x1a\n").unwrap();
        let error = open(folder.path()).unwrap_err().to_string();
        for word in ["several kinds", name, "preview.png", "quoted pattern"] {
            assert!(error.contains(word), "no '{word}' in: {error}");
        }
    }
    // A list of slices is none.
    let folder = folder(&[Slice::new(1, 0.0)]);
    std::fs::rename(folder.path().join("s001.dcm"), folder.path().join("DICOMDIR")).unwrap();
    std::fs::write(folder.path().join("a.png"), "").unwrap();
    assert!(matches!(open(folder.path()), Err(SourceError::Png { .. })));
}

#[test]
fn a_slice_of_another_orientation_is_told_in_words() {
    let folder = folder(&[Slice::new(1, 0.0)]);
    let mut scout = Slice::new(2, 1.0).bytes();
    let axial = b"1\\0\\0\\0\\1\\0";
    let place = scout.windows(axial.len()).position(|bytes| bytes == axial).unwrap();
    scout[place..place + axial.len()].copy_from_slice(b"0\\1\\0\\0\\0\\1");
    std::fs::write(folder.path().join("scout.dcm"), scout).unwrap();
    let error = open(folder.path()).unwrap_err().to_string();
    for word in [
        "scout.dcm: its orientation is sagittal (rows along 0, 1, 0; columns along 0, 0, 1)",
        "s001.dcm is axial (rows along 1, 0, 0; columns along 0, 1, 0)",
        "take away",
    ] {
        assert!(error.contains(word), "no '{word}' in: {error}");
    }
}

#[test]
fn codings_that_are_not_read_are_named_with_the_file_and_what_to_do() {
    for (syntax, words) in [
        ("1.2.840.10008.1.2.4.90", ["JPEG 2000", "gdcmconv --raw"]),
        ("1.2.840.10008.1.2.4.91", ["JPEG 2000", "gdcmconv --raw"]),
        ("1.2.840.10008.1.2.4.80", ["JPEG-LS", "dcmdjpls"]),
        ("1.2.840.10008.1.2.4.81", ["JPEG-LS", "dcmdjpls"]),
        ("1.2.840.10008.1.2.1.99", ["deflated", "dcmconv +te"]),
    ] {
        let error = open_folder(&[Slice { syntax, ..Slice::new(1, 0.0) }]).unwrap_err().to_string();
        for word in [&["s001.dcm: ", syntax, "decompress it first"][..], &words].concat() {
            assert!(error.contains(word), "no '{word}' in: {error}");
        }
    }
}

#[test]
fn a_file_that_is_cut_anywhere_is_refused_by_name() {
    let whole = Slice::new(1, 0.0).bytes();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.dcm");
    std::fs::write(&path, &whole).unwrap();
    Source::open(&path, &SourceOptions::default()).unwrap();
    for keep in 0..whole.len() {
        std::fs::write(&path, &whole[..keep]).unwrap();
        let error = Source::open(&path, &SourceOptions::default()).unwrap_err();
        assert!(error.to_string().contains("cut.dcm"), "{keep}: {error}");
    }
}

proptest! {
    #[test]
    fn no_bytes_bring_the_program_down(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
    ) {
        let mut bytes = Slice::new(1, 0.0).bytes();
        for (place, value) in changes {
            // The preamble is of no interest.
            let place = 132 + place.index(bytes.len() - 132);
            bytes[place] = value;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dcm");
        std::fs::write(&path, &bytes).unwrap();
        match Source::open(&path, &SourceOptions::default()) {
            Ok(source) => {
                let voxels = source.dims_xyz.iter().product::<u64>();
                prop_assert!(voxels <= bytes.len() as u64);
            }
            Err(error) => prop_assert!(error.to_string().contains("a.dcm"), "{error}"),
        }
    }
}
