//! A server over real sockets: what it says is what the stores say.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod codes;
mod damage;
mod description;
mod ending;
mod limits;
mod manners;
mod native;
mod render;
mod rescan;
mod slow;
mod support;
mod token;
mod viewers;
