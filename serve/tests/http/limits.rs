//! What a client cannot make the server do, while another is served.

use crate::support::{Running, Volume, noise, options};
use octree_store::Encoding;
use serde_json::json;
use serve::{Options, Server, Token};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

const BRICK: &str = "/v1/v/bricks/0/1/0/0";
const TOKEN: &str = "correct-horse-battery-staple";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<u16>::new([20, 9, 9], 8, noise);
    volume.write(&folder.path().join("v.octavo"), Encoding::Lossless);
    folder
}

fn connect(server: &Running) -> TcpStream {
    let stream = TcpStream::connect(server.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.set_write_timeout(Some(Duration::from_secs(30))).unwrap();
    stream
}

/// What a server still says before it closes.
fn rest(mut stream: TcpStream) -> String {
    let mut text = Vec::new();
    // A server that closes with bytes of ours unread resets the connection: what came before counts.
    let _ = stream.read_to_end(&mut text);
    String::from_utf8_lossy(&text).into_owned()
}

#[test]
fn an_address_open_to_others_demands_a_token_or_a_clear_word() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let open = Options { bind: ([0, 0, 0, 0], 0).into(), ..Options::new(Vec::new()) };
    let bind = |options| runtime.block_on(Server::bind(options, None));
    let error = bind(open.clone()).unwrap_err();
    assert!(error.to_string().contains("--insecure-no-token"), "{error}");
    assert!(bind(Options { insecure_no_token: true, ..open.clone() }).is_ok());
    assert!(bind(Options { token: Some(Token::new(TOKEN).unwrap()), ..open }).is_ok());
    assert!(Token::new("short").is_err() && Token::new("has a space in the middle").is_err());
    assert!(!format!("{:?}", Token::new(TOKEN)).contains(TOKEN), "a token is not printed");
}

#[test]
fn a_token_opens_everything_and_without_it_only_health_is_told() {
    let folder = folder();
    let token = Some(Token::new(&format!("{TOKEN}\n")).unwrap());
    let server = Running::new(Options { token, ..options(folder.path()) });
    for path in
        [BRICK, "/", "/v1/datasets", "/metrics", "/openapi.json", "/nothing", "/zarr2/v/.zattrs"]
    {
        let reply = server.get(path);
        reply.assert_problem(401);
        assert!(reply.header("www-authenticate").starts_with("Bearer"));
    }
    assert_eq!((server.get("/healthz").status, server.get("/readyz").status), (200, 200));
    let bearer = format!("Bearer {TOKEN}");
    let cookie = format!("a=b; octavo_token={TOKEN}; c=d");
    for header in [("authorization", bearer.as_str()), ("cookie", cookie.as_str())] {
        let reply = server.get_with(BRICK, &[header]);
        assert_eq!(reply.status, 200);
        assert!(reply.header("cache-control").starts_with("private"));
    }
    for wrong in [
        "Bearer ",
        "Bearer correct-horse-battery-stapl",
        "Basic x",
        "Bearer correct-horse-battery-staple2",
        TOKEN,
    ] {
        assert_eq!(server.get_with(BRICK, &[("authorization", wrong)]).status, 401, "{wrong}");
    }
    let login = server.get(&format!("/?token={TOKEN}"));
    assert_eq!((login.status, login.header("location")), (303, "/"));
    let set = login.header("set-cookie");
    assert!(set.contains("HttpOnly") && set.contains("SameSite=Strict"), "{set}");
    assert_eq!(server.get("/?token=wrong").status, 401);
    assert_eq!(server.get(&format!("{BRICK}?token={TOKEN}")).status, 401);
    // Browsers ask without it whether they may ask with it.
    let preflight = [("origin", "https://a.example"), ("access-control-request-method", "GET")];
    assert_eq!(server.send("OPTIONS", BRICK, &preflight, None).status, 200);
}

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
fn a_list_of_a_hundred_thousand_keys_is_refused() {
    let folder = folder();
    let server = Running::over(folder.path());
    let keys = vec![[0, 0, 0, 0]; 100_000];
    server.post("/v1/v/bricks", &json!({"keys": keys}).to_string()).assert_problem(413);
    let camera = json!({"projection":"orthographic","position":[1,1,-9],"target":[1,1,1],"up":[0,-1,0],"height":9});
    let cut = json!({"cameras": [camera], "size": [9, 9], "have": keys[..20_000]});
    server.post("/v1/v/cut", &cut.to_string()).assert_problem(413);
    server.get("/v1/v/nodes?level=0&count=100000").assert_problem(413);
    assert_eq!(server.post("/v1/v/bricks", &json!({"keys": keys[..1000]}).to_string()).status, 200);
}

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
}

#[test]
fn heads_that_are_too_long_and_requests_that_are_none_are_refused() {
    let folder = folder();
    let server = Running::over(folder.path());
    let mut stream = connect(&server);
    let _ = write!(stream, "GET / HTTP/1.1\r\nhost: a\r\nx-long: {}\r\n\r\n", "a".repeat(100_000));
    let said = rest(stream);
    assert!(said.is_empty() || said.starts_with("HTTP/1.1 431"), "{said}");
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
    assert_eq!(server.get("/v1/v/bricks/0/0/0/0").status, 200);
}

#[test]
fn open_requests_end_before_the_server_does() {
    let folder = tempfile::tempdir().unwrap();
    Volume::<u16>::new([64, 64, 64], 32, noise)
        .write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let mut server = Running::over(folder.path());
    let keys = vec![[0, 1, 1, 1]; 400];
    let body = json!({"keys": keys}).to_string();
    let mut stream = connect(&server);
    write!(
        stream,
        "POST /v1/v/bricks HTTP/1.1\r\nhost: a\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .unwrap();
    let mut first = [0; 64];
    stream.read_exact(&mut first).unwrap();
    let idle = connect(&server);
    let reader = std::thread::scope(|scope| {
        let reader = scope.spawn(move || {
            let mut all = first.to_vec();
            stream.read_to_end(&mut all).unwrap();
            all
        });
        server.stop();
        reader.join().unwrap()
    });
    drop(idle);
    // Whole to the last chunk.
    assert!(reader.ends_with(b"\r\n0\r\n\r\n") && reader.len() > 400 * 36 * 36 * 36);
    assert!(TcpStream::connect(server.address).is_err());
}
