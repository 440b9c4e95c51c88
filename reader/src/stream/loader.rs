//! Loading: from units that frames want to decoded units, by way of jobs that others do (Niski 2007, chapter 6; Correa
//! 2004, sections 4.4 and 4.5).
//!
//! A state machine without threads, clock or I/O. Frames say what they want ([`Loader::want`]), [`Loader::poll`]
//! returns the next job, and results come back in any order. A page is in flight at most once, and a unit is decoded at
//! most once at a time. The same steps give the same result, so threads, async callers and tests drive the same logic.

use std::{io, ops::Range, sync::Arc, time::Duration};

use super::{
    cache::Cache,
    counters::Counters,
    index_reads::IndexReads,
    job::{Content, Job, Outcome, Read, Task},
    prefetch::Prefetch,
    queue::{Batch, Class, Joining, Priority, Queue},
};
use crate::error::Error;
use crate::sorted::{SortedMap, SortedSet};

/// How a loader behaves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    pub byte_cache: u64,
    pub decoded_cache: u64,
    /// The most reads in flight at once.
    pub max_reads: usize,
    pub joining: Joining,
    /// Bytes per frame that may be prefetched.
    pub prefetch_bytes: u64,
    /// How often a page is read before it is given up.
    pub max_attempts: u32,
    /// Time before the second attempt; it doubles with each further one.
    pub retry_delay: Duration,
}

/// The state of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UnitState {
    /// It is decoded and can be used.
    Decoded,
    /// It is not there yet, and can be loaded.
    Coming,
    /// It has been given up.
    Failed,
}

/// A unit that is wanted and not decoded yet.
#[derive(Clone, Debug)]
struct Want<P> {
    priority: Priority,
    /// The last frame that wanted it.
    frame: u64,
    /// When a frame first demanded it.
    demanded: Option<Duration>,
    pages: Vec<P>,
    is_decoding: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Failure {
    attempts: u32,
    given_up: bool,
    not_before: Duration,
}

/// A part of the file that has been given up. Roots that need it stay coarser.
#[derive(Debug)]
#[non_exhaustive]
pub struct Problem {
    /// The page or unit.
    pub location: String,
    /// The error that made the session give it up.
    pub error: Error,
}

pub(crate) struct Loader<C: Content> {
    content: Arc<C>,
    rules: Rules,
    frame: u64,
    bytes: Cache<C::Page, Arc<[u8]>>,
    decoded: Cache<C::Unit, Arc<C::Data>>,
    wants: SortedMap<C::Unit, Want<C::Page>>,
    /// Which of these wait for a page.
    waiting: SortedMap<C::Page, SortedSet<C::Unit>>,
    /// Which of these wait for the data of another unit, their base.
    waiting_for_base: SortedMap<C::Unit, SortedSet<C::Unit>>,
    /// Which of these can be decoded.
    ready: SortedSet<(Priority, C::Unit)>,
    queue: Queue<C::Page>,
    /// What units wait for before it is known which pages they need.
    index_reads: IndexReads<C::Unit>,
    reads: SortedMap<u64, Batch<C::Page>>,
    /// Pages of these.
    flying: SortedSet<C::Page>,
    next_read: u64,
    page_failures: SortedMap<C::Page, Failure>,
    failed: SortedSet<C::Unit>,
    problems: Vec<Problem>,
    prefetch: Prefetch<C::Page, C::Unit>,
    pub counters: Counters,
}

impl<C: Content> Loader<C> {
    pub fn new(content: Arc<C>, rules: Rules) -> Self {
        Self {
            content,
            rules,
            frame: 0,
            bytes: Cache::new(rules.byte_cache),
            decoded: Cache::new(rules.decoded_cache),
            wants: SortedMap::new(),
            waiting: SortedMap::new(),
            waiting_for_base: SortedMap::new(),
            ready: SortedSet::new(),
            queue: Queue::new(),
            index_reads: IndexReads::new(),
            reads: SortedMap::new(),
            flying: SortedSet::new(),
            next_read: 0,
            page_failures: SortedMap::new(),
            failed: SortedSet::new(),
            problems: Vec::new(),
            prefetch: Prefetch::new(),
            counters: Counters::default(),
        }
    }

    /// The same, whose reads have numbers from here on.
    pub fn with_first_read(self, next_read: u64) -> Self {
        Self { next_read, ..self }
    }

