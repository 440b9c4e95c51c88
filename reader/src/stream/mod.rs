//! Streaming: a picture for every frame at once, while what it lacks is loaded (Niski 2007, chapter 6; Correa 2004,
//! sections 4.4 to 4.6).
//!
//! A [`Session`] is told, frame by frame, which cut is wanted and which one will probably be wanted soon. It draws every root
//! at the finest level that is loaded and not finer than wanted, stitched without cracks; so each frame is complete though
//! nothing ever waits. Until the coarsest level is there, the file's overview is drawn. What is missing is asked for by
//! priority: levels missing, and demand before prefetch.
//!
//! A session has no threads, no clock and does no I/O: [`Session::poll`] says what is to be done, and whoever does it hands
//! back the result. [`Loaders`] are threads that do; an async program awaits the reads itself; a [`Simulation`] has a source
//! of a given latency and a clock of its own, so that what a session does can be tested to the byte.
//!
//! A [`Follower`] finds both cuts from the query of each frame. A [`Streamer`] is all of this at once, for a program that
//! draws a file from a moving camera and has threads to spare.
//!
//! # Overview of types
//!
//! [`crate::File::streamer`] starts a [`Streamer`], which behaves as its [`StreamerOptions`] say and returns [`Streamed`] for each
//! query. Its parts can be used alone. [`crate::File::session`] makes a [`Session`], with [`Options`] and a [`Mode`]; each [`Frame`]
//! says what it [`Shows`]. Its [`Job`]s are [`Read`]s, of a [`Class`], and [`Decoding`]s that become [`Decoded`]; [`Loaders`] or a
//! [`Simulation`] do them. A [`Follower`] predicts cuts from the [`Motion`] of a camera's [`Pose`].
//!
//! A [`Picture`] holds a [`DrawnRoot`] for each root: a [`DrawnSurface`], and a [`Strip`] of triangles along each half-arc, which take
//! a finer neighbour's samples at its [`BorderEdge`]s. [`Changes`] say what is new. [`Counters`] with their [`LatencyHistogram`] say
//! what a session has done, and a [`Problem`] what it has given up.
//!
//! **Memory**. Bytes of pages and decoded surfaces are in caches of their own, each with a bound. A bound is exceeded only by
//! what the running frame draws or demands, and by the coarsest level, which stays.
//!
//! **Damage**. A page that cannot be read or is not sound is tried again; when it is given up it is reported once
//! ([`Session::take_problems`]), and what needs it stays coarser.

mod cache;
mod content;
mod counters;
mod drawn_surface;
mod follower;
mod frame;
mod job;
mod loader;
#[cfg(feature = "threads")]
mod loaders;
mod motion;
mod picture;
mod prefetch;
mod queue;
mod simulation;
#[cfg(feature = "threads")]
mod streamer;
mod streaming;

#[cfg(test)]
mod tests;

use std::time::Duration;

pub use counters::{Counters, LatencyHistogram};
pub use drawn_surface::{BorderEdge, DrawnSurface, Strip};
pub use follower::Follower;
pub use frame::{Frame, Shows};
pub use job::Read;
pub use loader::Problem;
#[cfg(feature = "threads")]
pub use loaders::Loaders;
pub use motion::{Motion, Pose};
pub use picture::{Changes, DrawnRoot, Picture};
pub use queue::Class;
pub use simulation::Simulation;
#[cfg(feature = "threads")]
pub use streamer::{Streamed, Streamer, StreamerOptions};
pub use streaming::{Decoded, Decoding, Job, Session};

/// What a session does about what is not there: the three configurations of Correa 2004, section 4.6.1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// A frame waits for everything that it wants.
    Synchronous,
    /// A frame draws what is there; only what frames want is loaded.
    Asynchronous,
    /// As asynchronous; what later frames will probably want is loaded too.
    #[default]
    AsynchronousWithPrefetch,
}

/// How a session behaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Whether frames wait and whether it looks ahead.
    pub mode: Mode,
    /// Bound of the bytes of pages that are kept.
    pub byte_cache: u64,
    /// Bound of the bytes of decoded surfaces that are kept.
    pub decoded_cache: u64,
    /// Reads on their way at once; at least 1. Correa has eight threads; with twice as many there is nearly always one left
    /// for what will be wanted.
    pub max_reads: usize,
    /// Pages that lie no further apart are read at once: so many bytes may be read in vain between any two.
    pub max_gap: u64,
    /// A read is not made larger than this by joining pages.
    pub max_read_bytes: u64,
    /// Bytes that are prefetched per frame at most; Correa has 2 MB at 10 frames a second.
    pub prefetch_bytes: u64,
    /// How often a page is read before it is given up; at least 1. One that comes but is not sound is read twice.
    pub max_attempts: u32,
    /// Time before a failed read is tried again; it doubles with each attempt.
    pub retry_delay: Duration,
    /// Whether a root whose wanted level is not there may be drawn finer than wanted where it has been so far, instead of
    /// coarser: as the thesis does (section 6.2); a triangle budget may then be exceeded until the wanted level is there.
    pub may_stay_finer: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            byte_cache: 64 << 20,
            decoded_cache: 256 << 20,
            max_reads: 16,
            max_gap: 16 << 10,
            max_read_bytes: 1 << 20,
            prefetch_bytes: 256 << 10,
            max_attempts: 6,
            retry_delay: Duration::from_millis(100),
            may_stay_finer: true,
        }
    }
}
