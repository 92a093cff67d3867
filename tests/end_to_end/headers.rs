//! NRRD, MetaImage and DICOM: what independent readers (pynrrd, SimpleITK, pydicom) make of a file is what
//! comes back from the store made of it.

use crate::readers::python;
use crate::support::{Bench, sample};

#[test]
fn volumes_of_every_form_are_what_their_own_readers_say() {
    let bench = Bench::new();
    let folder = bench.folder().to_str().unwrap().to_owned();
    python("make_headers.py", &[&folder]);
    let list = std::fs::read_to_string(bench.path("list.txt")).unwrap();
    assert!(list.lines().count() > 100);
    for line in list.lines() {
        let (name, rest) = line.split_once('|').unwrap();
        let (flags, _) = rest.split_once('|').unwrap();
        let flags = if flags.is_empty() { String::new() } else { format!(" {flags}") };
        bench.ok(&format!("convert {name} -o o.octavo --force --encoding lossless{flags}"));
        bench.ok(&format!("verify o.octavo --against {name}"));
        bench.ok(&format!("extract o.octavo -o {name}.back.nii --force"));
    }
    python("same_as_header.py", &[&folder]);

    std::fs::remove_file(bench.path("o.octavo")).unwrap();
    for (input, words) in [
        ("dicom-study", &["2 series", "1.2.3.4.1 (6 slices, scout)", "--series"][..]),
        ("dicom-both --series 1.2", &["1.2 in it", "1.2.3.4.2 (6 slices)"]),
        ("refused-jpeg-ls.dcm", &["JPEG-LS", "1.2.840.10008.1.2.4.80", "dcmdjpls"]),
        ("refused-jpeg-2000.dcm", &["JPEG 2000", "1.2.840.10008.1.2.4.90", "gdcmconv --raw"]),
        ("ras.nrrd --series 1.2", &["ras.nrrd", "--series"]),
    ] {
        let name = input.split(' ').next().unwrap();
        let said = bench.run(&format!("convert {input} -o o.octavo"));
        assert_eq!(said.code, 2, "{input}: {}", said.err);
        for word in [name].iter().chain(words) {
            assert!(said.err.contains(word), "{input}: no '{word}' in: {}", said.err);
        }
        assert!(!bench.path("o.octavo").exists());
    }
    // What was chosen is remembered.
    bench.ok("convert dicom-study --series 1.2.3.4.2 -o o.octavo");
    assert_eq!(bench.ok("info o.octavo --json").json()["options"]["series"], "1.2.3.4.2");
    bench.ok("verify o.octavo --against dicom-study");
}

#[test]
fn bundled_volumes_are_what_their_own_readers_say() {
    let bench = Bench::new();
    for (file, options) in [
        ("headers/BallBinary30x30x30_gz_lineskip.nrrd", "reader=pynrrd"),
        ("headers/BallBinary30x30x30_bz2.nrrd", "reader=pynrrd"),
        ("headers/test2d_ascii.nrrd", "affine=no"),
        ("headers/fuel.mha", ""),
        ("headers/marschnerlobb.mha", ""),
    ] {
        let source = sample(file);
        bench.ok(&format!("convert {source} -o o.octavo --force --encoding lossless"));
        bench.ok("extract o.octavo -o back.nii --force");
        let back = bench.path("back.nii");
        let mut arguments = vec![source.as_str(), back.to_str().unwrap()];
        arguments.extend(options.split_whitespace());
        python("same_as_header.py", &arguments);
    }
}

/// Runs a conversion that must be refused as the input's fault, with these words.
fn refused(bench: &Bench, arguments: &str, words: &[&str]) {
    let said = bench.run(arguments);
    assert_eq!(said.code, 2, "octavo {arguments}: {}{}", said.out, said.err);
    for word in words {
        assert!(said.err.contains(word), "octavo {arguments}: no '{word}' in: {}", said.err);
    }
    assert!(!said.err.contains("panicked"), "{}", said.err);
    assert!(bench.names().iter().all(|name| !name.contains("octavo")), "{:?}", bench.names());
}

#[test]
fn headers_that_cannot_be_read_say_what_is_wrong() {
    let bench = Bench::new();
    let small = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n";
    bench.write("good.nrrd", format!("{small}\n12345678").as_bytes());
    bench.ok("convert good.nrrd -o g.octavo");
    std::fs::remove_file(bench.path("g.octavo")).unwrap();
    bench.write(
        "colour.nrrd",
        format!("{small}kinds: RGB-color domain domain\n\n12345678").as_bytes(),
    );
    refused(&bench, "convert colour.nrrd", &["colour.nrrd", "--channel"]);
    refused(&bench, "convert good.nrrd --dims 2,2,2", &["good.nrrd", "NRRD"]);
    refused(&bench, "convert good.nrrd --time 1", &["good.nrrd", "1"]);
    bench.write("long.nrrd", format!("{small}\n123456789").as_bytes());
    refused(&bench, "convert long.nrrd", &["long.nrrd", "cut"]);
    bench.write("away.nhdr", format!("{small}data file: away.raw\n").as_bytes());
    refused(&bench, "convert away.nhdr", &["away.nhdr", "away.raw"]);
    bench.write("hex.nrrd", small.replace("raw", "hex\n").as_bytes());
    refused(&bench, "convert hex.nrrd", &["hex.nrrd", "encoding"]);
    let small = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n";
    bench.write("away.mhd", format!("{small}ElementDataFile = a%d.raw 1 2 1\n").as_bytes());
    refused(&bench, "convert away.mhd", &["away.mhd", "a1.raw"]);
    bench
        .write("wide.mha", small.replace("UCHAR", "LONG_LONG\nElementDataFile = LOCAL").as_bytes());
    refused(&bench, "convert wide.mha", &["wide.mha", "64-bit"]);
    bench.write("a.dcm", b"this is no DICOM file");
    refused(&bench, "convert a.dcm", &["a.dcm", "DICOM"]);
    // Kinds are known by their first bytes, too.
    std::fs::copy(bench.path("good.nrrd"), bench.path("good.xyz")).unwrap();
    bench.ok("convert good.xyz -o g.out");
}

#[test]
fn bundled_volumes_cut_short_or_damaged_are_refused_by_name() {
    let bench = Bench::new();
    for (file, name) in [
        ("headers/BallBinary30x30x30_gz_lineskip.nrrd", "t.nrrd"),
        ("headers/BallBinary30x30x30_bz2.nrrd", "t.nrrd"),
        ("headers/fuel.mha", "t.mha"),
    ] {
        let whole = std::fs::read(sample(file)).unwrap();
        for keep in [0, 1, 9, 100, 300, whole.len() / 2, whole.len() - 5, whole.len() - 1] {
            bench.write(name, &whole[..keep]);
            refused(&bench, &format!("convert {name}"), &[name]);
        }
        let mut damaged = whole.clone();
        let place = whole.len() - 40;
        damaged[place..place + 20].fill(0x55);
        bench.write(name, &damaged);
        refused(&bench, &format!("convert {name}"), &[name]);
    }
}
