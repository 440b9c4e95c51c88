//! The queue of pages to read: by priority, each page once, near pages together (Niski 2007, section 6.1.1; Correa
//! 2004, sections 4.4 and 4.5).
//!
//! Every frame wants its pages anew. That renews priorities, and drops pages before they are read once frames no longer
//! want them. Niski stamps requests with times for the same reason.

use std::{cmp::Reverse, time::Duration};

use crate::sorted::{SortedMap, SortedSet};

/// Why something is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Class {
    /// A frame needs it to be drawn as wanted.
    Demand,
    /// A later frame will probably need it.
    Prefetch,
}

/// The urgency of a page, most urgent least: demand before prefetch, then by missing levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Priority {
    class: Class,
    missing: Reverse<u8>,
}

impl Priority {
    /// `missing` is by how many levels the block that can be drawn is coarser than wanted.
    pub fn new(class: Class, missing: u8) -> Self {
        Self { class, missing: Reverse(missing) }
    }

    pub fn class(self) -> Class {
        self.class
    }
}

/// A run of bytes in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct ByteSpan {
    pub offset: u64,
    pub length: u64,
}

impl ByteSpan {
    pub fn end(self) -> u64 {
        self.offset.saturating_add(self.length)
    }
}

/// Which pages are read together.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Joining {
    /// Pages up to this many bytes apart, which are wasted.
    pub max_gap: u64,
    /// Joining makes no read larger than this.
    pub max_length: u64,
}

#[derive(Clone, Copy, Debug)]
struct Wish {
    priority: Priority,
    span: ByteSpan,
    /// The last frame that wanted it.
    frame: u64,
    /// When it may be read.
    due: Duration,
}

/// Pages that wait to be read.
#[derive(Debug)]
pub(crate) struct Queue<K> {
    frame: u64,
    wishes: SortedMap<K, Wish>,
    by_priority: SortedSet<(Priority, K)>,
    by_span: SortedSet<(ByteSpan, K)>,
}

/// Pages that are read together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Batch<K> {
    pub class: Class,
    /// From the first to the last one.
    pub span: ByteSpan,
    /// By span in the file.
    pub pages: Vec<(K, ByteSpan)>,
}

impl<K: Copy + Ord> Queue<K> {
    pub fn new() -> Self {
        Self { frame: 0, wishes: SortedMap::new(), by_priority: SortedSet::new(), by_span: SortedSet::new() }
    }

    /// Begins a frame, which has to want everything again.
    pub fn begin_frame(&mut self, frame: u64) {
        self.frame = frame;
    }

    /// Queues a page, or renews its priority. Of several in a frame the highest counts.
    pub fn want(&mut self, key: K, priority: Priority, span: ByteSpan, due: Duration) {
        let priority = match self.wishes.get(&key) {
            Some(old) if old.frame == self.frame => priority.min(old.priority),
            _ => priority,
        };
        self.remove(&key);
        self.by_priority.insert((priority, key));
        self.by_span.insert((span, key));
        self.wishes.insert(key, Wish { priority, span, frame: self.frame, due });
    }

    /// Drops pages that the running frame has not wanted, and returns them.
    pub fn drop_stale(&mut self) -> Vec<K> {
        let stale = |(&key, wish): (&K, &Wish)| (wish.frame < self.frame).then_some(key);
        let stale: Vec<K> = self.wishes.iter().filter_map(stale).collect();
        stale.iter().for_each(|key| self.remove(key));
        stale
    }

    fn remove(&mut self, key: &K) {
        if let Some(wish) = self.wishes.remove(key) {
            self.by_priority.remove(&(wish.priority, *key));
            self.by_span.remove(&(wish.span, *key));
        }
    }

    /// Whether a demanded page waits.
    pub fn has_demand(&self) -> bool {
        self.by_priority.first().is_some_and(|(priority, _)| priority.class == Class::Demand)
    }

