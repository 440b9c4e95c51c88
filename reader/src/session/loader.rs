//! Loading: from pages that frames want to decoded pages, by way of jobs that others do (Niski 2007, chapter 6; Correa 2004,
//! sections 4.4 and 4.5).
//!
//! A state machine without threads, clock or I/O: a frame says what it wants ([`Loader::want`]), [`Loader::poll`] says what
//! is to be done next, and results come back in any order. A page is at most once on its way. So the same steps give the same
//! result, and threads, async callers and tests drive one logic.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    sync::Arc,
    time::Duration,
};

use super::{
    cache::Cache,
    counters::Counters,
    job::{Job, Outcome, Pages, Read, Task},
    queue::{Batch, Class, Joining, Priority, Queue},
};
use crate::error::Error;

/// For how many frames nothing is prefetched after the cache had no room for what had been.
const PREFETCH_PAUSE: u64 = 30;

/// How a loader behaves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    pub byte_cache: u64,
    pub decoded_cache: u64,
    pub max_reads: usize,
    pub joining: Joining,
    pub prefetch_bytes: u64,
    /// Reads of a page before it is given up.
    pub max_attempts: u32,
    /// Time before the second one; it doubles with each.
    pub retry_delay: Duration,
}

/// How a page stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Standing {
    /// It can be used.
    Decoded,
    /// It is wanted.
    Coming,
    /// It has been given up.
    Failed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Queued,
    Reading,
    /// Its bytes are there.
    Ready,
    Decoding,
}

/// A page that is wanted and not decoded yet.
#[derive(Clone, Copy, Debug)]
struct Want {
    priority: Priority,
    /// The last frame that wanted it.
    frame: u64,
    /// When the first frame demanded it.
    demanded: Option<Duration>,
    stage: Stage,
}

#[derive(Clone, Copy, Debug, Default)]
struct Failure {
    attempts: u32,
    given_up: bool,
    not_before: Duration,
}

/// A page that has been given up.
#[derive(Debug)]
#[non_exhaustive]
pub struct Problem {
    /// The page.
    pub page: String,
    /// Why.
    pub error: Error,
}

pub(crate) struct Loader<P: Pages> {
    pages: Arc<P>,
    rules: Rules,
    frame: u64,
    bytes: Cache<P::Unit, Arc<[u8]>>,
    decoded: Cache<P::Unit, Arc<P::Data>>,
    wants: BTreeMap<P::Unit, Want>,
    queue: Queue<P::Unit>,
    /// Pages whose bytes are there, by priority.
    ready: BTreeSet<(Priority, P::Unit)>,
    reads: BTreeMap<u64, Batch<P::Unit>>,
    next_read: u64,
    failures: BTreeMap<P::Unit, Failure>,
    problems: Vec<Problem>,
    /// Bytes of pages that were read before any frame demanded them.
    unused_prefetch: BTreeMap<P::Unit, u64>,
    prefetch_left: u64,
    prefetch_paused_until: u64,
    pub counters: Counters,
}

impl<P: Pages> Loader<P> {
    pub fn new(pages: Arc<P>, rules: Rules) -> Self {
        Self {
            pages,
            rules,
            frame: 0,
            bytes: Cache::new(rules.byte_cache),
            decoded: Cache::new(rules.decoded_cache),
            wants: BTreeMap::new(),
            queue: Queue::new(),
            ready: BTreeSet::new(),
            reads: BTreeMap::new(),
            next_read: 0,
            failures: BTreeMap::new(),
            problems: Vec::new(),
            unused_prefetch: BTreeMap::new(),
            prefetch_left: 0,
            prefetch_paused_until: 0,
            counters: Counters::default(),
        }
    }

    pub fn pages(&self) -> &Arc<P> {
        &self.pages
    }

    pub fn byte_cache(&self) -> &Cache<P::Unit, Arc<[u8]>> {
        &self.bytes
    }

    pub fn decoded_cache(&self) -> &Cache<P::Unit, Arc<P::Data>> {
        &self.decoded
    }

