//! `octavo tradeoff`, on the bundled tooth: its figures against the other commands' and against theory, and
//! its page in a real browser.

use crate::support::{Bench, Said, octavo, sample};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// One report for many claims: it takes a while to measure.
#[test]
fn the_tooths_report_is_true_and_can_be_seen() {
    let bench = Bench::new();
    let tooth = sample("tooth.nii.gz");
    let report = bench.ok(&format!("tradeoff {tooth} -o t --json --threads 2")).json();
    every_rung_says_what_info_and_verify_say_of_the_same_conversion(&bench, &report);
    figures_go_the_way_that_theory_says(&report);
    every_level_lies_within_its_bound_and_level_0_is_what_the_store_says(&report);
    a_view_that_costs_less_shows_less(&report);
    wishes_are_the_best_of_the_table_and_their_commands_work(&bench, &report);
    the_page_shows_every_plot_in_a_real_browser_and_asks_for_no_other_file(&bench);
}

fn rungs(report: &Value) -> &[Value] {
    report["rungs"].as_array().unwrap()
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} of {value}"))
}

fn rung<'a>(report: &'a Value, name: &str) -> &'a Value {
    let named = rungs(report).iter().find(|rung| rung["name"] == name);
    named.unwrap_or_else(|| panic!("no rung {name}"))
}

fn every_rung_says_what_info_and_verify_say_of_the_same_conversion(bench: &Bench, report: &Value) {
    assert_eq!(report["schema"], "octavo.tradeoff/1");
    assert_eq!(report["sample"]["fraction"], 1.0);
    let tooth = sample("tooth.nii.gz");
    for rung in rungs(report) {
        let arguments: Vec<_> =
            rung["arguments"].as_array().unwrap().iter().map(|a| a.as_str().unwrap()).collect();
        bench.ok(&format!("convert {tooth} -o a.octavo --force {}", arguments.join(" ")));
        let info = bench.ok("info a.octavo --json").json();
        let name = &rung["name"];
        assert_eq!(info["digest"], rung["digest"], "{name}");
        assert_eq!(info["rms"], rung["kept_rms"], "{name}");
        assert_eq!(info["amax"], rung["kept_amax"], "{name}");
        assert_eq!(info["dropped_voxels"], rung["dropped_voxels"], "{name}");
        for (level, stored) in
            rung["levels"].as_array().unwrap().iter().zip(info["levels"].as_array().unwrap())
        {
            assert_eq!(level["lod_rms_bound"], stored["lod_rms_bound"], "{name}");
            assert_eq!(level["lod_amax_bound"], stored["lod_amax_bound"], "{name}");
            assert_eq!(level["payload_bytes"], stored["payload_bytes"], "{name}");
        }
        if info["dropped_voxels"] == 0 {
            assert_eq!(info["psnr_db"], rung["psnr_db"], "{name}");
            assert_eq!(rung["rms"], rung["kept_rms"]);
        } else {
            assert!(number(rung, "amax") >= number(&info, "dropped_amax"));
        }
        let payload = info["levels"][0]["payload_bytes"].as_f64().unwrap();
        let bits = 8.0 * payload / (103.0 * 94.0 * 161.0);
        assert!((number(rung, "payload_bits_per_voxel") - bits).abs() < 1e-9, "{name}");
        // The path in the metadata is all that differs: a page of the index at most.
        let bytes = number(rung, "file_bytes") - number(&info, "file_bytes");
        assert!(bytes.abs() <= 8192.0, "{name}: {bytes}");
        let against = bench.ok(&format!("verify a.octavo --against {tooth} --json")).json();
        assert_eq!(against["against"]["rms"], rung["kept_rms"], "{name}");
        assert_eq!(against["against"]["amax"], rung["kept_amax"], "{name}");
    }
}

