//! HTTP as it should be: tags, conditions, ranges, HEAD, origins, caching.

use crate::support::{Running, Volume, noise};
use octree_store::Encoding;
use std::io::{Read, Write};

const BRICK: &str = "/v1/v/bricks/0/1/0/0";

fn serve() -> (Running, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<u16>::new([20, 9, 9], 8, noise);
    volume.write(&folder.path().join("v.octavo"), Encoding::Lossless);
    (Running::over(folder.path()), folder)
}

#[test]
fn who_has_it_already_hears_so() {
    let (server, _folder) = serve();
    for path in
        [BRICK, "/v1/v/info", "/zarr2/v/.zattrs", "/zarr3/v/0/c/0/0/0", "/precomputed/v/info", "/"]
    {
        let first = server.get(path);
        let tag = first.header("etag");
        assert!(tag.starts_with('"') && tag.len() > 10, "{path} {tag}");
        for list in
            [tag.to_owned(), format!("\"other\", {tag}"), format!("W/{tag}"), "*".to_owned()]
        {
            let again = server.get_with(path, &[("if-none-match", &list)]);
            assert_eq!((again.status, again.body.len()), (304, 0), "{path} {list}");
            assert_eq!(again.header("etag"), tag);
            assert_eq!(again.header("access-control-allow-origin"), "*");
        }
        assert_eq!(server.get_with(path, &[("if-none-match", "\"other\"")]).status, 200);
        assert_eq!(server.get_with(path, &[("if-match", tag)]).status, 200);
        server.get_with(path, &[("if-match", "\"other\"")]).assert_problem(412);
    }
}

#[test]
fn if_match_comes_first_and_lists_may_come_in_lines() {
    let (server, _folder) = serve();
    for path in [BRICK, "/v1/v/info", "/v1/v/slices/z/3"] {
        let tag = server.get(path).header("etag").to_owned();
        let both = [("if-match", "\"other\""), ("if-none-match", tag.as_str())];
        server.get_with(path, &both).assert_problem(412);
        let lines = [("if-match", "\"other\""), ("if-match", tag.as_str())];
        assert_eq!(server.get_with(path, &lines).status, 200, "{path}");
        let lines = [("if-none-match", "\"other\""), ("if-none-match", tag.as_str())];
        assert_eq!(server.get_with(path, &lines).status, 304, "{path}");
        // A weak tag is none that If-Match takes.
        server.get_with(path, &[("if-match", &format!("W/{tag}"))]).assert_problem(412);
    }
}

#[test]
fn a_request_of_http_1_1_has_one_host() {
    let (server, _folder) = serve();
    let said = |head: &str| {
        let mut stream = std::net::TcpStream::connect(server.address).unwrap();
        write!(stream, "GET /readyz {head}\r\nconnection: close\r\n\r\n").unwrap();
        std::io::read_to_string(stream).unwrap()
    };
    assert!(said("HTTP/1.1\r\nhost: a").starts_with("HTTP/1.1 200"));
    assert!(said("HTTP/1.0").starts_with("HTTP/1.0 200"));
    for head in ["HTTP/1.1", "HTTP/1.1\r\nhost: a\r\nhost: b"] {
        let said = said(head);
        assert!(said.starts_with("HTTP/1.1 400") && said.contains("one Host"), "{said}");
        assert!(said.contains("access-control-allow-origin: *"), "{said}");
    }
}

#[test]
fn tags_differ_where_bytes_do() {
    let (server, _folder) = serve();
    let mut tags = std::collections::HashMap::new();
    for path in [
        BRICK,
        "/v1/v/bricks/0/0/0/0",
        "/v1/v/bricks/1/0/0/0",
        "/v1/v/bricks/0/1/0/0?form=stored",
        "/v1/v/bricks/0/1/0/0?form=codes",
        "/zarr2/v/0/0/0/1",
        "/precomputed/v/0/8-16_0-8_0-8",
    ] {
        let reply = server.get(path);
        assert_eq!(reply.status, 200, "{path}");
        if let Some(other) = tags.insert(reply.header("etag").to_owned(), reply.body.clone()) {
            assert_eq!(other, reply.body, "{path}");
        }
    }
    assert!(tags.len() >= 6);
}

