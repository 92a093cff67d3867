//! Pictures by the program: without Vulkan, and against the source.

use crate::support::{Bench, sample};

fn bench() -> Bench {
    let bench = Bench::new();
    bench.scan("a_40x33x20_u16.raw");
    bench.ok("convert a_40x33x20_u16.raw -o a.octavo --brick 16 --encoding lossless");
    bench
}

#[test]
fn a_picture_is_drawn_without_vulkan_and_agrees_with_the_source() {
    let bench = bench();
    let said = bench
        .ok("render a.octavo -o a.png --size 80x60 --backend cpu --against a_40x33x20_u16.raw --diff d.png --depth z.raw --json")
        .json();
    assert_eq!((&said["schema"], &said["backend"]), (&"octavo.render/1".into(), &"cpu".into()));
    for key in ["bricks_in_cut", "bricks_loaded", "bytes_read", "frames"] {
        assert!(said[key].as_u64().is_some_and(|n| n > 0), "{key}: {said}");
    }
    for key in ["frame_ms", "upload_ms", "ssim", "max_abs_diff"] {
        assert!(said[key].is_number(), "{key}: {said}");
    }
    let psnr = said["psnr_db"].as_f64();
    assert!(psnr.is_none_or(|db| db > 60.0), "{said}");
    assert_eq!(std::fs::metadata(bench.path("z.raw")).unwrap().len(), 80 * 60 * 4);
    let png = std::fs::read(bench.path("a.png")).unwrap();
    assert!(png.windows(11).any(|w| w == b"octavo:view"));
    let again = bench.run("render a.octavo -o a.png --backend cpu");
    assert_eq!(again.code, 2, "{}", again.err);
}

#[test]
fn rays_end_at_the_depths_that_are_given() {
    let bench = bench();
    let draw = "--size 40x30 --backend cpu --view z- --depth";
    bench.ok(&format!("render a.octavo -o whole.png {draw} whole.raw"));
    let floats = |name: &str| -> Vec<f32> {
        let bytes = std::fs::read(bench.path(name)).unwrap();
        bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    };
    let depths = floats("whole.raw");
    let seen = depths.iter().filter(|d| d.is_finite()).count();
    assert!(seen > 100, "{seen}");
    // Half of the picture ends before anything is seen; the other half is as it was. What is no number ends nothing.
    let nearest = depths.iter().copied().fold(f32::INFINITY, f32::min);
    let ends = (0..40 * 30).map(|i| match i % 40 {
        x if x < 20 => nearest * 0.5,
        x if x < 30 => f32::INFINITY,
        _ => f32::NAN,
    });
    bench.write("ends.raw", &ends.flat_map(f32::to_le_bytes).collect::<Vec<_>>());
    bench.ok(&format!("render a.octavo -o half.png {draw} half.raw --depth-in ends.raw"));
    for (i, (half, whole)) in floats("half.raw").iter().zip(&depths).enumerate() {
        let expected = if i % 40 < 20 { f32::INFINITY } else { *whole };
        assert_eq!(*half, expected, "{i}");
    }
    bench.write("short.raw", &[0; 40 * 30 * 4 - 1]);
    let said = bench.run(&format!("render a.octavo -o x.png {draw} x.raw --depth-in short.raw"));
    assert_eq!(said.code, 2, "{}", said.err);
    assert!(said.err.contains("4800 bytes") && said.err.contains("4799"), "{}", said.err);
}

#[test]
fn a_clip_box_shows_only_what_lies_in_it() {
    let bench = bench();
    let draw = |name: &str, clip: &str| {
        bench.ok(&format!(
            "render a.octavo -o {name} --size 60x45 --backend cpu --depth {name}.raw{clip}"
        ));
        let bytes = std::fs::read(bench.path(&format!("{name}.raw"))).unwrap();
        bytes.as_chunks().0.iter().filter(|b| f32::from_le_bytes(**b).is_finite()).count()
    };
    let (whole, half) = (draw("w.png", ""), draw("h.png", " --clip -5,0,0,20,33,20"));
    assert!(0 < half && half < whole, "{half} {whole}");
    for (wrong, reason) in [
        ("--clip 1,2,3", "X0,Y0,Z0,X1,Y1,Z1"),
        ("--clip 0,0,0,5,0,5", "empty along y"),
        ("--mode mip --window 5,5", "LOW,HIGH"),
    ] {
        let said = bench.run(&format!("render a.octavo -o x.png --backend cpu {wrong}"));
        assert_eq!(said.code, 2, "{}", said.err);
        assert!(said.err.contains(reason), "{}", said.err);
    }
}

