//! Maps and sets in the order of their keys, for the maps of which the reader has many kinds.
//!
//! Entries lie in runs of at most [`MOST`], in order, and a list has the runs: two searches by halves find an entry,
//! and a change moves at most one run. A kind of map takes a quarter of the code that the standard library's takes,
//! which is what counts in a browser.

use std::ops::{Bound, RangeBounds};

/// The most entries of a run.
const MOST: usize = 64;
/// Runs that would have no more together become one.
const FEW: usize = 24;

/// Values by key.
#[derive(Clone, Debug)]
pub(crate) struct SortedMap<K, V> {
    /// None is empty.
    runs: Vec<Vec<(K, V)>>,
    count: usize,
}

/// Where an entry is, or where it would be inserted.
#[derive(Clone, Copy)]
struct Place {
    run: usize,
    at: usize,
    is_there: bool,
}

impl<K, V> Default for SortedMap<K, V> {
    fn default() -> Self {
        Self { runs: Vec::new(), count: 0 }
    }
}

impl<K, V> SortedMap<K, V> {
    /// A map without entries.
    pub const fn new() -> Self {
        Self { runs: Vec::new(), count: 0 }
    }

    pub fn len(&self) -> usize {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    pub fn clear(&mut self) {
        self.runs.clear();
        self.count = 0;
    }

    /// The entries, ascending.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = (&K, &V)> + Clone {
        self.runs.iter().flatten().map(|(key, value)| (key, value))
    }

    pub fn keys(&self) -> impl DoubleEndedIterator<Item = &K> + Clone {
        self.runs.iter().flatten().map(|(key, _)| key)
    }

    pub fn values(&self) -> impl ExactSizeIterator<Item = &V> {
        Counted { entries: self.runs.iter().flatten().map(|(_, value)| value), left: self.count }
    }

    pub fn iter_mut(&mut self) -> impl Iterator<Item = (&K, &mut V)> {
        self.runs.iter_mut().flatten().map(|(key, value)| (&*key, value))
    }

    pub fn values_mut(&mut self) -> impl Iterator<Item = &mut V> {
        self.runs.iter_mut().flatten().map(|(_, value)| value)
    }

    pub fn into_values(self) -> impl Iterator<Item = V> {
        self.runs.into_iter().flatten().map(|(_, value)| value)
    }

    /// The entry with the least key.
    pub fn first(&self) -> Option<(&K, &V)> {
        self.runs.first()?.first().map(|(key, value)| (key, value))
    }

    /// Removes all entries but those that are to be kept.
    pub fn retain(&mut self, mut keeps: impl FnMut(&K, &mut V) -> bool) {
        self.runs.iter_mut().for_each(|run| run.retain_mut(|(key, value)| keeps(key, value)));
        self.runs.retain(|run| !run.is_empty());
        self.count = self.runs.iter().map(Vec::len).sum();
    }

    fn take(&mut self, Place { run: number, at, .. }: Place) -> (K, V) {
        self.count -= 1;
        let entry = self.runs[number].remove(at);
        let length = self.runs[number].len();
        if length == 0 {
            self.runs.remove(number);
        } else if self.runs.get(number + 1).is_some_and(|next| length + next.len() <= FEW) {
            let next = self.runs.remove(number + 1);
            self.runs[number].extend(next);
        }
        entry
    }

    fn put(&mut self, Place { run: mut number, mut at, .. }: Place, key: K, value: V) -> &mut V {
        self.count += 1;
        match self.runs.get_mut(number) {
            None => self.runs.push(Vec::with_capacity(1)),
            Some(run) if run.len() >= MOST => {
                // What comes in order fills its runs.
                let middle = if at == MOST { MOST } else { MOST / 2 };
                let rest = run.split_off(middle);
                self.runs.insert(number + 1, rest);
                if at > middle || middle == MOST {
                    (number, at) = (number + 1, at - middle);
                }
            }
            Some(_) => {}
        }
        let run = &mut self.runs[number];
        run.insert(at, (key, value));
        &mut run[at].1
    }
}

