//! Clients that are slow, or take nothing, while another is served.

use crate::support::{
    Running, Volume, ask_and_take_nothing, connect, folder, noise, options, rest, runtime,
};
use octree_store::Encoding;
use serde_json::json;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

const BRICK: &str = "/v1/v/bricks/0/1/0/0";

#[test]
fn a_slow_head_is_cut_off_while_others_are_served() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.head_time = Duration::from_millis(600);
    let server = Running::new(options);
    let began = Instant::now();
    // Nothing at all, the beginning of HTTP/2, and a head that never ends.
    let starts: [&[u8]; 4] =
        [b"", b"P", b"PRI * HTTP/2.0\r\n", b"GET / HTTP/1.1\r\nhost: a\r\nx-slow: "];
    let streams: Vec<TcpStream> = starts
        .into_iter()
        .flat_map(|start| std::iter::repeat_n(start, 8))
        .map(|start| {
            let mut stream = connect(&server);
            stream.write_all(start).unwrap();
            stream
        })
        .collect();
    for _ in 0..20 {
        assert_eq!(server.get(BRICK).status, 200);
        for mut stream in &streams[24..] {
            let _ = stream.write_all(b"a");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    for stream in streams {
        let said = rest(stream);
        assert!(said.is_empty() || said.contains(" 408 "), "{said}");
    }
    assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
}

#[test]
fn a_slow_body_times_out() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.request_time = Duration::from_millis(300);
    let server = Running::new(options);
    let mut stream = connect(&server);
    stream.write_all(b"POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\ncontent-length: 100\r\nconnection: close\r\n\r\n{").unwrap();
    assert!(rest(stream).starts_with("HTTP/1.1 408"));
}