    /// The number of its next read.
    pub fn next_read(&self) -> u64 {
        self.next_read
    }

    pub fn content(&self) -> &Arc<C> {
        &self.content
    }

    pub fn byte_cache(&self) -> &Cache<C::Page, Arc<[u8]>> {
        &self.bytes
    }

    pub fn decoded_cache(&self) -> &Cache<C::Unit, Arc<C::Data>> {
        &self.decoded
    }

    /// Begins a frame, which has to want everything again.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        self.counters.frames += 1;
        self.queue.begin_frame(self.frame);
        self.index_reads.begin_frame();
        self.bytes.begin_frame(self.frame);
        self.decoded.begin_frame(self.frame);
        self.prefetch.begin_frame(self.frame, self.rules.prefetch_bytes);
        self.waiting.clear();
        self.waiting_for_base.clear();
        self.ready.clear();
    }

    /// Drops what the frame does not want, and makes room. Reads in flight continue, and their pages are kept.
    pub fn end_wants(&mut self) {
        self.counters.cancelled += self.queue.drop_stale().len() as u64;
        let frame = self.frame;
        self.wants.retain(|_, want| want.frame == frame || want.is_decoding);
        self.make_room();
    }

    /// The state of a unit. Does not want it.
    pub fn state(&self, unit: C::Unit) -> UnitState {
        if self.decoded.contains(&unit) {
            UnitState::Decoded
        } else if self.failed.contains(&unit) {
            UnitState::Failed
        } else {
            UnitState::Coming
        }
    }

    /// A unit, if it is decoded. Does not count as a use.
    pub fn peek(&self, unit: C::Unit) -> Option<Arc<C::Data>> {
        self.decoded.get(&unit).cloned()
    }

    /// Whether a unit is wanted, or being decoded.
    pub fn is_loading(&self, unit: C::Unit) -> bool {
        self.wants.contains_key(&unit)
    }

    /// A unit, if it is decoded. Counts as a use by the running frame.
    pub fn take(&mut self, unit: C::Unit) -> Option<Arc<C::Data>> {
        let data = self.decoded.get(&unit).cloned()?;
        self.decoded.use_now(unit);
        Some(data)
    }

    /// Counts a decoded unit as used by every frame until it is released.
    pub fn hold(&mut self, unit: C::Unit) {
        self.decoded.pin(unit);
    }

    /// Ends a hold. The frame before the running one counts as the unit's last use.
    pub fn release(&mut self, unit: C::Unit) {
        if !self.content.is_pinned(unit)
            && let Some(data) = self.decoded.remove(&unit)
        {
            let bytes = self.content.byte_count(&data);
            self.decoded.insert(unit, data, bytes, false);
        }
    }

    /// Wants a unit for the running frame, or for later ones. `missing` is by how many levels the block that can be
    /// drawn is coarser.
    pub fn want(&mut self, unit: C::Unit, class: Class, missing: u8, now: Duration) -> UnitState {
        let demand = class == Class::Demand;
        if self.decoded.contains(&unit) {
            if demand {
                self.decoded.use_now(unit);
                self.counters.prefetch_used_bytes += self.prefetch.use_unit(unit, &*self.content);
            } else {
                self.decoded.refresh(unit);
            }
            return UnitState::Decoded;
        }
        if self.failed.contains(&unit) {
            return UnitState::Failed;
        }
        if !demand && (self.bytes.room() == 0 || self.prefetch.is_reading_paused()) {
            return UnitState::Coming;
        }
        let priority = Priority::new(class, missing);
        let frame = self.frame;
        let want = match self.wants.get(&unit) {
            Some(old) => {
                let priority = if old.frame == frame { priority.min(old.priority) } else { priority };
                self.ready.remove(&(old.priority, unit));
                Want { priority, frame, ..old.clone() }
            }
            None => match self.content.pages(unit) {
                Ok(pages) => Want { priority, frame, demanded: None, pages, is_decoding: false },
                Err(Error::Missing { ranges }) => {
                    self.index_reads.want(unit, (class, missing, now), ranges);
                    return UnitState::Coming;
                }
                Err(error) => {
                    self.give_up_unit(unit, error);
                    return UnitState::Failed;
                }
            },
        };
        self.want_pages(unit, want, demand.then_some(now))
    }

