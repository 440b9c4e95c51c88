//! Threads that do a session's jobs. Each reads and decodes (Niski 2007, section 6.1, keeps loader threads alive; Correa 2004, section
//! 4.4, has eight).

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

use super::{Frame, Job, Session, loading::Shared};
use crate::{error::Result, select::Node, source::ReadAt};

/// The longest that a thread sleeps before it looks for work again.
const REST: Duration = Duration::from_millis(200);

/// Threads that load for a session. They end after their current reads once the session, or this, is dropped. Dropping this waits for
/// them.
pub struct Loaders {
    shared: Arc<Shared>,
    start: Instant,
    /// Nanoseconds spent reading and decoding, over all threads.
    work: Arc<[AtomicU64; 2]>,
    threads: Vec<JoinHandle<()>>,
}

impl Loaders {
    /// Starts `count` threads that read the session's file from `source`. A session on a network needs as many as
    /// [`super::Options::max_reads`], and one more to decode.
    pub fn spawn(session: &Session, source: Arc<impl ReadAt + Send + Sync + 'static>, count: usize) -> Self {
        let shared = session.shared().clone();
        let start = Instant::now();
        let times: Arc<[AtomicU64; 2]> = Arc::default();
        let count = count.max(1);
        let spawn = |number| {
            let (shared, source, times) = (shared.clone(), source.clone(), times.clone());
            // The first of several is always free for geometry.
            let also_texels = number > 0 || count == 1;
            std::thread::spawn(move || work(&shared, &*source, (start, also_texels), &times))
        };
        let threads = (0..count).map(spawn).collect();
        Self { shared, start, work: times, threads }
    }

    /// Time spent reading and decoding so far, over all threads.
    pub fn work_times(&self) -> [Duration; 2] {
        [0, 1].map(|k| Duration::from_nanos(self.work[k].load(Ordering::Relaxed)))
    }

    /// Time since the threads started, from which the session's times are counted.
    pub fn now(&self) -> Duration {
        self.start.elapsed()
    }

    /// Draws a frame. Waits until everything is loaded in [`super::Mode::Synchronous`], otherwise never.
    ///
    /// # Errors
    /// As [`Session::begin`].
    pub fn frame(&self, session: &mut Session, wanted: &[Node], expected: &[Node]) -> Result<Frame> {
        session.begin(wanted, expected, self.now())?;
        loop {
            if let Some(frame) = session.end(self.now()) {
                return Ok(frame);
            }
            let loading = self.shared.lock();
            drop(self.shared.changed.wait_timeout(loading, Duration::from_millis(2)));
        }
    }

    /// Waits until nothing is left to do for the running frame.
    pub fn settle(&self) {
        loop {
            let loading = self.shared.lock();
            if loading.is_idle() {
                return;
            }
            drop(self.shared.changed.wait_timeout(loading, Duration::from_millis(2)));
        }
    }
}

impl Drop for Loaders {
    fn drop(&mut self) {
        self.shared.end();
        for thread in self.threads.drain(..) {
            // A panic of a loader has been reported by the thread.
            let _ = thread.join();
        }
    }
}

fn work(shared: &Shared, source: &impl ReadAt, (start, also_texels): (Instant, bool), times: &[AtomicU64; 2]) {
    let note = |kind: usize, begun: Instant| {
        times[kind].fetch_add(u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    };
    loop {
        let mut loading = shared.lock();
        if shared.is_over() {
            return;
        }
        let Some(job) = loading.poll(start.elapsed(), also_texels) else {
            let due = loading.next_due().map(|due| due.saturating_sub(start.elapsed()));
            let rest = due.unwrap_or(REST).clamp(Duration::from_millis(1), REST);
            drop(shared.changed.wait_timeout(loading, rest));
            continue;
        };
        drop(loading);
        let begun = Instant::now();
        match job {
            Job::Read(read) => {
                // The session handles a panic like any other failure of the read.
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
