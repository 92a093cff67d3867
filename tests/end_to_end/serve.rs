//! The server as its users meet it, and clients that others wrote: what they read is the source, bit for bit.

use crate::readers::python_of;
use crate::support::{Bench, octavo, sample};
use rustix::process::{Pid, Resource, Rlimit, getrlimit, prlimit};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// A server that ends when it is dropped.
struct Serving {
    child: Child,
    base: String,
    /// What it prints after its address: a line for each dataset.
    said: BufReader<ChildStdout>,
}

impl Serving {
    fn new(bench: &Bench, arguments: &str) -> Self {
        Self::started(octavo(), bench, arguments)
    }

    /// A server that may have so many files open.
    fn limited(bench: &Bench, arguments: &str, files: usize) -> Self {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("ulimit -n {files} && exec \"$0\" \"$@\"")]);
        command.arg(octavo().get_program());
        Self::started(command, bench, arguments)
    }

    fn started(mut command: Command, bench: &Bench, arguments: &str) -> Self {
        command.args(["serve", "--bind", "127.0.0.1:0"]).args(arguments.split(' '));
        command.current_dir(bench.folder()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut said = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        said.read_line(&mut line).unwrap();
        let base = line.trim().trim_end_matches('/').to_owned();
        assert!(base.starts_with("http://127.0.0.1:"), "{line}");
        Self { child, base, said }
    }

    fn interrupt(&self) {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The interpreter that has other people's readers of served volumes.
fn clients(script: &str, arguments: &[&str]) {
    python_of("OCTAVO_TEST_CLIENTS", "tests/clients", script, arguments);
}

#[test]
fn it_ends_cleanly_when_it_is_interrupted_and_logs_requests_as_json() {
    let bench = Bench::new();
    bench.scan("a.raw");
    bench.ok("convert a.raw --dims 40,33,20 --dtype u16");
    let mut server = Serving::new(&bench, "a.octavo --access-log");
    let address = server.base.trim_start_matches("http://").to_owned();
    let mut stream = std::net::TcpStream::connect(&address).unwrap();
    std::io::Write::write_all(
        &mut stream,
        b"GET /v1/a/info HTTP/1.1\r\nhost: a\r\nconnection: close\r\n\r\n",
    )
    .unwrap();
    let reply = std::io::read_to_string(&mut stream).unwrap();
    assert!(reply.starts_with("HTTP/1.1 200") && reply.contains("octavo.info/1"), "{reply}");
    server.interrupt();
    assert_eq!(server.child.wait().unwrap().code(), Some(0));
    let log = std::io::read_to_string(server.child.stderr.take().unwrap()).unwrap();
    let line =
        log.lines().find(|line| line.contains("/v1/a/info")).expect("the request was logged");
    let entry: serde_json::Value = serde_json::from_str(line).unwrap();
    assert_eq!((&entry["method"], &entry["status"]), (&"GET".into(), &200.into()));
}

/// The compressed pixels of a PNG.
fn pixels(png: &[u8]) -> Vec<u8> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 8 <= png.len() {
        let length = u32::from_be_bytes(png[at..at + 4].try_into().unwrap()) as usize;
        if &png[at + 4..at + 8] == b"IDAT" {
            found.extend_from_slice(&png[at + 8..at + 8 + length]);
        }
        at += 12 + length;
    }
    assert!(!found.is_empty(), "a PNG has pixels");
    found
}

#[test]
fn a_served_picture_is_the_one_that_render_draws() {
    let bench = Bench::new();
    bench.ok(&format!("convert {} -o tooth.octavo", sample("tooth.nii.gz")));
    let camera = r#"{"projection":"perspective","position":[250,-60,-90],"target":[51,47,80],"up":[0,-1,0],"fov_y_deg":30}"#;
    bench.write("eye.json", camera.as_bytes());
    bench.ok("render tooth.octavo -o eye.png --size 120x90 --camera eye.json --backend cpu");
    let server = Serving::new(&bench, "tooth.octavo --renderer cpu");
    let body = format!(r#"{{"camera":{camera},"size":[120,90],"step":0.5,"seconds":20}}"#);
    let address = server.base.trim_start_matches("http://");
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    let head = format!(
        "POST /v1/tooth/render HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-length: {}\r\n\r\n",
        body.len()
    );
    std::io::Write::write_all(&mut stream, (head + &body).as_bytes()).unwrap();
    let mut reply = Vec::new();
    std::io::Read::read_to_end(&mut stream, &mut reply).unwrap();
    let end = reply.windows(4).position(|bytes| bytes == b"\r\n\r\n").unwrap();
    let head = String::from_utf8_lossy(&reply[..end]).to_lowercase();
    assert!(
        head.starts_with("http/1.1 200") && head.contains("x-octavo-converged: true"),
        "{head}"
    );
    let own = std::fs::read(bench.path("eye.png")).unwrap();
    assert!(pixels(&reply[end + 4..]) == pixels(&own), "the same pixels");
}

/// What a server answers on a connection that stays open: the status, and the body.
fn ask(stream: &mut BufReader<TcpStream>, path: &str) -> (String, Vec<u8>) {
    write!(stream.get_mut(), "GET {path} HTTP/1.1\r\nhost: a\r\n\r\n").unwrap();
    let mut lines = Vec::new();
    while lines.last().is_none_or(|line: &String| line != "\r\n") {
        let mut line = String::new();
        assert!(stream.read_line(&mut line).unwrap() > 0, "the connection ended");
        lines.push(line);
    }
    let length = lines.iter().find_map(|line| line.strip_prefix("content-length: ")).unwrap();
    let mut body = vec![0; length.trim().parse().unwrap()];
    stream.read_exact(&mut body).unwrap();
    (lines[0].split(' ').nth(1).unwrap().to_owned(), body)
}

#[test]
fn a_brick_that_was_dropped_has_the_store_s_value_for_it_in_samples_and_frames() {
    let bench = Bench::new();
    let raw: Vec<u8> = (0..40 * 33 * 20).flat_map(|_| (-900_i16).to_le_bytes()).collect();
    bench.write("low.raw", &raw);
    bench.ok("convert low.raw --dims 40,33,20 --dtype i16 --empty-below -500");
    let info = bench.ok("info low.octavo --json").json();
    let value = i16::try_from(info["empty_value"].as_i64().unwrap()).unwrap();
    assert_ne!(value, 0, "another value than what stands everywhere");
    let server = Serving::new(&bench, "low.octavo --renderer none");
    let address = server.base.trim_start_matches("http://");
    let mut stream = BufReader::new(TcpStream::connect(address).unwrap());
    let (status, samples) = ask(&mut stream, "/v1/low/bricks/0/0/0/0");
    assert_eq!((status.as_str(), samples.len()), ("200", 2 * 36 * 36 * 36));
    assert!(samples.chunks(2).all(|sample| sample == value.to_le_bytes()));
    let body = r#"{"keys":[[0,0,0,0]]}"#;
    write!(
        stream.get_mut(),
        "POST /v1/low/bricks HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .unwrap();
    let mut reply = Vec::new();
    stream.read_to_end(&mut reply).unwrap();
    // The frame: key 0, empty, no body, the value twice.
    let mut frame = vec![0; 8];
    frame.extend_from_slice(&[3, 0, 0, 0, 0, 0, 0, 0]);
    frame.extend_from_slice(&[f64::from(value).to_le_bytes(); 2].concat());
    assert!(reply.windows(frame.len()).any(|window| window == frame), "{reply:?}");
}

#[test]
fn a_server_without_a_file_to_spare_keeps_what_it_knows_and_looks_again_later() {
    let bench = Bench::new();
    bench.scan("a.raw");
    std::fs::create_dir(bench.path("folder")).unwrap();
    bench.ok("convert a.raw --dims 40,33,20 --dtype u16 -o folder/a.octavo");
    bench.ok("convert a.raw --dims 40,33,20 --dtype u16 -o b.octavo");
    bench.ok("convert a.raw --dims 40,33,20 --dtype u16 --brick 8 -o other.octavo");
    let server = Serving::new(&bench, "folder b.octavo --rescan 0.1 --renderer none");
    let address = server.base.trim_start_matches("http://");
    let mut stream = BufReader::new(TcpStream::connect(address).unwrap());
    let (status, before) = ask(&mut stream, "/v1/a/info");
    assert_eq!((status.as_str(), ask(&mut stream, "/v1/b/info").0.as_str()), ("200", "200"));
    let pid = Pid::from_child(&server.child);
    let files = |current| Rlimit { current, ..getrlimit(Resource::Nofile) };
    let all = prlimit(Some(pid), Resource::Nofile, files(Some(3))).unwrap();
    // It can look at no folder and open no store; several looks long.
    std::fs::rename(bench.path("other.octavo"), bench.path("b.octavo")).unwrap();
    let began = Instant::now();
    let mut refused = false;
    while began.elapsed() < Duration::from_millis(600) || !refused {
        assert_eq!(ask(&mut stream, "/v1/a/info"), ("200".to_owned(), before.clone()));
        refused = ask(&mut stream, "/v1/b/info").0 == "500";
        assert!(began.elapsed() < Duration::from_secs(30), "it was replaced");
        std::thread::sleep(Duration::from_millis(20));
    }
    prlimit(Some(pid), Resource::Nofile, all).unwrap();
    while ask(&mut stream, "/v1/b/info").0 != "200" {
        assert!(began.elapsed() < Duration::from_mins(1), "it can be opened again");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn more_connections_than_files_leave_room_for_stores_and_for_who_asks() {
    let bench = Bench::new();
    bench.scan("a.raw");
    bench.ok("convert a.raw --dims 40,33,20 --dtype u16");
    let mut server = Serving::limited(&bench, "a.octavo --rescan 0.1 --renderer none", 200);
    let address = server.base.trim_start_matches("http://").to_owned();
    let mut stream = BufReader::new(TcpStream::connect(&address).unwrap());
    let silent: Vec<TcpStream> = (0..300).map(|_| TcpStream::connect(&address).unwrap()).collect();
    let began = Instant::now();
    while began.elapsed() < Duration::from_millis(500) {
        assert_eq!(ask(&mut stream, "/v1/a/bricks/0/0/0/0").0, "200");
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(silent);
    server.interrupt();
    assert_eq!(server.child.wait().unwrap().code(), Some(0));
    let log = std::io::read_to_string(server.child.stderr.take().unwrap()).unwrap();
    assert!(log.contains("\"connections\":104") && !log.contains("could not be accepted"), "{log}");
}

#[test]
fn a_picture_whose_client_left_makes_room_for_others() {
    let bench = Bench::new();
    bench.ok(&format!("convert {} -o tooth.octavo", sample("tooth.nii.gz")));
    let server = Serving::new(&bench, "tooth.octavo --renderer cpu");
    let address = server.base.trim_start_matches("http://");
    let draw = |more: &str| {
        let camera = r#"{"projection":"perspective","position":[250,-60,-90],"target":[51,47,80],"up":[0,-1,0],"fov_y_deg":30}"#;
        let body = format!(r#"{{"camera":{camera},{more}}}"#);
        let mut stream = TcpStream::connect(address).unwrap();
        write!(
            stream,
            "POST /v1/tooth/render HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-length: {}\r\n\r\n{body}",
            body.len()
        )
        .unwrap();
        stream
    };
    // Minutes of work.
    let left = draw(r#""size":[2048,2048],"step":0.1,"accuracy":0.1"#);
    std::thread::sleep(Duration::from_millis(1500));
    let drawn = || {
        let mut reply = Vec::new();
        let _ = draw(r#""size":[32,32],"accuracy":4"#).read_to_end(&mut reply);
        reply.starts_with(b"HTTP/1.1 200")
    };
    assert!(!drawn(), "one picture at a time");
    drop(left);
    let began = Instant::now();
    while !drawn() {
        assert!(began.elapsed() < Duration::from_secs(30), "it is still being drawn");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_camera_out_of_all_scale_is_drawn_or_the_clients_to_change() {
    let bench = Bench::new();
    bench.scan("a.raw");
    bench.ok("convert a.raw --dims 40,33,20 --dtype u16");
    let server = Serving::new(&bench, "a.octavo --renderer cpu");
    let orthographic = |height: &str| {
        format!(
            r#"{{"projection":"orthographic","position":[20,16,-40],"target":[20,16,10],"up":[0,-1,0],"height":{height}}}"#
        )
    };
    // Of directions whose squares no f32 holds, until they are made shorter.
    let matrix = r#"{"projection":"matrix","clip_from_world":[[1,10,0,0],[1,1,0,0],[5,0,1,0],[0,0,3e-22,0]]}"#;
    for (camera, status) in
        [(orthographic("1e300"), "400"), (matrix.to_owned(), "200"), (orthographic("50"), "200")]
    {
        let body = format!(r#"{{"camera":{camera},"size":[16,16]}}"#);
        let mut stream = TcpStream::connect(server.base.trim_start_matches("http://")).unwrap();
        let length = body.len();
        write!(
            stream,
            "POST /v1/a/render HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n{body}"
        )
        .unwrap();
        let mut reply = Vec::new();
        stream.read_to_end(&mut reply).unwrap();
        let line = format!("HTTP/1.1 {status}");
        assert!(reply.starts_with(line.as_bytes()), "{}", String::from_utf8_lossy(&reply));
    }
}

#[test]
fn files_that_are_passed_over_are_told_once() {
    let bench = Bench::new();
    bench.scan("a.raw");
    for folder in ["one", "two"] {
        std::fs::create_dir(bench.path(folder)).unwrap();
        bench.ok(&format!("convert a.raw --dims 40,33,20 --dtype u16 -o {folder}/a.octavo"));
    }
    let odd = std::ffi::OsStr::from_bytes(b"odd\xff.octavo");
    std::fs::copy(bench.path("one/a.octavo"), bench.path("one").join(odd)).unwrap();
    std::fs::copy(bench.path("one/a.octavo"), bench.path("one/new\nline.octavo")).unwrap();
    let mut server = Serving::new(&bench, "one two --rescan 0.1 --renderer none");
    let mut lines = [String::new(), String::new()];
    for line in &mut lines {
        server.said.read_line(line).unwrap();
    }
    assert!(
        lines[0].starts_with("a: https://") && lines[1].starts_with("new\u{fffd}line: https://")
    );
    std::thread::sleep(Duration::from_millis(500));
    server.interrupt();
    assert_eq!(server.child.wait().unwrap().code(), Some(0));
    let log = std::io::read_to_string(server.child.stderr.take().unwrap()).unwrap();
    let told = |what: &str| log.lines().filter(|line| line.contains(what)).count();
    assert_eq!((told("has its name"), told("no UTF-8")), (1, 1), "{log}");
}

#[test]
fn what_it_cannot_do_is_said_with_the_right_exit_code() {
    let bench = Bench::new();
    let open = bench.run("serve . --bind 0.0.0.0:0");
    assert_eq!(open.code, 2);
    assert!(open.err.contains("--insecure-no-token"), "{}", open.err);
    assert_eq!(bench.run("serve nothing.octavo").code, 2);
    assert_eq!(bench.run("serve . --token-file nothing.txt").code, 2);
    bench.write("token.txt", b"short");
    assert_eq!(bench.run("serve . --token-file token.txt").code, 2);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let said = bench.run(&format!("serve . --bind {}", taken.local_addr().unwrap()));
    assert_eq!(said.code, 3, "{}", said.err);
}

#[test]
fn every_level_is_the_source_s_pyramid_through_every_client() {
    let bench = Bench::new();
    let tooth = sample("tooth.nii.gz");
    bench.ok(&format!("convert {tooth} -o tooth.octavo --encoding lossless"));
    bench.ok("extract tooth.octavo -o tooth.raw");
    // Signed, odd in every dimension, anisotropic.
    let noise: Vec<u8> =
        (0..2 * 71 * 45 * 38_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 21) as u8).collect();
    bench.write("odd.raw", &noise);
    bench.ok("convert odd.raw --dims 71,45,38 --dtype i16 --encoding lossless --spacing 0.5,0.5,2 --unit um");
    let server = Serving::new(&bench, ".");
    let path = |name: &str| bench.path(name).display().to_string();
    let tooth = path("tooth.raw");
    clients("volumes.py", &[&server.base, "tooth", &tooth, "103,94,161", "uint16", "1e6,1e6,1e6"]);
    clients(
        "volumes.py",
        &[&server.base, "odd", &path("odd.raw"), "71,45,38", "int16", "500,500,2000"],
    );
    for dataset in ["tooth", "odd"] {
        clients("metadata.py", &[&server.base, dataset]);
    }
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/cut.py");
    let example = example.display().to_string();
    clients(&example, &[&server.base, "tooth"]);
    let dims = "103,94,161";
    clients("example.py", &[&server.base, "tooth", &example, &tooth, dims, "uint16"]);
}

#[test]
fn a_hot_cube_lies_at_one_place_of_the_world_in_every_client_at_every_level() {
    let bench = Bench::new();
    let hot = [16..24_u32, 8..16, 24..32];
    let mut volume = Vec::new();
    for z in 0..39 {
        for y in 0..37 {
            for x in 0..45 {
                let inside = hot.iter().zip([x, y, z]).all(|(span, at)| span.contains(&at));
                volume.extend_from_slice(&(if inside { 40_000_u16 } else { 0 }).to_le_bytes());
            }
        }
    }
    bench.write("hot.raw", &volume);
    bench.ok("convert hot.raw --dims 45,37,39 --dtype u16 --encoding lossless --spacing 0.5,1,2 --unit um --brick 8");
    let server = Serving::new(&bench, "hot.octavo");
    clients("hot.py", &[&server.base, "hot", "10000,12000,56000"]);
}

#[test]
fn codes_and_packed_chunks_are_read_by_clients_that_others_wrote() {
    let bench = Bench::new();
    bench.scan("scan.raw");
    let convert =
        |rest: &str| bench.ok(&format!("convert scan.raw --dims 40,33,20 --dtype u16 {rest}"));
    // Noise, which no compressor gains on, and what one does gain on.
    let noise: Vec<u8> =
        (0..2 * 40 * 33 * 33_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 21) as u8).collect();
    bench.write("noise.raw", &noise);
    bench.ok("convert noise.raw --dims 40,33,33 --dtype i16 --encoding lossless");
    convert("-o whole.octavo --encoding lossless");
    convert("-o eight.octavo");
    convert("-o bounded.octavo --encoding max-error=40");
    convert("-o lattice.octavo --encoding max-error=3 --overlap-at-rest assembled");
    let noise = bench.path("noise.raw").display().to_string();
    let packed = Serving::new(&bench, ". --compressor zstd");
    clients("codes.py", &[&packed.base, "whole", "lattice"]);
    let packed = Serving::new(&bench, ". --compressor blosc-lz4");
    let base = packed.base.as_str();
    clients("volumes.py", &[base, "noise", &noise, "40,33,33", "int16", "1e6,1e6,1e6"]);
    clients("codes.py", &[base, "whole", "eight", "bounded"]);
}

/// Neuroglancer, niivue and the page in a browser; `tests/run.sh` installs them.
#[test]
fn browsers_show_what_the_source_has() {
    let bench = Bench::new();
    let tooth = sample("tooth.nii.gz");
    bench.ok(&format!("convert {tooth} -o tooth.octavo --encoding lossless"));
    bench.ok("extract tooth.octavo -o tooth.raw");
    let mut server = Serving::new(&bench, "tooth.octavo");
    let mut line = String::new();
    server.said.read_line(&mut line).unwrap();
    let link = line.trim().strip_prefix("tooth: ").unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let browser = std::env::var("OCTAVO_TEST_VIEWERS")
        .map_or_else(|_| root.join("target/browser"), Into::into);
    let raw = bench.path("tooth.raw").display().to_string();
    let shots = bench.folder().display().to_string();
    for arguments in [
        vec!["page.mjs", &server.base, "tooth", &shots],
        vec!["viewers.mjs", &server.base, "tooth", &raw, "103,94,161", "dist", link],
    ] {
        let output = Command::new("node").args(&arguments).current_dir(&browser).output().unwrap();
        assert!(
            output.status.success(),
            "{arguments:?} (run by 'bash tests/run.sh', which installs its viewers): {}{}",
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        );
    }
}