impl<K: Copy + Ord, V> SortedMap<K, V> {
    #[inline(never)]
    fn find(&self, key: K) -> Place {
        let after = self.runs.partition_point(|run| run.last().is_some_and(|(last, _)| *last < key));
        match self.runs.get(after) {
            Some(run) => {
                let at = run.partition_point(|(other, _)| *other < key);
                Place { run: after, at, is_there: run[at].0 == key }
            }
            // After the last one.
            None => {
                let last = self.runs.len().saturating_sub(1);
                Place { run: last, at: self.runs.last().map_or(0, Vec::len), is_there: false }
            }
        }
    }

    pub fn get(&self, key: &K) -> Option<&V> {
        let Place { run, at, is_there } = self.find(*key);
        is_there.then(|| &self.runs[run][at].1)
    }

    pub fn get_mut(&mut self, key: &K) -> Option<&mut V> {
        let Place { run, at, is_there } = self.find(*key);
        is_there.then(|| &mut self.runs[run][at].1)
    }

    pub fn contains_key(&self, key: &K) -> bool {
        self.find(*key).is_there
    }

    /// Adds an entry, or gives it another value and returns the one before.
    pub fn insert(&mut self, key: K, value: V) -> Option<V> {
        let place = self.find(key);
        if place.is_there {
            return Some(std::mem::replace(&mut self.runs[place.run][place.at].1, value));
        }
        self.put(place, key, value);
        None
    }

    /// The value of a key, which is added if it is not there.
    pub fn or_insert_with(&mut self, key: K, make: impl FnOnce() -> V) -> &mut V {
        let place = self.find(key);
        if place.is_there { &mut self.runs[place.run][place.at].1 } else { self.put(place, key, make()) }
    }

    pub fn or_default(&mut self, key: K) -> &mut V
    where
        V: Default,
    {
        self.or_insert_with(key, V::default)
    }

    pub fn remove(&mut self, key: &K) -> Option<V> {
        let place = self.find(*key);
        place.is_there.then(|| self.take(place).1)
    }

    pub fn pop_first(&mut self) -> Option<(K, V)> {
        (self.count > 0).then(|| self.take(Place { run: 0, at: 0, is_there: true }))
    }

    /// The entries whose keys are in a range, ascending.
    pub fn range(&self, range: impl RangeBounds<K>) -> impl DoubleEndedIterator<Item = (&K, &V)> {
        let (from, to) = (self.start_of(range.start_bound()), self.end_of(range.end_bound()));
        let run = |number: usize| self.runs.get(number).map_or(&[][..], Vec::as_slice);
        let (first, between, last) = if from.0 < to.0 {
            (&run(from.0)[from.1..], &self.runs[from.0 + 1..to.0], &run(to.0)[..to.1])
        } else if from.0 == to.0 {
            (run(from.0).get(from.1..to.1).unwrap_or(&[]), &[][..], &[][..])
        } else {
            (&[][..], &[][..], &[][..])
        };
        first.iter().chain(between.iter().flatten()).chain(last).map(|(key, value)| (key, value))
    }

    /// The entry with the greatest key that is at most `key`.
    pub fn last_up_to(&self, key: &K) -> Option<(&K, &V)> {
        let (run, at) = self.place_up_to(key)?;
        self.runs.get(run)?.get(at).map(|(key, value)| (key, value))
    }

    pub fn last_up_to_mut(&mut self, key: &K) -> Option<(&K, &mut V)> {
        let (run, at) = self.place_up_to(key)?;
        self.runs.get_mut(run)?.get_mut(at).map(|(key, value)| (&*key, value))
    }

    fn place_up_to(&self, key: &K) -> Option<(usize, usize)> {
        let Place { run, at, is_there } = self.find(*key);
        if is_there {
            return Some((run, at));
        }
        match at {
            0 => run.checked_sub(1).map(|run| (run, self.runs[run].len() - 1)),
            _ => Some((run, at - 1)),
        }
    }

