//! Small stores made of a function, a server over them, and a client.

use octree_store::{Encoding, Geometry, Metadata, NodeKey, Sample, StoreWriter, encode_samples};
use serve::{Options, Renderer, Server};
use std::io::Read;
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// A volume with all its levels, x fastest; each level the mean of the one below.
pub(crate) struct Volume<T> {
    pub(crate) geometry: Geometry,
    pub(crate) levels: Vec<Vec<T>>,
}

impl<T: Sample> Volume<T> {
    pub(crate) fn new(dims: [u64; 3], core: u32, value: impl Fn([u64; 3]) -> f64) -> Self {
        let geometry = Geometry::new(dims, core, 2).unwrap();
        let mut levels: Vec<Vec<T>> =
            vec![places(dims).map(|place| T::from_f64(value(place))).collect()];
        for level in 1..=geometry.top_level() {
            let (below, fine) = (geometry.dims_at(level - 1), levels.last().unwrap());
            let mean = |[x, y, z]: [u64; 3]| {
                let cells =
                    (0..8).map(|i| [2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2)]);
                let inside: Vec<f64> = cells
                    .filter(|p| (0..3).all(|axis| p[axis] < below[axis]))
                    .map(|p| fine[index(p, below)].to_f64())
                    .collect();
                T::from_f64(inside.iter().sum::<f64>() / inside.len() as f64)
            };
            let coarse = places(geometry.dims_at(level)).map(mean).collect();
            levels.push(coarse);
        }
        Self { geometry, levels }
    }

    pub(crate) fn at(&self, level: u8, place: [u64; 3]) -> T {
        self.levels[usize::from(level)][index(place, self.geometry.dims_at(level))]
    }

    /// A brick's samples, overlap included.
    pub(crate) fn brick(&self, key: NodeKey) -> Vec<T> {
        let (origin, dims) = (self.geometry.sample_origin(key), self.geometry.dims_at(key.level()));
        let side = self.geometry.brick_side() as u64;
        places([side; 3])
            .map(|place| {
                let inside = [0, 1, 2].map(|axis| {
                    (origin[axis] + place[axis] as i64).clamp(0, dims[axis] as i64 - 1) as u64
                });
                self.at(key.level(), inside)
            })
            .collect()
    }

    pub(crate) fn keys(&self) -> Vec<NodeKey> {
        let all = self.geometry.levels().flat_map(|level| {
            places(self.geometry.grid_at(level)).map(move |place| NodeKey::new(level, place))
        });
        all.collect()
    }

    /// Writes the store.
    pub(crate) fn write(&self, path: &Path, encoding: Encoding) {
        let work = path.with_extension("work");
        let mut writer = StoreWriter::create(path, &work, Vec::new()).unwrap();
        let mut ranges = std::collections::HashMap::new();
        for level in self.geometry.levels() {
            let above = self.geometry.grid_at(level).map(|n| n.div_ceil(2));
            let mut parents: Vec<NodeKey> =
                places(above).map(|place| NodeKey::new(level + 1, place)).collect();
            parents.sort_unstable();
            for parent in parents {
                let (mut octet, mut payloads) = (Vec::new(), Vec::new());
                let children = parent.children().into_iter();
                for key in children.filter(|key| self.geometry.contains(*key)) {
                    let (mut record, payload) = encode_samples(key, &self.brick(key), encoding);
                    record.child_mask = self.geometry.child_mask(key);
                    if level > 0 {
                        for child in key.children() {
                            if let Some((min, max)) = ranges.get(&child) {
                                record.subtree_min = record.subtree_min.min(*min);
                                record.subtree_max = record.subtree_max.max(*max);
                            }
                        }
                    }
                    ranges.insert(key, (record.subtree_min, record.subtree_max));
                    payloads.extend_from_slice(&payload);
                    octet.push(record);
                }
                writer.append(&mut octet, &payloads, Vec::new()).unwrap();
            }
        }
        let mut metadata = Metadata::new(&self.geometry, T::TYPE, encoding);
        metadata.spacing_xyz = [0.5, 1.0, 2.0];
        metadata.value_min = self.levels[0].iter().map(|v| v.to_f64()).reduce(f64::min);
        metadata.value_max = self.levels[0].iter().map(|v| v.to_f64()).reduce(f64::max);
        writer.finish(metadata).unwrap();
        let _ = std::fs::remove_file(work);
    }
}

