//! Laws of a conversion, held against naive twins: whatever the size, the type, the bricks.

mod errors;
mod invariance;
mod ranges;
mod samples;
mod support;
mod values;
