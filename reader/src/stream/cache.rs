//! A cache bounded in bytes, which evicts what has been unused for most frames first (Niski 2007, section 6.1.3; Correa
//! 2004, section 4.4).
//!
//! Every use stamps an entry with the frame's number. Pinned entries, and those that the running frame uses, are never
//! evicted: only they can exceed the bound.

use crate::sorted::{SortedMap, SortedSet};

#[derive(Debug)]
struct Entry<V> {
    value: V,
    bytes: u64,
    /// The last frame that used it.
    frame: u64,
    pinned: bool,
}

/// Values by key, bounded in bytes.
#[derive(Debug)]
pub(crate) struct Cache<K, V> {
    limit: u64,
    bytes: u64,
    pinned: u64,
    /// Bytes that are pinned or that the running frame uses.
    held: u64,
    frame: u64,
    entries: SortedMap<K, Entry<V>>,
    /// Entries that are not pinned, by frame of last use.
    by_age: SortedSet<(u64, K)>,
}

impl<K: Copy + Ord, V> Cache<K, V> {
    /// An empty cache of at most `limit` bytes.
    pub fn new(limit: u64) -> Self {
        let (entries, by_age) = (SortedMap::new(), SortedSet::new());
        Self { limit, bytes: 0, pinned: 0, held: 0, frame: 0, entries, by_age }
    }

    /// Begins frame `frame`, which is later than the ones before: nothing is used by it yet.
    pub fn begin_frame(&mut self, frame: u64) {
        self.frame = frame;
        self.held = self.pinned;
    }

    /// A value. This does not count as a use.
    pub fn get(&self, key: &K) -> Option<&V> {
        self.entries.get(key).map(|entry| &entry.value)
    }

    /// Whether it is cached.
    pub fn contains(&self, key: &K) -> bool {
        self.entries.contains_key(key)
    }

    /// Bytes of all entries.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes that are pinned or that the running frame uses.
    pub fn held_bytes(&self) -> u64 {
        self.held
    }

    /// Bytes that can still be added without evicting anything that the running frame uses.
    pub fn room(&self) -> u64 {
        self.limit.saturating_sub(self.held)
    }

    /// The running frame uses an entry: it stays until the next one.
    pub fn use_now(&mut self, key: K) {
        self.stamp(key, self.frame);
    }

    /// Makes an entry, which will probably be used soon, the newest of those that may be evicted.
    pub fn refresh(&mut self, key: K) {
        self.stamp(key, self.frame.saturating_sub(1));
    }

    fn stamp(&mut self, key: K, frame: u64) {
        let Some(entry) = self.entries.get_mut(&key) else { return };
        if entry.pinned || entry.frame >= frame {
            return;
        }
        self.by_age.remove(&(entry.frame, key));
        entry.frame = frame;
        self.by_age.insert((frame, key));
        if frame == self.frame {
            self.held += entry.bytes;
        }
    }

    /// Adds a value, replacing an older one; `used` says whether the running frame uses it.
    pub fn insert(&mut self, key: K, value: V, bytes: u64, used: bool) {
        self.remove(&key);
        let frame = if used { self.frame } else { self.frame.saturating_sub(1) };
        if frame == self.frame {
            self.held += bytes;
        }
        self.bytes += bytes;
        self.by_age.insert((frame, key));
        self.entries.insert(key, Entry { value, bytes, frame, pinned: false });
    }

    /// Keeps an entry until it is removed.
    pub fn pin(&mut self, key: K) {
        let Some(entry) = self.entries.get_mut(&key) else { return };
        if !std::mem::replace(&mut entry.pinned, true) {
            self.by_age.remove(&(entry.frame, key));
            self.pinned += entry.bytes;
            if entry.frame != self.frame {
                self.held += entry.bytes;
            }
        }
    }

    /// Removes an entry.
    pub fn remove(&mut self, key: &K) -> Option<V> {
        let entry = self.entries.remove(key)?;
        self.by_age.remove(&(entry.frame, *key));
        self.bytes -= entry.bytes;
        self.pinned -= if entry.pinned { entry.bytes } else { 0 };
        if entry.pinned || entry.frame == self.frame {
            self.held -= entry.bytes;
        }
        Some(entry.value)
    }

    /// Evicts entries until the bound is kept or all that are left must stay. Calls `evicted` with each key.
    pub fn shrink(&mut self, mut evicted: impl FnMut(K)) {
        while self.bytes > self.limit {
            let Some(&(frame, key)) = self.by_age.first() else { break };
            if frame >= self.frame {
                break;
            }
            self.remove(&key);
            evicted(key);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(cache: &Cache<u32, char>) -> Vec<u32> {
        cache.entries.keys().copied().collect()
    }

    #[test]
    fn the_longest_unused_goes_first_and_a_use_counts() {
        let mut cache = Cache::new(30);
        for frame in 1..=3 {
            cache.begin_frame(frame);
            cache.insert(frame as u32, 'x', 10, true);
        }
        cache.begin_frame(4);
        cache.use_now(1);
        cache.insert(4, 'x', 10, true);
        let mut gone = Vec::new();
        cache.shrink(|key| gone.push(key));
        assert_eq!((gone, keys(&cache)), (vec![2], vec![1, 3, 4]));
    }

    #[test]
    fn what_a_frame_uses_and_what_is_pinned_outlasts_the_bound() {
        let mut cache = Cache::new(15);
        cache.begin_frame(1);
        cache.insert(1, 'p', 10, true);
        cache.pin(1);
        cache.insert(2, 'a', 10, true);
        cache.insert(3, 'b', 10, true);
        cache.insert(4, 'c', 10, false);
        assert_eq!((cache.held_bytes(), cache.room()), (30, 0));
        cache.shrink(|key| assert_eq!(key, 4));
        assert_eq!((keys(&cache), cache.bytes()), (vec![1, 2, 3], 30));
        cache.begin_frame(2);
        assert_eq!((cache.held_bytes(), cache.room()), (10, 5));
        cache.shrink(|_| ());
        assert_eq!(keys(&cache), [1]);
        assert_eq!(cache.bytes(), 10);
    }

    #[test]
    fn refreshed_entries_go_last_of_those_that_may_go() {
        let mut cache = Cache::new(20);
        cache.begin_frame(1);
        for key in [1, 2] {
            cache.insert(key, 'x', 10, true);
        }
        cache.begin_frame(3);
        cache.refresh(1);
        cache.insert(3, 'x', 10, true);
        cache.shrink(|_| ());
        assert_eq!(keys(&cache), [1, 3]);
        assert_eq!(cache.remove(&3), Some('x'));
        assert_eq!((cache.held_bytes(), cache.bytes()), (0, 10));
    }
}
