//! How much a client can ask for, while another is served.

use crate::support::{Running, Volume, connect, folder, noise, options, rest, runtime};
use octree_store::Encoding;
use serde_json::json;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

const BRICK: &str = "/v1/v/bricks/0/1/0/0";

#[test]
fn a_body_of_ten_gigabytes_is_refused_before_it_comes() {
    let folder = folder();
    let server = Running::over(folder.path());
    let mut stream = connect(&server);
    stream
        .write_all(b"POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\ncontent-length: 10000000000\r\n\r\n{")
        .unwrap();
    let mut head = [0; 12];
    stream.read_exact(&mut head).unwrap();
    assert_eq!(&head, b"HTTP/1.1 413");
    // One that does not say how long it is, is cut off at the limit.
    let mut stream = connect(&server);
    stream
        .write_all(b"POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\ntransfer-encoding: chunked\r\n\r\n")
        .unwrap();
    let chunk = [b"10000\r\n".to_vec(), vec![b' '; 65_536], b"\r\n".to_vec()].concat();
    let mut sent = 0_u64;
    while sent < 64 << 20 && stream.write_all(&chunk).is_ok() {
        sent += 65_536;
    }
    assert!(sent < 32 << 20, "{sent} bytes of a body were taken");
    assert_eq!(server.get(BRICK).status, 200);
}

#[test]
fn a_body_over_http_2_is_refused_before_it_comes() {
    let folder = folder();
    let server = Running::over(folder.path());
    runtime().block_on(async {
        let stream = tokio::net::TcpStream::connect(server.address).await.unwrap();
        let (client, connection) = h2::client::handshake(stream).await.unwrap();
        tokio::spawn(connection);
        let uri = format!("http://{}/v1/v/bricks", server.address);
        let request =
            http::Request::post(uri).header("content-length", "3000000").body(()).unwrap();
        let (answer, mut body) =
            client.ready().await.unwrap().send_request(request, false).unwrap();
        // It may have been refused already.
        let _ = body.send_data(bytes::Bytes::from_static(b"{"), false);
        assert_eq!(answer.await.unwrap().status().as_u16(), 413);
    });
}

#[test]
fn a_list_of_a_hundred_thousand_keys_is_refused() {
    let folder = folder();
    let server = Running::over(folder.path());
    let keys = vec![[0, 0, 0, 0]; 100_000];
    server.post("/v1/v/bricks", &json!({"keys": keys}).to_string()).assert_problem(413);
    let camera = json!({"projection":"orthographic","position":[1,1,-9],"target":[1,1,1],"up":[0,-1,0],"height":9});
    let cut = json!({"cameras": [camera], "size": [9, 9], "have": keys[..20_000]});
    server.post("/v1/v/cut", &cut.to_string()).assert_problem(413);
    server.get("/v1/v/nodes?level=0&count=100000").assert_problem(413);
    server.get("/v1/v/nodes?level=0&count=5000&format=json").assert_problem(413);
    assert_eq!(server.get("/v1/v/nodes?level=0&count=5000").status, 200);
    assert_eq!(server.post("/v1/v/bricks", &json!({"keys": keys[..1000]}).to_string()).status, 200);
}

#[test]
fn a_slice_of_too_many_samples_is_refused() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.slice_samples = 100;
    let server = Running::new(options);
    server.get("/v1/v/slices/z/0").assert_problem(413);
    assert_eq!(server.get("/v1/v/slices/x/0").body.len(), 2 * 81);
    assert_eq!(server.get("/v1/v/slices/z/0?level=1").body.len(), 2 * 50);
}

#[test]
fn requests_at_once_are_bounded_and_health_is_told_all_the_same() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.requests = 2;
    options.limits.request_time = Duration::from_secs(2);
    let server = Running::new(options);
    let _open: Vec<TcpStream> = (0..2)
        .map(|_| {
            let mut stream = connect(&server);
            stream
                .write_all(b"POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\ncontent-length: 100\r\n\r\n{")
                .unwrap();
            stream
        })
        .collect();
    std::thread::sleep(Duration::from_millis(200));
    server.get(BRICK).assert_problem(503);
    assert_eq!((server.get("/healthz").status, server.get("/readyz").status), (200, 200));
    let began = Instant::now();
    while server.get(BRICK).status != 200 {
        assert!(began.elapsed() < Duration::from_secs(20), "requests that ended still count");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn connections_over_the_limit_are_told_to_come_again() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.connections = 3;
    let server = Running::new(options);
    let held: Vec<TcpStream> = (0..3).map(|_| connect(&server)).collect();
    std::thread::sleep(Duration::from_millis(200));
    let said = rest(connect(&server));
    assert!(said.starts_with("HTTP/1.1 503") && said.contains("retry-after: 1"), "{said}");
    let (head, body) = said.split_once("\r\n\r\n").unwrap();
    assert!(head.contains(&format!("content-length: {}", body.len())));
    serde_json::from_str::<serde_json::Value>(body).unwrap();
    drop(held);
    let began = Instant::now();
    loop {
        let mut stream = connect(&server);
        write!(stream, "GET /healthz HTTP/1.1\r\nhost: a\r\nconnection: close\r\n\r\n").unwrap();
        if rest(stream).starts_with("HTTP/1.1 200") {
            break;
        }
        assert!(began.elapsed() < Duration::from_secs(20), "room that was given back is not used");
        std::thread::sleep(Duration::from_millis(20));
    }
    let metrics = String::from_utf8(server.get("/metrics").body).unwrap();
    let refused = "octavo_refused_connections_total ";
    let refused = metrics.lines().find_map(|line| line.strip_prefix(refused)).unwrap();
    assert!(refused.parse::<u32>().unwrap() > 0);
}

