//! A connection's place among those that may be open. One that asks nothing has it on loan.
//!
//! From when it is taken until its first head is whole, and whenever all its answers were taken, a connection must ask within its
//! time; and where others find no place, the one that has asked nothing for longest loses its own. hyper knows
//! the first limit for HTTP/1, and neither for HTTP/2.

use crate::ledger::{Cut, Ledger, Loan};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A connection's place.
#[derive(Debug)]
pub(crate) struct Place {
    ledger: Arc<Ledger>,
    cut: Cut,
    within: Duration,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Requests whose answers were not taken yet.
    at_work: usize,
    /// There is one where nothing is at work.
    idle: Option<Loan>,
}

impl Place {
    pub(crate) fn new(ledger: &Arc<Ledger>, within: Duration) -> Arc<Self> {
        let (ledger, cut) = (Arc::clone(ledger), Cut::default());
        let idle = ledger.lend(0, &cut, within);
        let state = Mutex::new(State { at_work: 0, idle });
        Arc::new(Self { ledger, cut, within, state })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells the connection that it is to end.
    pub(crate) fn cut(&self) -> &Cut {
        &self.cut
    }

    /// A request has come.
    pub(crate) fn work(self: &Arc<Self>) -> Work {
        let mut state = self.state();
        state.at_work += 1;
        state.idle = None;
        drop(state);
        Work { place: Arc::clone(self) }
    }
}

/// A request until its answer was taken, which is when it is dropped.
#[derive(Debug)]
pub(crate) struct Work {
    place: Arc<Place>,
}

impl Work {
    /// Ends the connection that it came by.
    pub(crate) fn cut(&self) -> &Cut {
        &self.place.cut
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let place = &self.place;
        let mut state = place.state();
        state.at_work -= 1;
        if state.at_work == 0 {
            state.idle = place.ledger.lend(0, &place.cut, place.within);
        }
    }
}
