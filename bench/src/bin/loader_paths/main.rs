//! What the adaptive loader costs and saves, over camera paths: `bench/loader.sh` runs all of it.
//!
//! `loader_paths frames` times refinement and index on a simulated volume of 16384^3; `sets` counts working sets against
//! image and volume size; `store STORE` converges, jumps, and reads a real store.

mod paths;
mod render;
mod simulated;

use clap::{Parser, Subcommand};
use octree_store::loader::{
    Appearance, BrickSource, Criterion, Deviation, Feedback, Frame, Loader, LoaderOptions,
    NodeData, Quality, Scene, StoreNodes, View, select_cut,
};
use octree_store::{BrickScratch, Geometry, NodeKey, Store};
use paths::{OPAQUE, Path, THRESHOLD, TRANSPARENT, appearance};
use render::Volume;
use simulated::Simulated;
use std::collections::HashMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

#[derive(Debug, Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Time refinement and index along the paths, on a simulated volume
    Frames {
        /// Voxels a side of the volume
        #[arg(long, default_value_t = 16_384)]
        side: u64,
        /// Leaves that the first cut is to have
        #[arg(long, default_value_t = 5000)]
        leaves: usize,
    },
    /// Count working sets against image and volume size, on simulated volumes
    Sets {
        /// The largest image's side in pixels: the work grows with its square
        #[arg(long, default_value_t = 4096)]
        image: u32,
    },
    /// Converge, jump and read, on a real store of spacing 1
    Store {
        /// The store
        store: PathBuf,
        /// Threads that fetch
        #[arg(long, default_value_t = 2)]
        threads: usize,
    },
}

const SIZE: [u32; 2] = [1024, 576];
/// Between two frames where nothing is drawn: a fast renderer's.
const FRAME: Duration = Duration::from_millis(2);

fn main() -> anyhow::Result<()> {
    match Arguments::parse().command {
        Command::Frames { side, leaves } => frames(side, leaves),
        Command::Sets { image } => sets(image),
        Command::Store { store, threads } => {
            converge(&store, threads)?;
            measured(&store)?;
            throughput(&store, threads)
        }
    }
}

fn scene<'a>(views: &'a [View], appearance: &'a Appearance, accuracy: f64) -> Scene<'a> {
    let quality = Quality { accuracy, ..Quality::default() };
    Scene { views, clip: None, appearance, quality }
}