    fn want_pages(&mut self, unit: C::Unit, mut want: Want<C::Page>, demanded: Option<Duration>) -> UnitState {
        let has_failed = |page| self.page_failures.get(page).is_some_and(|failure| failure.given_up);
        if want.pages.iter().any(has_failed) {
            // The failure of the page has been reported.
            self.failed.insert(unit);
            self.wants.remove(&unit);
            return UnitState::Failed;
        }
        let mut is_ready = true;
        for &page in &want.pages {
            if self.bytes.contains(&page) {
                if demanded.is_some() {
                    self.bytes.use_now(page);
                    self.counters.prefetch_used_bytes += self.prefetch.use_page(page);
                } else {
                    self.bytes.refresh(page);
                }
                continue;
            }
            is_ready = false;
            self.waiting.or_default(page).insert(unit);
            if !self.flying.contains(&page) {
                let due = self.page_failures.get(&page).map_or(Duration::ZERO, |failure| failure.not_before);
                self.queue.want(page, want.priority, self.content.span(page), due);
            }
        }
        if let Some(base) = self.content.base(unit).filter(|base| !self.decoded.contains(base)) {
            is_ready = false;
            self.waiting_for_base.or_default(base).insert(unit);
        }
        if demanded.is_some() && want.demanded.is_none() {
            want.demanded = demanded;
            if is_ready || want.is_decoding {
                self.counters.byte_hits += 1;
            } else {
                self.counters.misses += 1;
            }
        }
        if is_ready && !want.is_decoding {
            self.ready.insert((want.priority, unit));
        }
        self.wants.insert(unit, want);
        UnitState::Coming
    }

    /// The next job: to decode a unit whose pages are loaded, else to read. `None` if all jobs are in progress or wait
    /// to be retried.
    pub fn poll(&mut self, now: Duration) -> Option<Job<C>> {
        if let Some(task) = self.next_task() {
            return Some(Job::Decode(task));
        }
        if self.is_full() {
            return None;
        }
        if let Some((range, class)) = self.index_reads.take(self.next_read, now) {
            let read = Read { id: self.next_read, offset: range.start, length: range.end - range.start, class };
            self.next_read += 1;
            self.counters.requests += 1;
            self.counters.bytes_read += read.length;
            return Some(Job::Read(read));
        }
        // Prefetching waits until nothing is demanded, and leaves a read free for what may be.
        let may_prefetch = !self.queue.has_demand() && self.reads.len() + 1 < self.rules.max_reads.max(2);
        let prefetch_left = if may_prefetch { self.prefetch.left } else { 0 };
        let most = |class| if class == Class::Demand { u64::MAX } else { prefetch_left };
        let batch = self.queue.take(now, self.rules.joining, most)?;
        self.flying.extend(batch.pages.iter().map(|(page, _)| page));
        let read =
            Read { id: self.next_read, offset: batch.span.offset, length: batch.span.length, class: batch.class };
        self.next_read += 1;
        self.counters.requests += 1;
        self.counters.bytes_read += read.length;
        if batch.class == Class::Prefetch {
            self.counters.prefetch_requests += 1;
            self.prefetch.left -= read.length;
        }
        self.reads.insert(read.id, batch);
        Some(Job::Read(read))
    }

    /// Whether as many reads are in flight as may be.
    pub fn is_full(&self) -> bool {
        self.reads.len() + self.index_reads.flying_count() >= self.rules.max_reads
    }

    fn next_task(&mut self) -> Option<Task<C>> {
        while let Some((priority, unit)) = self.ready.pop_first() {
            // Without room for decoded units that are only expected, their bytes suffice: then no frame waits for
            // reads.
            let is_crowded = self.decoded.room() == 0 || self.prefetch.is_decoding_paused();
            if priority.class() == Class::Prefetch && is_crowded {
                continue;
            }
            let Some(want) = self.wants.get_mut(&unit) else { continue };
            let bytes = |&page: &C::Page| Some((page, self.bytes.get(&page)?.clone()));
            // Prefetched bytes may have been evicted before they could be decoded; a later frame wants them again.
            let Some(pages) = want.pages.iter().map(bytes).collect() else { continue };
            let base = match self.content.base(unit).map(|base| self.decoded.get(&base)) {
                Some(None) => continue,
                base => base.flatten().cloned(),
            };
            want.is_decoding = true;
            return Some(Task { content: self.content.clone(), unit, pages, base });
        }
        None
    }