    fn start_of(&self, bound: Bound<&K>) -> (usize, usize) {
        match bound {
            Bound::Unbounded => (0, 0),
            Bound::Included(key) => self.find(*key).before(),
            Bound::Excluded(key) => self.find(*key).after(),
        }
    }

    fn end_of(&self, bound: Bound<&K>) -> (usize, usize) {
        match bound {
            Bound::Unbounded => (self.runs.len(), 0),
            Bound::Included(key) => self.find(*key).after(),
            Bound::Excluded(key) => self.find(*key).before(),
        }
    }
}

impl Place {
    fn before(self) -> (usize, usize) {
        (self.run, self.at)
    }

    fn after(self) -> (usize, usize) {
        (self.run, self.at + usize::from(self.is_there))
    }
}

impl<K: PartialEq, V: PartialEq> PartialEq for SortedMap<K, V> {
    fn eq(&self, other: &Self) -> bool {
        self.count == other.count && self.iter().eq(other.iter())
    }
}

impl<K: Eq, V: Eq> Eq for SortedMap<K, V> {}

impl<K: Copy + Ord, V> Extend<(K, V)> for SortedMap<K, V> {
    fn extend<T: IntoIterator<Item = (K, V)>>(&mut self, entries: T) {
        entries.into_iter().for_each(|(key, value)| _ = self.insert(key, value));
    }
}

impl<K: Copy + Ord, V> FromIterator<(K, V)> for SortedMap<K, V> {
    fn from_iter<T: IntoIterator<Item = (K, V)>>(entries: T) -> Self {
        let mut map = Self::new();
        map.extend(entries);
        map
    }
}

impl<K, V> IntoIterator for SortedMap<K, V> {
    type Item = (K, V);
    type IntoIter = std::iter::Flatten<std::vec::IntoIter<Vec<(K, V)>>>;

    fn into_iter(self) -> Self::IntoIter {
        self.runs.into_iter().flatten()
    }
}

/// An iterator that knows how many are left.
struct Counted<I> {
    entries: I,
    left: usize,
}

impl<I: Iterator> Iterator for Counted<I> {
    type Item = I::Item;

    fn next(&mut self) -> Option<I::Item> {
        self.left = self.left.saturating_sub(1);
        self.entries.next()
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.left, Some(self.left))
    }
}

impl<I: Iterator> ExactSizeIterator for Counted<I> {}

/// Keys.
#[derive(Clone, Debug)]
pub(crate) struct SortedSet<K>(SortedMap<K, ()>);

impl<K> Default for SortedSet<K> {
    fn default() -> Self {
        Self(SortedMap::new())
    }
}

impl<K> SortedSet<K> {
    /// A set without keys.
    pub const fn new() -> Self {
        Self(SortedMap::new())
    }

    #[cfg(feature = "threads")]
    pub fn is_empty(&self) -> bool {
        self.0.count == 0
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// The keys, ascending.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &K> + Clone {
        self.0.keys()
    }

    /// The least key.
    pub fn first(&self) -> Option<&K> {
        self.0.first().map(|(key, ())| key)
    }
}

impl<K: Copy + Ord> SortedSet<K> {
    pub fn contains(&self, key: &K) -> bool {
        self.0.contains_key(key)
    }

    /// Adds a key. Returns whether it is new.
    pub fn insert(&mut self, key: K) -> bool {
        self.0.insert(key, ()).is_none()
    }

    /// Removes a key. Returns whether it was there.
    pub fn remove(&mut self, key: &K) -> bool {
        self.0.remove(key).is_some()
    }

    pub fn pop_first(&mut self) -> Option<K> {
        self.0.pop_first().map(|(key, ())| key)
    }