#[test]
fn ranges_are_parts_of_the_whole() {
    let (server, _folder) = serve();
    let whole = server.get(BRICK);
    let length = whole.body.len();
    assert_eq!(whole.header("accept-ranges"), "bytes");
    let part = |range: &str| server.get_with(BRICK, &[("range", range)]);
    for (range, from, to) in [
        ("bytes=0-0", 0, 1),
        ("bytes=10-19", 10, 20),
        ("bytes=100-", 100, length),
        ("bytes=-292", length - 292, length),
        ("bytes=5-999999999", 5, length),
        ("bytes=-999999999", 0, length),
    ] {
        let reply = part(range);
        assert_eq!(reply.status, 206, "{range}");
        assert_eq!(reply.body, whole.body[from..to], "{range}");
        assert_eq!(reply.header("content-range"), format!("bytes {from}-{}/{length}", to - 1));
        assert_eq!(reply.header("content-length"), (to - from).to_string());
    }
    for range in [format!("bytes={length}-"), "bytes=-0".to_owned()] {
        let reply = part(&range);
        reply.assert_problem(416);
        assert_eq!(reply.header("content-range"), format!("bytes */{length}"));
    }
    for range in ["bytes=9-3", "bytes=a-b", "lines=1-2", "bytes=0-1,4-5", "bytes=", "bytes=--1"] {
        assert_eq!((part(range).status, part(range).body), (200, whole.body.clone()), "{range}");
    }
    let tag = whole.header("etag");
    let if_range =
        |tag: &str| server.get_with(BRICK, &[("range", "bytes=0-3"), ("if-range", tag)]).status;
    assert_eq!((if_range(tag), if_range("\"other\"")), (206, 200));
}

#[test]
fn head_says_what_get_would() {
    let (server, _folder) = serve();
    for path in [
        BRICK,
        "/zarr2/v/.zattrs",
        "/zarr2/v/0/0/0/0",
        "/precomputed/v/info",
        "/zarr2/v/nothing",
        "/",
    ] {
        let (get, head) = (server.get(path), server.send("HEAD", path, &[], None));
        assert_eq!(head.status, get.status);
        assert_eq!(head.header("content-length"), get.body.len().to_string(), "{path}");
        assert_eq!(head.header("etag"), get.header("etag"));
        assert_eq!(head.header("content-type"), get.header("content-type"));
        assert!(head.body.is_empty());
    }
}

#[test]
fn head_has_no_ranges_and_a_document_s_are_parts_of_the_plain_one() {
    let (server, _folder) = serve();
    let whole = server.get(BRICK).body.len().to_string();
    let head = server.send("HEAD", BRICK, &[("range", "bytes=0-3")], None);
    assert_eq!((head.status, head.header("content-length")), (200, whole.as_str()));
    let plain = server.get_with("/v1/v/info", &[("accept-encoding", "identity")]);
    let headers = [("accept-encoding", "gzip, zstd"), ("range", "bytes=2-9")];
    let part = server.get_with("/v1/v/info", &headers);
    assert_eq!((part.status, part.header("content-encoding")), (206, ""));
    assert_eq!((part.header("etag"), &part.body[..]), (plain.header("etag"), &plain.body[2..10]));
}

#[test]
fn the_page_lets_nothing_in_from_elsewhere() {
    let (server, _folder) = serve();
    for path in ["/", "/page/app.js", "/page/style.css"] {
        let reply = server.get(path);
        let policy = reply.header("content-security-policy");
        assert!(policy.starts_with("default-src 'none'; script-src 'self'"), "{policy}");
        assert!(policy.contains("frame-ancestors 'none'"), "{policy}");
        assert_eq!(reply.header("x-content-type-options"), "nosniff");
        assert_eq!(reply.header("referrer-policy"), "no-referrer");
    }
}

