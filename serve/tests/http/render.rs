//! Pictures: what is asked reaches the renderer, one at a time.

use crate::support::{Running, Volume, noise, options};
use octree_store::{Encoding, Store};
use serve::{Options, Picture, RenderError, RenderRequest, Renderer};
use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const CAMERA: &str = r#"{"projection":"orthographic","position":[1,1,-9],"target":[1,1,1],"up":[0,-1,0],"height":9}"#;

/// Notes what it is asked, and draws when it is told to.
struct Told {
    asked: Mutex<SyncSender<RenderRequest>>,
    go: Mutex<Receiver<Result<Picture, RenderError>>>,
}

impl Renderer for Told {
    fn render(&self, store: &Store, request: &RenderRequest) -> Result<Picture, RenderError> {
        assert_eq!(store.geometry().dims_xyz(), [20, 9, 9]);
        self.asked.lock().unwrap().send(request.clone()).unwrap();
        let said = self.go.try_lock().unwrap().recv().unwrap();
        assert!(
            !said.as_ref().is_ok_and(|picture| picture.bytes.is_empty()),
            "the bug that was asked for"
        );
        said
    }
}

struct Bench {
    _folder: tempfile::TempDir,
    server: Running,
    asked: Receiver<RenderRequest>,
    go: SyncSender<Result<Picture, RenderError>>,
}

fn bench() -> Bench {
    bench_with(|_| {})
}

fn bench_with(change: impl FnOnce(&mut Options)) -> Bench {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([20, 9, 9], 8, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let ((tell, asked), (go, told)) = (sync_channel(4), sync_channel(4));
    let renderer = Told { asked: Mutex::new(tell), go: Mutex::new(told) };
    let mut options = options(folder.path());
    change(&mut options);
    let server = Running::drawing(options, Some(Arc::new(renderer)));
    Bench { _folder: folder, server, asked, go }
}

fn picture(text: &str, converged: bool) -> Picture {
    Picture { bytes: text.as_bytes().to_vec(), content_type: "image/png", converged }
}

fn body(more: &str) -> String {
    format!(r#"{{"camera":{CAMERA},"size":[7,5]{more}}}"#)
}

#[test]
fn what_is_asked_reaches_the_renderer_and_its_picture_the_client() {
    let Bench { server, asked, go, .. } = &bench();
    go.send(Ok(picture("one", false))).unwrap();
    let reply = server.post("/v1/v/render", &body(""));
    assert_eq!((reply.status, &*reply.body), (200, &b"one"[..]));
    assert_eq!(reply.header("content-type"), "image/png");
    assert_eq!(reply.header("x-octavo-converged"), "false");
    assert_eq!(reply.header("cache-control"), "no-store");
    let request = asked.recv().unwrap();
    assert_eq!((request.view.size, request.accuracy, request.step_voxels), ([7, 5], 1.0, 1.0));
    assert_eq!((request.transfer, request.at_most), (None, Duration::from_secs(10)));

    go.send(Ok(picture("two", true))).unwrap();
    let transfer = r#"{"points":[{"value":0,"color":[0,0,0],"extinction":1}]}"#;
    let more = format!(r#","accuracy":2,"step":0.5,"seconds":0,"transfer":{transfer}"#);
    let reply = server.post("/v1/v/render", &body(&more));
    assert_eq!((&*reply.body, reply.header("x-octavo-converged")), (&b"two"[..], "true"));
    let request = asked.recv().unwrap();
    assert_eq!(
        (request.accuracy, request.step_voxels, request.at_most),
        (2.0, 0.5, Duration::ZERO)
    );
    assert_eq!(request.transfer.unwrap().points().len(), 1);
}

#[test]
fn one_picture_is_drawn_at_a_time_and_bricks_are_served_meanwhile() {
    let Bench { server, asked, go, .. } = &bench();
    std::thread::scope(|scope| {
        let first = scope.spawn(|| server.post("/v1/v/render", &body("")));
        asked.recv().unwrap();
        let second = server.post("/v1/v/render", &body(""));
        second.assert_problem(503);
        assert_eq!(second.header("retry-after"), "1");
        assert_eq!(server.get("/v1/v/bricks/0/1/0/0").status, 200);
        go.send(Ok(picture("late", true))).unwrap();
        assert_eq!(first.join().unwrap().status, 200);
    });
    go.send(Ok(picture("next", true))).unwrap();
    assert_eq!(server.post("/v1/v/render", &body("")).status, 200);
}

#[test]
fn a_picture_that_nobody_waits_for_is_given_up() {
    let given_up = |request: &RenderRequest| {
        let began = Instant::now();
        while !request.given_up.load(Ordering::Relaxed) {
            assert!(began.elapsed() < Duration::from_secs(20), "it is still wanted");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    let Bench { server, asked, go, .. } = &bench();
    let mut stream = TcpStream::connect(server.address).unwrap();
    let body = body("");
    write!(
        stream,
        "POST /v1/v/render HTTP/1.1\r\nhost: a\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .unwrap();
    let request = asked.recv().unwrap();
    assert!(!request.given_up.load(Ordering::Relaxed));
    drop(stream);
    given_up(&request);
    go.send(Ok(picture("late", true))).unwrap();

    let limits = |options: &mut Options| options.limits.request_time = Duration::from_millis(200);
    let Bench { server, asked, go, .. } = &bench_with(limits);
    server.post("/v1/v/render", &body).assert_problem(408);
    given_up(&asked.recv().unwrap());
    go.send(Ok(picture("late", true))).unwrap();
}

#[test]
fn a_renderer_that_fails_or_panics_harms_one_request() {
    let Bench { server, go, .. } = &bench();
    go.send(Err(RenderError::Failed("the device is lost".into()))).unwrap();
    let reply = server.post("/v1/v/render", &body(""));
    reply.assert_problem(500);
    assert!(reply.json()["detail"].as_str().unwrap().contains("device is lost"));
    // What cannot be drawn is the client's to change.
    go.send(Err(RenderError::Request("out of all scale".into()))).unwrap();
    let reply = server.post("/v1/v/render", &body(""));
    reply.assert_problem(400);
    assert!(reply.json()["detail"].as_str().unwrap().contains("out of all scale"));
    go.send(Ok(picture("", true))).unwrap();
    server.post("/v1/v/render", &body("")).assert_problem(500);
}

#[test]
fn pictures_that_cannot_be_are_refused_before_anything_is_drawn() {
    let Bench { server, asked, .. } = &bench();
    for (more, size) in [
        (r#","accuracy":0"#, "[7,5]"),
        (r#","accuracy":1e300"#, "[7,5]"),
        (r#","step":0.01"#, "[7,5]"),
        (r#","step":-1"#, "[7,5]"),
        (r#","seconds":20.5"#, "[7,5]"),
        (r#","seconds":-1"#, "[7,5]"),
        (r#","speed":1"#, "[7,5]"),
        (r#","transfer":{"points":[]}"#, "[7,5]"),
        ("", "[0,5]"),
        ("", "[4294967295,4294967295]"),
        ("", "[4096,1025]"),
        ("", "[7]"),
    ] {
        let body = body(more).replace("[7,5]", size);
        server.post("/v1/v/render", &body).assert_problem(400);
    }
    server.post("/v1/none/render", &body("")).assert_problem(404);
    assert!(asked.try_recv().is_err());
}
