//! Threads that do a session's jobs. Each reads and decodes (Niski 2007, section 6.1, keeps loader threads alive;
//! Correa 2004, section 4.4, has eight).

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

use super::{
    Decoded, Frame, HeightsSession, Job, Session,
    loading::{Geometry, Shared},
};
use crate::{
    error::Result,
    select::{Node, Query},
    source::ReadAt,
};

/// The longest that a thread sleeps before it looks for work again.
const REST: Duration = Duration::from_millis(200);

/// Threads that load for a session. They end after their current reads once the session, or this, is dropped. Dropping
/// this waits for them.
pub struct Loaders {
    shared: Arc<dyn Work>,
    start: Instant,
    /// Nanoseconds spent reading and decoding, over all threads.
    work: Arc<[AtomicU64; 2]>,
    threads: Vec<JoinHandle<()>>,
}

/// What threads do for a session of either kind.
trait Work: Send + Sync {
    /// The next job; none after waiting for one for a while.
    fn next(&self, start: Instant, also_texels: bool) -> Option<Job>;
    /// Whether the session has ended.
    fn is_over(&self) -> bool;
    fn supply(&self, read: u64, result: io::Result<Vec<u8>>, now: Duration);
    fn finish(&self, decoded: Decoded, now: Duration);
    fn end(&self);
    /// Waits for a change, but not for long.
    fn rest(&self);
    /// Whether nothing is left to do for the running frame.
    fn is_idle(&self) -> bool;
}

impl<C: Geometry> Work for Shared<C>
where
    Shared<C>: Send + Sync,
{
    fn next(&self, start: Instant, also_texels: bool) -> Option<Job> {
        let mut loading = self.lock();
        if Shared::is_over(self) {
            return None;
        }
        let job = loading.poll(start.elapsed(), also_texels);
        if job.is_none() {
            let due = loading.next_due().map(|due| due.saturating_sub(start.elapsed()));
            let rest = due.unwrap_or(REST).clamp(Duration::from_millis(1), REST);
            drop(self.changed.wait_timeout(loading, rest));
        }
        job
    }

    fn is_over(&self) -> bool {
        Shared::is_over(self)
    }

    fn supply(&self, read: u64, result: io::Result<Vec<u8>>, now: Duration) {
        Shared::supply(self, read, result, now);
    }

    fn finish(&self, decoded: Decoded, now: Duration) {
        Shared::finish(self, decoded, now);
    }

    fn end(&self) {
        Shared::end(self);
    }

    fn rest(&self) {
        let loading = self.lock();
        drop(self.changed.wait_timeout(loading, Duration::from_millis(2)));
    }

    fn is_idle(&self) -> bool {
        self.lock().is_idle()
    }
}

impl Loaders {
    /// Starts `count` threads that read the session's file from `source`. A session on a network needs as many as
    /// [`super::Options::max_reads`], and one more to decode.
    pub fn spawn(session: &Session, source: Arc<impl ReadAt + Send + Sync + 'static>, count: usize) -> Self {
        Self::start(session.shared().clone(), source, count)
    }

    /// The same for a file of heights.
    pub fn spawn_for_heights(
        session: &HeightsSession,
        source: Arc<impl ReadAt + Send + Sync + 'static>,
        count: usize,
    ) -> Self {
        Self::start(session.shared().clone(), source, count)
    }

    fn start(shared: Arc<dyn Work>, source: Arc<impl ReadAt + Send + Sync + 'static>, count: usize) -> Self {
        let start = Instant::now();
        let times: Arc<[AtomicU64; 2]> = Arc::default();
        let count = count.max(1);
        let spawn = |number| {
            let (shared, source, times) = (shared.clone(), source.clone(), times.clone());
            // The first of several is always free for geometry.
            let also_texels = number > 0 || count == 1;
            std::thread::spawn(move || work(&*shared, &*source, (start, also_texels), &times))
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
        Ok(self.wait_for(|| session.end(self.now())))
    }

    /// Draws a frame of a file of heights. Waits as [`Loaders::frame`].
    ///
    /// # Errors
    /// As [`HeightsSession::begin`].
    pub fn frame_of_heights(
        &self,
        session: &mut HeightsSession,
        wanted: &Query,
        expected: Option<&Query>,
    ) -> Result<Frame> {
        session.begin(wanted, expected, self.now())?;
        Ok(self.wait_for(|| session.end(self.now())))
    }

    fn wait_for<T>(&self, mut end: impl FnMut() -> Option<T>) -> T {
        loop {
            if let Some(ended) = end() {
                return ended;
            }
            self.shared.rest();
        }
    }

    /// Waits until nothing is left to do for the running frame.
    pub fn settle(&self) {
        while !self.shared.is_idle() {
            self.shared.rest();
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

fn work(shared: &dyn Work, source: &impl ReadAt, (start, also_texels): (Instant, bool), times: &[AtomicU64; 2]) {
    let note = |kind: usize, begun: Instant| {
        times[kind].fetch_add(u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    };
    while !shared.is_over() {
        let Some(job) = shared.next(start, also_texels) else { continue };
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