#[test]
fn every_origin_may_ask_and_read() {
    let (server, _folder) = serve();
    let preflight = server.send(
        "OPTIONS",
        "/v1/v/cut",
        &[
            ("origin", "https://viewer.example"),
            ("access-control-request-method", "POST"),
            ("access-control-request-headers", "content-type,authorization,range"),
        ],
        None,
    );
    assert_eq!(preflight.status, 200);
    assert_eq!(preflight.header("access-control-allow-origin"), "*");
    assert!(preflight.header("access-control-allow-methods").contains("POST"));
    // A star does not stand for Authorization.
    let allowed = preflight.header("access-control-allow-headers").to_ascii_lowercase();
    for name in ["content-type", "authorization", "range"] {
        assert!(allowed.contains(name), "{allowed}");
    }
    for path in
        [BRICK, "/nothing", "/v1/v/bricks/0/99/0/0", "/healthz", "/v1/v/bricks/0/1/0/0?form=odd"]
    {
        let reply = server.get(path);
        assert_eq!(reply.header("access-control-allow-origin"), "*", "{path}");
        assert!(reply.header("access-control-expose-headers").contains("etag"), "{path}");
    }
    server.send("DELETE", BRICK, &[], None).assert_problem(405);
    server.send("POST", BRICK, &[], Some("")).assert_problem(405);
}

#[test]
fn an_address_that_names_the_content_is_immutable_and_others_are_asked_for_again() {
    let (server, _folder) = serve();
    let pinned = server.get("/v1/datasets").json()[0]["pinned_name"].as_str().unwrap().to_owned();
    for rest in ["info", "bricks/0/1/0/0", "nodes?level=0"] {
        let (plain, fixed) =
            (server.get(&format!("/v1/v/{rest}")), server.get(&format!("/v1/{pinned}/{rest}")));
        assert_eq!(plain.body, fixed.body);
        assert_eq!(plain.header("cache-control"), "public, no-cache");
        assert_eq!(fixed.header("cache-control"), "public, max-age=31536000, immutable");
    }
    assert_eq!(
        server.get(&format!("/zarr3/{pinned}/0/c/0/0/0")).header("cache-control"),
        "public, max-age=31536000, immutable"
    );
    server.get("/v1/v@0123456789abcdef/info").assert_problem(404);
    server.get("/v1/v@/info").assert_problem(404);
}

#[test]
fn documents_are_packed_where_it_pays_and_bricks_are_not() {
    let (server, _folder) = serve();
    let plain = server.get_with("/v1/v/info", &[("accept-encoding", "identity")]);
    for (accepted, name) in
        [("gzip, deflate", "gzip"), ("gzip, zstd;q=0.5", "zstd"), ("zstd;q=0, gzip", "gzip")]
    {
        let packed = server.get_with("/v1/v/info", &[("accept-encoding", accepted)]);
        assert_eq!(packed.header("content-encoding"), name);
        assert_eq!(packed.header("vary"), "accept-encoding");
        // Another representation, another tag; which is honoured in turn.
        assert_ne!(packed.header("etag"), plain.header("etag"));
        let tag = packed.header("etag");
        let again =
            server.get_with("/v1/v/info", &[("accept-encoding", accepted), ("if-none-match", tag)]);
        assert_eq!(again.status, 304);
        if name == "zstd" {
            assert_eq!(zstd::bulk::decompress(&packed.body, 1 << 20).unwrap(), plain.body);
        }
    }
    // A list may come in lines, and a weight's name in either case.
    let lines = [("accept-encoding", "br"), ("accept-encoding", "zstd; Q=0, gzip")];
    let packed = server.get_with("/v1/v/info", &lines);
    assert_eq!(packed.header("content-encoding"), "gzip");
    let mut unpacked = Vec::new();
    flate2::read::GzDecoder::new(&*packed.body).read_to_end(&mut unpacked).unwrap();
    assert_eq!(unpacked, plain.body);
    // One packet carries it either way.
    let small = server.get_with("/zarr3/v/0/zarr.json", &[("accept-encoding", "gzip, zstd")]);
    assert_eq!(small.header("content-encoding"), "");
    assert!((300..1024).contains(&small.body.len()), "{}", small.body.len());
    let brick = server.get_with(BRICK, &[("accept-encoding", "gzip, zstd")]);
    assert_eq!(brick.header("content-encoding"), "");
    assert_eq!(plain.header("content-encoding"), "");
}

