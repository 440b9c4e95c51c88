//! What has changed in a picture, so that whoever shows it looks at that alone.

use std::collections::VecDeque;

use super::picture::new_stamp;

/// The most changes that are remembered. Whoever has missed more looks at everything.
const MOST: usize = 4096;

/// The last changes of a picture.
#[derive(Clone, Debug, Default)]
pub(super) struct History {
    /// The stamp of the picture now.
    stamp: u64,
    /// The stamp before the changes that are remembered.
    first: u64,
    /// Stamps that the picture got, ascending, each with the roots that changed with it.
    changes: VecDeque<(u64, u32)>,
}

impl History {
    /// The stamp of the picture.
    pub fn stamp(&self) -> u64 {
        self.stamp
    }

    /// Gives the picture a new stamp, if any root has changed.
    pub fn note(&mut self, roots: impl IntoIterator<Item = u32>) {
        let mut roots = roots.into_iter().peekable();
        if roots.peek().is_none() {
            return;
        }
        self.stamp = new_stamp();
        self.changes.extend(roots.map(|root| (self.stamp, root)));
        while self.changes.len() > MOST
            && let Some((oldest, _)) = self.changes.pop_front()
        {
            // Changes of one stamp are forgotten together.
            self.first = oldest;
            let is_newer = |(stamp, _): &(u64, u32)| *stamp != oldest;
            let count = self.changes.iter().position(is_newer).unwrap_or(self.changes.len());
            self.changes.drain(..count);
        }
    }

    /// The roots that have changed since a stamp, if that is one of the picture's own and not too old.
    pub fn since(&self, stamp: u64) -> Option<impl Iterator<Item = u32> + '_> {
        let after = self.changes.partition_point(|(other, _)| *other <= stamp);
        let has_been = match after.checked_sub(1) {
            Some(last) => self.changes[last].0 == stamp,
            None => self.first == stamp,
        };
        has_been.then(|| self.changes.range(after..).map(|(_, root)| *root))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_changes_since_any_own_stamp_are_known_until_there_are_too_many() {
        let mut history = History::default();
        assert_eq!(history.since(0).unwrap().count(), 0);
        history.note([]);
        assert_eq!(history.stamp(), 0);
        let mut stamps = vec![0];
        for root in 0..10 {
            history.note([root, 100 + root]);
            stamps.push(history.stamp());
        }
        for (count, &stamp) in stamps.iter().rev().enumerate() {
            let changed: Vec<u32> = history.since(stamp).unwrap().collect();
            let expected: Vec<u32> = (10 - count as u32..10).flat_map(|root| [root, 100 + root]).collect();
            assert_eq!(changed, expected);
        }
        // Another picture that was the same once has stamps of its own.
        let mut other = history.clone();
        other.note([7]);
        assert_eq!(other.since(stamps[10]).unwrap().collect::<Vec<u32>>(), [7]);
        assert!(history.since(other.stamp()).is_none());
        history.note([8]);
        assert!(other.since(history.stamp()).is_none());
        // Many changes push out all that came before.
        history.note(0..MOST as u32);
        assert!(stamps.iter().all(|&stamp| history.since(stamp).is_none()));
        let stamp = history.stamp();
        history.note([1]);
        assert_eq!(history.since(stamp).unwrap().collect::<Vec<u32>>(), [1]);
        history.note(0..2 * MOST as u32);
        assert!(history.since(stamp).is_none());
        assert_eq!(history.since(history.stamp()).unwrap().count(), 0);
    }
}
