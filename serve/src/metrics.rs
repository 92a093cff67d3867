//! Counters for Prometheus.

use crate::app::App;
use prometheus_client::encoding::{EncodeLabelSet, text};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;
use std::time::Duration;

/// Upper ends of the buckets of answer times, in seconds.
const BUCKETS: [f64; 12] =
    [0.0001, 0.000_25, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.1, 0.5, 2.5, 10.0];

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Answered {
    route: String,
    method: String,
    status: u16,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Route {
    route: String,
}

/// What is counted.
#[derive(Debug)]
pub(crate) struct Metrics {
    answers: Family<Answered, Counter>,
    seconds: Family<Route, Histogram>,
    pub(crate) connections: Gauge,
    pub(crate) refused_connections: Counter,
    pub(crate) failures: Counter,
    pub(crate) cache_hits: Counter,
    pub(crate) cache_misses: Counter,
    pub(crate) sent_bytes: Counter,
}

impl Default for Metrics {
    fn default() -> Self {
        Self {
            answers: Family::default(),
            seconds: Family::new_with_constructor(|| Histogram::new(BUCKETS)),
            connections: Gauge::default(),
            refused_connections: Counter::default(),
            failures: Counter::default(),
            cache_hits: Counter::default(),
            cache_misses: Counter::default(),
            sent_bytes: Counter::default(),
        }
    }
}

impl Metrics {
    /// Counts an answer. Routes are templates and methods are of a list, so that clients cannot make series.
    pub(crate) fn answered(&self, route: &str, method: &http::Method, status: u16, took: Duration) {
        let method = match method.as_str() {
            known @ ("GET" | "HEAD" | "POST" | "OPTIONS") => known,
            _ => "other",
        };
        let answered = Answered { route: route.to_owned(), method: method.to_owned(), status };
        self.answers.get_or_create(&answered).inc();
        self.seconds.get_or_create(&Route { route: route.to_owned() }).observe(took.as_secs_f64());
    }
}

/// All metrics as text.
pub(crate) fn exposition(app: &App) -> Result<String, std::fmt::Error> {
    let mut registry = Registry::with_prefix("octavo");
    let metrics = &app.metrics;
    registry.register("answers", "Answers by route", metrics.answers.clone());
    registry.register("answer_seconds", "From request to head of answer", metrics.seconds.clone());
    registry.register("connections", "Open connections", metrics.connections.clone());
    let refused = metrics.refused_connections.clone();
    registry.register("refused_connections", "Connections over the limit", refused);
    registry.register("failures", "Bricks that could not be read", metrics.failures.clone());
    registry.register("sent_bytes", "Bytes of answers of known length", metrics.sent_bytes.clone());
    registry.register("cache_hits", "Bricks found ready", metrics.cache_hits.clone());
    registry.register("cache_misses", "Bricks that had to be made", metrics.cache_misses.clone());
    let gauge = |value: u64| {
        let gauge = Gauge::<i64>::default();
        gauge.set(i64::try_from(value).unwrap_or(i64::MAX));
        gauge
    };
    let (running, waiting) = app.decoders.load();
    registry.register("decodes_running", "Bricks being decoded", gauge(running as u64));
    registry.register("decodes_waiting", "Requests that wait to decode", gauge(waiting as u64));
    registry.register("cache_bytes", "Bytes of answers kept ready", gauge(app.kept_bytes()));
    registry.register("datasets", "Stores served", gauge(app.catalog.list().len() as u64));
    let mut out = String::new();
    text::encode(&mut out, &registry)?;
    Ok(out)
}
