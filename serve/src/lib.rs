//! Serves stores over HTTP: bricks for renderers, and the same volumes as OME-Zarr and Neuroglancer
//! precomputed for the viewers that people already use.
//!
//! [`Server::bind`] looks into the given stores and folders and takes the address; [`Server::run`] answers
//! until it is told to stop. Nothing is written anywhere. `docs/HTTP.md` has the formats, byte by byte;
//! `/openapi.json` describes the addresses.
//!
//! A request goes through `observe` (metrics, access log), CORS, and `admit` (token, limits) to its route in
//! `routes`, and its answer through `pace`, which sees to it that it is taken. Routes ask the `app::App` for *products*: the bytes of one brick in one shape, decoded on a bounded
//! pool and kept in a bounded cache.

mod admit;
mod answer;
mod app;
mod blosc;
mod catalog;
mod code_map;
mod connections;
mod dataset;
mod decoders;
mod frames;
mod handles;
mod ledger;
mod metrics;
mod observe;
mod options;
mod pace;
mod place;
mod problem;
mod product;
mod records;
mod render;
mod routes;
mod server;
mod statistics;
mod views;

pub use options::{Compressor, Limits, Options, OptionsError, Token};
pub use render::{Picture, RenderError, RenderRequest, Renderer};
pub use server::{ServeError, Server};
pub use views::neuroglancer_link;
