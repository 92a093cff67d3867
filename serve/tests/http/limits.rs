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
        &format!("Sealed {TOKEN}"),
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

/// An HTTP/2 client that asks for so much and opens no window; how many of its requests were refused.
async fn ask_and_take_nothing(
    server: &Running,
    method: &str,
    path: &str,
    body: &str,
    times: usize,
) -> (usize, tokio::task::JoinHandle<()>) {
    let stream = tokio::net::TcpStream::connect(server.address).await.unwrap();
    let mut builder = h2::client::Builder::new();
    builder.initial_window_size(0);
    let (mut client, connection) = builder.handshake::<_, bytes::Bytes>(stream).await.unwrap();
    let mut answers = Vec::new();
    let kept = tokio::spawn(async move {
        let _ = connection.await;
    });
    for _ in 0..times {
        client = client.ready().await.unwrap();
        let uri = format!("http://{}{path}", server.address);
        let request = http::Request::builder().method(method).uri(uri).body(()).unwrap();
        let (answer, mut sent) = client.send_request(request, body.is_empty()).unwrap();
        if !body.is_empty() {
            sent.send_data(body.to_owned().into(), true).unwrap();
        }
        answers.push(answer);
    }
    let (mut refused, mut kept_answers) = (0, Vec::new());
    for answer in answers {
        let answer = answer.await.unwrap();
        refused += usize::from(answer.status() == 503);
        kept_answers.push(answer);
    }
    let kept = tokio::spawn(async move {
        let _ = kept.await;
        drop((client, kept_answers));
    });
    (refused, kept)
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
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
    let reader = std::thread::scope(|scope| {
        let reader = scope.spawn(move || {
            let mut all = first.to_vec();
            stream.read_to_end(&mut all).unwrap();
            all
        });
        server.stop();
        reader.join().unwrap()
    });
    // Whole to the last chunk.
    assert!(reader.ends_with(b"\r\n0\r\n\r\n") && reader.len() > 400 * 36 * 36 * 36);
    assert!(TcpStream::connect(server.address).is_err());
}

#[test]
fn connections_that_ask_nothing_do_not_delay_the_end() {
    let folder = folder();
    let mut server = Running::over(folder.path());
    let mut kept: Vec<TcpStream> = (0..3).map(|_| connect(&server)).collect();
    // One says nothing, one begins as HTTP/2 does, and one had its answer.
    kept[1].write_all(b"PRI").unwrap();
    kept[2].write_all(b"GET /healthz HTTP/1.1\r\nhost: a\r\n\r\n").unwrap();
    let mut head = [0; 12];
    kept[2].read_exact(&mut head).unwrap();
    let began = Instant::now();
    server.stop();
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

#[test]
fn a_client_that_takes_nothing_delays_the_end_by_no_more_than_was_said() {
    let folder = folder();
    let mut options = options(folder.path());
    options.limits.drain_time = Duration::from_millis(300);
    let mut server = Running::new(options);
    let keys = r#"{"keys":[[0,0,0,0],[0,1,0,0]]}"#;
    let runtime = runtime();
    let _kept = runtime.block_on(ask_and_take_nothing(&server, "POST", "/v1/v/bricks", keys, 1));
    let began = Instant::now();
    server.stop();
    assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
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