    /// Whether something that the running frame wants may still come.
    pub fn has_coming(&self) -> bool {
        self.wants.values().any(|want| want.frame == self.frame) || !self.index_reads.is_idle()
    }

    /// Whether nothing is left to do for the running frame.
    #[cfg(feature = "threads")]
    pub fn is_idle(&self) -> bool {
        let has_demand = !self.ready.is_empty() || self.queue.has_demand() || !self.reads.is_empty();
        let has_demand = has_demand || !self.index_reads.is_idle();
        !has_demand && !self.wants.values().any(|want| want.is_decoding)
    }

    /// Whether the running frame still wants any page of a read. If not, a caller may abort the read with an error.
    pub fn is_wanted(&self, read: u64) -> bool {
        let pages = self.reads.get(&read).map_or(&[][..], |batch| &batch.pages);
        self.index_reads.is_flying(read) || pages.iter().any(|(page, _)| self.waiting.contains_key(page))
    }

    /// When the next failed read may be retried.
    pub fn next_due(&self) -> Option<Duration> {
        [self.queue.next_due(), self.index_reads.next_due()].into_iter().flatten().min()
    }

    /// Takes the result of a read. Ignores results of unknown reads.
    pub fn supply(&mut self, read: u64, result: io::Result<Vec<u8>>, now: Duration) {
        if let Some(range) = self.index_reads.arrive(read) {
            return self.supply_index(range, result, now);
        }
        let Some(batch) = self.reads.remove(&read) else { return };
        let result = result.and_then(|bytes| match bytes.len() as u64 == batch.span.length {
            true => Ok(bytes),
            false => Err(io::ErrorKind::UnexpectedEof.into()),
        });
        for &(page, span) in &batch.pages {
            self.flying.remove(&page);
            let start = (span.offset - batch.span.offset) as usize;
            match &result {
                Ok(bytes) => {
                    let bytes = bytes.get(start..start + span.length as usize).unwrap_or_default();
                    if self.content.is_sound(page, bytes) {
                        self.keep_page(page, bytes.into(), batch.class);
                    } else {
                        // A second copy may be sound; a third would be no better.
                        self.fail(page, Error::format("the checksum does not match"), 2, now);
                    }
                }
                Err(error) => {
                    let source = io::Error::new(error.kind(), error.to_string());
                    let error = Error::Io { offset: span.offset, length: span.length, source };
                    self.fail(page, error, self.rules.max_attempts, now);
                }
            }
        }
        self.make_room();
    }

    /// Takes the result of a read of the index. The units that wait then know what they need, or what they need to know
    /// next.
    fn supply_index(&mut self, range: Range<u64>, result: io::Result<Vec<u8>>, now: Duration) {
        let length = range.end - range.start;
        let result = result.and_then(|bytes| match bytes.len() as u64 == length {
            true => Ok(bytes),
            false => Err(io::ErrorKind::UnexpectedEof.into()),
        });
        let units = self.index_reads.take_units();
        match result {
            Ok(bytes) => {
                self.index_reads.succeed(range.start);
                self.content.supply(range.start, bytes);
            }
            Err(source) => {
                let first = self.rules.retry_delay;
                let delay = |attempts: u32| first.saturating_mul(1 << (attempts - 1).min(16));
                if self.index_reads.fail(range.start, delay, now) >= self.rules.max_attempts {
                    // Which units need this range is not known. Those that wait for anything are given up; others may
                    // try again.
                    self.index_reads.succeed(range.start);
                    self.failed.extend(units.keys());
                    let location = format!("{length} bytes of the index at offset {}", range.start);
                    return self.report(location, Error::Io { offset: range.start, length, source });
                }
                self.counters.retries += 1;
            }
        }
        for (unit, (class, missing, since)) in units {
            self.want(unit, class, missing, since);
        }
    }