#[test]
fn a_client_that_takes_nothing_is_dropped() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([64, 64, 64], 32, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let mut options = options(folder.path());
    options.limits.stall_time = Duration::from_millis(500);
    options.limits.streams = 1;
    let server = Running::new(options);
    let body = json!({"keys": vec![[0, 0, 0, 0]; 10_000]}).to_string();
    let mut stream = connect(&server);
    write!(
        stream,
        "POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .unwrap();
    std::thread::sleep(Duration::from_millis(200));
    // The only stream is taken; one who wants another is told to come again.
    let refused = server.post("/v1/v/bricks", r#"{"keys":[[0,0,0,0]]}"#);
    refused.assert_problem(503);
    assert_eq!(refused.header("retry-after"), "1");
    let began = Instant::now();
    while server.post("/v1/v/bricks", r#"{"keys":[[0,0,0,0]]}"#).status != 200 {
        assert!(began.elapsed() < Duration::from_secs(20), "the stalled stream is still there");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_stream_of_which_an_http_2_client_takes_nothing_gives_way() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.stall_time = Duration::from_millis(400);
    options.limits.streams = 1;
    let server = Running::new(options);
    let runtime = runtime();
    let keys = r#"{"keys":[[0,0,0,0],[0,1,0,0]]}"#;
    let (_, kept) =
        runtime.block_on(ask_and_take_nothing(&server, "POST", "/v1/v/bricks", keys, 1));
    server.post("/v1/v/bricks", keys).assert_problem(503);
    let began = Instant::now();
    while server.post("/v1/v/bricks", keys).status != 200 {
        assert!(began.elapsed() < Duration::from_secs(20), "the stalled stream is still there");
        std::thread::sleep(Duration::from_millis(20));
    }
    // Its connection was closed.
    runtime.block_on(kept).unwrap();
}

#[test]
fn a_stalled_stream_gives_way_to_one_who_asks_before_its_time_is_over() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.streams = 1;
    let server = Running::new(options);
    let keys = r#"{"keys":[[0,0,0,0],[0,1,0,0]]}"#;
    let runtime = runtime();
    let (_, _kept) =
        runtime.block_on(ask_and_take_nothing(&server, "POST", "/v1/v/bricks", keys, 1));
    let began = Instant::now();
    while server.post("/v1/v/bricks", keys).status != 200 {
        assert!(began.elapsed() < Duration::from_secs(15), "the stalled stream is still there");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn connections_that_ask_nothing_give_way_to_others_and_end_in_their_time() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.connections = 3;
    let server = Running::new(options.clone());
    let mut silent: Vec<TcpStream> = (0..3).map(|_| connect(&server)).collect();
    silent[1].write_all(b"GET / HTTP/1.1\r\nhost: a\r\nx-slow: ").unwrap();
    silent[2].write_all(b"GET /healthz HTTP/1.1\r\nhost: a\r\n\r\n").unwrap();
    let served = |server: &Running| {
        let mut stream = connect(server);
        let _ = stream.write_all(b"GET /healthz HTTP/1.1\r\nhost: a\r\nconnection: close\r\n\r\n");
        rest(stream).starts_with("HTTP/1.1 200")
    };
    let began = Instant::now();
    while !served(&server) {
        // Long before the time in which a head must come.
        assert!(began.elapsed() < Duration::from_secs(15), "silent connections keep their places");
        std::thread::sleep(Duration::from_millis(50));
    }

    // One of HTTP/2 that asks nothing, though it answers pings.
    options.limits.head_time = Duration::from_millis(400);
    let server = Running::new(options);
    runtime().block_on(async {
        let stream = tokio::net::TcpStream::connect(server.address).await.unwrap();
        let (_client, connection) = h2::client::handshake(stream).await.unwrap();
        let ended = tokio::time::timeout(Duration::from_secs(15), connection).await;
        assert!(ended.is_ok(), "an idle connection is still open");
    });
}

#[test]
fn a_stream_that_is_taken_is_not_idle_however_long_it_is() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([64, 64, 64], 32, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let mut options = options(folder.path());
    options.limits.head_time = Duration::from_millis(200);
    let server = Running::new(options);
    let body = json!({"keys": vec![[0, 1, 1, 1]; 400]}).to_string();
    let mut stream = connect(&server);
    write!(
        stream,
        "POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .unwrap();
    let (mut all, mut part) = (Vec::new(), vec![0; 2 << 20]);
    loop {
        let count = stream.read(&mut part).unwrap();
        all.extend_from_slice(&part[..count]);
        if count == 0 {
            break;
        }
        // Some forty times.
        if all.len() % 3 == 0 {
            std::thread::sleep(Duration::from_millis(30));
        }
    }
    assert!(all.ends_with(b"\r\n0\r\n\r\n") && all.len() > 400 * 2 * 36 * 36 * 36);
}

#[test]
fn answers_that_are_not_taken_have_bounded_room_and_give_way_to_others() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([64, 64, 64], 32, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let mut options = options(folder.path());
    // Ten bricks of 36^3 samples.
    options.limits.answer_bytes = 10 * 2 * 36 * 36 * 36 + 10 * 1024;
    let server = Running::new(options);
    let runtime = runtime();
    let (refused, kept) = runtime.block_on(ask_and_take_nothing(&server, "GET", BRICK, "", 15));
    assert_eq!(refused, 5);
    let said = server.get(BRICK);
    said.assert_problem(503);
    assert_eq!((said.header("retry-after"), server.get("/readyz").status), ("1", 200));
    let began = Instant::now();
    while server.get(BRICK).status != 200 {
        // Long before the stalled answers' own time is over.
        assert!(began.elapsed() < Duration::from_secs(15), "the stalled answers are still there");
        std::thread::sleep(Duration::from_millis(50));
    }
    runtime.block_on(kept).unwrap();
}

#[test]
fn bodies_that_do_not_end_have_bounded_room_and_harm_no_other_requests() {
    let folder = folder();
    let mut options = options(folder.path());
    // Three of a million bytes, in kibibytes.
    options.limits.all_body_bytes = 3 * 977 * 1024;
    options.limits.request_time = Duration::from_secs(5);
    let server = Running::new(options);
    let slow: Vec<TcpStream> = (0..6)
        .map(|_| {
            let mut stream = connect(&server);
            stream.write_all(b"POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\ncontent-length: 1000000\r\nconnection: close\r\n\r\n{").unwrap();
            stream
        })
        .collect();
    std::thread::sleep(Duration::from_millis(300));
    server.post("/v1/v/bricks", r#"{"keys":[[0,0,0,0]]}"#).assert_problem(503);
    assert_eq!(server.get(BRICK).status, 200);
    let said: Vec<String> = slow.into_iter().map(rest).collect();
    let refused = said.iter().filter(|said| said.starts_with("HTTP/1.1 503")).count();
    let late = said.iter().filter(|said| said.starts_with("HTTP/1.1 408")).count();
    assert_eq!((refused, late), (3, 3), "{said:?}");
    assert_eq!(server.post("/v1/v/bricks", r#"{"keys":[[0,0,0,0]]}"#).status, 200);
}

#[test]
fn a_stream_ends_when_its_time_is_over_and_says_so_by_its_length() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.stream_time = Duration::ZERO;
    let server = Running::new(options);
    let reply = server.post("/v1/v/bricks", r#"{"keys":[[0,0,0,0],[0,1,0,0]]}"#);
    assert_eq!(reply.status, 200);
    assert!(reply.body.len() < 16 + 2 * 32, "frames came after the time");
}

#[test]
fn a_long_answer_may_take_longer_than_a_client_may_stall() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([64, 64, 64], 64, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let mut options = options(folder.path());
    options.limits.stall_time = Duration::from_millis(400);
    let server = Running::new(options);
    runtime().block_on(async {
        let stream = tokio::net::TcpStream::connect(server.address).await.unwrap();
        let (client, connection) = h2::client::handshake(stream).await.unwrap();
        tokio::spawn(connection);
        let uri = format!("http://{}/v1/v/bricks/0/0/0/0", server.address);
        let request = http::Request::get(uri).body(()).unwrap();
        let (answer, _) = client.ready().await.unwrap().send_request(request, true).unwrap();
        let (mut body, mut length) = (answer.await.unwrap().into_body(), 0);
        // About 300 KiB a second, for two seconds.
        while let Some(part) = body.data().await {
            let part = part.expect("it is taken fast enough");
            length += part.len();
            tokio::time::sleep(Duration::from_secs_f64(part.len() as f64 / 300e3)).await;
            body.flow_control().release_capacity(part.len()).unwrap();
        }
        assert_eq!(length, 2 * 68 * 68 * 68);
    });
}
