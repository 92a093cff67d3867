//! `report.html`: one file that asks for no other, for light and dark, wide and narrow.

use super::drawing::{GRID, INK};
use super::plots::{self, LEGEND, Plot, label_of};
use super::report::{Report, short};
use super::view::ViewReading;
use plotters::style::RGBColor;
use preprocess::tradeoff::RungReading;
use std::fmt::Write;

const STYLE: &str = include_str!("report.css");

/// Text as it may stand in a page.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The whole page.
pub(super) fn page(report: &Report) -> anyhow::Result<String> {
    let plots = plots::all(report)?;
    let mut page = String::new();
    let title = format!("What each way to store {} costs", file_name(&report.source.path));
    let colours = [(INK, "ink"), (GRID, "grid")].map(|(colour, name)| {
        let hex = hex(colour);
        format!("svg [fill=\"{hex}\"]{{fill:var(--{name})}}svg [stroke=\"{hex}\"]{{stroke:var(--{name})}}")
    });
    write!(
        page,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}{colours}\n</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n",
        title = escaped(&title),
        colours = colours.concat(),
    )?;
    summary(&mut page, report)?;
    wishes(&mut page, report)?;
    figures(&mut page, report, &plots)?;
    rungs(&mut page, report)?;
    levels(&mut page, report)?;
    if let Some(reading) = &report.view {
        view(&mut page, reading)?;
    }
    page.push_str("</main>\n</body>\n</html>\n");
    Ok(page)
}

fn file_name(path: &str) -> &str {
    path.trim_end_matches('/').rsplit('/').next().unwrap_or(path)
}

fn hex(RGBColor(r, g, b): RGBColor) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

fn summary(page: &mut String, report: &Report) -> std::fmt::Result {
    let by = |dims: [u64; 3]| dims.map(|n| n.to_string()).join(" × ");
    let Report { source, sample, values, machine, .. } = report;
    let whole = sample.fraction >= 1.0;
    let measured = if whole {
        "all of it".to_owned()
    } else {
        format!(
            "{} voxels from its middle, {} % of them",
            by(sample.dims_xyz),
            short(100.0 * sample.fraction)
        )
    };
    let range = match (values.value_min, values.value_max) {
        (Some(min), Some(max)) => format!("{} to {}", short(min), short(max)),
        _ => "none".to_owned(),
    };
    let no_numbers = values.nan_count + values.inf_count;
    let range =
        if no_numbers > 0 { format!("{range}; {no_numbers} voxels are no numbers") } else { range };
    let threshold = report.empty_below.map_or("no bricks are dropped".to_owned(), |threshold| {
        let how = if threshold.how == "given" { "given" } else { "Otsu’s, from the histogram" };
        format!("bricks below {} in the rungs named so ({how})", short(threshold.value))
    });
    page.push_str("<dl>\n");
    for (term, text) in [
        (
            "Volume",
            format!("{}, {} voxels of {}", source.path, by(source.dims_xyz), source.sample_type),
        ),
        ("Measured", measured),
        ("Values", range),
        ("Bricks", format!("{}³ + {} overlap", report.brick_core, report.brick_overlap)),
        ("Dropped", threshold),
        (
            "Machine",
            format!(
                "{}, {} cores, {} instructions; {} threads used",
                machine.cpu, machine.cores, machine.instruction_set, report.threads
            ),
        ),
        ("Made", format!("by {}, {}", report.created_by, report.created_utc)),
    ] {
        writeln!(page, "<div><dt>{term}</dt><dd>{}</dd></div>", escaped(&text))?;
    }
    page.push_str("</dl>\n");
    Ok(())
}

