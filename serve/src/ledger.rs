//! Memory that is lent to clients: for answers until they are taken, for bodies until they are whole.
//!
//! All loans together have so much room, and each has its time. A connection that keeps one for longer is cut off; and where room is
//! wanted and there is none, the one that has kept its loan for longest, if that is longer than who takes what it gets
//! would need. So slow clients cost a bounded sum, and give way to others.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio::time::Instant;

/// For which a loan is not called in, however scarce room is.
const PATIENCE: Duration = Duration::from_secs(2);

/// Tells a connection that it is to end.
pub(crate) type Cut = Arc<Notify>;

/// When a loan is over, and which it is.
type LoanKey = (Instant, u64);

#[derive(Debug)]
struct Debt {
    since: Instant,
    connection: Cut,
}

/// Room, and who has it.
#[derive(Debug)]
pub(crate) struct Ledger {
    kibibytes: Arc<Semaphore>,
    all: u32,
    debts: Mutex<BTreeMap<LoanKey, Debt>>,
    next: AtomicU64,
}

impl Ledger {
    pub(crate) fn new(bytes: u64) -> Arc<Self> {
        let all = u32::try_from(bytes >> 10).unwrap_or(u32::MAX).max(1);
        Arc::new(Self {
            kibibytes: Arc::new(Semaphore::new(all as usize)),
            all,
            debts: Mutex::default(),
            next: AtomicU64::new(0),
        })
    }

    fn debts(&self) -> MutexGuard<'_, BTreeMap<LoanKey, Debt>> {
        self.debts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lends a connection room for so many bytes, if there is; more than all there is, is lent alone.
    pub(crate) fn lend(
        self: &Arc<Self>,
        bytes: u64,
        connection: &Cut,
        within: Duration,
    ) -> Option<Loan> {
        let kibibytes = u32::try_from(bytes.div_ceil(1024)).unwrap_or(u32::MAX).min(self.all);
        let Ok(room) = Arc::clone(&self.kibibytes).try_acquire_many_owned(kibibytes) else {
            self.call_in();
            return None;
        };
        let since = Instant::now();
        let key = (since + within, self.next.fetch_add(1, Ordering::Relaxed));
        self.debts().insert(key, Debt { since, connection: Arc::clone(connection) });
        Some(Loan { ledger: Arc::clone(self), key, _room: room })
    }

    /// Cuts off the connection whose loan is over first, of those that have had theirs for a while.
    pub(crate) fn call_in(&self) {
        let now = Instant::now();
        if let Some(debt) = self.debts().values().find(|debt| debt.since + PATIENCE <= now) {
            debt.connection.notify_one();
        }
    }

    /// Cuts off connections whose time is over.
    pub(crate) fn call_in_overdue(&self) {
        let now = Instant::now();
        for (_, debt) in self.debts().range(..(now, 0)) {
            debt.connection.notify_one();
        }
    }
}

/// A loan; given back when dropped.
#[derive(Debug)]
pub(crate) struct Loan {
    ledger: Arc<Ledger>,
    key: LoanKey,
    _room: OwnedSemaphorePermit,
}

impl Drop for Loan {
    fn drop(&mut self) {
        self.ledger.debts().remove(&self.key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_mins(1);

    async fn was_cut(connection: &Cut) -> bool {
        tokio::time::timeout(Duration::from_millis(1), connection.notified()).await.is_ok()
    }

    #[tokio::test(start_paused = true)]
    async fn room_is_lent_once_and_given_back() {
        let ledger = Ledger::new(10 << 10);
        let connection = Cut::default();
        let lend = |bytes| ledger.lend(bytes, &connection, LONG);
        let first = lend(9 << 10).unwrap();
        assert!(lend(2 << 10).is_none());
        let second = lend(1).unwrap();
        assert!(lend(1).is_none(), "a byte takes a kibibyte");
        drop(first);
        assert!(lend(1 << 30).is_none(), "not while another has some");
        drop(second);
        assert!(lend(1 << 30).is_some(), "alone");
        assert!(ledger.debts().is_empty());
    }

    #[tokio::test(start_paused = true)]
    async fn who_keeps_a_loan_too_long_is_cut_off_and_no_other() {
        let ledger = Ledger::new(10 << 10);
        let [slow, quick, prompt] = [(); 3].map(|()| Cut::default());
        let _kept = ledger.lend(0, &slow, Duration::from_secs(5)).unwrap();
        let _newer = ledger.lend(0, &quick, Duration::from_secs(50)).unwrap();
        drop(ledger.lend(0, &prompt, Duration::from_secs(5)));
        ledger.call_in_overdue();
        assert!(!was_cut(&slow).await);
        tokio::time::advance(Duration::from_secs(6)).await;
        ledger.call_in_overdue();
        assert!(was_cut(&slow).await && !was_cut(&quick).await && !was_cut(&prompt).await);
    }

    #[tokio::test(start_paused = true)]
    async fn where_room_is_wanted_the_oldest_loan_is_called_in_but_no_young_one() {
        let ledger = Ledger::new(10 << 10);
        let [old, young, new] = [(); 3].map(|()| Cut::default());
        let _old = ledger.lend(5 << 10, &old, LONG).unwrap();
        tokio::time::advance(PATIENCE * 3 / 4).await;
        let _young = ledger.lend(5 << 10, &young, LONG).unwrap();
        assert!(ledger.lend(1, &new, LONG).is_none());
        assert!(!was_cut(&old).await && !was_cut(&young).await);
        tokio::time::advance(Duration::from_secs(1)).await;
        assert!(ledger.lend(1, &new, LONG).is_none());
        assert!(was_cut(&old).await && !was_cut(&young).await);
    }
}
