//! How fast volumes are enlarged, without a disk: `enlarge RAW [--factor F] [--detail A] …`
//!
//! All slices of the enlarged volume are computed, handed out one after the other, and forgotten. Beside
//! it the arithmetic roofline: multiplications and additions of f32 that this machine does a second
//! out of registers, on as many threads, over those that a separable kernel needs for a new voxel:
//! 4 (1 + 1/f + 1/f^2) multiplications and 3/4 as many additions (f = 4: 5.25 and 3.9). They are
//! not fused: a fused sum would depend on the machine.

use anyhow::{Result, ensure};
use clap::Parser;
use multiversion::multiversion;
use octree_store::SampleType;
use preprocess::{CubicKernel, Detail, Source, SourceOptions, Upscale};
use serde::Serialize;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

/// Measure how fast a volume is enlarged
#[derive(Debug, Parser)]
struct Arguments {
    /// A volume of u16
    input: PathBuf,
    /// How many times
    #[arg(long, default_value_t = 4)]
    factor: u32,
    /// catmull-rom, b-spline or mitchell
    #[arg(long, default_value = "catmull-rom")]
    kernel: CubicKernel,
    /// Detail, over the local contrast
    #[arg(long)]
    detail: Option<f64>,
    /// Threads
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Memory in bytes
    #[arg(long, default_value_t = 512 << 20)]
    memory: u64,
}

#[derive(Serialize)]
struct Report {
    inside_seconds: f64,
    voxels: u64,
    million_voxels_per_sec: f64,
    roofline_million_voxels_per_sec: f64,
    clamped_voxels: u64,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let detail = arguments.detail.map(|amplitude| Detail { amplitude, seed: 1 });
    let upscale = Upscale::new(arguments.factor, arguments.kernel, detail)?;
    let mut source = Source::open(&arguments.input, &SourceOptions::default())?.upscale(upscale)?;
    ensure!(source.sample_type() == SampleType::U16, "this measures u16");
    source.limit_slices(arguments.threads, arguments.memory)?;
    let [width, height, depth] = source.dims_xyz;
    let mut slice = vec![0_u16; (width * height) as usize];
    let started = Instant::now();
    let mut slices = source.slices()?;
    for _ in 0..depth {
        slices.next(&mut slice)?;
        black_box(&slice);
    }
    let seconds = started.elapsed().as_secs_f64();
    let voxels = width * height * depth;
    let f = f64::from(arguments.factor);
    let needed = 1.75 * 4.0 * (1.0 + 1.0 / f + 1.0 / (f * f));
    let report = Report {
        inside_seconds: seconds,
        voxels,
        million_voxels_per_sec: voxels as f64 / seconds / 1e6,
        roofline_million_voxels_per_sec: operations_per_sec(arguments.threads)? / needed / 1e6,
        clamped_voxels: source.clamped_voxels().unwrap_or(0),
    };
    println!("{}", serde_json::to_string(&report)?);
    Ok(())
}

/// Multiplications and additions of f32 that so many threads do a second.
fn operations_per_sec(threads: usize) -> Result<f64> {
    let rates: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads)
            .map(|number| {
                std::thread::Builder::new().name(format!("roofline-{number}")).spawn_scoped(
                    scope,
                    || {
                        let mut lanes = [[1.0_f32; 16]; 12];
                        let started = Instant::now();
                        multiply_and_add(black_box(&mut lanes), 1_000_000);
                        black_box(lanes);
                        1_000_000.0 * 2.0 * 16.0 * 12.0 / started.elapsed().as_secs_f64()
                    },
                )
            })
            .collect::<Result<_, _>>()?;
        Ok::<_, std::io::Error>(threads.into_iter().filter_map(|t| t.join().ok()).collect())
    })?;
    Ok(rates.iter().sum())
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
fn multiply_and_add(lanes: &mut [[f32; 16]; 12], rounds: u32) {
    let mut sums = *lanes;
    for _ in 0..rounds {
        for lane in sums.as_flattened_mut() {
            *lane = *lane * 0.999 + 0.001;
        }
    }
    *lanes = sums;
}