fn wishes(page: &mut String, report: &Report) -> std::fmt::Result {
    page.push_str(
        "<h2>Three wishes</h2>\n<div class=\"scroll\" tabindex=\"0\" role=\"region\" \
         aria-label=\"Three wishes\"><table class=\"wishes\">\n<thead><tr><th scope=\"col\">Wish</th>\
         <th scope=\"col\" class=\"word\">Best, and the command for it</th><th scope=\"col\">Bits a voxel</th>\
         <th scope=\"col\">AMAX</th><th scope=\"col\">RMS</th><th scope=\"col\">Random brick µs</th></tr></thead>\n<tbody>\n",
    );
    for wish in &report.wishes {
        let how = if wish.limit == "default" { " (the default limit)" } else { "" };
        write!(page, "<tr><th scope=\"row\">{}{how}</th>", escaped(&capital(&wish.words())))?;
        let best = wish.rung.as_deref().and_then(|name| report.rung(name));
        match (best, &wish.command) {
            (Some(rung), Some(command)) => writeln!(
                page,
                "<td class=\"word\">{}<br><code>{}</code></td><td data-of=\"Bits a voxel\">{:.2}</td>\
                 <td data-of=\"AMAX\">{}</td><td data-of=\"RMS\">{}</td><td data-of=\"Random brick µs\">{:.1}</td></tr>",
                escaped(&rung.name),
                whole_flags(command),
                rung.file_bits_per_voxel,
                short(rung.amax),
                short(rung.rms),
                rung.random_read_micros
            )?,
            _ => writeln!(page, "<td class=\"word\" colspan=\"5\">none of these</td></tr>")?,
        }
    }
    page.push_str("</tbody>\n</table></div>\n");
    Ok(())
}