fn figures_go_the_way_that_theory_says(report: &Value) {
    assert_eq!(number(rung(report, "lossless"), "amax"), 0.0);
    assert_eq!(rung(report, "lossless")["psnr_db"], Value::Null);
    for effort in ["balanced", "small"] {
        let bounded: Vec<_> = rungs(report)
            .iter()
            .filter(|rung| {
                rung["encoding"].as_str().unwrap().starts_with("max-error=")
                    && rung["effort"] == effort
                    && rung["empty_below"].is_null()
                    && rung["stored_overlap"] == true
            })
            .map(|rung| {
                let bound = rung["encoding"].as_str().unwrap().strip_prefix("max-error=").unwrap();
                (bound.parse::<f64>().unwrap(), rung)
            })
            .collect();
        assert_eq!(bounded.len(), 5);
        for (bound, rung) in &bounded {
            assert!(number(rung, "amax") <= *bound, "{}", rung["name"]);
        }
        for pair in bounded.windows(2) {
            assert!(pair[0].0 < pair[1].0, "the ladder goes up");
            let bits = |rung: &Value| number(rung, "payload_bits_per_voxel");
            assert!(
                bits(pair[1].1) < bits(pair[0].1),
                "{} {}",
                pair[0].1["name"],
                pair[1].1["name"]
            );
            assert!(number(pair[1].1, "rms") > number(pair[0].1, "rms"));
        }
    }
    // Efforts change bytes alone.
    for key in ["rms", "amax", "psnr_db"] {
        for name in ["u8 fast", "u8 small", "u8 small assembled"] {
            assert_eq!(rung(report, "u8")[key], rung(report, name)[key], "{name}");
        }
    }
    let bits = |name| number(rung(report, name), "file_bits_per_voxel");
    assert!(bits("u8 small") < bits("u8") && bits("u8") <= bits("u8 fast"));
    assert!(bits("u8 small assembled") < bits("u8 small"));
    for rung in rungs(report) {
        for key in [
            "encode_mb_per_sec",
            "decode_mb_per_sec",
            "decode_mb_per_sec_one_thread",
            "random_read_micros",
        ] {
            assert!(number(rung, key) > 0.0, "{key} of {}", rung["name"]);
        }
    }
}

fn a_view_that_costs_less_shows_less(report: &Value) {
    let pictures = report["view"]["pictures"].as_array().unwrap();
    assert_eq!(pictures.len(), 16);
    let picture = |accuracy: f64, step: f64| {
        let same = |p: &&Value| p["accuracy"] == accuracy && p["step_voxels"] == step;
        pictures.iter().find(same).unwrap_or_else(|| panic!("{accuracy} {step}"))
    };
    for step in [0.25, 0.5, 1.0, 2.0] {
        for pair in [0.5, 1.0, 2.0, 4.0].windows(2) {
            let [finer, coarser] = [picture(pair[0], step), picture(pair[1], step)];
            for key in ["bricks", "bytes"] {
                assert!(number(finer, key) >= number(coarser, key), "{finer} {coarser}");
            }
        }
        assert!(number(picture(0.5, step), "bytes") > number(picture(4.0, step), "bytes"));
    }
    let psnr = |accuracy, step| number(picture(accuracy, step), "psnr_db");
    assert!(psnr(0.5, 0.25) >= 45.0, "{}", report["view"]);
    for pair in [(0.5, 1.0), (1.0, 2.0), (2.0, 4.0)] {
        assert!(psnr(pair.0, 0.25) > psnr(pair.1, 0.25), "{}", report["view"]);
    }
    assert!(psnr(0.5, 0.25) > psnr(0.5, 2.0), "{}", report["view"]);
    assert!(pictures.iter().all(|picture| number(picture, "frame_ms") > 0.0));
}

fn every_level_lies_within_its_bound_and_level_0_is_what_the_store_says(report: &Value) {
    for rung in rungs(report) {
        let levels = rung["levels"].as_array().unwrap();
        assert_eq!(levels.len(), 4);
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b;
        assert!(close(number(&levels[0], "deviation_rms"), number(rung, "rms")));
        assert_eq!(levels[0]["deviation_amax"], rung["amax"]);
        for level in levels {
            for measure in ["rms", "amax"] {
                let [measured, bound] =
                    [format!("deviation_{measure}"), format!("{measure}_bound")]
                        .map(|key| number(level, &key));
                assert!(measured <= bound, "{}: {level}", rung["name"]);
                let tightness = level[format!("{measure}_tightness")].as_f64();
                assert_eq!(tightness, (bound > 0.0).then(|| measured / bound));
            }
        }
        // A mean of eight and what it is made of: the first step is measured, not bounded.
        if rung["name"] == "lossless" {
            assert!(number(&levels[1], "rms_tightness") > 0.999_999);
            assert!(number(&levels[1], "amax_tightness") > 0.999_999);
            assert!(number(&levels[3], "rms_tightness") > 0.3);
        }
    }
}

