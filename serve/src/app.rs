//! What all routes share: the stores, the pool, the cache of products.

use crate::catalog::Catalog;
use crate::dataset::{Dataset, Named};
use crate::decoders::Decoders;
use crate::ledger::Ledger;
use crate::metrics::Metrics;
use crate::options::Options;
use crate::problem::Problem;
use crate::product::{self, Product, Shape};
use crate::render::Renderer;
use crate::statistics::Statistics;
use octree_store::{NodeKey, Store};
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::Semaphore;

type CacheKey = (u64, Shape, NodeKey);

/// A product weighs what it takes.
#[derive(Debug, Clone)]
struct Bytes;

impl Weighter<CacheKey, Product> for Bytes {
    fn weight(&self, _: &CacheKey, product: &Product) -> u64 {
        product.bytes.len() as u64 + 512
    }
}

/// The server's state.
pub(crate) struct App {
    pub(crate) options: Options,
    pub(crate) catalog: Catalog,
    pub(crate) decoders: Decoders,
    pub(crate) metrics: Metrics,
    pub(crate) renderer: Option<Arc<dyn Renderer>>,
    /// Room for answers that clients have not taken yet, and for bodies that they have not sent yet.
    pub(crate) answers: Arc<Ledger>,
    pub(crate) bodies: Arc<Ledger>,
    /// Places of connections that ask nothing.
    pub(crate) places: Arc<Ledger>,
    /// Requests that may be worked on.
    pub(crate) requests: Semaphore,
    /// One picture at a time: a renderer takes all processors.
    pub(crate) drawing: Arc<Semaphore>,
    products: Cache<CacheKey, Product, Bytes>,
    ready: AtomicBool,
}

impl std::fmt::Debug for App {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("App").field("options", &self.options).finish_non_exhaustive()
    }
}

impl App {
    pub(crate) fn new(options: Options, renderer: Option<Arc<dyn Renderer>>) -> Self {
        let limits = options.limits;
        let items = (options.cache_bytes / (32 << 10)).max(16) as usize;
        Self {
            catalog: Catalog::new(options.stores.clone(), limits.open_stores),
            decoders: Decoders::new(limits.decodes, limits.waiting, limits.streams),
            metrics: Metrics::default(),
            renderer,
            requests: Semaphore::new(limits.requests.max(1)),
            answers: Ledger::new(limits.answer_bytes),
            bodies: Ledger::new(limits.all_body_bytes),
            places: Ledger::new(0),
            drawing: Arc::new(Semaphore::new(1)),
            products: Cache::with_weighter(items, options.cache_bytes, Bytes),
            ready: AtomicBool::new(true),
            options,
        }
    }

    /// Whether requests should be sent here.
    pub(crate) fn is_ready(&self) -> bool {
        self.ready.load(Ordering::Relaxed)
    }

    /// Says that the server is about to stop.
    pub(crate) fn retire(&self) {
        self.ready.store(false, Ordering::Relaxed);
    }

    /// A brick in a shape: kept, or made on the pool unless too many wait for it.
    pub(crate) async fn product(
        self: &Arc<Self>,
        dataset: &Arc<Dataset>,
        key: NodeKey,
        shape: Shape,
    ) -> Result<Product, Problem> {
        self.lookup(dataset, key, shape, false).await
    }

    /// The same for a stream, which waits its turn.
    pub(crate) async fn product_in_turn(
        self: &Arc<Self>,
        dataset: &Arc<Dataset>,
        key: NodeKey,
        shape: Shape,
    ) -> Result<Product, Problem> {
        self.lookup(dataset, key, shape, true).await
    }

    async fn lookup(
        self: &Arc<Self>,
        dataset: &Arc<Dataset>,
        key: NodeKey,
        shape: Shape,
        in_turn: bool,
    ) -> Result<Product, Problem> {
        // Keys outside the volume must not reach the cache.
        if !contains(dataset, key) {
            return Err(Problem::absent(format!("the dataset has no {key}")));
        }
        // Who asks for what is being made waits for it. Failures are not kept.
        match self.products.get_value_or_guard_async(&(dataset.id, shape, key)).await {
            Ok(product) => {
                self.metrics.cache_hits.inc();
                Ok(product)
            }
            Err(guard) => {
                self.metrics.cache_misses.inc();
                let opened = self.opened(dataset);
                let work = move |scratch: &mut _| {
                    opened().map(|store| product::make(&store, key, shape, scratch))
                };
                let made = if in_turn {
                    self.decoders.run_in_turn(work).await??
                } else {
                    self.decoders.run(work).await??
                };
                let product = made.map_err(|error| self.report(dataset, &error))?;
                // A cache that was made smaller than one product keeps nothing.
                let _ = guard.insert(product.clone());
                Ok(product)
            }
        }
    }

    /// What opens a dataset's store, where a thread may wait for files.
    pub(crate) fn opened(
        self: &Arc<Self>,
        dataset: &Arc<Dataset>,
    ) -> impl FnOnce() -> Result<Arc<Store>, Problem> + Send + 'static {
        let (app, dataset) = (Arc::clone(self), Arc::clone(dataset));
        move || app.catalog.handles.of(&dataset)
    }

    /// Reads a dataset's store on the pool, or refuses when too many wait for it.
    pub(crate) async fn read<T: Send + 'static>(
        self: &Arc<Self>,
        dataset: &Arc<Dataset>,
        work: impl FnOnce(&Store) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let opened = self.opened(dataset);
        self.decoders.run(move |_| opened().map(|store| work(&store))).await?
    }

    /// What a store's error is to a client; damage is counted and logged.
    pub(crate) fn report(&self, dataset: &Dataset, error: &octree_store::StoreError) -> Problem {
        let problem = Problem::of_store(error);
        if problem.status().is_server_error() {
            self.metrics.failures.inc();
            tracing::error!(dataset = dataset.name, detail = problem.detail(), "cannot be read");
        }
        problem
    }

    /// Statistics of a dataset's values, made when they are first asked for.
    pub(crate) async fn with_statistics<T: Send + 'static>(
        self: &Arc<Self>,
        named: &Named,
        work: impl FnOnce(&Dataset, &Statistics) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let dataset = Arc::clone(&named.dataset);
        self.read(&named.dataset, move |store| work(&dataset, dataset.statistics(store))).await
    }

    /// Bytes of products that are kept.
    pub(crate) fn kept_bytes(&self) -> u64 {
        self.products.weight()
    }
}

/// Whether the dataset has a node of this key.
pub(crate) fn contains(dataset: &Dataset, key: NodeKey) -> bool {
    let geometry = dataset.geometry;
    key.level() <= geometry.top_level() && geometry.contains(key)
}

/// The key of these coordinates, if the dataset has such a node.
pub(crate) fn key_of(dataset: &Dataset, [level, x, y, z]: [u64; 4]) -> Option<NodeKey> {
    let limit = 1 << NodeKey::AXIS_BITS;
    if level >= 64 || [x, y, z].iter().any(|v| *v >= limit) {
        return None;
    }
    let key = NodeKey::new(level as u8, [x, y, z]);
    contains(dataset, key).then_some(key)
}
