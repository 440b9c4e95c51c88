//! What a session shares with whoever does its jobs: a loader of geometry and, where channels are shown, one of texels.
//!
//! Texels never delay geometry: they get a job only when geometry has none to give, and one thread of several does none
//! of theirs.

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
    heights::HeightsContent,
    job::{self, Content, Outcome, Read, Task},
    loader::{Loader, Problem, Rules},
    texel_content::TexelContent,
};
#[cfg(not(feature = "channels"))]
use crate::Error;
use crate::Result;

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
    /// As a closure, so that compilers leave out the decoding of heights where nobody streams them.
    Heights(Box<dyn FnOnce() -> Outcome<HeightsContent> + Send>),
    Texels(Task<TexelContent>, HasChannels),
}

/// The result of a [`Decoding`].
pub struct Decoded(DecodedOf);

enum DecodedOf {
    Geometry(Outcome<FileContent>),
    Heights(Outcome<HeightsContent>),
    /// With the content that it is of: other channels may be shown since.
    Texels(Arc<TexelContent>, Outcome<TexelContent>, HasChannels),
}

impl Decoding {
    /// Decodes.
    pub fn run(self) -> Decoded {
        Decoded(match self.0 {
            DecodingOf::Geometry(task) => DecodedOf::Geometry(task.run()),
            DecodingOf::Heights(task) => DecodedOf::Heights(task()),
            DecodingOf::Texels(task, has) => DecodedOf::Texels(Arc::clone(&task.content), task.run(), has),
        })
    }
}

/// Content that is drawn by itself: a mesh, or heights.
pub(crate) trait Geometry: Content + Sized {
    /// Decoding of such content.
    fn decoding(task: Task<Self>) -> Decoding;

    /// The outcome, if it is of such content.
    fn outcome(decoded: Decoded) -> Result<Outcome<Self>, Decoded>;
}

impl Geometry for FileContent {
    fn decoding(task: Task<Self>) -> Decoding {
        Decoding(DecodingOf::Geometry(task))
    }

    fn outcome(decoded: Decoded) -> Result<Outcome<Self>, Decoded> {
        match decoded.0 {
            DecodedOf::Geometry(outcome) => Ok(outcome),
            other => Err(Decoded(other)),
        }
    }
}

impl Geometry for HeightsContent {
    fn decoding(task: Task<Self>) -> Decoding {
        Decoding(DecodingOf::Heights(Box::new(move || task.run())))
    }

    fn outcome(decoded: Decoded) -> Result<Outcome<Self>, Decoded> {
        match decoded.0 {
            DecodedOf::Heights(outcome) => Ok(outcome),
            other => Err(Decoded(other)),
        }
    }
}

fn geometry_job<C: Geometry>(job: job::Job<C>) -> Job {
    match job {
        job::Job::Read(read) => Job::Read(read),
        job::Job::Decode(task) => Job::Decode(C::decoding(task)),
    }
}

impl TexelLoader {
    fn poll(&mut self, now: Duration) -> Option<Job> {
        Some(match self.loader.poll(now)? {
            job::Job::Read(read) => Job::Read(read),
            job::Job::Decode(task) => Job::Decode(Decoding(DecodingOf::Texels(task, self.has))),
        })
    }
}

/// Numbers of reads of texels begin here, so that a number says whose read it is.
const FIRST_TEXEL_READ: u64 = 1 << 63;

/// What has this needs the feature `channels`. Without the feature nothing has it, and compilers leave out all code for
/// what nothing has.
#[derive(Clone, Copy, Debug)]
pub(crate) enum HasChannels {
    #[cfg(feature = "channels")]
    Yes,
}

/// Proof that this reader shows channels.
///
/// # Errors
/// [`Error::Unsupported`] without the feature `channels`.
pub(crate) fn has_channels() -> Result<HasChannels> {
    #[cfg(feature = "channels")]
    return Ok(HasChannels::Yes);
    #[cfg(not(feature = "channels"))]
    return Err(Error::Unsupported {
        what: "this one shows no channels (it was compiled without its feature `channels`)".into(),
    });
}

