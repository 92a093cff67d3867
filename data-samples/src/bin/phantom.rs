//! `phantom`: writes a synthetic volume of any size to a raw file.
//!
//! Exit codes: 0 done, 2 wrong usage, 3 the file could not be written.

use std::{path::PathBuf, process::ExitCode, time::Instant};

use clap::{Args, Parser, Subcommand, ValueEnum};
use data_samples::{
    ByteOrder, DEFAULT_NOISE_SIGMA, Kind, Phantom, PhantomError, SampleType, WriteError,
    write_raw_file,
};

/// Write a synthetic volume to a raw file: x fastest, no header, the same bytes on any machine.
///
/// Memory does not depend on the volume's size.
#[derive(Debug, Parser)]
#[command(
    version,
    after_help = "\
Example: phantom micro-ct --dims 512,512,256 -o foam.raw
RAYON_NUM_THREADS sets the number of threads. Exit codes: 0 done, 2 wrong usage, 3 cannot write."
)]
struct Arguments {
    #[command(subcommand)]
    kind: KindArguments,
}

#[derive(Debug, Subcommand)]
enum KindArguments {
    /// Like a micro-CT scan: nested ellipsoids, foam with pores of about 40 voxels, noise
    MicroCt {
        #[command(flatten)]
        output: OutputArguments,
        /// Chooses the foam and the noise
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Standard deviation of the noise, 0 for none
        #[arg(long, value_name = "SIGMA", default_value_t = DEFAULT_NOISE_SIGMA)]
        noise: f64,
    },
    /// A x + B y + C z in voxels, rounded and clamped to the type
    Ramp {
        #[command(flatten)]
        output: OutputArguments,
        /// A, B and C
        #[arg(long, value_name = "A,B,C", default_value = "1,1,1", value_parser = triple::<f64>)]
        #[arg(allow_hyphen_values = true)]
        slope: [f64; 3],
    },
    /// A sphere in the middle, with a hard edge
    Sphere {
        #[command(flatten)]
        output: OutputArguments,
        /// In voxels; 0.4 of the shortest side if not given
        #[arg(long, value_name = "VOXELS")]
        radius: Option<f64>,
        /// The value inside
        #[arg(long, default_value_t = 200.0, allow_hyphen_values = true)]
        inside: f64,
        /// The value outside
        #[arg(long, default_value_t = 20.0, allow_hyphen_values = true)]
        outside: f64,
    },
    /// One bright voxel in a dark volume
    HotVoxel {
        #[command(flatten)]
        output: OutputArguments,
        /// Where; the middle if not given
        #[arg(long, value_name = "X,Y,Z", value_parser = triple::<usize>)]
        at: Option<[usize; 3]>,
        /// Its value
        #[arg(long, default_value_t = 200.0, allow_hyphen_values = true)]
        hot: f64,
        /// The value of all others
        #[arg(long, default_value_t = 20.0, allow_hyphen_values = true)]
        background: f64,
    },
    /// One value everywhere
    Constant {
        #[command(flatten)]
        output: OutputArguments,
        /// The value
        #[arg(long, default_value_t = 100.0, allow_hyphen_values = true)]
        value: f64,
    },
}

#[derive(Debug, Args)]
struct OutputArguments {
    /// Voxels along x, y and z
    #[arg(long, value_name = "X,Y,Z", value_parser = triple::<usize>)]
    dims: [usize; 3],
    /// Sample type (micro-ct: u8 is the high byte of u16, f32 the same number)
    #[arg(long, value_enum, default_value_t = TypeArgument::U16)]
    dtype: TypeArgument,
    /// Most significant byte first
    #[arg(long)]
    big_endian: bool,
    /// The file to write, replaced if it exists; `KIND_XxYxZ_DTYPE.raw` if not given
    #[arg(short, long, value_name = "OUT.raw")]
    output: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum TypeArgument {
    U8,
    U16,
    F32,
}

/// What the arguments ask for, checked: nothing has been written yet.
struct Job {
    phantom: Phantom,
    sample_type: SampleType,
    order: ByteOrder,
    path: PathBuf,
}

fn main() -> ExitCode {
    match plan(Arguments::parse().kind).map_err(WriteError::from).and_then(|job| run(&job)) {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("phantom: {error}");
            ExitCode::from(if matches!(error, WriteError::Phantom(_)) { 2 } else { 3 })
        }
    }
}

fn plan(arguments: KindArguments) -> Result<Job, PhantomError> {
    let (kind, output) = match arguments {
        KindArguments::MicroCt { output, seed, noise } => {
            (Kind::MicroCt { seed, noise_sigma: noise }, output)
        }
        KindArguments::Ramp { output, slope } => (Kind::Ramp { slope_xyz: slope }, output),
        KindArguments::Sphere { output, radius, inside, outside } => {
            let shortest = output.dims.into_iter().min().unwrap_or_default();
            let radius_voxels = radius.unwrap_or(0.4 * shortest as f64);
            (Kind::Sphere { radius_voxels, inside, outside }, output)
        }
        KindArguments::HotVoxel { output, at, hot, background } => {
            (Kind::HotVoxel { at_xyz: at, hot, background }, output)
        }
        KindArguments::Constant { output, value } => (Kind::Constant { value }, output),
    };
    let phantom = Phantom::new(kind, output.dims)?;
    let sample_type = match output.dtype {
        TypeArgument::U8 => SampleType::U8,
        TypeArgument::U16 => SampleType::U16,
        TypeArgument::F32 => SampleType::F32,
    };
    phantom.check_fits(sample_type)?;
    let order = if output.big_endian { ByteOrder::Big } else { ByteOrder::Little };
    let path = output.output.unwrap_or_else(|| phantom.file_name(sample_type).into());
    Ok(Job { phantom, sample_type, order, path })
}

fn run(job: &Job) -> Result<String, WriteError> {
    let start = Instant::now();
    let bytes = write_raw_file(&job.phantom, job.sample_type, job.order, &job.path)?;
    let elapsed_secs = start.elapsed().as_secs_f64();
    let [nx, ny, nz] = job.phantom.dims_xyz();
    let order = if job.order == ByteOrder::Big { "big-endian" } else { "little-endian" };
    Ok(format!(
        "{}: {nx} x {ny} x {nz} {} {order}, {bytes} bytes, {elapsed_secs:.2} s, {:.1} million voxels/s",
        job.path.display(),
        job.sample_type,
        job.phantom.voxel_count() as f64 / elapsed_secs / 1e6,
    ))
}

/// Three numbers with commas between.
fn triple<T: std::str::FromStr<Err: std::fmt::Display>>(text: &str) -> Result<[T; 3], String> {
    let numbers: Vec<T> = text
        .split(',')
        .map(|part| part.trim().parse().map_err(|error| format!("'{part}': {error}")))
        .collect::<Result<_, _>>()?;
    numbers.try_into().map_err(|_| "three numbers are needed, as in 512,512,256".to_owned())
}
