//! Requests to a server: it answers each with a status that fits, and the next one as well.

use serve::{Options, Server};
use std::net::SocketAddr;
use std::sync::{OnceLock, mpsc};
use std::time::Duration;
use tempfile::TempDir;

/// A server over one small store, until the process ends.
struct Running {
    address: SocketAddr,
    agent: ureq::Agent,
    _folder: TempDir,
}

fn running() -> &'static Running {
    static RUNNING: OnceLock<Running> = OnceLock::new();
    RUNNING.get_or_init(|| {
        let (folder, _) = crate::files::noise_store();
        let mut options = Options::new(vec![folder.path().to_owned()]);
        options.bind.set_port(0);
        let (tell, told) = mpsc::sync_channel(1);
        let serving = std::thread::Builder::new().name("server".into()).spawn(move || {
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .worker_threads(1)
                .enable_all()
                .build()
                .unwrap();
            runtime.block_on(async move {
                let server = Server::bind(options, None).await.unwrap();
                tell.send(server.address()).unwrap();
                server.run(std::future::pending()).await;
            });
        });
        serving.unwrap();
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(Duration::from_secs(20)))
            .build()
            .into();
        Running { address: told.recv().unwrap(), agent, _folder: folder }
    })
}

/// Bodies of the two addresses that take any; or an address and a query. The first byte chooses.
pub fn http(bytes: &[u8]) {
    let Some((&choice, rest)) = bytes.split_first() else { return };
    let Running { address, agent, .. } = running();
    let base = format!("http://{address}");
    let reply = match choice % 3 {
        0 => agent.post(format!("{base}/v1/a/bricks")).send(rest),
        1 => agent.post(format!("{base}/v1/a/cut")).send(rest),
        _ => {
            // What a URL may hold; the rest is the client's own to refuse.
            let path: String =
                rest.iter().filter(|b| b.is_ascii_graphic()).map(|&b| char::from(b)).collect();
            agent.get(format!("{base}/{path}")).call()
        }
    };
    let mut reply = match reply {
        Ok(reply) => reply,
        Err(ureq::Error::BadUri(_) | ureq::Error::Http(_)) => return,
        Err(error) => panic!("no answer: {error}"),
    };
    let status = reply.status().as_u16();
    assert!((200..500).contains(&status), "{status}: nothing of this store is damaged");
    let body = reply.body_mut().with_config().limit(64 << 20).read_to_vec().unwrap();
    if status >= 400 && !body.is_empty() {
        let problem: serde_json::Value = serde_json::from_slice(&body).unwrap();
        assert_eq!(problem["status"], status);
    }
    let alive = agent.get(format!("{base}/healthz")).call().unwrap();
    assert_eq!(alive.status().as_u16(), 200);
}