    /// Begins a frame: everything has to be wanted again.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        self.counters.frames += 1;
        self.queue.begin_frame(self.frame);
        self.bytes.begin_frame(self.frame);
        self.decoded.begin_frame(self.frame);
        self.prefetch_left = self.rules.prefetch_bytes;
    }

    /// Drops what the frame does not want, and makes room. Reads on their way end as they may: what they bring is kept.
    pub fn end_wants(&mut self) {
        self.counters.cancelled += self.queue.drop_stale().len() as u64;
        let frame = self.frame;
        self.wants.retain(|_, want| want.frame == frame || matches!(want.stage, Stage::Reading | Stage::Decoding));
        let wants = &self.wants;
        self.ready.retain(|(_, unit)| wants.contains_key(unit));
        self.make_room();
    }

    /// Whether a frame can have a page now; counts as use.
    pub fn take(&mut self, unit: P::Unit) -> Option<Arc<P::Data>> {
        let data = self.decoded.get(&unit).cloned()?;
        self.decoded.use_now(unit);
        self.note_demand(unit);
        Some(data)
    }

    /// How a page stands, without wanting it.
    pub fn standing(&self, unit: P::Unit) -> Standing {
        if self.decoded.contains(&unit) {
            Standing::Decoded
        } else if self.failures.get(&unit).is_some_and(|failure| failure.given_up) {
            Standing::Failed
        } else {
            Standing::Coming
        }
    }

    /// The running frame wants a page: for itself, or because it expects later frames to.
    pub fn want(&mut self, unit: P::Unit, class: Class, missing: u8, now: Duration) -> Standing {
        if class == Class::Demand && self.decoded.contains(&unit) {
            self.counters.hits += 1;
        }
        let has_no_room = self.decoded.room() == 0 || self.frame < self.prefetch_paused_until;
        if class == Class::Prefetch && has_no_room {
            return self.standing(unit);
        }
        self.want_with_prerequisites(unit, Priority::new(class, missing), now)
    }

    fn want_with_prerequisites(&mut self, unit: P::Unit, priority: Priority, now: Duration) -> Standing {
        let demand = priority.class() == Class::Demand;
        if self.decoded.contains(&unit) {
            if demand {
                self.decoded.use_now(unit);
                self.note_demand(unit);
            } else {
                self.decoded.refresh(unit);
            }
            return Standing::Decoded;
        }
        if self.failures.get(&unit).is_some_and(|failure| failure.given_up) {
            return Standing::Failed;
        }
        let mut before = Vec::new();
        self.pages.prerequisites(unit, &mut |unit| before.push(unit));
        for unit_before in before {
            if self.want_with_prerequisites(unit_before, priority, now) == Standing::Failed {
                // That has been reported.
                self.failures.insert(unit, Failure { given_up: true, ..Failure::default() });
                self.forget_want(unit);
                return Standing::Failed;
            }
        }
        let place = self.pages.place(unit);
        let has_bytes = place.length == 0 || self.bytes.contains(&unit);
        let first_stage = if has_bytes { Stage::Ready } else { Stage::Queued };
        let new = Want { priority, frame: self.frame, demanded: None, stage: first_stage };
        let want = self.wants.entry(unit).or_insert(new);
        let old_priority = want.priority;
        want.priority = if want.frame == self.frame { priority.min(old_priority) } else { priority };
        want.frame = self.frame;
        if demand && want.demanded.is_none() {
            want.demanded = Some(now);
            match want.stage {
                Stage::Queued | Stage::Reading => self.counters.misses += 1,
                Stage::Ready | Stage::Decoding if place.length > 0 => self.counters.byte_hits += 1,
                Stage::Ready | Stage::Decoding => {}
            }
        }
        let Want { priority, stage, .. } = *want;
        match stage {
            Stage::Queued => {
                let due = self.failures.get(&unit).map_or(Duration::ZERO, |failure| failure.not_before);
                self.queue.want(unit, priority, place, due);
            }
            Stage::Ready => {
                self.ready.remove(&(old_priority, unit));
                self.ready.insert((priority, unit));
                if demand { self.bytes.use_now(unit) } else { self.bytes.refresh(unit) }
            }
            Stage::Reading | Stage::Decoding => {}
        }
        if demand {
            self.note_demand(unit);
        }
        Standing::Coming
    }

    /// What was prefetched has been of use.
    fn note_demand(&mut self, unit: P::Unit) {
        if let Some(bytes) = self.unused_prefetch.remove(&unit) {
            self.counters.prefetch_used_bytes += bytes;
        }
    }

    fn forget_want(&mut self, unit: P::Unit) {
        if let Some(want) = self.wants.remove(&unit) {
            self.ready.remove(&(want.priority, unit));
        }
    }

    /// What to do next: decode what can be, else read. Nothing while all of that is on its way, or waits for its time.
    pub fn poll(&mut self, now: Duration) -> Option<Job<P>> {
        if let Some(task) = self.next_task() {
            return Some(Job::Decode(task));
        }
        if self.reads.len() >= self.rules.max_reads {
            return None;
        }
        // Prefetching waits until nothing is demanded, and leaves a read free for what may be.
        let may_prefetch = !self.queue.has_demand() && self.reads.len() + 1 < self.rules.max_reads.max(2);
        let prefetch_left = if may_prefetch { self.prefetch_left } else { 0 };
        let most = |class| if class == Class::Demand { u64::MAX } else { prefetch_left };
        let batch = self.queue.take(now, self.rules.joining, most)?;
        for (unit, _) in &batch.pages {
            if let Some(want) = self.wants.get_mut(unit) {
                want.stage = Stage::Reading;
            }
        }
        let id = self.next_read;
        self.next_read += 1;
        self.counters.requests += 1;
        self.counters.bytes_read += batch.place.length;
        if batch.class == Class::Prefetch {
            self.counters.prefetch_requests += 1;
            self.prefetch_left -= batch.place.length;
        }
        let read = Read { id, offset: batch.place.offset, length: batch.place.length, class: batch.class };
        self.reads.insert(id, batch);
        Some(Job::Read(read))
    }

    fn next_task(&mut self) -> Option<Task<P>> {
        let mut lost = Vec::new();
        let mut found = None;
        for &(_, unit) in &self.ready {
            let has_bytes = self.pages.place(unit).length == 0;
            let bytes = if has_bytes { Some(Arc::default()) } else { self.bytes.get(&unit).cloned() };
            let Some(bytes) = bytes else {
                // Prefetched, and evicted before it could be decoded.
                lost.push(unit);
                continue;
            };
            let (mut before, mut all_there) = (Vec::new(), true);
            self.pages.prerequisites(unit, &mut |unit| match self.decoded.get(&unit) {
                Some(data) => before.push(data.clone()),
                None => all_there = false,
            });
            if all_there {
                found = Some(Task { pages: self.pages.clone(), unit, bytes, before });
                break;
            }
        }
        lost.into_iter().for_each(|unit| self.forget_want(unit));
        let task = found?;
        if let Some(want) = self.wants.get_mut(&task.unit) {
            want.stage = Stage::Decoding;
            self.ready.remove(&(want.priority, task.unit));
        }
        Some(task)
    }

    /// Whether anything is being read.
    pub fn is_reading(&self) -> bool {
        !self.reads.is_empty()
    }

    /// Whether the running frame still wants any page of a read; if not, a caller may end it with an error.
    pub fn is_wanted(&self, read: u64) -> bool {
        let wanted = |unit: &P::Unit| self.wants.get(unit).is_some_and(|want| want.frame == self.frame);
        self.reads.get(&read).is_some_and(|batch| batch.pages.iter().any(|(unit, _)| wanted(unit)))
    }

    /// When a read that waits for its time may be tried again.
    pub fn next_due(&self) -> Option<Duration> {
        self.queue.next_due()
    }

    /// Takes in what a read brought. Results nobody asked for are ignored.
    pub fn supply(&mut self, read: u64, result: io::Result<Vec<u8>>, now: Duration) {
        let Some(batch) = self.reads.remove(&read) else { return };
        let result = result.and_then(|bytes| match bytes.len() as u64 == batch.place.length {
            true => Ok(bytes),
            false => Err(io::ErrorKind::UnexpectedEof.into()),
        });
        for &(unit, place) in &batch.pages {
            let start = (place.offset - batch.place.offset) as usize;
            match &result {
                Ok(bytes) => {
                    let page = bytes.get(start..start + place.length as usize).unwrap_or_default();
                    if self.pages.is_sound(unit, page) {
                        self.keep_bytes(unit, page.into(), batch.class);
                    } else {
                        self.fail(unit, Error::format("the checksum does not match"), 2, now);
                    }
                }
                Err(error) => {
                    let source = io::Error::new(error.kind(), error.to_string());
                    let error = Error::Io { offset: place.offset, length: place.length, source };
                    self.fail(unit, error, self.rules.max_attempts, now);
                }
            }
        }
        self.make_room();
    }

    fn keep_bytes(&mut self, unit: P::Unit, page: Arc<[u8]>, class: Class) {
        let length = page.len() as u64;
        let frame = self.frame;
        let want = self.wants.get_mut(&unit);
        let demanded = want.as_ref().is_some_and(|want| want.demanded.is_some());
        let used = want.as_ref().is_some_and(|want| want.frame == frame && want.priority.class() == Class::Demand);
        if class == Class::Prefetch {
            self.counters.prefetch_bytes += length;
            if demanded {
                self.counters.prefetch_used_bytes += length;
            } else {
                self.unused_prefetch.insert(unit, length);
            }
        }
        self.bytes.insert(unit, page, length, used);
        match want {
            Some(want) if want.frame == frame => {
                want.stage = Stage::Ready;
                self.ready.insert((want.priority, unit));
            }
            Some(_) => drop(self.wants.remove(&unit)),
            None => {}
        }
    }

    /// Tries again later or, after `max_attempts` in all, gives up.
    fn fail(&mut self, unit: P::Unit, error: Error, max_attempts: u32, now: Duration) {
        let failure = self.failures.entry(unit).or_default();
        failure.attempts += 1;
        if failure.attempts >= max_attempts {
            self.give_up(unit, error);
            return;
        }
        let doublings = (failure.attempts - 1).min(16);
        failure.not_before = now.saturating_add(self.rules.retry_delay.saturating_mul(1 << doublings));
        let due = failure.not_before;
        self.counters.retries += 1;
        match self.wants.get_mut(&unit) {
            Some(want) if want.frame == self.frame => {
                want.stage = Stage::Queued;
                self.queue.want(unit, want.priority, self.pages.place(unit), due);
            }
            _ => self.forget_want(unit),
        }
    }

    fn give_up(&mut self, unit: P::Unit, error: Error) {
        self.failures.entry(unit).or_default().given_up = true;
        self.counters.failures += 1;
        self.forget_want(unit);
        let page = self.pages.name(unit);
        let error = error.at(|| page.clone());
        self.problems.push(Problem { page, error });
    }

    /// Takes in a decoded page.
    pub fn finish(&mut self, outcome: Outcome<P>, now: Duration) {
        let Outcome { unit, result } = outcome;
        let want = self.wants.remove(&unit);
        let data = match result {
            Ok(data) => data,
            Err(error) => return self.give_up(unit, error),
        };
        self.counters.decoded += 1;
        self.failures.remove(&unit);
        if let Some(since) = want.and_then(|want| want.demanded) {
            self.counters.latency.add(now.saturating_sub(since));
        }
        let used = want.is_some_and(|want| want.frame == self.frame && want.priority.class() == Class::Demand);
        let bytes = self.pages.byte_count(&data);
        self.decoded.insert(unit, data, bytes, used);
        if self.pages.is_pinned(unit) {
            self.decoded.pin(unit);
        }
        self.make_room();
    }

    fn make_room(&mut self) {
        let mut evicted = Vec::new();
        self.decoded.shrink(|unit| evicted.push(unit));
        if evicted.iter().any(|unit| self.unused_prefetch.contains_key(unit)) {
            self.prefetch_paused_until = self.frame + PREFETCH_PAUSE;
        }
        self.bytes.shrink(|unit| evicted.push(unit));
        self.counters.evictions += evicted.len() as u64;
        for unit in evicted {
            if !self.decoded.contains(&unit) && !self.bytes.contains(&unit) {
                self.unused_prefetch.remove(&unit);
            }
        }
    }

    /// Pages given up since the last call.
    pub fn take_problems(&mut self) -> Vec<Problem> {
        std::mem::take(&mut self.problems)
    }

    /// Forgets which pages have been given up: they are tried again when they are wanted.
    pub fn retry_failed(&mut self) {
        self.failures.clear();
    }
}

#[cfg(test)]
impl<P: Pages> Loader<P> {
    /// A frame that only prefetches, without a bound.
    pub fn prefetch_for_test(&mut self, units: &[P::Unit]) {
        self.begin_frame();
        self.prefetch_left = u64::MAX;
        for &unit in units {
            self.want(unit, Class::Prefetch, 1, Duration::ZERO);
        }
        self.end_wants();
    }
}