#[test]
fn malformed_requests_are_told_what_is_wrong() {
    let (server, _folder) = serve();
    server.get("/v1/v/bricks/0/1/0/0?form=odd").assert_problem(400);
    server.get("/v1/v/bricks/0/1/0/0?from=stored").assert_problem(400);
    server.get("/v1/v/nodes").assert_problem(400);
    server.get("/v1/v/nodes?level=-1").assert_problem(400);
    for body in [
        "",
        "{}",
        "[]",
        "{\"keys\":[[0,0,0]]}",
        "{\"keys\":[[0,0,0,-1]]}",
        "{\"keys\":[],\"more\":1}",
        "\u{0}",
    ] {
        server.post("/v1/v/bricks", body).assert_problem(400);
    }
    let camera = r#"{"projection":"perspective","position":[1,1,-9],"target":[1,1,1],"up":[0,-1,0],"fov_y_deg":40}"#;
    for body in [
        "{}".to_owned(),
        r#"{"cameras":[],"size":[9,9]}"#.to_owned(),
        format!(r#"{{"cameras":[{camera}],"size":[0,9]}}"#),
        format!(r#"{{"cameras":[{camera}],"size":[9,9],"accuracy":0}}"#),
        format!(r#"{{"cameras":[{camera}],"size":[9,9],"budget_bricks":0}}"#),
        format!(r#"{{"cameras":[{camera}],"size":[9,9],"budget_bricks":99999999}}"#),
        format!(r#"{{"cameras":[{camera}],"size":[9,9],"transfer":{{"points":[]}}}}"#),
        format!(r#"{{"cameras":[{}],"size":[9,9]}}"#, [camera; 65].join(",")),
    ] {
        server.post("/v1/v/cut", &body).assert_problem(400);
    }
}

#[test]
fn the_server_says_that_it_lives_and_what_it_did() {
    let (server, _folder) = serve();
    server.get(BRICK);
    server.get(BRICK);
    server.send("BREW", BRICK, &[], None).assert_problem(405);
    assert_eq!(server.get("/healthz").status, 200);
    assert_eq!(server.get("/readyz").status, 200);
    let metrics = String::from_utf8(server.get("/metrics").body).unwrap();
    let route = "octavo_answers_total{route=\"/v1/{dataset}/bricks/{level}/{x}/{y}/{z}\",method=\"GET\",status=\"200\"} 2";
    assert!(metrics.contains(route), "{metrics}");
    assert!(metrics.contains("octavo_cache_hits_total 1\n"), "{metrics}");
    // Clients cannot make series.
    assert!(metrics.contains("method=\"other\",status=\"405\"} 1") && !metrics.contains("BREW"));
    assert!(metrics.ends_with("# EOF\n"));
}

#[test]
fn http_2_gives_the_same_answers_many_at_a_time() {
    let (server, _folder) = serve();
    let expected = server.get(BRICK);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let stream = tokio::net::TcpStream::connect(server.address).await.unwrap();
        let (mut client, connection) = h2::client::handshake(stream).await.unwrap();
        tokio::spawn(connection);
        let mut answers = Vec::new();
        for _ in 0..20 {
            client = client.ready().await.unwrap();
            let uri = format!("http://{}{BRICK}", server.address);
            let request = http::Request::get(uri).body(()).unwrap();
            answers.push(client.send_request(request, true).unwrap().0);
        }
        for answer in answers {
            let answer = answer.await.unwrap();
            assert_eq!((answer.status().as_u16(), answer.version()), (200, http::Version::HTTP_2));
            assert_eq!(answer.headers()["etag"], expected.header("etag"));
            let (mut body, mut bytes) = (answer.into_body(), Vec::new());
            while let Some(part) = body.data().await {
                let part = part.unwrap();
                body.flow_control().release_capacity(part.len()).unwrap();
                bytes.extend_from_slice(&part);
            }
            assert_eq!(bytes, expected.body);
        }
    });
}
