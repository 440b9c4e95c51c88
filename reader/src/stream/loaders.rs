//! Threads that do a session's jobs: each reads and decodes (Niski 2007, section 6.1: loader threads that are kept alive;
//! Correa 2004, section 4.4: eight of them).

use std::{
    io,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

use super::{Frame, Job, Session, streaming::Shared};
use crate::{error::Result, select::Node, source::ReadAt};

/// How long a thread sleeps at most before it looks again.
const REST: Duration = Duration::from_millis(200);

/// Threads that load for a session. They end, after the reads that they are at, when the session is dropped; and when this
/// is, which waits for them.
pub struct Loaders {
    shared: Arc<Shared>,
    start: Instant,
    /// Nanoseconds that reading and decoding have taken, all threads together.
    work: Arc<[AtomicU64; 2]>,
    threads: Vec<JoinHandle<()>>,
}

impl Loaders {
    /// Starts `count` threads that read the session's file from `source`. A session that waits for a network wants as many as
    /// [`super::Options::max_reads`], and one more to decode.
    pub fn spawn(session: &Session, source: Arc<impl ReadAt + Send + Sync + 'static>, count: usize) -> Self {
        let shared = session.shared().clone();
        let start = Instant::now();
        let times: Arc<[AtomicU64; 2]> = Arc::default();
        let spawn = |_| {
            let (shared, source, times) = (shared.clone(), source.clone(), times.clone());
            std::thread::spawn(move || work(&shared, &*source, start, &times))
        };
        let threads = (0..count.max(1)).map(spawn).collect();
        Self { shared, start, work: times, threads }
    }

    /// How long reading and decoding have taken so far, all threads together.
    pub fn work_times(&self) -> [Duration; 2] {
        [0, 1].map(|k| Duration::from_nanos(self.work[k].load(Ordering::Relaxed)))
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

fn work(shared: &Shared, source: &impl ReadAt, start: Instant, times: &[AtomicU64; 2]) {
    let note = |kind: usize, begun: Instant| {
        times[kind].fetch_add(u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    };
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
        let begun = Instant::now();
        match Job::from(job) {
            Job::Read(read) => {
                // Whoever waits for the read is told of a panic as of any other failure.
                let result = catch_unwind(AssertUnwindSafe(|| read.run(source)));
                let result = result.unwrap_or_else(|_| Err(io::Error::other("the source panicked")));
                note(0, begun);
                shared.supply(read.id, result, start.elapsed());
            }
            Job::Decode(decoding) => {
                let decoded = decoding.run();
                note(1, begun);
                shared.finish(decoded, start.elapsed());
            }
        }
    }
}