    /// The keys in a range, ascending.
    pub fn range(&self, range: impl RangeBounds<K>) -> impl DoubleEndedIterator<Item = &K> {
        self.0.range(range).map(|(key, ())| key)
    }
}

impl<K: Copy + Ord> Extend<K> for SortedSet<K> {
    fn extend<T: IntoIterator<Item = K>>(&mut self, keys: T) {
        keys.into_iter().for_each(|key| _ = self.insert(key));
    }
}

impl<'k, K: Copy + Ord + 'k> Extend<&'k K> for SortedSet<K> {
    fn extend<T: IntoIterator<Item = &'k K>>(&mut self, keys: T) {
        keys.into_iter().for_each(|&key| _ = self.insert(key));
    }
}

impl<K: Copy + Ord> FromIterator<K> for SortedSet<K> {
    fn from_iter<T: IntoIterator<Item = K>>(keys: T) -> Self {
        let mut set = Self::new();
        set.extend(keys);
        set
    }
}

impl<K> IntoIterator for SortedSet<K> {
    type Item = K;
    type IntoIter = std::iter::Map<<SortedMap<K, ()> as IntoIterator>::IntoIter, fn((K, ())) -> K>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter().map(|(key, ())| key)
    }
}

/// The places of some numbers in ascending order; equal ones keep theirs. One sort serves all that has numbers.
pub(crate) fn in_order(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut placed: Vec<u64> = numbers.zip(0_u64..).map(|(number, at)| u64::from(number) << 32 | at).collect();
    placed.sort_unstable();
    placed.into_iter().map(|placed| placed as u32).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use proptest::prelude::*;

    fn check(map: &SortedMap<u16, u32>, model: &BTreeMap<u16, u32>) {
        assert!(map.iter().eq(model.iter()) && map.iter().rev().eq(model.iter().rev()));
        assert_eq!((map.len(), map.first()), (model.len(), model.first_key_value()));
        assert!(map.runs.iter().all(|run| !run.is_empty() && run.len() <= MOST));
    }

    proptest! {
        #[test]
        fn a_map_answers_as_that_of_the_standard_library(
            // Few keys, so that runs are filled, emptied, split and joined.
            changes in proptest::collection::vec((0_u8..8, 0_u16..400, any::<u32>()), 0..1500),
            in_order in 0_u16..300,
        ) {
            let mut map: SortedMap<u16, u32> = (0..in_order).map(|key| (key, u32::from(key))).collect();
            let mut model: BTreeMap<u16, u32> = (0..in_order).map(|key| (key, u32::from(key))).collect();
            for (change, key, value) in changes {
                match change {
                    0..4 => prop_assert_eq!(map.insert(key, value), model.insert(key, value)),
                    4..6 => prop_assert_eq!(map.remove(&key), model.remove(&key)),
                    6 => prop_assert_eq!(*map.or_default(key), *model.entry(key).or_default()),
                    _ if value % 16 == 0 => prop_assert_eq!(map.pop_first(), model.pop_first()),
                    _ => {}
                }
                prop_assert_eq!(map.get(&key), model.get(&key));
                let to = key.saturating_add((value % 300) as u16);
                prop_assert!(map.range(key..to).eq(model.range(key..to)));
                prop_assert!(map.range(key..=to).rev().eq(model.range(key..=to).rev()));
                prop_assert!(map.range(..key).next_back() == model.range(..key).next_back());
                prop_assert_eq!(map.last_up_to(&key), model.range(..=key).next_back());
            }
            check(&map, &model);
            map.retain(|key, value| (u32::from(*key) + *value) % 3 == 0);
            model.retain(|key, value| (u32::from(*key) + *value) % 3 == 0);
            check(&map, &model);
            prop_assert!(map.into_iter().eq(model));
        }
    }

    #[test]
    fn keys_in_order_fill_their_runs() {
        let set: SortedSet<u32> = (0..10 * MOST as u32).collect();
        assert_eq!(set.0.runs.len(), 10);
    }
}