fn wishes_are_the_best_of_the_table_and_their_commands_work(bench: &Bench, report: &Value) {
    let tooth = sample("tooth.nii.gz");
    let wishes = report["wishes"].as_array().unwrap();
    assert_eq!(wishes.len(), 3);
    for wish in wishes {
        let kind = wish["wish"].as_str().unwrap();
        let by_size = kind == "most_accurate_under_size";
        let limit = number(wish, if by_size { "bits_per_voxel" } else { "amax" });
        let (limited, cost) = match kind {
            "smallest_under_error" => ("amax", "file_bits_per_voxel"),
            "most_accurate_under_size" => ("file_bits_per_voxel", "rms"),
            "fastest_to_read_under_error" => ("amax", "random_read_micros"),
            other => panic!("a wish of another kind: {other}"),
        };
        let within = || rungs(report).iter().filter(|rung| number(rung, limited) <= limit);
        let chosen = rung(report, wish["rung"].as_str().unwrap());
        assert!(within().any(|rung| rung == chosen), "{wish}");
        assert!(within().all(|rung| number(rung, cost) >= number(chosen, cost)), "{wish}");
        let command = wish["command"].as_str().unwrap();
        let arguments = command.strip_prefix("octavo ").unwrap();
        assert!(arguments.starts_with(&format!("convert {tooth}")), "{command}");
        bench.ok(&format!("{arguments} -o wish.octavo --force"));
        assert_eq!(bench.ok("info wish.octavo --json").json()["digest"], chosen["digest"]);
    }
}

#[test]
fn a_sample_is_said_to_be_one_and_options_are_kept() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    let said = bench.ok(
        "tradeoff a_40x33x20_u16.raw -o t --json --sample 5000 --brick 8 --overlap 1 --threads 1 \
         --max-error 3,100 --empty-below 2500 --wish-error 0.5 --wish-bits 0.001",
    );
    let report = said.json();
    let dims: Vec<u64> = report["sample"]["dims_xyz"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n.as_u64().unwrap())
        .collect();
    assert!(dims.iter().product::<u64>() <= 5000, "{dims:?}");
    let fraction = dims.iter().product::<u64>() as f64 / (40.0 * 33.0 * 20.0);
    assert!((number(&report["sample"], "fraction") - fraction).abs() < 1e-12);
    assert_eq!(report["empty_below"]["value"], 2500.0);
    assert_eq!(report["empty_below"]["how"], "given");
    assert!(number(rung(&report, "max-error=3"), "amax") <= 3.0);
    assert!(rungs(&report).iter().all(|rung| number(rung, "encode_secs") > 0.0));
    // Nothing is so small: the wish is not fulfilled, and says so.
    assert_eq!(report["wishes"][1]["rung"], Value::Null);
    assert_eq!(report["wishes"][1]["limit"], "given");
    let command = report["wishes"][0]["command"].as_str().unwrap();
    assert!(command.contains("--brick 8 --overlap 1"), "{command}");
    assert_eq!(
        report,
        serde_json::from_slice::<Value>(&std::fs::read(bench.path("t/report.json")).unwrap())
            .unwrap()
    );
    assert_eq!(names(&bench.path("t")), ["report.html", "report.json"]);
}

#[test]
fn volumes_without_a_range_have_a_report_too() {
    let bench = Bench::new();
    bench.write("flat_9x9x9_u16.raw", &[7; 2 * 729]);
    bench.write("nan_9x9x9_f32.raw", &f32::NAN.to_le_bytes().repeat(729));
    for name in ["flat_9x9x9_u16", "nan_9x9x9_f32"] {
        let report = bench.ok(&format!("tradeoff {name}.raw -o {name} --json")).json();
        assert_eq!(report["empty_below"], Value::Null, "{name}");
        assert!(rungs(&report).iter().all(|rung| rung["amax"] == 0.0), "{name}");
        let page = std::fs::read_to_string(bench.path(&format!("{name}/report.html"))).unwrap();
        assert!(!page.contains("NaN") && !page.contains("inf"), "{name}");
    }
}

