//! `report.json`: schema `octavo.tradeoff/1`, which docs/TRADEOFF.md documents.

use super::view::ViewReading;
use octree_store::{Region, SampleType, SourceDescription};
use preprocess::ConvertOptions;
use preprocess::tradeoff::{RungReading, SampleValues, Sampled, Wish, choose};
use serde::Serialize;
use std::time::SystemTime;

/// All that was measured, and where.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    schema: &'static str,
    pub(super) created_by: &'static str,
    pub(super) created_utc: String,
    pub(super) machine: Machine,
    /// Threads of conversions, and of decoding on all threads.
    pub(super) threads: usize,
    memory_bytes: u64,
    pub(super) source: SourceJson,
    pub(super) sample: SampleJson,
    pub(super) values: SampleValues,
    pub(super) brick_core: u32,
    pub(super) brick_overlap: u32,
    pub(super) empty_below: Option<Threshold>,
    pub(super) rungs: Vec<RungReading>,
    pub(super) wishes: Vec<WishJson>,
    /// Null where nobody drew.
    pub(super) view: Option<ViewReading>,
}

#[derive(Debug, Serialize)]
pub(super) struct Machine {
    pub(super) cpu: String,
    pub(super) cores: usize,
    /// What the kernels ran on.
    pub(super) instruction_set: &'static str,
}

#[derive(Debug, Serialize)]
pub(super) struct SourceJson {
    pub(super) path: String,
    bytes: u64,
    pub(super) sample_type: SampleType,
    pub(super) dims_xyz: [u64; 3],
}

#[derive(Debug, Serialize)]
pub(super) struct SampleJson {
    /// Within the region that was asked for, or the whole.
    min_xyz: [u64; 3],
    max_xyz: [u64; 3],
    pub(super) dims_xyz: [u64; 3],
    voxels: u64,
    pub(super) fraction: f64,
}

/// The threshold of the rungs that drop bricks.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Threshold {
    pub(super) value: f64,
    /// `given` or `otsu`.
    pub(super) how: &'static str,
}

/// A limit of a wish.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Limit {
    pub(super) value: f64,
    /// `given` or `default`.
    pub(super) how: &'static str,
}

impl Limit {
    pub(super) fn given(value: f64) -> Self {
        Self { value, how: "given" }
    }

    fn default(value: f64) -> Self {
        Self { value, how: "default" }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct WishJson {
    #[serde(flatten)]
    pub(super) wish: Wish,
    /// Where the limit comes from.
    pub(super) limit: &'static str,
    /// The name of the rung that fulfils it best; null where none does.
    pub(super) rung: Option<String>,
    /// The command that converts the whole input this way.
    pub(super) command: Option<String>,
}

/// What a report is made of.
#[derive(Debug)]
pub(super) struct Measured<'a> {
    pub(super) description: &'a SourceDescription,
    pub(super) file_dims_xyz: [u64; 3],
    pub(super) sampled: &'a Sampled,
    pub(super) threshold: Option<Threshold>,
    pub(super) how: &'a ConvertOptions,
    pub(super) rungs: Vec<RungReading>,
    pub(super) view: Option<ViewReading>,
    pub(super) wish_error: Option<Limit>,
    pub(super) wish_bits: Option<Limit>,
    /// The beginning of the command that converts the input.
    pub(super) convert: String,
}

impl Report {
    pub(super) fn new(measured: Measured<'_>) -> Self {
        let Measured { description, sampled, threshold, how, rungs, convert, .. } = measured;
        let sample_type = sampled.sample_type();
        let error =
            measured.wish_error.unwrap_or_else(|| Limit::default(sampled.values.range() / 256.0));
        let bits =
            measured.wish_bits.unwrap_or_else(|| Limit::default(4.0 * sample_type.bytes() as f64));
        let wishes = [
            (Wish::SmallestUnderError { amax: error.value }, error),
            (Wish::MostAccurateUnderSize { bits_per_voxel: bits.value }, bits),
            (Wish::FastestToReadUnderError { amax: error.value }, error),
        ]
        .map(|(wish, limit)| {
            let best = choose(wish, &rungs).map(|place| &rungs[place]);
            WishJson {
                wish,
                limit: limit.how,
                rung: best.map(|rung| rung.name.clone()),
                command: best.map(|rung| format!("{convert} {}", rung.arguments.join(" "))),
            }
        });
        let Region { min, max } = sampled.region;
        Self {
            schema: "octavo.tradeoff/1",
            created_by: concat!("octavo ", env!("CARGO_PKG_VERSION")),
            created_utc: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            machine: Machine::this(),
            threads: how.threads,
            memory_bytes: how.memory_bytes,
            source: SourceJson {
                path: description.path.clone(),
                bytes: description.bytes,
                sample_type,
                dims_xyz: measured.file_dims_xyz,
            },
            sample: SampleJson {
                min_xyz: min,
                max_xyz: max,
                dims_xyz: sampled.region.dims_xyz(),
                voxels: sampled.region.voxels(),
                fraction: sampled.fraction,
            },
            values: sampled.values.clone(),
            brick_core: how.brick_core,
            brick_overlap: how.brick_overlap,
            empty_below: threshold,
            rungs,
            wishes: wishes.into(),
            view: measured.view,
        }
    }

    /// The rung of a name.
    pub(super) fn rung(&self, name: &str) -> Option<&RungReading> {
        self.rungs.iter().find(|rung| rung.name == name)
    }
}

impl Machine {
    fn this() -> Self {
        let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let named = info.lines().find_map(|line| {
            let (key, name) = line.split_once(':')?;
            (key.trim() == "model name").then(|| name.trim().to_owned())
        });
        Self {
            cpu: named.unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            instruction_set: octree_store::instruction_set(),
        }
    }
}

impl WishJson {
    /// The wish in words, its limit included.
    pub(super) fn words(&self) -> String {
        match self.wish {
            Wish::SmallestUnderError { amax } => {
                format!("smallest with no error above {}", short(amax))
            }
            Wish::MostAccurateUnderSize { bits_per_voxel } => {
                format!("most accurate within {} bits a voxel", short(bits_per_voxel))
            }
            Wish::FastestToReadUnderError { amax } => {
                format!("fastest to read with no error above {}", short(amax))
            }
        }
    }
}

/// A number in four digits, without zeros that say nothing.
pub(super) fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = value.abs().log10().floor() as i32;
    if !(-4..=6).contains(&magnitude) {
        return format!("{value:.2e}");
    }
    let text = format!("{value:.*}", (3 - magnitude).max(0) as usize);
    match text.split_once('.') {
        Some(_) => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits_at_most() {
        for (value, text) in [
            (0.0, "0"),
            (5.078_125, "5.078"),
            (1300.0, "1300"),
            (12_345.6, "12346"),
            (0.012_345, "0.01235"),
            (-2.5, "-2.5"),
            (1e-30, "1.00e-30"),
            (3.4e38, "3.40e38"),
        ] {
            assert_eq!(short(value), text);
        }
    }
}
