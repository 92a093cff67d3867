//! The thread that draws: always the newest wish, small while the hand moves, whole when it rests.

use super::latest::{Latest, Taken};
use octree_store::loader::{Camera, View};
use render_check::picture::Picture;
use render_check::view::Look;
use render_check::{Effort, Renderer};
use std::time::{Duration, Instant};

/// What the window wants to see.
#[derive(Debug, Clone)]
pub(super) struct Wish {
    /// Its number; later ones are newer.
    pub(super) serial: u64,
    /// Where from.
    pub(super) camera: Camera,
    /// How.
    pub(super) look: Look,
    /// Width and height of the window in pixels.
    pub(super) size: [u32; 2],
    /// Whether the hand moves, so that a quick picture counts more than a fine one.
    pub(super) moving: bool,
}

/// What was drawn of a wish.
#[derive(Debug)]
pub(super) struct Painted {
    /// What it was drawn for.
    pub(super) wish: Wish,
    /// As large as the window, or smaller.
    pub(super) picture: Picture,
    /// Of the window's full size, and nothing is left to load.
    pub(super) whole: bool,
    /// Whether the cut is coarser than asked for, for want of room.
    pub(super) limited: bool,
    /// What it took.
    pub(super) effort: Effort,
    /// What went wrong, in words.
    pub(super) problems: Vec<String>,
}

/// A moving picture is to take no longer.
const PATIENCE: Duration = Duration::from_millis(50);
/// The smallest of a window's pixels that are drawn while it moves, along a side.
const COARSEST: u32 = 8;

/// Draws wishes until the window is gone; `show` takes what was drawn, and says whether there is still a window.
///
/// # Errors
/// When the renderer fails.
pub(super) fn paint(
    mut renderer: Renderer,
    wishes: &Latest<Wish>,
    mut show: impl FnMut(Painted) -> bool,
) -> anyhow::Result<()> {
    let mut pixels_per_sec = None;
    while let Some(mut wish) = wishes.wait() {
        let mut done = false;
        while !done {
            let size = if wish.moving { moving_size(wish.size, pixels_per_sec) } else { wish.size };
            let view = View::new(wish.camera.clone(), size)?;
            let started = Instant::now();
            let rendered = renderer.frame(&view, &wish.look, None)?;
            let pixels = f64::from(size[0]) * f64::from(size[1]);
            pixels_per_sec = Some(pixels / started.elapsed().as_secs_f64().max(1e-6));
            // A hand that rests sends another wish.
            done = rendered.converged;
            let painted = Painted {
                wish: wish.clone(),
                picture: rendered.picture,
                whole: rendered.converged && size == wish.size,
                limited: rendered.limited,
                effort: *renderer.effort(),
                problems: rendered.problems,
            };
            if !show(painted) {
                return Ok(());
            }
            if !done {
                match wishes.take() {
                    Taken::New(newer) => wish = newer,
                    Taken::Nothing => renderer.wait(PATIENCE),
                    Taken::Closed => return Ok(()),
                }
            }
        }
    }
    Ok(())
}

/// The size at which a picture takes about [`PATIENCE`]: the window's, or that divided by a whole number.
fn moving_size(size: [u32; 2], pixels_per_sec: Option<f64>) -> [u32; 2] {
    let pixels = f64::from(size[0]) * f64::from(size[1]);
    let affordable = pixels_per_sec.map_or(pixels / 16.0, |speed| speed * PATIENCE.as_secs_f64());
    let divisor = ((pixels / affordable).sqrt().ceil() as u32).clamp(1, COARSEST);
    size.map(|side| side.div_ceil(divisor).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_picture_is_as_large_as_time_allows() {
        let size = [1000, 600];
        assert_eq!(moving_size(size, Some(12e6)), size);
        assert_eq!(moving_size(size, Some(11.9e6)), [500, 300]);
        assert_eq!(moving_size(size, Some(3e6)), [500, 300]);
        assert_eq!(moving_size(size, Some(1.0)), [125, 75]);
        assert_eq!(moving_size(size, None), [250, 150]);
        assert_eq!(moving_size([1, 3], Some(1.0)), [1, 1]);
    }
}