#[test]
fn reports_are_replaced_only_when_asked_and_nothing_is_left_of_what_failed() {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    let missing = bench.run("tradeoff missing.nii -o t");
    assert_eq!((missing.code, bench.path("t").exists()), (2, false));
    let refused = bench.run("tradeoff a_40x33x20_u16.raw -o t --empty-below nan");
    assert_eq!((refused.code, bench.path("t").exists()), (2, false), "{}", refused.err);
    for bad in ["--max-error=-1", "--max-error=nan", "--wish-error=-2", "--sample=0"] {
        assert_eq!(bench.run(&format!("tradeoff a_40x33x20_u16.raw -o t {bad}")).code, 2, "{bad}");
    }
    bench.write("file", b"mine");
    for (place, word) in [("file", "no folder"), ("none/t", "no such folder")] {
        let refused = bench.run(&format!("tradeoff a_40x33x20_u16.raw -o {place}"));
        assert_eq!(refused.code, 2, "{}", refused.err);
        assert!(refused.err.contains(word), "{}", refused.err);
    }
    assert_eq!(std::fs::read(bench.path("file")).unwrap(), b"mine");
    std::fs::create_dir(bench.path("t")).unwrap();
    std::fs::write(bench.path("t/report.json"), b"mine").unwrap();
    let refused = bench.run("tradeoff a_40x33x20_u16.raw -o t");
    assert_eq!(refused.code, 2);
    assert!(refused.err.contains("--force"), "{}", refused.err);
    assert_eq!(std::fs::read(bench.path("t/report.json")).unwrap(), b"mine");
    bench.ok("tradeoff a_40x33x20_u16.raw -o t --force --max-error 9");
    assert_eq!(names(&bench.path("t")), ["report.html", "report.json"]);
}