    fn keep_page(&mut self, page: C::Page, bytes: Arc<[u8]>, class: Class) {
        let length = bytes.len() as u64;
        self.page_failures.remove(&page);
        let waiting = self.waiting.remove(&page).unwrap_or_default();
        let is_demanded = |unit: &C::Unit| {
            self.wants.get(unit).is_some_and(|want| want.priority.class() == Class::Demand && want.frame == self.frame)
        };
        let demanded = waiting.iter().any(is_demanded);
        self.bytes.insert(page, bytes, length, demanded);
        if class == Class::Prefetch {
            self.counters.prefetch_bytes += length;
            self.prefetch.add_page(page, length);
        } else {
            self.prefetch.forget_page(page);
        }
        if demanded {
            self.counters.prefetch_used_bytes += self.prefetch.use_page(page);
        }
        waiting.into_iter().for_each(|unit| self.check_ready(unit));
    }

    /// Lets a wanted unit be decoded once all that it needs is there.
    fn check_ready(&mut self, unit: C::Unit) {
        let Some(want) = self.wants.get(&unit).filter(|want| !want.is_decoding) else { return };
        let has_base = self.content.base(unit).is_none_or(|base| self.decoded.contains(&base));
        if has_base && want.pages.iter().all(|page| self.bytes.contains(page)) {
            self.ready.insert((want.priority, unit));
        }
    }

    /// Schedules another attempt, or gives the page up after `max_attempts`.
    fn fail(&mut self, page: C::Page, error: Error, max_attempts: u32, now: Duration) {
        let failure = self.page_failures.or_default(page);
        failure.attempts += 1;
        if failure.attempts >= max_attempts {
            failure.given_up = true;
            for unit in self.waiting.remove(&page).unwrap_or_default() {
                self.wants.remove(&unit);
                self.failed.insert(unit);
            }
            let location = self.content.page_name(page);
            return self.report(location, error);
        }
        let delay = self.rules.retry_delay.saturating_mul(1 << (failure.attempts - 1).min(16));
        failure.not_before = now.saturating_add(delay);
        let due = failure.not_before;
        self.counters.retries += 1;
        let priority = |unit: &C::Unit| self.wants.get(unit).map(|want| want.priority);
        if let Some(priority) = self.waiting.get(&page).and_then(|units| units.iter().filter_map(priority).min()) {
            self.queue.want(page, priority, self.content.span(page), due);
        }
    }

    fn give_up_unit(&mut self, unit: C::Unit, error: Error) {
        self.failed.insert(unit);
        self.wants.remove(&unit);
        self.report(self.content.unit_name(unit), error);
    }

    pub fn report(&mut self, location: String, error: Error) {
        self.counters.failures += 1;
        let error = error.at(|| location.clone());
        self.problems.push(Problem { location, error });
    }

    /// Takes the result of decoding.
    pub fn finish(&mut self, outcome: Outcome<C>, now: Duration) {
        let Outcome { unit, result } = outcome;
        let want = self.wants.remove(&unit);
        let data = match result {
            Ok(data) => data,
            Err(error) => return self.give_up_unit(unit, error),
        };
        self.counters.decoded += 1;
        let demanded = want.as_ref().and_then(|want| want.demanded);
        match demanded {
            Some(since) => self.counters.latency.add(now.saturating_sub(since)),
            None => self.prefetch.add_unit(unit, want.iter().flat_map(|want| &want.pages)),
        }
        let is_current = want.is_some_and(|want| want.frame == self.frame && want.priority.class() == Class::Demand);
        self.decoded.insert(unit, data.clone(), self.content.byte_count(&data), is_current);
        if self.content.is_pinned(unit) {
            self.decoded.pin(unit);
        }
        let based = self.waiting_for_base.remove(&unit).unwrap_or_default();
        based.into_iter().for_each(|unit| self.check_ready(unit));
        self.make_room();
    }

    fn make_room(&mut self) {
        let (counters, prefetch) = (&mut self.counters, &mut self.prefetch);
        self.bytes.shrink(|page| {
            counters.evictions += 1;
            prefetch.page_evicted(page);
        });
        self.decoded.shrink(|unit| {
            counters.evictions += 1;
            prefetch.unit_evicted(unit);
        });
    }

    /// Everything that has been given up since the last call.
    pub fn take_problems(&mut self) -> Vec<Problem> {
        std::mem::take(&mut self.problems)
    }

    /// Forgets all failures, so units are tried again when they are wanted.
    pub fn retry_failed(&mut self) {
        self.page_failures.clear();
        self.index_reads.forget_failures();
        self.failed.clear();
    }
}
