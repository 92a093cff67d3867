//! A place for one thing, from one thread to another: a newer one replaces what was not yet taken.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// The newest thing that was put here, if nobody has taken it.
#[derive(Debug)]
pub(super) struct Latest<T> {
    held: Mutex<Held<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct Held<T> {
    newest: Option<T>,
    closed: bool,
}

/// What is there.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Taken<T> {
    /// Something new.
    New(T),
    /// Nothing new.
    Nothing,
    /// Nothing, and nothing will come.
    Closed,
}

impl<T> Latest<T> {
    pub(super) fn new() -> Self {
        Self { held: Mutex::new(Held { newest: None, closed: false }), changed: Condvar::new() }
    }

    fn held(&self) -> MutexGuard<'_, Held<T>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a thing here, in place of one that was not taken.
    pub(super) fn put(&self, thing: T) {
        self.held().newest = Some(thing);
        self.changed.notify_all();
    }

    /// Says that nothing will come any more.
    pub(super) fn close(&self) {
        self.held().closed = true;
        self.changed.notify_all();
    }

    /// Takes what is there now.
    pub(super) fn take(&self) -> Taken<T> {
        let mut held = self.held();
        match held.newest.take() {
            _ if held.closed => Taken::Closed,
            Some(thing) => Taken::New(thing),
            None => Taken::Nothing,
        }
    }

    /// Waits for a thing; none when nothing will come.
    pub(super) fn wait(&self) -> Option<T> {
        let idle = |held: &mut Held<T>| held.newest.is_none() && !held.closed;
        let mut held =
            self.changed.wait_while(self.held(), idle).unwrap_or_else(PoisonError::into_inner);
        if held.closed { None } else { held.newest.take() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    #[test]
    fn the_newest_is_taken_once() {
        let latest = Latest::new();
        assert_eq!(latest.take(), Taken::Nothing);
        latest.put(1);
        latest.put(2);
        assert_eq!(latest.take(), Taken::New(2));
        assert_eq!(latest.take(), Taken::Nothing);
        latest.put(3);
        assert_eq!(latest.wait(), Some(3));
        latest.put(4);
        latest.close();
        assert_eq!((latest.take(), latest.wait()), (Taken::Closed, None));
    }

    #[test]
    fn who_waits_is_woken_by_things_and_by_the_end() {
        let latest = Latest::new();
        thread::scope(|scope| {
            let taker = scope.spawn(|| {
                let mut last = 0;
                while let Some(thing) = latest.wait() {
                    assert!(thing > last, "{thing} after {last}");
                    last = thing;
                    if last == 1000 {
                        return last;
                    }
                }
                last
            });
            (1..=1000).for_each(|thing| latest.put(thing));
            assert_eq!(taker.join().unwrap(), 1000);
            let waiter = scope.spawn(|| latest.wait());
            latest.close();
            assert_eq!(waiter.join().unwrap(), None);
        });
    }
}
