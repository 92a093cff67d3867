//! The least recently used one goes first, unless it is pinned.
//!
//! Entries lie in a vector; those that are not pinned form a doubly linked list through it, oldest
//! first. Pinned entries are in no list, so a frame that changes nothing touches nothing.

use std::collections::HashMap;
use std::hash::Hash;

const NONE: u32 = u32::MAX;

#[derive(Debug)]
struct Entry<K, V> {
    key: K,
    value: V,
    pinned: bool,
    before: u32,
    after: u32,
}

/// A map from keys to values that knows which unpinned entry was used longest ago.
#[derive(Debug)]
pub(super) struct Lru<K, V> {
    places: HashMap<K, u32>,
    entries: Vec<Option<Entry<K, V>>>,
    free: Vec<u32>,
    oldest: u32,
    newest: u32,
}

impl<K: Copy + Eq + Hash, V> Lru<K, V> {
    pub(super) fn new() -> Self {
        let (oldest, newest) = (NONE, NONE);
        Self { places: HashMap::new(), entries: Vec::new(), free: Vec::new(), oldest, newest }
    }

    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// The value, without using it.
    pub(super) fn peek(&self, key: K) -> Option<&V> {
        let &place = self.places.get(&key)?;
        self.entry(place).map(|entry| &entry.value)
    }

    /// The value; the entry becomes the newest.
    pub(super) fn get(&mut self, key: K) -> Option<&V> {
        let &place = self.places.get(&key)?;
        if !self.entry(place)?.pinned {
            self.unlink(place);
            self.link_newest(place);
        }
        self.entry(place).map(|entry| &entry.value)
    }

    /// Adds an entry as the newest, or replaces it.
    pub(super) fn insert(&mut self, key: K, value: V) {
        if let Some(&place) = self.places.get(&key) {
            if let Some(entry) = self.entry_mut(place) {
                entry.value = value;
            }
            self.get(key);
            return;
        }
        let entry = Entry { key, value, pinned: false, before: NONE, after: NONE };
        let place = self.free.pop().unwrap_or_else(|| {
            self.entries.push(None);
            (self.entries.len() - 1) as u32
        });
        self.entries[place as usize] = Some(entry);
        self.places.insert(key, place);
        self.link_newest(place);
    }

    /// Keeps an entry until it is unpinned; false where there is none.
    pub(super) fn pin(&mut self, key: K) -> bool {
        let Some(&place) = self.places.get(&key) else { return false };
        if self.entry(place).is_some_and(|entry| !entry.pinned) {
            self.unlink(place);
            if let Some(entry) = self.entry_mut(place) {
                entry.pinned = true;
            }
        }
        true
    }

    pub(super) fn is_pinned(&self, key: K) -> bool {
        self.places.get(&key).and_then(|&place| self.entry(place)).is_some_and(|entry| entry.pinned)
    }

    /// Lets an entry go again, as the newest.
    pub(super) fn unpin(&mut self, key: K) {
        let Some(&place) = self.places.get(&key) else { return };
        if self.entry(place).is_some_and(|entry| entry.pinned) {
            if let Some(entry) = self.entry_mut(place) {
                entry.pinned = false;
            }
            self.link_newest(place);
        }
    }

    /// Takes out the unpinned entry that was used longest ago.
    pub(super) fn pop_oldest(&mut self) -> Option<(K, V)> {
        let place = self.oldest;
        if place == NONE {
            return None;
        }
        self.unlink(place);
        let entry = self.entries[place as usize].take()?;
        self.places.remove(&entry.key);
        self.free.push(place);
        Some((entry.key, entry.value))
    }

    fn entry(&self, place: u32) -> Option<&Entry<K, V>> {
        self.entries.get(place as usize)?.as_ref()
    }

    fn entry_mut(&mut self, place: u32) -> Option<&mut Entry<K, V>> {
        self.entries.get_mut(place as usize)?.as_mut()
    }

    fn unlink(&mut self, place: u32) {
        let Some(entry) = self.entry(place) else { return };
        let (before, after) = (entry.before, entry.after);
        match self.entry_mut(before) {
            Some(entry) => entry.after = after,
            None => self.oldest = after,
        }
        match self.entry_mut(after) {
            Some(entry) => entry.before = before,
            None => self.newest = before,
        }
    }

    fn link_newest(&mut self, place: u32) {
        let newest = self.newest;
        if let Some(entry) = self.entry_mut(place) {
            (entry.before, entry.after) = (newest, NONE);
        }
        match self.entry_mut(newest) {
            Some(entry) => entry.after = place,
            None => self.oldest = place,
        }
        self.newest = place;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The obvious way: a vector of entries, oldest first.
    #[derive(Default)]
    struct Twin(Vec<(u8, u32, bool)>);

    impl Twin {
        fn at(&self, key: u8) -> Option<usize> {
            self.0.iter().position(|entry| entry.0 == key)
        }

        fn renew(&mut self, key: u8) {
            if let Some(at) = self.at(key).filter(|&at| !self.0[at].2) {
                let entry = self.0.remove(at);
                self.0.push(entry);
            }
        }
    }

    proptest! {
        #[test]
        fn it_does_as_a_plain_list_does(steps in proptest::collection::vec((0..5_u8, 0..12_u8, any::<u32>()), 0..200)) {
            let (mut lru, mut twin) = (Lru::new(), Twin::default());
            for (step, key, value) in steps {
                match step {
                    0 => {
                        lru.insert(key, value);
                        match twin.at(key) {
                            Some(at) => { twin.0[at].1 = value; twin.renew(key); }
                            None => twin.0.push((key, value, false)),
                        }
                    }
                    1 => {
                        let expected = twin.at(key).map(|at| twin.0[at].1);
                        twin.renew(key);
                        prop_assert_eq!(lru.get(key).copied(), expected);
                    }
                    2 => {
                        if let Some(at) = twin.at(key) { twin.0[at].2 = true; }
                        prop_assert_eq!(lru.pin(key), twin.at(key).is_some());
                    }
                    3 => {
                        if let Some(at) = twin.at(key).filter(|&at| twin.0[at].2) {
                            twin.0[at].2 = false;
                            twin.renew(key);
                        }
                        lru.unpin(key);
                    }
                    _ => {
                        let expected = twin.0.iter().position(|entry| !entry.2).map(|at| twin.0.remove(at));
                        prop_assert_eq!(lru.pop_oldest(), expected.map(|entry| (entry.0, entry.1)));
                    }
                }
                prop_assert_eq!(lru.len(), twin.0.len());
            }
        }
    }
}
