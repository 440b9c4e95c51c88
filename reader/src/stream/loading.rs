//! What a session shares with whoever does its jobs: a loader of geometry and, where channels are shown, one of texels.
//!
//! Texels never delay geometry: they get a job only when geometry has none to give, and one thread of several does none of theirs.

use std::{
    io,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use super::{
    content::FileContent,
    job::{self, Outcome, Read, Task},
    loader::{Loader, Problem, Rules},
    texel_content::TexelContent,
};

/// A job of a session.
#[must_use]
pub enum Job {
    /// A read. Hand its result to [`super::Session::supply`].
    Read(Read),
    /// Decoding. Hand its result to [`super::Session::finish`].
    Decode(Decoding),
}

/// Decoding to do, on any thread, in any order.
pub struct Decoding(DecodingOf);

enum DecodingOf {
    Geometry(Task<FileContent>),
    Texels(Task<TexelContent>),
}

/// The result of a [`Decoding`].
pub struct Decoded(DecodedOf);

enum DecodedOf {
    Geometry(Outcome<FileContent>),
    /// With the content that it is of: other channels may be shown since.
    Texels(Arc<TexelContent>, Outcome<TexelContent>),
}

impl Decoding {
    /// Decodes.
    pub fn run(self) -> Decoded {
        Decoded(match self.0 {
            DecodingOf::Geometry(task) => DecodedOf::Geometry(task.run()),
            DecodingOf::Texels(task) => DecodedOf::Texels(Arc::clone(&task.content), task.run()),
        })
    }
}

impl From<job::Job<FileContent>> for Job {
    fn from(job: job::Job<FileContent>) -> Self {
        match job {
            job::Job::Read(read) => Self::Read(read),
            job::Job::Decode(task) => Self::Decode(Decoding(DecodingOf::Geometry(task))),
        }
    }
}

impl From<job::Job<TexelContent>> for Job {
    fn from(job: job::Job<TexelContent>) -> Self {
        match job {
            job::Job::Read(read) => Self::Read(read),
            job::Job::Decode(task) => Self::Decode(Decoding(DecodingOf::Texels(task))),
        }
    }
}

/// Numbers of reads of texels begin here, so that a number says whose read it is.
const FIRST_TEXEL_READ: u64 = 1 << 63;

/// The loaders of a session.
pub(crate) struct Loading {
    pub geometry: Loader<FileContent>,
    /// None while no channel is shown.
    pub texels: Option<Loader<TexelContent>>,
    next_texel_read: u64,
}

impl Loading {
    pub fn new(geometry: Loader<FileContent>) -> Self {
        Self { geometry, texels: None, next_texel_read: FIRST_TEXEL_READ }
    }

    /// Loads these texels from now on, or none. What comes of others is ignored.
    pub fn show(&mut self, content: Option<TexelContent>, rules: Rules) {
        if let Some(before) = &self.texels {
            self.next_texel_read = before.next_read();
        }
        let first = self.next_texel_read;
        self.texels = content.map(|content| Loader::new(Arc::new(content), rules).with_first_read(first));
    }

    /// The next job: of texels only if asked to, and if geometry has none.
    pub fn poll(&mut self, now: Duration, also_texels: bool) -> Option<Job> {
        if let Some(job) = self.geometry.poll(now) {
            return Some(job.into());
        }
        let texels = self.texels.as_mut().filter(|_| also_texels && !self.geometry.is_full())?;
        texels.poll(now).map(Job::from)
    }

    pub fn supply(&mut self, read: u64, result: io::Result<Vec<u8>>, now: Duration) {
        match &mut self.texels {
            _ if read < FIRST_TEXEL_READ => self.geometry.supply(read, result, now),
            Some(texels) => texels.supply(read, result, now),
            None => {}
        }
    }

    pub fn finish(&mut self, decoded: Decoded, now: Duration) {
        match (decoded.0, &mut self.texels) {
            (DecodedOf::Geometry(outcome), _) => self.geometry.finish(outcome, now),
            (DecodedOf::Texels(content, outcome), Some(texels)) if Arc::ptr_eq(&content, texels.content()) => {
                texels.finish(outcome, now);
            }
            (DecodedOf::Texels(..), _) => {}
        }
    }

    /// Whether nothing is left to do for the running frame.
    #[cfg(feature = "threads")]
    pub fn is_idle(&self) -> bool {
        self.geometry.is_idle() && self.texels.as_ref().is_none_or(Loader::is_idle)
    }

    /// Whether the running frame still wants any page of a read.
    pub fn is_wanted(&self, read: u64) -> bool {
        if read < FIRST_TEXEL_READ {
            return self.geometry.is_wanted(read);
        }
        self.texels.as_ref().is_some_and(|texels| texels.is_wanted(read))
    }

    /// When the next failed read may be retried.
    pub fn next_due(&self) -> Option<Duration> {
        let of_texels = self.texels.as_ref().and_then(Loader::next_due);
        [self.geometry.next_due(), of_texels].into_iter().flatten().min()
    }

    pub fn take_problems(&mut self) -> Vec<Problem> {
        let mut problems = self.geometry.take_problems();
        problems.extend(self.texels.iter_mut().flat_map(Loader::take_problems));
        problems
    }

    pub fn retry_failed(&mut self) {
        self.geometry.retry_failed();
        self.texels.iter_mut().for_each(Loader::retry_failed);
    }
}

/// The state that a session shares with its loaders.
pub(crate) struct Shared {
    loading: Mutex<Loading>,
    /// Signals that a frame has begun, a result has come, or the session has ended.
    pub changed: Condvar,
    /// Whether the session has ended.
    is_over: AtomicBool,
}

impl Shared {
    pub fn new(loading: Loading) -> Self {
        Self { loading: Mutex::new(loading), changed: Condvar::new(), is_over: AtomicBool::new(false) }
    }

    #[cfg(feature = "threads")]
    pub fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Ends the threads that load.
    pub fn end(&self) {
        // A thread that is about to sleep holds the lock, so none misses the signal.
        let loading = self.lock();
        self.is_over.store(true, Ordering::Relaxed);
        drop(loading);
        self.changed.notify_all();
    }

    pub fn lock(&self) -> MutexGuard<'_, Loading> {
        self.loading.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn supply(&self, read: u64, result: io::Result<Vec<u8>>, now: Duration) {
        self.lock().supply(read, result, now);
        self.changed.notify_all();
    }

    pub fn finish(&self, decoded: Decoded, now: Duration) {
        self.lock().finish(decoded, now);
        self.changed.notify_all();
    }
}