/// All places of a box, x fastest.
pub(crate) fn places(dims: [u64; 3]) -> impl Iterator<Item = [u64; 3]> {
    (0..dims.iter().product::<u64>())
        .map(move |i| [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]])
}

pub(crate) fn index([x, y, z]: [u64; 3], dims: [u64; 3]) -> usize {
    ((z * dims[1] + y) * dims[0] + x) as usize
}

/// Noise: nothing in it repeats, so that a voxel in a wrong place shows.
pub(crate) fn noise([x, y, z]: [u64; 3]) -> f64 {
    let mut n = x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    n ^= z.wrapping_mul(0x1656_67B1_9E37_79F9);
    n = (n ^ (n >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (n >> 48) as f64
}

/// A server of its own thread; stops when dropped.
pub(crate) struct Running {
    pub(crate) address: SocketAddr,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Running {
    pub(crate) fn new(options: Options) -> Self {
        Self::drawing(options, None)
    }

    /// A server with a renderer.
    pub(crate) fn drawing(mut options: Options, renderer: Option<Arc<dyn Renderer>>) -> Self {
        options.bind.set_port(0);
        let (stop, stopped) = tokio::sync::oneshot::channel();
        let (tell, told) = std::sync::mpsc::sync_channel(1);
        let serve = move || {
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .worker_threads(2)
                .enable_all()
                .build()
                .unwrap();
            runtime.block_on(async move {
                let server = Server::bind(options, renderer).await.unwrap();
                tell.send(server.address()).unwrap();
                let stopped = async {
                    let _ = stopped.await;
                };
                server.run(stopped).await;
            });
        };
        let thread = std::thread::Builder::new().name("server".into()).spawn(serve).unwrap();
        let address = told.recv().unwrap();
        Self { address, stop: Some(stop), thread: Some(thread) }
    }

    /// A server over what lies in a folder.
    pub(crate) fn over(folder: &Path) -> Self {
        Self::new(options(folder))
    }

    pub(crate) fn get(&self, path: &str) -> Reply {
        self.send("GET", path, &[], None)
    }

    pub(crate) fn get_with(&self, path: &str, headers: &[(&str, &str)]) -> Reply {
        self.send("GET", path, headers, None)
    }

    pub(crate) fn post(&self, path: &str, body: &str) -> Reply {
        self.send("POST", path, &[], Some(body))
    }

    pub(crate) fn send(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: Option<&str>,
    ) -> Reply {
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .allow_non_standard_methods(true)
            .timeout_global(Some(Duration::from_mins(1)))
            .build()
            .into();
        let mut request = ureq::http::Request::builder()
            .method(method)
            .uri(format!("http://{}{path}", self.address));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(body.unwrap_or_default().to_owned()).unwrap();
        let response =
            if body.is_some() { agent.run(request) } else { agent.run(request.map(|_| ())) };
        let mut response = response.unwrap();
        let headers = response.headers().clone();
        let status = response.status().as_u16();
        let reader = response.body_mut().with_config().limit(1 << 30);
        Reply { status, headers, body: reader.read_to_vec().unwrap() }
    }

    /// Tells the server to stop, and waits until it has.
    pub(crate) fn stop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop();
    }
}

pub(crate) fn options(folder: &Path) -> Options {
    let mut options = Options::new(vec![PathBuf::from(folder)]);
    options.rescan = Duration::from_millis(50);
    options
}

/// An answer.
#[derive(Debug)]
pub(crate) struct Reply {
    pub(crate) status: u16,
    headers: ureq::http::HeaderMap,
    pub(crate) body: Vec<u8>,
}

impl Reply {
    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|_| panic!("no JSON: {}", String::from_utf8_lossy(&self.body)))
    }

    /// That this is a refusal as all refusals are.
    pub(crate) fn assert_problem(&self, status: u16) {
        assert_eq!(self.status, status, "{}", String::from_utf8_lossy(&self.body));
        assert_eq!(self.header("content-type"), "application/problem+json");
        assert_eq!(self.header("access-control-allow-origin"), "*");
        assert_eq!(self.header("cache-control"), "no-store");
        assert_eq!(self.json()["status"], status);
    }
}