/// All the room there may be: limits are not what is measured here.
fn roomy(visibility: bool, threads: usize) -> LoaderOptions {
    LoaderOptions {
        slots: 1 << 20,
        memory_bytes: 8 << 30,
        requests: 1 << 16,
        uploads_per_frame: 1 << 16,
        threads,
        prefetch_frames: 0,
        visibility,
        ..LoaderOptions::default()
    }
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// Refinement and index, a frame at a time, as a camera moves.
fn frames(side: u64, leaves: usize) -> anyhow::Result<()> {
    let mut source = Simulated::new(side)?;
    let world = side as f64;
    // The accuracy at which the first cut of the orbit has so many leaves.
    let (mut fine, mut coarse) = (0.1, 64.0);
    let opaque = appearance(THRESHOLD, world, OPAQUE)?;
    for _ in 0..20 {
        let middle = f64::sqrt(fine * coarse);
        let views = [Path::Orbit.view(0, world, SIZE)?];
        let cut = select_cut(&mut source, &scene(&views, &opaque, middle), usize::MAX);
        if cut.leaves.len() > leaves { fine = middle } else { coarse = middle }
    }
    println!(
        "| path | leaves | changed frames | refine: median | 99 % | index: median | 99 % | both: median | 99 % | most |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for path in Path::ALL {
        // As a renderer would have it: no more room than the cut takes, and bounded uploads.
        let options = LoaderOptions {
            slots: leaves,
            uploads_per_frame: 64,
            requests: 256,
            ..roomy(false, 1)
        };
        let mut loader = Loader::new(source.clone(), options)?;
        let (mut refine, mut index, mut both, mut counts) = (vec![], vec![], vec![], vec![]);
        let mut changed = 0;
        for frame in 0..path.frames() {
            let views = [path.view(frame, world, SIZE)?];
            let seen = appearance(THRESHOLD * path.threshold(frame), world, OPAQUE)?;
            let scene = scene(&views, &seen, coarse);
            if frame == 0 {
                run(&mut loader, &scene, None, BrickSource::geometry(&source))?;
            }
            let drawn = loader.frame(&scene);
            let statistics = loader.statistics();
            refine.push(1e3 * statistics.refine_secs);
            index.push(1e3 * statistics.index_secs);
            both.push(1e3 * (statistics.refine_secs + statistics.index_secs));
            counts.push(drawn.index.leaves().count() as f64);
            changed += u32::from(statistics.index_secs > 1e-6);
            // As if the frame were shown for some time.
            std::thread::sleep(FRAME);
        }
        for all in [&mut refine, &mut index, &mut both, &mut counts] {
            all.sort_by(f64::total_cmp);
        }
        println!(
            "| {} | {:.0} | {changed} of {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |",
            path.name(),
            quantile(&counts, 0.5),
            path.frames(),
            quantile(&refine, 0.5),
            quantile(&refine, 0.99),
            quantile(&index, 0.5),
            quantile(&index, 0.99),
            quantile(&both, 0.5),
            quantile(&both, 0.99),
            quantile(&both, 1.0),
        );
    }
    println!(
        "\nMilliseconds; {side}^3, 1024 x 576, {coarse:.2} pixels a voxel, {leaves} slots, 64 uploads a frame."
    );
    Ok(())
}

/// What it took to converge.
#[derive(Debug, Default, Clone, Copy)]
struct Taken {
    frames: u32,
    /// In the loader and waiting for it, without the rays that give the feedback.
    secs: f64,
}

/// Frames until nothing is left to do.
fn run(
    loader: &mut Loader,
    scene: &Scene,
    mut volume: Option<&mut Volume>,
    geometry: &Geometry,
) -> anyhow::Result<(Frame, Taken)> {
    let mut taken = Taken::default();
    loop {
        let started = Instant::now();
        let frame = loader.frame(scene);
        if volume.is_some() {
            // A picture takes longer than what a frame asks for; rays are cast when it is there.
            while loader.unread() > 0 {
                std::thread::sleep(Duration::from_micros(200));
            }
        } else {
            std::thread::sleep(FRAME);
        }
        taken.secs += started.elapsed().as_secs_f64();
        taken.frames += 1;
        anyhow::ensure!(frame.events.is_empty(), "{:?}", frame.events);
        if frame.converged {
            return Ok((frame, taken));
        }
        anyhow::ensure!(taken.frames < 10_000, "it does not converge: {:?}", loader.statistics());
        if let Some(volume) = &mut volume {
            volume.take(&frame);
            let seen = volume.see(geometry, &frame.index, &scene.views[0], scene.appearance);
            loader.feedback(frame.index.serial(), Feedback::Octants(&seen));
        }
    }
}

/// Leaves that show their own brick, and all slots in use.
fn bricks(frame: &Frame, loader: &Loader) -> (usize, usize) {
    let own = |(_, node): &(NodeKey, &octree_store::loader::IndexNode)| {
        matches!(node.data, NodeData::Slot(_)) && node.data_level == node.level
    };
    (frame.index.leaves().filter(own).count(), loader.statistics().slots_in_use)
}

/// Working sets, with and without visibility.
fn sets(largest: u32) -> anyhow::Result<()> {
    let count = |side: u64, size: [u32; 2], depth: f64, visibility: bool| {
        let source = Simulated::new(side)?;
        let world = side as f64;
        let seen = appearance(THRESHOLD, world, depth)?;
        let views = [Path::Orbit.view(0, world, size)?];
        let scene = scene(&views, &seen, 1.0);
        let geometry = *BrickSource::geometry(&source);
        let mut loader = Loader::new(source, roomy(visibility, 1))?;
        let mut volume = Volume::Formula(simulated::value);
        let (frame, _) = run(&mut loader, &scene, visibility.then_some(&mut volume), &geometry)?;
        anyhow::Ok(bricks(&frame, &loader))
    };
    println!("| 1024 x 576, 16384^3 | without feedback | with it | ratio |");
    println!("|---|---|---|---|");
    for (name, depth) in [("opaque", OPAQUE), ("transparent", TRANSPARENT)] {
        let without = count(16_384, SIZE, depth, false)?.0;
        let with = count(16_384, SIZE, depth, true)?.0;
        println!("| {name} | {without} | {with} | {:.2} |", with as f64 / without as f64);
    }
    println!();
    let images: Vec<u32> =
        [256, 512, 1024, 2048, 4096].into_iter().filter(|&image| image <= largest).collect();
    print!("| volume |");
    for image in &images {
        print!(" {image}^2 |");
    }
    println!("\n|---|{}", "---|".repeat(images.len()));
    for side in [256, 512, 1024, 2048, 4096, 8192, 16_384] {
        print!("| {side}^3 |");
        for &image in &images {
            print!(" {} |", count(side, [image; 2], OPAQUE, true)?.0);
        }
        println!();
    }
    println!("\nBricks of the cut's leaves at 1 voxel a pixel, opaque, with visibility feedback.");
    Ok(())
}

/// Cold start and jump on a real store, with and without feedback.
fn converge(path: &PathBuf, threads: usize) -> anyhow::Result<()> {
    println!(
        "| | feedback | leaf bricks | slots | frames | seconds | bytes read / bytes of the cut | after a jump: frames | seconds |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, depth) in [("opaque", OPAQUE), ("transparent", TRANSPARENT)] {
        for visibility in [false, true] {
            let store = Store::open(path)?;
            let (geometry, world) = (*store.geometry(), store.geometry().dims_xyz()[0] as f64);
            let lengths = payload_lengths(&store)?;
            let mut loader = Loader::new(store, roomy(visibility, threads))?;
            let mut volume = Volume::Pool(HashMap::new());
            let seen = appearance(THRESHOLD, world, depth)?;
            let mut go = |loader: &mut Loader, frame| {
                let views = [Path::Jump.view(frame, world, SIZE)?];
                let scene = scene(&views, &seen, 1.0);
                run(loader, &scene, visibility.then_some(&mut volume), &geometry)
            };
            let (frame, cold) = go(&mut loader, 0)?;
            let (leaf_bricks, slots) = bricks(&frame, &loader);
            let of_cut: u64 = frame
                .index
                .leaves()
                .filter(|(_, node)| {
                    matches!(node.data, NodeData::Slot(_)) && node.data_level == node.level
                })
                .map(|(key, _)| u64::from(lengths[&key]))
                .sum();
            let amplification = loader.statistics().bytes_read as f64 / of_cut as f64;
            let (_, jump) = go(&mut loader, 60)?;
            println!(
                "| {name} | {} | {leaf_bricks} | {slots} | {} | {:.2} | {amplification:.2} | {} | {:.2} |",
                if visibility { "yes" } else { "no" },
                cold.frames,
                cold.secs,
                jump.frames,
                jump.secs,
            );
        }
    }
    println!(
        "\n1024 x 576, 1 voxel a pixel, {threads} fetch threads; seconds without the time of the rays.\n"
    );
    Ok(())
}

fn payload_lengths(store: &Store) -> anyhow::Result<HashMap<NodeKey, u32>> {
    let mut lengths = HashMap::new();
    for level in store.geometry().levels() {
        store.visit_level(level, |record| {
            lengths.insert(record.key, record.place.length);
            true
        })?;
    }
    Ok(lengths)
}

/// What refinement by measured error saves.
fn measured(path: &PathBuf) -> anyhow::Result<()> {
    let store = Store::open(path)?;
    let world = store.geometry().dims_xyz()[0] as f64;
    let views = [Path::Orbit.view(0, world, SIZE)?];
    println!("| | by size alone | RMS, 1/255 | RMS, 4/255 | largest, 4/255 |");
    println!("|---|---|---|---|---|");
    for (name, depth) in
        [("opaque", OPAQUE), ("transparent", TRANSPARENT), ("thin", 3.0), ("faint", 100.0)]
    {
        let seen = appearance(THRESHOLD, world, depth)?;
        print!("| {name} |");
        for criterion in [
            Criterion::ProjectedSize,
            Criterion::MeasuredError {
                tolerance: 1.0 / 255.0,
                deviation: Deviation::RootMeanSquare,
            },
            Criterion::MeasuredError {
                tolerance: 4.0 / 255.0,
                deviation: Deviation::RootMeanSquare,
            },
            Criterion::MeasuredError { tolerance: 4.0 / 255.0, deviation: Deviation::Largest },
        ] {
            let mut scene = scene(&views, &seen, 1.0);
            scene.quality.criterion = criterion;
            let cut = select_cut(&mut StoreNodes::new(&store), &scene, usize::MAX);
            print!(" {} |", cut.bricks());
        }
        println!();
    }
    println!("\nBricks of the cut's leaves, without visibility.\n");
    Ok(())
}

/// Bricks a second through the loader, and in a plain loop on as many threads.
fn throughput(path: &PathBuf, threads: usize) -> anyhow::Result<()> {
    let world = Store::open(path)?.geometry().dims_xyz()[0] as f64;
    let views = [Path::Orbit.view(0, world, [2048, 2048])?];
    let seen = appearance(THRESHOLD, world, OPAQUE)?;
    let scene = scene(&views, &seen, 1.0);
    let (mut loader_rates, mut loop_rates) = (Vec::new(), Vec::new());
    let mut keys: Vec<NodeKey> = Vec::new();
    for round in 0..6 {
        let store = Store::open(path)?;
        let started = Instant::now();
        let mut loader = Loader::new(store, roomy(false, threads))?;
        let mut order = Vec::new();
        loop {
            let frame = loader.frame(&scene);
            order.extend(frame.uploads.iter().map(|upload| upload.key));
            if frame.converged {
                break;
            }
            std::thread::sleep(FRAME);
        }
        let rate = loader.statistics().bricks_read as f64 / started.elapsed().as_secs_f64();
        drop(loader);
        keys = order;
        let store = Store::open(path)?;
        let started = Instant::now();
        std::thread::scope(|scope| {
            let readers: Vec<_> = (0..threads)
                .map(|thread| {
                    let (store, keys) = (&store, &keys);
                    scope.spawn(move || {
                        let mut scratch = BrickScratch::default();
                        let mut kept = Vec::new();
                        // Each thread its own stretch, as the loader's groups are.
                        for keys in keys.chunks(8).skip(thread).step_by(threads) {
                            for key in keys {
                                kept.push(store.upload_brick(&store.node(*key)?, &mut scratch)?);
                            }
                        }
                        anyhow::Ok(kept.len())
                    })
                })
                .collect();
            readers.into_iter().try_for_each(|reader| match reader.join() {
                Ok(result) => result.map(drop),
                Err(_) => anyhow::bail!("a reader stopped"),
            })
        })?;
        let plain = keys.len() as f64 / started.elapsed().as_secs_f64();
        if round > 0 {
            loader_rates.push(rate);
            loop_rates.push(plain);
        }
    }
    loader_rates.sort_by(f64::total_cmp);
    loop_rates.sort_by(f64::total_cmp);
    let (loader, plain) = (quantile(&loader_rates, 0.5), quantile(&loop_rates, 0.5));
    println!("| {} bricks, {threads} threads | loader | plain loop | ratio |", keys.len());
    println!("|---|---|---|---|");
    println!("| bricks a second | {loader:.0} | {plain:.0} | {:.2} |", loader / plain);
    Ok(())
}
