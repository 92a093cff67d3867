//! A progress bar on a terminal, quiet lines when piped, and an ear for Ctrl-C.

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use preprocess::Progress;
use std::io::{IsTerminal, stderr};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

static STOP: AtomicBool = AtomicBool::new(false);

/// The bars of all work that goes on, one below the other.
static BARS: LazyLock<MultiProgress> = LazyLock::new(|| {
    let terminal = stderr().is_terminal();
    MultiProgress::with_draw_target(if terminal {
        ProgressDrawTarget::stderr_with_hz(8)
    } else {
        ProgressDrawTarget::hidden()
    })
});

/// Whether someone asked the program to stop.
pub(crate) fn stopped() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Seconds between lines where no bar can be drawn.
const LINE_SECS: u64 = 10;

/// Shows how many bricks are done, at what rate, and how long the rest will take.
pub(crate) struct Bar {
    shown: ProgressBar,
    what: String,
    started: Instant,
    /// What is counted.
    unit: &'static str,
    /// Lines printed so far, where stderr is no terminal.
    lines: Option<AtomicU64>,
}

impl Bar {
    /// A bar for so many bricks. From here on Ctrl-C and SIGTERM end the work cleanly.
    pub(crate) fn new(what: impl Into<String>, bricks: u64) -> Self {
        Self::of(what, bricks, "bricks")
    }

    /// A bar for so many of something else.
    pub(crate) fn of(what: impl Into<String>, count: u64, unit: &'static str) -> Self {
        // A second call finds the handler in place, which is all that is wanted.
        let _ = ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed));
        let what = what.into();
        let terminal = stderr().is_terminal();
        let bar = BARS.add(ProgressBar::new(count));
        let style = ProgressStyle::with_template(
            "{msg} {wide_bar} {human_pos}/{human_len} {prefix}, {per_sec}, {eta} left",
        );
        bar.set_style(style.expect("the template is fixed and valid"));
        bar.set_message(what.clone());
        bar.set_prefix(unit);
        bar.enable_steady_tick(Duration::from_millis(250));
        let lines = (!terminal && count > 0).then(|| AtomicU64::new(0));
        Self { shown: bar, what, started: Instant::now(), unit, lines }
    }

    /// Takes the bar off the screen.
    pub(crate) fn finish(&self) {
        self.shown.finish_and_clear();
    }

    /// A line now and then for a log: the first after ten seconds.
    fn line(&self, lines: &AtomicU64) {
        let due = self.started.elapsed().as_secs() / LINE_SECS;
        if lines.fetch_max(due, Ordering::Relaxed) < due {
            let (done, all) = (self.shown.position(), self.shown.length().unwrap_or(0));
            eprintln!(
                "{}: {done} of {all} {}, {} s left",
                self.what,
                self.unit,
                self.shown.eta().as_secs()
            );
        }
    }
}

impl Progress for Bar {
    fn bricks_done(&self, bricks: u64) {
        self.shown.inc(bricks);
        if let Some(lines) = &self.lines {
            self.line(lines);
        }
    }

    fn should_stop(&self) -> bool {
        stopped()
    }
}