    /// How many pages wait.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.wishes.len()
    }

    /// When the next page may be read.
    pub fn next_due(&self) -> Option<Duration> {
        self.wishes.values().map(|wish| wish.due).min()
    }

    /// Takes the most urgent page, with pages of its class nearby. `most_bytes` bounds the size of a read of each
    /// class.
    pub fn take(&mut self, now: Duration, joining: Joining, most_bytes: impl Fn(Class) -> u64) -> Option<Batch<K>> {
        let ready = |&&(priority, key): &&(Priority, K)| {
            let wish = self.wishes.get(&key);
            wish.is_some_and(|wish| wish.due <= now && wish.span.length <= most_bytes(priority.class))
        };
        let &(priority, first) = self.by_priority.iter().find(ready)?;
        let class = priority.class;
        let span = self.wishes.get(&first)?.span;
        let max_length = joining.max_length.min(most_bytes(class));
        let mut batch = Batch { class, span, pages: Vec::new() };
        let joins = |page: &ByteSpan, read: ByteSpan| {
            let gap = page.offset.saturating_sub(read.end()).max(read.offset.saturating_sub(page.end()));
            let length = page.end().max(read.end()) - page.offset.min(read.offset);
            gap <= joining.max_gap && length <= max_length
        };
        let suits = |key: &K| {
            self.wishes.get(key).is_some_and(|wish| wish.priority.class == class && wish.due <= now) && *key != first
        };
        for &(span, key) in self.by_span.range(..(span, first)).rev().filter(|(_, key)| suits(key)) {
            if !joins(&span, batch.span) {
                break;
            }
            let end = batch.span.end().max(span.end());
            batch.span = ByteSpan { offset: span.offset, length: end - span.offset };
            batch.pages.push((key, span));
        }
        // By span, as they are found.
        batch.pages.reverse();
        batch.pages.push((first, span));
        for &(span, key) in self.by_span.range((span, first)..).filter(|(_, key)| suits(key)) {
            if !joins(&span, batch.span) {
                break;
            }
            batch.span.length = batch.span.end().max(span.end()) - batch.span.offset;
            batch.pages.push((key, span));
        }
        batch.pages.iter().for_each(|(key, _)| self.remove(key));
        Some(batch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const APART: Joining = Joining { max_gap: 0, max_length: 0 };
    const NOW: Duration = Duration::ZERO;

    fn span(offset: u64) -> ByteSpan {
        ByteSpan { offset, length: 10 }
    }

    fn order(queue: &mut Queue<u32>) -> Vec<u32> {
        std::iter::from_fn(|| queue.take(NOW, APART, |_| u64::MAX)).map(|batch| batch.pages[0].0).collect()
    }

    #[test]
    fn demand_comes_before_prefetch_and_more_missing_levels_first() {
        let mut queue = Queue::new();
        queue.want(1, Priority::new(Class::Prefetch, 9), span(0), NOW);
        queue.want(2, Priority::new(Class::Demand, 1), span(100), NOW);
        queue.want(3, Priority::new(Class::Demand, 3), span(200), NOW);
        queue.want(4, Priority::new(Class::Prefetch, 1), span(300), NOW);
        // What is wanted twice in a frame is read once, at the higher priority.
        queue.want(4, Priority::new(Class::Demand, 2), span(300), NOW);
        queue.want(4, Priority::new(Class::Prefetch, 2), span(300), NOW);
        assert!(queue.has_demand());
        assert_eq!(order(&mut queue), [3, 4, 2, 1]);
        assert_eq!(queue.len(), 0);
    }

    #[test]
    fn every_frame_renews_priorities_and_drops_what_it_does_not_want() {
        let mut queue = Queue::new();
        queue.begin_frame(1);
        for key in 1..=3 {
            queue.want(key, Priority::new(Class::Demand, key as u8), span(100 * u64::from(key)), NOW);
        }
        queue.begin_frame(2);
        queue.want(3, Priority::new(Class::Demand, 1), span(300), NOW);
        queue.want(1, Priority::new(Class::Demand, 2), span(100), NOW);
        assert_eq!(queue.drop_stale(), [2]);
        assert_eq!(order(&mut queue), [1, 3]);
    }

    #[test]
    fn near_pages_of_a_class_are_read_at_once_up_to_the_stated_waste() {
        let mut queue = Queue::new();
        for (key, offset) in [(1, 0), (2, 15), (3, 40), (4, 200), (5, 30)] {
            let class = if key == 5 { Class::Prefetch } else { Class::Demand };
            queue.want(key, Priority::new(class, if key == 2 { 5 } else { 1 }), span(offset), NOW);
        }
        let joining = Joining { max_gap: 15, max_length: 1000 };
        let batch = queue.take(NOW, joining, |_| u64::MAX).unwrap();
        assert_eq!(batch.pages.iter().map(|page| page.0).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(batch.span, ByteSpan { offset: 0, length: 50 });
        let batch = queue.take(NOW, joining, |_| u64::MAX).unwrap();
        assert_eq!((batch.pages.len(), batch.span), (1, span(200)));
        // What does not fit into the bytes of its class waits.
        let no_prefetch = |class| if class == Class::Prefetch { 9 } else { u64::MAX };
        assert_eq!(queue.take(NOW, joining, no_prefetch), None);
        assert_eq!(queue.take(NOW, joining, |_| 10).unwrap().pages, [(5, span(30))]);
    }

    #[test]
    fn a_page_waits_for_its_time() {
        let mut queue = Queue::new();
        let later = Duration::from_millis(7);
        queue.want(1, Priority::new(Class::Demand, 1), span(0), later);
        assert_eq!(queue.take(NOW, APART, |_| u64::MAX), None);
        assert_eq!(queue.next_due(), Some(later));
        assert!(queue.take(later, APART, |_| u64::MAX).is_some());
    }
}