/// A command that breaks between words, and not within a flag.
fn whole_flags(command: &str) -> String {
    let word = |word: &str| match escaped(word) {
        flag if flag.starts_with("--") => format!("<span>{flag}</span>"),
        word => word,
    };
    command.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn figures(page: &mut String, report: &Report, plots: &[Plot]) -> std::fmt::Result {
    page.push_str("<h2>Size, speed and error</h2>\n<p class=\"legend\">");
    for (name, colour) in LEGEND {
        write!(page, "<span><i style=\"background:{}\"></i>{name}</span>", hex(colour))?;
    }
    page.push_str(
        "<span>▲ effort fast</span><span>● balanced</span><span>■ small</span><span>✕ small, overlap assembled</span></p>\n\
         <p>Errors are those of what a reader gets at full resolution, in source units, dropped bricks included. \
         On a logarithmic axis there is no zero: what has no error stands in the shaded column at the edge.</p>\n\
         <ol class=\"key\">\n",
    );
    for rung in &report.rungs {
        writeln!(page, "<li>{}</li>", escaped(&label_of(rung)))?;
    }
    page.push_str("</ol>\n<div class=\"plots\">\n");
    for plot in plots {
        writeln!(
            page,
            "<figure><figcaption>{}</figcaption>{}</figure>",
            escaped(&plot.title),
            plot.svgs.iter().map(|svg| svg.trim()).collect::<String>()
        )?;
    }
    writeln!(
        page,
        "</div>\n<p>Conversion speed is the source’s bytes over the time until the store is durable, from a raw \
         file in memory, on {} threads; decoding speed is level 0’s voxels in the source’s type over the time to read, \
         check and decode the cores of all its bricks, warm, on one thread; a random brick comes with its overlap, which \
         must be read from up to 26 neighbours where it is not stored. 1 MB is 10⁶ bytes.</p>",
        report.threads
    )
}

fn rungs(page: &mut String, report: &Report) -> std::fmt::Result {
    type Column = (&'static str, fn(&RungReading) -> String);
    let columns: [Column; 11] = [
        ("Bits a voxel, file", |r| format!("{:.2}", r.file_bits_per_voxel)),
        ("Bits a voxel, level 0", |r| format!("{:.2}", r.payload_bits_per_voxel)),
        ("RMS", |r| short(r.rms)),
        ("AMAX", |r| short(r.amax)),
        ("PSNR dB", |r| r.psnr_db.map_or("–".into(), |psnr| format!("{psnr:.1}"))),
        ("Dropped voxels", |r| r.dropped_voxels.to_string()),
        ("Convert MB/s", |r| format!("{:.0}", r.encode_mb_per_sec)),
        ("Decode MB/s, 1 thread", |r| format!("{:.0}", r.decode_mb_per_sec_one_thread)),
        ("Decode MB/s, all threads", |r| format!("{:.0}", r.decode_mb_per_sec)),
        ("Random brick µs", |r| format!("{:.1}", r.random_read_micros)),
        ("File bytes", |r| r.file_bytes.to_string()),
    ];
    page.push_str(
        "<h2>All ways</h2>\n<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"All ways\">\
         <table>\n<thead><tr><th scope=\"col\">Way</th>",
    );
    for (name, _) in columns {
        write!(page, "<th scope=\"col\">{name}</th>")?;
    }
    page.push_str("</tr></thead>\n<tbody>\n");
    for rung in &report.rungs {
        write!(page, "<tr><th scope=\"row\">{}</th>", escaped(&rung.name))?;
        for (_, text) in columns {
            write!(page, "<td>{}</td>", escaped(&text(rung)))?;
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</tbody>\n</table></div>\n");
    Ok(())
}

fn levels(page: &mut String, report: &Report) -> std::fmt::Result {
    page.push_str(
        "<h2>Levels</h2>\n<p>How far what a reader gets at a level lies from full resolution, measured over every \
         level-0 voxel, and the bound that follows from what the store states. Tightness is measured over bound: 1 is \
         tight.</p>\n<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Levels\"><table>\n<thead><tr>\
         <th scope=\"col\">Way</th><th scope=\"col\">Level</th><th scope=\"col\">RMS</th>\
         <th scope=\"col\">RMS bound</th><th scope=\"col\">Tightness</th><th scope=\"col\">AMAX</th>\
         <th scope=\"col\">AMAX bound</th><th scope=\"col\">Tightness</th></tr></thead>\n<tbody>\n",
    );
    let tightness = |t: Option<f64>| t.map_or("–".to_owned(), |t| format!("{t:.3}"));
    // Efforts change bytes alone: one of them says it all.
    for rung in report.rungs.iter().filter(|rung| rung.effort == "balanced") {
        for level in &rung.levels {
            writeln!(
                page,
                "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                escaped(&rung.name),
                level.level,
                short(level.deviation_rms),
                short(level.rms_bound),
                tightness(level.rms_tightness),
                short(level.deviation_amax),
                short(level.amax_bound),
                tightness(level.amax_tightness),
            )?;
        }
    }
    page.push_str("</tbody>\n</table></div>\n");
    Ok(())
}

fn view(page: &mut String, reading: &ViewReading) -> anyhow::Result<()> {
    let plot = plots::of_view(reading)?;
    let [width, height] = reading.size;
    write!(
        page,
        "<h2>A view</h2>\n<p>One picture of {width} × {height} pixels, view {}, stored as {}, by {}. PSNR is against the source          itself, drawn in 64 bits without an octree, samples {} voxels apart. Pixels a voxel is          <code>--accuracy</code>: above 1 coarser levels are taken; the step between samples, in voxels of the level at hand, is <code>--step</code>.</p>\n         <div class=\"plots\"><figure><figcaption>{}</figcaption>{}</figure></div>\n         <div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"A view\"><table>\n<thead><tr>         <th scope=\"col\">Pixels a voxel, step</th><th scope=\"col\">ms a frame</th><th scope=\"col\">Bricks read</th>         <th scope=\"col\">Bytes read</th><th scope=\"col\">PSNR dB</th><th scope=\"col\">SSIM</th></tr></thead>\n<tbody>\n",
        reading.view,
        escaped(&reading.encoding),
        escaped(&reading.adapter),
        short(reading.true_step_voxels),
        escaped(&plot.title),
        plot.svgs.iter().map(|svg| svg.trim()).collect::<String>(),
    )?;
    for picture in &reading.pictures {
        writeln!(
            page,
            "<tr><th scope=\"row\">{}</th><td>{:.1}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.4}</td></tr>",
            picture.name(),
            picture.frame_ms,
            picture.bricks,
            picture.bytes,
            picture.psnr_db.map_or("–".into(), |psnr| format!("{psnr:.1}")),
            picture.ssim
        )?;
    }
    page.push_str("</tbody>\n</table></div>\n");
    Ok(())
}
