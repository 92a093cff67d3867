//! A progress bar on a terminal, quiet lines when piped, and an ear for Ctrl-C.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use preprocess::Progress;
use std::io::{IsTerminal, stderr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

static STOP: AtomicBool = AtomicBool::new(false);

/// Shows how many bricks are done, at what rate, and how long the rest will take.
pub(crate) struct Bar(ProgressBar);

impl Bar {
    /// A bar for so many bricks. From here on Ctrl-C and SIGTERM end the work cleanly.
    pub(crate) fn new(what: &'static str, bricks: u64) -> Self {
        // A second call finds the handler in place, which is all that is wanted.
        let _ = ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed));
        let target = if stderr().is_terminal() {
            ProgressDrawTarget::stderr_with_hz(8)
        } else {
            ProgressDrawTarget::hidden()
        };
        let bar = ProgressBar::with_draw_target(Some(bricks), target);
        let style = ProgressStyle::with_template(
            "{msg} {wide_bar} {human_pos}/{human_len} bricks, {per_sec}, {eta} left",
        );
        bar.set_style(style.expect("the template is fixed and valid"));
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(250));
        Self(bar)
    }

    /// Takes the bar off the screen.
    pub(crate) fn finish(&self) {
        self.0.finish_and_clear();
    }
}

impl Progress for Bar {
    fn bricks_done(&self, bricks: u64) {
        self.0.inc(bricks);
    }

    fn should_stop(&self) -> bool {
        STOP.load(Ordering::Relaxed)
    }
}
