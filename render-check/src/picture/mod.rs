//! Pictures: what rays gathered, what a display shows of it, files, and how two differ.

mod compare;
mod write;

pub use compare::{Comparison, compare, difference};
pub use write::{Bits, write_depth_png, write_depth_raw, write_png};

/// Colour times opacity, opacity, and distance from the eye, for every pixel; rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width and height.
    pub size: [u32; 2],
    /// Red, green, blue (times opacity) and opacity.
    pub colors: Vec<[f32; 4]>,
    /// World distance from the eye at which a ray is half opaque, meets the surface, or is greatest; infinite where it
    /// is none of these.
    pub depths: Vec<f32>,
}

/// What a display shows: red, green, blue from 0 to 1, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// Width and height.
    pub size: [u32; 2],
    /// A colour for each pixel.
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// What a display shows over a background.
    pub fn over(&self, background: [f64; 3]) -> Shown {
        let show = |&[r, g, b, a]: &[f32; 4]| {
            let behind = (1.0 - a).max(0.0);
            let [x, y, z] = background.map(|c| c as f32 * behind);
            [r + x, g + y, b + z].map(|c| c.clamp(0.0, 1.0))
        };
        Shown { size: self.size, pixels: self.colors.iter().map(show).collect() }
    }
}
