//! A reader that knows nothing but FORMAT.md reads stores, those of version 1 that are kept and new ones, as the program does.

use crate::readers::python;
use crate::support::Bench;
use std::path::Path;

#[test]
fn kept_stores_read_as_the_table_says() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../octree-store/tests/version-1");
    let mut stores: Vec<_> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "octavo"))
        .collect();
    stores.sort();
    assert_eq!(stores.len(), 6);
    let table = folder.join("bricks.tsv");
    let paths = std::iter::once(&table).chain(&stores).map(|path| path.to_str().unwrap());
    python("bricks.py", &std::iter::once("same").chain(paths).collect::<Vec<_>>());
}

#[test]
fn new_stores_read_as_the_program_does() {
    let bench = Bench::new();
    let bytes: Vec<u8> = (0..30 * 21 * 17_u32)
        .flat_map(|i| ((i * i % 1009) as u16 + (i / 4000 * 800) as u16).to_le_bytes())
        .collect();
    bench.write("a_30x21x17_u16.raw", &bytes);
    let options = [
        "--effort fast",
        "--encoding lossless --effort small --overlap 0",
        "--encoding max-error=9 --overlap-at-rest assembled --overlap 3",
        "--encoding max-error=300 --effort small --empty-below 1000",
    ];
    let mut stores = Vec::new();
    for (number, options) in options.into_iter().enumerate() {
        let name = format!("{number}.octavo");
        bench.ok(&format!("convert a_30x21x17_u16.raw -o {name} --brick 8 {options}"));
        stores.push(bench.path(&name).to_str().unwrap().to_owned());
    }
    let program = env!("CARGO_BIN_EXE_octavo");
    let arguments = ["program", program].into_iter().chain(stores.iter().map(String::as_str));
    python("bricks.py", &arguments.collect::<Vec<_>>());
}