/// A loader of texels.
pub(crate) struct TexelLoader {
    pub loader: Loader<TexelContent>,
    has: HasChannels,
}

/// The loaders of a session.
pub(crate) struct Loading<C: Geometry = FileContent> {
    pub geometry: Loader<C>,
    /// None while no channel is shown.
    pub texels: Option<TexelLoader>,
    next_texel_read: u64,
}

impl<C: Geometry> Loading<C> {
    pub fn new(geometry: Loader<C>) -> Self {
        Self { geometry, texels: None, next_texel_read: FIRST_TEXEL_READ }
    }

    /// Loads these texels from now on, or none. What comes of others is ignored.
    pub fn show(&mut self, content: Option<(TexelContent, HasChannels)>, rules: Rules) {
        if let Some(before) = &self.texels {
            self.next_texel_read = before.loader.next_read();
        }
        let first = self.next_texel_read;
        self.texels = content.map(|(content, has)| TexelLoader {
            loader: Loader::new(Arc::new(content), rules).with_first_read(first),
            has,
        });
    }

    /// The next job: of texels only if asked to, and if geometry has none.
    pub fn poll(&mut self, now: Duration, also_texels: bool) -> Option<Job> {
        if let Some(job) = self.geometry.poll(now) {
            return Some(geometry_job(job));
        }
        let texels = self.texels.as_mut().filter(|_| also_texels && !self.geometry.is_full())?;
        texels.poll(now)
    }

    pub fn supply(&mut self, read: u64, result: io::Result<Vec<u8>>, now: Duration) {
        match &mut self.texels {
            _ if read < FIRST_TEXEL_READ => self.geometry.supply(read, result, now),
            Some(texels) => texels.loader.supply(read, result, now),
            None => {}
        }
    }

    pub fn finish(&mut self, decoded: Decoded, now: Duration) {
        match (C::outcome(decoded), &mut self.texels) {
            (Ok(outcome), _) => self.geometry.finish(outcome, now),
            (Err(Decoded(DecodedOf::Texels(content, outcome, _))), Some(TexelLoader { loader, .. }))
                if Arc::ptr_eq(&content, loader.content()) =>
            {
                loader.finish(outcome, now);
            }
            (Err(_), _) => {}
        }
    }

    /// Whether nothing is left to do for the running frame.
    #[cfg(feature = "threads")]
    pub fn is_idle(&self) -> bool {
        self.geometry.is_idle() && self.texels.as_ref().is_none_or(|texels| texels.loader.is_idle())
    }

    /// Whether the running frame still wants any page of a read.
    pub fn is_wanted(&self, read: u64) -> bool {
        if read < FIRST_TEXEL_READ {
            return self.geometry.is_wanted(read);
        }
        self.texels.as_ref().is_some_and(|texels| texels.loader.is_wanted(read))
    }

    /// When the next failed read may be retried.
    pub fn next_due(&self) -> Option<Duration> {
        let of_texels = self.texels.as_ref().and_then(|texels| texels.loader.next_due());
        [self.geometry.next_due(), of_texels].into_iter().flatten().min()
    }

    pub fn take_problems(&mut self) -> Vec<Problem> {
        let mut problems = self.geometry.take_problems();
        problems.extend(self.texels.iter_mut().flat_map(|texels| texels.loader.take_problems()));
        problems
    }

    pub fn retry_failed(&mut self) {
        self.geometry.retry_failed();
        self.texels.iter_mut().for_each(|texels| texels.loader.retry_failed());
    }
}

/// The state that a session shares with its loaders.
pub(crate) struct Shared<C: Geometry = FileContent> {
    loading: Mutex<Loading<C>>,
    /// Signals that a frame has begun, a result has come, or the session has ended.
    pub changed: Condvar,
    /// Whether the session has ended.
    is_over: AtomicBool,
}

impl<C: Geometry> Shared<C> {
    pub fn new(loading: Loading<C>) -> Self {
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

    pub fn lock(&self) -> MutexGuard<'_, Loading<C>> {
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
