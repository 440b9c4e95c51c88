//! Reads of lists and index blocks that units wait for: what pages a unit needs is only known from them.

use std::{ops::Range, time::Duration};

use super::queue::Class;
use crate::sorted::SortedMap;

/// A unit that waits, as it was wanted: class, missing levels, time.
pub(crate) type Waiting = (Class, u8, Duration);

/// The ranges that are missing, by their beginning, and who waits for them.
#[derive(Debug)]
pub(crate) struct IndexReads<U> {
    units: SortedMap<U, Waiting>,
    wanted: SortedMap<u64, Wanted>,
    flying: SortedMap<u64, Range<u64>>,
    failures: SortedMap<u64, Failure>,
}

#[derive(Clone, Copy, Debug)]
struct Wanted {
    end: u64,
    class: Class,
}

#[derive(Clone, Copy, Debug)]
struct Failure {
    attempts: u32,
    not_before: Duration,
}

impl<U: Copy + Ord> IndexReads<U> {
    pub fn new() -> Self {
        Self { units: SortedMap::new(), wanted: SortedMap::new(), flying: SortedMap::new(), failures: SortedMap::new() }
    }

    /// Forgets what the frame before wanted.
    pub fn begin_frame(&mut self) {
        self.units.clear();
        self.wanted.clear();
    }

    /// A unit waits for ranges.
    pub fn want(&mut self, unit: U, waiting: Waiting, ranges: Vec<Range<u64>>) {
        self.units.insert(unit, waiting);
        for Range { start, end } in ranges {
            if self.flying.values().any(|flying| flying.start <= start && end <= flying.end) {
                continue;
            }
            let wanted = self.wanted.or_insert_with(start, || Wanted { end, class: waiting.0 });
            *wanted = Wanted { end: end.max(wanted.end), class: wanted.class.min(waiting.0) };
        }
    }

    /// The next range to read, unless it waits to be tried again.
    pub fn take(&mut self, id: u64, now: Duration) -> Option<(Range<u64>, Class)> {
        let is_due = |start: &u64| self.failures.get(start).is_none_or(|failure| failure.not_before <= now);
        let due = self.wanted.iter().filter(|(start, _)| is_due(start));
        let (&start, &Wanted { end, class }) = due.min_by_key(|(_, wanted)| wanted.class)?;
        self.wanted.remove(&start);
        self.flying.insert(id, start..end);
        Some((start..end, class))
    }

    /// Whether a read is one of these; if so, it has ended.
    pub fn arrive(&mut self, id: u64) -> Option<Range<u64>> {
        self.flying.remove(&id)
    }

    /// The units that wait. They have to be wanted again.
    pub fn take_units(&mut self) -> SortedMap<U, Waiting> {
        self.wanted.clear();
        std::mem::take(&mut self.units)
    }

    /// Notes that a read has failed, and when to try it again. Returns the number of attempts.
    pub fn fail(&mut self, start: u64, delay: impl FnOnce(u32) -> Duration, now: Duration) -> u32 {
        let attempts = self.failures.get(&start).map_or(0, |failure| failure.attempts) + 1;
        self.failures.insert(start, Failure { attempts, not_before: now.saturating_add(delay(attempts)) });
        attempts
    }

    /// Forgets failures.
    pub fn succeed(&mut self, start: u64) {
        self.failures.remove(&start);
    }

    pub fn forget_failures(&mut self) {
        self.failures.clear();
    }

    pub fn is_idle(&self) -> bool {
        self.wanted.is_empty() && self.flying.is_empty()
    }

    pub fn is_flying(&self, id: u64) -> bool {
        self.flying.contains_key(&id)
    }

    pub fn flying_count(&self) -> usize {
        self.flying.len()
    }

    /// When the next failed read may be tried again.
    pub fn next_due(&self) -> Option<Duration> {
        self.wanted.keys().filter_map(|start| self.failures.get(start)).map(|failure| failure.not_before).min()
    }
}