#[test]
fn an_interrupted_measurement_leaves_nothing() {
    let bench = Bench::new();
    bench.noise("a_400x400x300_u16.raw", 400 * 400 * 300 * 2);
    let mut command = octavo();
    command.args(["tradeoff", "a_400x400x300_u16.raw", "-o", "t"]).current_dir(bench.folder());
    command.stderr(std::process::Stdio::piped());
    let child = command.spawn().unwrap();
    let scratch = bench.path("t");
    let begun = std::time::Instant::now();
    while !has_store(&scratch) {
        assert!(begun.elapsed().as_secs() < 120, "no conversion was begun");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let said = Said::of(&child.wait_with_output().unwrap());
    assert_eq!(said.code, 3, "{}", said.err);
    assert!(said.err.contains("stopped before the end"), "{}", said.err);
    assert!(!said.err.contains("--resume"), "{}", said.err);
    assert_eq!(bench.names(), ["a_400x400x300_u16.raw"]);
}

/// Whether a scratch folder beneath has a store in the making.
fn has_store(folder: &Path) -> bool {
    let Ok(entries) = std::fs::read_dir(folder) else { return false };
    entries.flatten().any(|entry| entry.path().join("rung.octavo.partial").exists())
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The browser that tests/run.sh installs.
fn chromium(arguments: &[&str]) -> Said {
    let program = std::env::var("OCTAVO_TEST_BROWSER").unwrap_or_else(|_| "chromium".into());
    let profile = tempfile_folder("chromium-profile");
    let mut command = Command::new(&program);
    command
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--no-first-run",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(arguments);
    let output = command.output();
    std::fs::remove_dir_all(&profile).ok();
    let output =
        output.unwrap_or_else(|error| panic!("{program} (bash tests/run.sh installs it): {error}"));
    Said::of(&output)
}

fn tempfile_folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("octavo-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// A place under target/ where pictures are kept for those who look.
fn artifacts() -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/test-artifacts");
    std::fs::create_dir_all(&path).unwrap();
    path.canonicalize().unwrap()
}

fn the_page_shows_every_plot_in_a_real_browser_and_asks_for_no_other_file(bench: &Bench) {
    let page = std::fs::read_to_string(bench.path("t/report.html")).unwrap();
    let without_names = page.replace("http://www.w3.org/2000/svg", "");
    for asks in ["http:", "https:", "src=", "@import", "url(", "<script", "<link"] {
        assert!(!without_names.contains(asks), "{asks}");
    }
    // Each plot for wide pages and for narrow ones.
    assert_eq!(page.matches("<svg").count(), 2 * 12);
    assert_eq!(page.matches("<title id=").count(), 2 * 12);
    assert_eq!(page.matches("<desc id=").count(), 2 * 12);

    // A copy that says where its plots are, and how many pixels of the screen their smallest letters have.
    let script = "<script>const seen=[...document.querySelectorAll('svg')].filter(s=>\
        s.getBoundingClientRect().width>0);\
        document.documentElement.dataset.boxes=JSON.stringify({height:\
        document.documentElement.scrollHeight,width:document.documentElement.scrollWidth,\
        letters:Math.min(...seen.flatMap(s=>[...s.querySelectorAll('text')].map(t=>\
        parseFloat(getComputedStyle(t).fontSize)*s.getBoundingClientRect().width/s.viewBox.baseVal.width))),\
        wishes:(t=>t.scrollWidth<=t.parentElement.clientWidth)(document.querySelector('.wishes')),\
        named:[...document.querySelectorAll('.scroll')].every(s=>{s.scrollLeft=9999;const t=s.querySelector('tbody th');\
        return t.getBoundingClientRect().left>=s.getBoundingClientRect().left&&t.offsetWidth<s.clientWidth/2\
        ||s.scrollLeft==0}),\
        boxes:seen.map(s=>{const b=s.getBoundingClientRect();\
        return [b.left,b.top,b.right,b.bottom]})})</script></body>";
    let told = bench.write("told.html", page.replace("</body>", script).as_bytes());
    for (name, width, dark) in [
        ("wide", 1280, false),
        ("narrow", 500, false),
        ("dark", 1280, true),
        ("narrow-dark", 500, true),
    ] {
        let window = format!("--window-size={width},900");
        let mode = format!("--blink-settings=preferredColorScheme={}", u8::from(!dark));
        let url = format!("file://{}", told.display());
        let dom = chromium(&[&window, &mode, "--dump-dom", &url]);
        let boxes = dom.out.split("data-boxes=\"").nth(1).unwrap_or_else(|| panic!("{}", dom.err));
        let boxes = boxes.split('"').next().unwrap().replace("&quot;", "\"");
        let boxes: Value = serde_json::from_str(&boxes).unwrap();
        // Tables scroll within themselves: the page never grows wider than the screen.
        assert_eq!(boxes["width"], width, "{name}");
        // Wishes and their commands are read without scrolling, and rows keep their names while scrolling.
        assert_eq!([&boxes["wishes"], &boxes["named"]], [true, true], "{name}");
        assert_eq!(boxes["boxes"].as_array().unwrap().len(), 12, "{name}");
        assert!(boxes["letters"].as_f64().unwrap() >= 11.0, "{name}: {}", boxes["letters"]);
        let height = boxes["height"].as_u64().unwrap();
        let picture = artifacts().join(format!("tradeoff-{name}.png"));
        let window = format!("--window-size={width},{height}");
        let shot = format!("--screenshot={}", picture.display());
        let url = format!("file://{}", bench.path("t/report.html").display());
        let said = chromium(&[&window, &mode, &shot, &url]);
        assert!(picture.is_file(), "{}", said.err);
        let picture = Picture::load(&picture);
        let background = picture.at(1, 1);
        assert_eq!(background.iter().map(|&v| u32::from(v)).sum::<u32>() < 200, dark, "{name}");
        for (plot, at) in boxes["boxes"].as_array().unwrap().iter().enumerate() {
            let [left, top, right, bottom] =
                [0, 1, 2, 3].map(|i| at[i].as_f64().unwrap().max(0.0) as usize);
            assert!(right > left + 200 && right <= width && bottom > top + 100, "{at}");
            let coloured = picture.count(left..right, top..bottom, |[r, g, b]| {
                r.max(g).max(b) - r.min(g).min(b) > 60
            });
            let paper = picture.at(left + 1, top + 1);
            let drawn = picture.count(left..right, top..bottom, |pixel| {
                pixel.iter().zip(paper).any(|(a, b)| a.abs_diff(b) > 40)
            });
            // At least ten marks of some 20 pixels each in colour; letters and axes beside them.
            assert!(
                coloured > 200 && drawn > 2 * coloured / 3 + 1000,
                "{name} {plot}: {coloured} {drawn}"
            );
        }
    }
}

struct Picture {
    width: usize,
    channels: usize,
    pixels: Vec<u8>,
}

impl Picture {
    fn load(path: &Path) -> Self {
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!(info.bit_depth, png::BitDepth::Eight);
        Self { width: info.width as usize, channels: info.color_type.samples(), pixels }
    }

    fn at(&self, x: usize, y: usize) -> [u8; 3] {
        let at = (y * self.width + x) * self.channels;
        [self.pixels[at], self.pixels[at + 1], self.pixels[at + 2]]
    }

    fn count(
        &self,
        xs: std::ops::Range<usize>,
        ys: std::ops::Range<usize>,
        is: impl Fn([u8; 3]) -> bool,
    ) -> usize {
        let height = self.pixels.len() / (self.width * self.channels);
        ys.filter(|y| *y < height)
            .flat_map(|y| xs.clone().map(move |x| (x, y)))
            .filter(|&(x, y)| is(self.at(x, y)))
            .count()
    }
}