/// One frame of a stream.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    pub(crate) name: u64,
    pub(crate) kind: u8,
    pub(crate) numbers: [f64; 2],
    pub(crate) body: Vec<u8>,
}

/// Reads a framed stream as docs/HTTP.md describes it.
pub(crate) fn frames(bytes: &[u8]) -> Vec<Frame> {
    assert_eq!(bytes[..8], *b"OCTF\x01\0\0\0");
    let count = u64::from_le_bytes(bytes[8..16].try_into().unwrap());
    let (mut rest, mut frames) = (&bytes[16..], Vec::new());
    while !rest.is_empty() {
        let length = u32::from_le_bytes(rest[12..16].try_into().unwrap()) as usize;
        let number = |at: usize| f64::from_le_bytes(rest[at..at + 8].try_into().unwrap());
        frames.push(Frame {
            name: u64::from_le_bytes(rest[..8].try_into().unwrap()),
            kind: rest[8],
            numbers: [number(16), number(24)],
            body: rest[32..32 + length].to_vec(),
        });
        rest = &rest[32 + length..];
    }
    assert_eq!(frames.len() as u64, count);
    frames
}

/// Flips a byte in the middle of a brick's payload.
pub(crate) fn damage(path: &Path, key: NodeKey) {
    let record = octree_store::Store::open(path).unwrap().node(key).unwrap();
    let mut bytes = std::fs::read(path).unwrap();
    // Payloads follow the first page (FORMAT.md, "File").
    let at = 4096 + record.place.offset as usize + record.place.length as usize / 2;
    bytes[at] ^= 0x55;
    std::fs::write(path, bytes).unwrap();
    let store = octree_store::Store::open(path).unwrap();
    assert!(store.read_brick_samples(key).is_err(), "the damage is where it should be");
}

/// Flips a bit of a node's record, where it lies in the index.
pub(crate) fn damage_record(path: &Path, key: NodeKey) {
    let record = octree_store::Store::open(path).unwrap().node(key).unwrap().to_bytes();
    let mut bytes = std::fs::read(path).unwrap();
    let places: Vec<usize> =
        (0..=bytes.len() - record.len()).filter(|at| bytes[*at..].starts_with(&record)).collect();
    assert!(!places.is_empty());
    for at in places {
        bytes[at + 50] ^= 1;
    }
    std::fs::write(path, bytes).unwrap();
    assert!(octree_store::Store::open(path).unwrap().node(key).is_err());
}

/// A folder with one small store, `v`.
pub(crate) fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<u16>::new([20, 9, 9], 8, noise);
    volume.write(&folder.path().join("v.octavo"), Encoding::Lossless);
    folder
}

pub(crate) fn connect(server: &Running) -> TcpStream {
    let stream = TcpStream::connect(server.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.set_write_timeout(Some(Duration::from_secs(30))).unwrap();
    stream
}

/// What a server still says before it closes.
pub(crate) fn rest(mut stream: TcpStream) -> String {
    let mut text = Vec::new();
    // A server that closes with bytes of ours unread resets the connection: what came before counts.
    let _ = stream.read_to_end(&mut text);
    String::from_utf8_lossy(&text).into_owned()
}

/// An HTTP/2 client that asks for so much and opens no window; how many of its requests were refused.
pub(crate) async fn ask_and_take_nothing(
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

pub(crate) fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
}
