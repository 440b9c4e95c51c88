//! A source of a given latency under a virtual clock, for tests and measurements.

use std::time::Duration;

use super::{Frame, Job, Read, Session};
use crate::{error::Result, select::Node, sorted::SortedMap, source::ReadAt};

/// Does a session's jobs with a source whose every read takes a given time, whatever its size and however many are in
/// flight. Decoding takes no time. The clock is virtual: nothing waits, and the same steps have the same result.
#[derive(Debug)]
pub struct Simulation<T> {
    source: T,
    latency: Duration,
    now: Duration,
    /// By arrival.
    flying: SortedMap<(Duration, u64), Read>,
}

impl<T: ReadAt> Simulation<T> {
    /// A clock at zero.
    pub fn new(source: T, latency: Duration) -> Self {
        Self { source, latency, now: Duration::ZERO, flying: SortedMap::new() }
    }

    /// The time of the clock.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// The source of the bytes.
    pub fn source(&self) -> &T {
        &self.source
    }

    /// Draws a frame. In [`super::Mode::Synchronous`] the clock advances until everything is loaded.
    ///
    /// # Errors
    /// As [`Session::begin`].
    pub fn frame(&mut self, session: &mut Session, wanted: &[Node], expected: &[Node]) -> Result<Frame> {
        session.begin(wanted, expected, self.now)?;
        loop {
            self.start_jobs(session);
            if let Some(frame) = session.end(self.now) {
                return Ok(frame);
            }
            self.step(session, Duration::MAX);
        }
    }

    /// Advances the clock, and does the jobs of that time.
    pub fn advance(&mut self, session: &Session, time: Duration) {
        let end = self.now.saturating_add(time);
        self.start_jobs(session);
        while self.step(session, end) {}
        self.now = end;
    }

    /// Advances the clock until nothing is left to do.
    pub fn settle(&mut self, session: &Session) {
        self.start_jobs(session);
        while self.step(session, Duration::MAX) {}
    }

    /// Advances to the next event, if that is no later than `end`.
    fn step(&mut self, session: &Session, end: Duration) -> bool {
        let arrival = self.flying.keys().next().map(|&(due, _)| due);
        let retry = session.next_due().filter(|&due| due > self.now);
        let Some(next) = [arrival, retry].into_iter().flatten().min().filter(|&next| next <= end) else { return false };
        self.now = next;
        if arrival == Some(next)
            && let Some((_, read)) = self.flying.pop_first()
        {
            session.supply(&read, read.run(&self.source), self.now);
        }
        self.start_jobs(session);
        true
    }

    fn start_jobs(&mut self, session: &Session) {
        while let Some(job) = session.poll(self.now) {
            match job {
                Job::Read(read) => drop(self.flying.insert((self.now + self.latency, read.id), read)),
                Job::Decode(decoding) => session.finish(decoding.run(), self.now),
            }
        }
    }
}
