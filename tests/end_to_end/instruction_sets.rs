//! The same program on processors that lack AVX-512, and AVX2 too: QEMU runs it instruction by instruction
//! and says which ones there are. So every kernel is compared with its other versions as they were built.

use crate::support::{Bench, Said, octavo};
use octree_store::{Sample, SampleType, with_sample_type};
use serde_json::Value;
use std::process::Command;

/// Processors by QEMU's names, and which kernels run there.
const PROCESSORS: [(&str, &str); 2] = [("Haswell", "AVX2"), ("Nehalem", "baseline")];

/// Runs the program in the bench's folder as a processor would, the one at hand or an emulated one, and
/// says what it printed. It must succeed.
fn run_on(cpu: Option<&str>, bench: &Bench, arguments: &str) -> Said {
    let mut command = match cpu {
        None => octavo(),
        Some(cpu) => {
            let program = std::env::var("OCTAVO_TEST_EMULATOR");
            let mut command = Command::new(program.unwrap_or_else(|_| "qemu-x86_64".into()));
            command.args(["-cpu", cpu, env!("CARGO_BIN_EXE_octavo")]);
            command
        }
    };
    command.args(arguments.split(' ')).current_dir(bench.folder());
    let output = command.output();
    let output = output
        .unwrap_or_else(|error| panic!("{command:?} (bash tests/run.sh installs it): {error}"));
    let said = Said::of(&output);
    assert_eq!(said.code, 0, "{command:?}: {}{}", said.out, said.err);
    said
}

/// A volume of every sample type: steps, a plain ramp, noise, and any bits at all in one corner. Its sides
/// are odd and no multiple of a vector or of a brick.
fn volume<T: Sample>() -> Vec<u8> {
    let mut bytes = Vec::new();
    for i in 0..45 * 37 * 41_u64 {
        let [x, y, z] = [i % 45, i / 45 % 37, i / (45 * 37)];
        let noise = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let wild = x < 16 && y < 16 && z < 16;
        if wild {
            bytes.extend_from_slice(&noise.to_le_bytes()[..size_of::<T>()]);
        } else {
            let steps = if x < 30 { 3 * (x / 7) + 5 * (y / 9) } else { z + y };
            let unit = if T::TYPE.is_integer() { 1.0 } else { 0.37 };
            let v = T::from_f64((steps + (noise >> 61)) as f64 * unit);
            bytes.extend_from_slice(&octree_store::to_le_bytes(&[v]));
        }
    }
    bytes
}

/// Ways to convert that use every kernel: codings, predictions, arrangements, filters between levels.
const WAYS: [&str; 8] = [
    "--encoding u8 --effort fast",
    "--encoding u8 --effort small --overlap-at-rest assembled --downsample max",
    "--encoding lossless --downsample min",
    "--encoding lossless --effort small --downsample mode",
    "--encoding max-error=0 --downsample nearest",
    "--encoding max-error=1.3 --effort small",
    "--encoding max-error=7 --overlap-at-rest assembled",
    "--encoding max-error=900 --empty-below 12",
];

#[test]
fn kernels_of_every_instruction_set_make_and_read_the_same_bytes() {
    let bench = Bench::new();
    let mut inputs = Vec::new();
    for sample_type in SampleType::ALL {
        let name = format!("{sample_type}_45x37x41_{sample_type}.raw");
        with_sample_type!(sample_type, T => bench.write(&name, &volume::<T>()));
        inputs.push(name);
    }
    let inputs = inputs.join(" ");
    for how in WAYS {
        let convert = |cpu: Option<&str>, folder: &str| {
            std::fs::create_dir_all(bench.path(folder)).unwrap();
            let brick = "--brick 16 --threads 1 --json --force";
            let said = run_on(cpu, &bench, &format!("convert {inputs} -o {folder} {brick} {how}"));
            let lines = said.out.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
            let told: Vec<_> = lines
                .map(|line| {
                    let of = |key: &str| line["report"][key].as_str().unwrap().to_owned();
                    (of("instruction_set"), of("digest"))
                })
                .collect();
            assert_eq!(told.len(), SampleType::ALL.len());
            told
        };
        let here = convert(None, "here");
        let read = |cpu, sample_type: &SampleType| {
            let store = format!("here/{sample_type}_45x37x41_{sample_type}.octavo");
            run_on(cpu, &bench, &format!("extract {store} -o read.raw --force"));
            std::fs::read(bench.path("read.raw")).unwrap()
        };
        let read_here = SampleType::ALL.map(|sample_type| read(None, &sample_type));
        for (cpu, instruction_set) in PROCESSORS {
            let there = convert(Some(cpu), "there");
            let here = here.iter().zip(&read_here);
            for ((sample_type, (here, read_here)), there) in
                SampleType::ALL.iter().zip(here).zip(there)
            {
                assert_eq!(there.0, instruction_set, "the kernels that {cpu} runs");
                assert_eq!(there.1, here.1, "{sample_type} {how}: {} against {}", here.0, there.0);
                assert!(*read_here == read(Some(cpu), sample_type), "{sample_type} {how} by {cpu}");
            }
        }
    }
}
