//! Threads that do a session's jobs: each reads and decodes (Niski 2007, section 6.1: loader threads that are kept alive;
//! Correa 2004, section 4.4: eight of them).

use std::{
    io,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
    thread::JoinHandle,
    time::{Duration, Instant},
};

use super::{Frame, Job, Session, streaming::Shared};
use crate::{adapt::Node, error::Result, source::ReadAt};

/// How long a thread sleeps at most before it looks again.
const REST: Duration = Duration::from_millis(200);

/// Threads that load for a session. They end, after the reads that they are at, when the session is dropped; and when this
/// is, which waits for them.
pub struct Loaders {
    shared: Arc<Shared>,
    start: Instant,
    threads: Vec<JoinHandle<()>>,
}

impl Loaders {
    /// Starts `count` threads that read the session's file from `source`. A session that waits for a network wants as many as
    /// [`super::Options::max_reads`], and one more to decode.
    pub fn spawn(session: &Session, source: Arc<impl ReadAt + Send + Sync + 'static>, count: usize) -> Self {
        let shared = session.shared().clone();
        let start = Instant::now();
        let spawn = |_| {
            let (shared, source) = (shared.clone(), source.clone());
            std::thread::spawn(move || work(&shared, &*source, start))
        };
        let threads = (0..count.max(1)).map(spawn).collect();
        Self { shared, start, threads }
    }

    /// Time since the threads began: what the session's times are counted from.
    pub fn now(&self) -> Duration {
        self.start.elapsed()
    }

    /// Draws a frame. In [`super::Mode::Synchronous`] it waits until everything is there, otherwise never.
    ///
    /// # Errors
    /// As [`Session::begin`].
    pub fn frame(&self, session: &mut Session, wanted: &[Node], expected: &[Node]) -> Result<Frame> {
        session.begin(wanted, expected, self.now())?;
        loop {
            if let Some(frame) = session.end(self.now()) {
                return Ok(frame);
            }
            let loader = self.shared.lock();
            drop(self.shared.changed.wait_timeout(loader, Duration::from_millis(2)));
        }
    }

    /// Waits until nothing is left to be done for the running frame.
    pub fn settle(&self) {
        loop {
            let loader = self.shared.lock();
            if loader.is_idle() {
                return;
            }
            drop(self.shared.changed.wait_timeout(loader, Duration::from_millis(2)));
        }
    }
}

impl Drop for Loaders {
    fn drop(&mut self) {
        self.shared.end();
        for thread in self.threads.drain(..) {
            // A thread that panicked has nothing left to tell.
            let _ = thread.join();
        }
    }
}

fn work(shared: &Shared, source: &impl ReadAt, start: Instant) {
    loop {
        let mut loader = shared.lock();
        if shared.is_over() {
            return;
        }
        let Some(job) = loader.poll(start.elapsed()) else {
            let due = loader.next_due().map(|due| due.saturating_sub(start.elapsed()));
            let rest = due.unwrap_or(REST).clamp(Duration::from_millis(1), REST);
            drop(shared.changed.wait_timeout(loader, rest));
            continue;
        };
        drop(loader);
        match Job::from(job) {
            Job::Read(read) => {
                // Whoever waits for the read is told of a panic as of any other failure.
                let result = catch_unwind(AssertUnwindSafe(|| read.run(source)));
                let result = result.unwrap_or_else(|_| Err(io::Error::other("the source panicked")));
                shared.supply(read.id, result, start.elapsed());
            }
            Job::Decode(decoding) => shared.finish(decoding.run(), start.elapsed()),
        }
    }
}
