//! How the server ends, whatever its clients do.

use crate::support::{
    Running, Volume, ask_and_take_nothing, connect, folder, noise, options, runtime,
};
use octree_store::Encoding;
use serde_json::json;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

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