#[test]
fn every_mode_draws_and_orbits_are_numbered() {
    let bench = bench();
    for mode in ["dvr", "iso", "mip"] {
        bench.ok(&format!(
            "render a.octavo -o {mode}.png --mode {mode} --size 40x30 --backend cpu --bits 16"
        ));
    }
    bench.ok("render a.octavo -o turn.png --orbit 3 --size 40x30 --backend cpu");
    let names = bench.names();
    for name in ["turn0.png", "turn1.png", "turn2.png", "mip.png"] {
        assert!(names.iter().any(|n| n == name), "{names:?}");
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_with_the_reason() {
    let bench = bench();
    bench.write("eye.json", br#"{"projection":"fisheye"}"#);
    let bright = r#"{"points":[{"value":0,"color":[0,0,0],"extinction":1e39}]}"#;
    bench.write("bright.json", bright.as_bytes());
    bench.write("map.json", br#"{"colormap":"vividis","range":[0,1],"points":[]}"#);
    for (arguments, reason) in [
        ("--camera eye.json", "fisheye"),
        ("--transfer map.json", "viridis"),
        ("--view sideways", "grazing"),
        ("--size 0x5", "WxH"),
        ("--step 0", "step must be above 0"),
        ("--step 1e-30", "at least 0.0001"),
        ("--mode iso --iso nan", "finite"),
        ("--orbit 0", "not in 1.."),
        ("--camera missing.json", "missing.json"),
        ("--transfer bright.json", "extinction must be at most"),
        ("--diff x.png --against a_40x33x20_u16.raw", "named twice"),
        ("--depth d.jpg", ".png"),
        ("--background 2,0,0", "0 to 1"),
    ] {
        let said = bench.run(&format!("render a.octavo -o x.png --backend cpu {arguments}"));
        assert_eq!(said.code, 2, "{arguments}: {}", said.err);
        assert!(said.err.contains(reason), "{arguments}: {}", said.err);
    }
    // Neither a store nor its source becomes a picture, whatever is forced.
    for output in ["a.octavo", "a_40x33x20_u16.raw", "other.jpg"] {
        let command = format!(
            "render a.octavo -o {output} --force --backend cpu --against a_40x33x20_u16.raw"
        );
        let said = bench.run(&command);
        assert_eq!(said.code, 2, "{output}: {}", said.err);
    }
    bench.ok("verify a.octavo");
    let said = bench.run("render a.octavo -o x.png --adapter no_such_adapter");
    assert_eq!(said.code, 3);
    assert!(
        said.err.contains("mesa-vulkan-drivers") && said.err.contains("--backend cpu"),
        "{}",
        said.err
    );
    assert!(!bench.names().iter().any(|name| name == "x.png"));
}

#[test]
fn render_check_says_yes_to_a_store_of_its_source_and_no_to_another() {
    let bench = bench();
    let yes = bench
        .ok("render-check a.octavo --against a_40x33x20_u16.raw -o pictures --backend cpu --json")
        .json();
    assert_eq!(yes["ok"], true, "{yes}");
    assert_eq!(yes["pictures"].as_array().unwrap().len(), 33);
    let page = std::fs::read_to_string(bench.path("pictures/index.html")).unwrap();
    assert!(page.contains("z_low_opaque_difference.png"));
    assert!(bench.path("pictures/z_low_opaque_difference.png").exists());
    let mut other = bench.scan("b_40x33x20_u16.raw");
    other.reverse();
    bench.write("b_40x33x20_u16.raw", &other);
    let no = bench.run("render-check a.octavo --against b_40x33x20_u16.raw --backend cpu");
    assert_eq!(no.code, 1, "{}{}", no.out, no.err);
}

#[test]
fn eight_bits_of_real_scans_look_like_them_where_a_voxel_covers_a_pixel() {
    for name in ["tooth.nii.gz", "bone.nii.gz"] {
        let (bench, source) = (Bench::new(), sample(name));
        bench.ok(&format!("convert {source} -o scan.octavo"));
        let said = bench
            .ok(&format!("render scan.octavo -o scan.png --size 200x150 --accuracy 0.1 --backend cpu --against {source} --json"))
            .json();
        assert!(said["psnr_db"].as_f64().is_none_or(|db| db >= 45.0), "{name}: {said}");
    }
}