#[test]
fn heads_that_are_too_long_and_requests_that_are_none_are_refused() {
    let folder = folder();
    let server = Running::over(folder.path());
    for length in [17_000, 100_000] {
        let mut stream = connect(&server);
        let long = "a".repeat(length);
        let _ = write!(stream, "GET / HTTP/1.1\r\nhost: a\r\nx-long: {long}\r\n\r\n");
        let said = rest(stream);
        assert!(said.is_empty() || said.starts_with("HTTP/1.1 431"), "{said}");
    }
    for junk in [
        "\r\n\r\n\r\n",
        "GET\r\n\r\n",
        "\u{0}\u{1}\u{2}\r\n\r\n",
        "GET / HTTP/9.9\r\n\r\n",
        "GET / HTTP/1.1\r\ncontent-length: -1\r\n\r\n",
    ] {
        let mut stream = connect(&server);
        stream.write_all(junk.as_bytes()).unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        let said = rest(stream);
        assert!(said.is_empty() || said.starts_with("HTTP/1.1 4"), "{junk:?} {said}");
    }
    assert_eq!(server.get(BRICK).status, 200);
}

#[test]
fn work_that_waits_is_bounded_and_the_rest_told_to_come_again() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([128, 128, 64], 64, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let mut options = options(folder.path());
    options.cache_bytes = 0;
    (options.limits.decodes, options.limits.waiting) = (1, 1);
    let server = Running::new(options);
    let statuses = std::sync::Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for i in 0..16 {
            let (server, statuses) = (&server, &statuses);
            scope.spawn(move || {
                for _ in 0..8 {
                    let reply = server.get(&format!("/v1/v/bricks/0/{}/{}/0", i % 2, i / 2 % 2));
                    if reply.status != 200 {
                        reply.assert_problem(503);
                        assert_eq!(reply.header("retry-after"), "1");
                    }
                    statuses.lock().unwrap().push(reply.status);
                }
            });
        }
    });
    let statuses = statuses.into_inner().unwrap();
    assert!(statuses.contains(&200) && statuses.contains(&503), "{statuses:?}");
    // One that is at work and one that waits are never too many, however often.
    std::thread::scope(|scope| {
        for i in 0..2 {
            let server = &server;
            scope.spawn(move || {
                for _ in 0..24 {
                    assert_eq!(server.get(&format!("/v1/v/bricks/0/{i}/0/0")).status, 200);
                }
            });
        }
    });
}

#[test]
fn kept_answers_have_bounded_room() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([64, 64, 64], 8, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let mut options = options(folder.path());
    options.cache_bytes = 100_000;
    let server = Running::new(options);
    for x in 0..8 {
        for y in 0..8 {
            let address = format!("/v1/v/bricks/0/{x}/{y}/0");
            assert_eq!(server.get(&address).body.len(), 2 * 12 * 12 * 12);
        }
    }
    let metrics = String::from_utf8(server.get("/metrics").body).unwrap();
    let kept = metrics.lines().find_map(|line| line.strip_prefix("octavo_cache_bytes ")).unwrap();
    let kept: u64 = kept.parse().unwrap();
    assert!((10_000..=100_000).contains(&kept), "{kept}");
    assert!(metrics.contains("octavo_cache_misses_total 64\n"), "{metrics}");
}

#[test]
fn one_http_2_connection_has_few_requests_at_once_and_short_heads() {
    let folder = folder();
    let server = Running::over(folder.path());
    runtime().block_on(async {
        let stream = tokio::net::TcpStream::connect(server.address).await.unwrap();
        let (client, connection) = h2::client::handshake(stream).await.unwrap();
        tokio::spawn(connection);
        let ask = |long: String| {
            let uri = format!("http://{}{BRICK}", server.address);
            http::Request::get(uri).header("x-long", long).body(()).unwrap()
        };
        let mut client = client.ready().await.unwrap();
        let (answer, _) = client.send_request(ask(String::new()), true).unwrap();
        assert_eq!(answer.await.unwrap().status().as_u16(), 200);
        assert_eq!(client.current_max_send_streams(), 64);
        // Answered by 431, or by the end of the connection.
        let mut client = client.ready().await.unwrap();
        let status = match client.send_request(ask("a".repeat(100_000)), true) {
            Ok((answer, _)) => answer.await.map_or(431, |answer| answer.status().as_u16()),
            Err(_) => 431,
        };
        assert_eq!(status, 431, "a head of 100 kB was read");
    });
}

#[test]
fn bodies_of_no_stated_length_count_as_long_and_short_ones_as_a_request() {
    let folder = folder();
    for (head, length) in
        [("content-length: 100", 64 << 10), ("transfer-encoding: chunked", 1 << 20)]
    {
        let mut options = options(folder.path());
        options.limits.all_body_bytes = 3 * length;
        let server = Running::new(options);
        let begin = || {
            let mut stream = connect(&server);
            write!(stream, "POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\n{head}\r\n\r\n").unwrap();
            stream
        };
        let held = [begin(), begin(), begin()];
        std::thread::sleep(Duration::from_millis(200));
        server.post("/v1/v/bricks", r#"{"keys":[]}"#).assert_problem(503);
        drop(held);
        let began = Instant::now();
        while server.post("/v1/v/bricks", r#"{"keys":[]}"#).status != 200 {
            assert!(began.elapsed() < Duration::from_secs(20), "{head}: room is not given back");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
