//! Connections: how many, how long, and how they end.

use crate::app::App;
use crate::observe::Caller;
use crate::place::Place;
use axum::Router;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use hyper_util::service::TowerToHyperService;
use std::future::Future;
use std::io::{self, Read, Write};
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio_io_timeout::TimeoutStream;
use tower::ServiceBuilder;
use tower::util::MapRequestLayer;

/// How HTTP/2 begins.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";

/// Requests of one HTTP/2 connection that are answered at once.
const CONCURRENT_STREAMS: u32 = 64;

/// What one connection over the limit hears.
const FULL: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 1\r\nconnection: close\r\n\
    access-control-allow-origin: *\r\ncontent-type: application/problem+json\r\ncontent-length: 91\r\n\r\n\
    {\"type\":\"about:blank\",\"title\":\"busy\",\"status\":503,\"detail\":\"too many connections are open\"}";

/// Takes connections until `stop` is done; then lets open requests end, for a while.
pub(crate) async fn accept(
    listener: TcpListener,
    app: Arc<App>,
    router: Router,
    stop: impl Future<Output = ()>,
) {
    let limits = app.options.limits;
    let room = Arc::new(Semaphore::new(limits.connections));
    let graceful = GracefulShutdown::new();
    let (stopping, stopped) = watch::channel(());
    let mut stop = pin!(stop);
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = &mut stop => break,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                // Out of file descriptors, mostly: who asks nothing makes room.
                tracing::warn!(%error, "a connection could not be accepted");
                app.places.call_in();
                tokio::time::sleep(Duration::from_millis(50)).await;
                continue;
            }
        };
        let Ok(permit) = Arc::clone(&room).try_acquire_owned() else {
            app.metrics.refused_connections.inc();
            app.places.call_in();
            let _ = refuse(stream);
            continue;
        };
        let watcher = graceful.watcher();
        let (app, router, stopped) = (Arc::clone(&app), router.clone(), stopped.clone());
        tokio::spawn(async move {
            app.metrics.connections.inc();
            let place = Place::new(&app.places, app.options.limits.head_time);
            let conversation = async {
                match begin(&stream, app.options.limits.head_time, stopped).await? {
                    Some(http2) => {
                        converse(stream, peer, http2, &app, &place, router, watcher).await
                    }
                    None => Ok(()),
                }
            };
            let ended = tokio::select! {
                ended = conversation => ended,
                () = place.cut().notified() => Err("it took, sent or asked too little".into()),
            };
            drop(permit);
            if let Err(error) = ended {
                tracing::debug!(%peer, %error, "a connection ended");
            }
            app.metrics.connections.dec();
        });
    }
    drop((listener, stopping));
    app.retire();
    if tokio::time::timeout(limits.drain_time, graceful.shutdown()).await.is_err() {
        tracing::warn!("requests that were still open are cut off");
    }
}

/// Says that there is no room, and has it over before the next is accepted: a burst of such connections holds no
/// file descriptors.
fn refuse(stream: TcpStream) -> io::Result<()> {
    let mut stream = stream.into_std()?;
    stream.write_all(FULL)?;
    // With what was asked still unread, closing would take the answer back.
    stream.read(&mut [0; 8192]).map(drop)
}

/// Whether a client begins as HTTP/2 does; none where the server stops before it says anything.
async fn begin(
    stream: &TcpStream,
    within: Duration,
    mut stopped: watch::Receiver<()>,
) -> io::Result<Option<bool>> {
    tokio::select! {
        begun = tokio::time::timeout(within, speaks_http2(stream)) => begun?.map(Some),
        _ = stopped.changed() => Ok(None),
    }
}

async fn converse(
    stream: TcpStream,
    peer: SocketAddr,
    http2: bool,
    app: &App,
    place: &Arc<Place>,
    router: Router,
    watcher: Watcher,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let limits = app.options.limits;
    stream.set_nodelay(true)?;
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(limits.stall_time));
    let io = TokioIo::new(Box::pin(stream));
    let place = Arc::clone(place);
    let with_caller = MapRequestLayer::new(move |mut request: http::Request<_>| {
        let work = Arc::new(place.work());
        request.extensions_mut().insert(Caller { address: peer, work });
        request
    });
    let service = ServiceBuilder::new().layer(with_caller).service(router);
    let service = TowerToHyperService::new(service);
    if http2 {
        let mut builder = hyper::server::conn::http2::Builder::new(TokioExecutor::new());
        builder
            .timer(TokioTimer::new())
            .max_concurrent_streams(CONCURRENT_STREAMS)
            .max_header_list_size(limits.head_bytes as u32)
            .keep_alive_interval(limits.head_time)
            .keep_alive_timeout(limits.stall_time);
        watcher.watch(builder.serve_connection(io, service)).await?;
    } else {
        let mut builder = hyper::server::conn::http1::Builder::new();
        builder
            .timer(TokioTimer::new())
            .header_read_timeout(limits.head_time)
            .max_header_size(limits.head_bytes)
            .max_buf_size(limits.head_bytes.max(8192) + 8192);
        watcher.watch(builder.serve_connection(io, service)).await?;
    }
    Ok(())
}

/// Whether a client begins as HTTP/2 does. Nothing is taken from the stream.
async fn speaks_http2(stream: &TcpStream) -> io::Result<bool> {
    let mut begin = [0; PREFACE.len()];
    loop {
        let count = stream.peek(&mut begin).await?;
        let same = begin[..count] == PREFACE[..count];
        if count == 0 || !same || count == PREFACE.len() {
            return Ok(same && count > 0);
        }
        // What was peeked at is still there, so that waiting for more would not wait.
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}
