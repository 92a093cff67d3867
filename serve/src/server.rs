//! The server from beginning to end.

use crate::app::App;
use crate::catalog::Entry;
use crate::options::{Options, OptionsError};
use crate::render::Renderer;
use crate::views::precomputed;
use crate::{connections, routes};
use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use thiserror::Error;
use tokio::net::TcpListener;

/// Why a server cannot be.
#[derive(Debug, Error)]
pub enum ServeError {
    /// Options that cannot be used.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The address cannot be taken.
    #[error("{bind} cannot be listened on: {source}")]
    Bind {
        /// The address.
        bind: SocketAddr,
        /// The system's error.
        source: io::Error,
    },
}

/// A server that has its address and knows its stores.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    app: Arc<App>,
}

impl Server {
    /// Looks into stores and folders, and takes the address. A store that cannot be opened is no error: it is listed
    /// with what is wrong with it.
    ///
    /// # Errors
    /// When the address is open to others and no token was given, or cannot be taken.
    pub async fn bind(
        options: Options,
        renderer: Option<Arc<dyn Renderer>>,
    ) -> Result<Self, ServeError> {
        options.check()?;
        let bind = options.bind;
        let at = |source| ServeError::Bind { bind, source };
        let listener = TcpListener::bind(bind).await.map_err(at)?;
        let address = listener.local_addr().map_err(at)?;
        let app = Arc::new(App::new(options, renderer));
        Ok(Self { listener, address, app })
    }

    /// The address that it has.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The datasets' names, each with the range of its samples as precomputed has them
    /// ([`neuroglancer_link`](crate::neuroglancer_link)); an error's text for one that cannot be opened.
    pub fn datasets(&self) -> Vec<(String, Result<[f64; 2], String>)> {
        let state = |entry| match entry {
            Entry::Open(dataset) => Ok(precomputed::range(&dataset.metadata)),
            Entry::Broken(problem) => Err(problem.detail().to_owned()),
        };
        self.app.catalog.list().into_iter().map(|(name, entry)| (name, state(entry))).collect()
    }

    /// Answers until `stop` is done, then lets open requests end.
    pub async fn run(self, stop: impl Future<Output = ()>) {
        let Self { listener, app, .. } = self;
        let rescans = tokio::spawn(rescan(Arc::clone(&app)));
        let calls = tokio::spawn(call_in(Arc::clone(&app)));
        let router = routes::router(&app);
        connections::accept(listener, app, router, stop).await;
        rescans.abort();
        calls.abort();
    }
}

/// Looks for stores that came, went or were replaced, again and again.
async fn rescan(app: Arc<App>) {
    loop {
        tokio::time::sleep(app.options.rescan).await;
        let looked = Arc::clone(&app);
        if tokio::task::spawn_blocking(move || looked.catalog.rescan()).await.is_err() {
            tracing::error!("looking for stores failed");
        }
    }
}

/// Cuts off, again and again, who does not take answers in time, or asks nothing. Bodies are part of requests, whose time is
/// limited.
async fn call_in(app: Arc<App>) {
    let limits = app.options.limits;
    let every = limits.stall_time.min(limits.head_time) / 4;
    loop {
        tokio::time::sleep(every).await;
        app.answers.call_in_overdue();
        app.places.call_in_overdue();
    }
}
