//! Streaming: a picture for every frame at once, while what it lacks is loaded (Niski 2007, chapter 6; Correa 2004,
//! sections 4.4 to 4.6).
//!
//! Each frame tells a [`Session`] which cut it wants and which one later frames will probably want. The session draws
//! every root at the finest loaded level that is not finer than wanted, stitched without cracks. So each frame is
//! complete, and nothing waits. Until the coarsest level is loaded, the session draws the file's overview. It asks for
//! missing pages by priority: demand before prefetch, and most missing levels first.
//!
//! A session has no threads and no clock, and does no I/O: [`Session::poll`] returns jobs, and whoever does them hands
//! back the results. [`Loaders`] are threads that do so; an async program awaits the reads itself; a [`Simulation`] has
//! a source of a given latency and a clock of its own, so that the work of a session can be tested to the byte.
//!
//! With [`Session::show_channels`], roots get a [`DrawnTexture`] beside geometry: their block's map and images, wanted
//! where the view ([`Session::look_from`]) shows them larger than a pixel, largest first, and at the size at which a
//! texel is a pixel. Geometry never waits for texels. What has none yet has a mean ([`DrawnRoot::mean`]). Programs that
//! draw with texture coordinates take them from [`ByPiece`].
//!
//! A [`Follower`] finds both cuts from the query of each frame. A [`Streamer`] combines all of this for a program that
//! draws a file from a moving camera and has threads to spare.
//!
//! With [`Options::light`], roots of files without normals are drawn in smooth light: [`DrawnRoot::lit`] has a normal
//! at each vertex, the same on both sides of every border. What a surface has of it by itself is found where it is
//! decoded; the normals at borders are found anew beside what changes.
//!
//! Of a large file, only a part of the tree is known. A streamer's follower chooses from this part, and a thread of it
//! walks on to what the query wants: until it arrives, the group above is drawn. A session reads the lists and index
//! blocks around the roots of its cuts as it reads their pages. The index is never dropped from memory.
//!
//! # Overview of types
//!
//! [`crate::File::streamer`] starts a [`Streamer`], which behaves as its [`StreamerOptions`] say and returns
//! [`Streamed`] for each query. Its parts can be used alone. [`crate::File::session`] makes a [`Session`], with
//! [`Options`] and a [`Mode`]; each [`Frame`] says what it [`Shows`]. Its [`Job`]s are [`Read`]s, of a [`Class`], and
//! [`Decoding`]s that become [`Decoded`]; [`Loaders`] or a
//! [`Simulation`] do them. A [`Follower`] predicts cuts from the [`Motion`] of a camera's [`Pose`].
//!
//! A [`Picture`] holds a [`DrawnRoot`] for each root: a [`DrawnSurface`], and a [`Strip`] of triangles along each
//! half-arc, which take a finer neighbour's samples at its [`BorderEdge`]s; [`Lit`] has both with normals, and
//! [`Light`] the normals for programs that join borders themselves.
//! [`Changes`] say what is new. [`Counters`] with their [`LatencyHistogram`] say
//! what a session has done, and a [`Problem`] what it has given up.
//!
//! With the feature `pool`, a `Pool` gives the roots of a picture places in a few large buffers of an engine, says what
//! to copy there and which calls draw them.
//!
//! Files of heights have a [`HeightsSession`] of their own, whose jobs, frames and pictures are the same, and
//! [`crate::heights::Heights::streamer`]. An [`Expecter`] predicts the query of later frames. Several streamers that
//! draw into one picture keep one budget by a [`crate::select::SharedBudget`].
//!
//! # Memory and damage
//!
//! Bytes of pages, decoded surfaces and images have a cache each, with a bound; the index has none. Only what the
//! running frame draws or demands, and the coarsest level, which stays, can exceed it.
//!
//! A page that cannot be read, or is not sound, is tried again. When a session gives it up, it reports that once
//! ([`Session::take_problems`]) and draws the roots that need the page coarser.

mod antichain;
mod by_piece;
mod cache;
mod content;
mod counters;
mod drawn_surface;
mod fans;
mod follower;
mod frame;
mod heights;
mod history;
mod index_reads;
mod job;
mod light;
mod lit;
mod loader;
#[cfg(feature = "threads")]
mod loaders;
mod loading;
mod motion;
mod octahedral;
mod pace;
mod picture;
#[cfg(feature = "pool")]
mod pool;
mod prefetch;
mod queue;
mod simulation;
#[cfg(feature = "threads")]
mod streamer;
mod streaming;
mod texel_content;
mod textures;
mod users;
#[cfg(feature = "threads")]
mod walker;

#[cfg(test)]
mod tests;

use std::time::Duration;

pub use by_piece::ByPiece;
pub use counters::{Counters, LatencyHistogram};
pub use drawn_surface::{BorderEdge, DrawnSurface, Strip};
pub use follower::Follower;
pub use frame::{Frame, Shows};
pub use heights::{HeightsSession, TileImages};
pub use job::Read;
pub use lit::{Light, Lit};
pub use loader::Problem;
#[cfg(feature = "threads")]
pub use loaders::Loaders;
pub use loading::{Decoded, Decoding, Job};
pub use motion::{Expecter, Motion, Pose};
pub use octahedral::direction;
pub use picture::{Changes, DrawnRoot, Picture};
#[cfg(feature = "pool")]
pub use pool::{Pool, PoolBuffer, PoolOptions, PoolPlace, PoolUpload, VERTEX_BYTES};
pub use queue::Class;
pub use simulation::Simulation;
#[cfg(feature = "threads")]
pub use streamer::{Streamed, Streamer, StreamerOptions};
pub use streaming::Session;
pub use texel_content::DrawnTexture;
#[cfg(feature = "threads")]
pub(crate) use walker::Walk;

/// What a session does about blocks that are not loaded: the three configurations of Correa 2004, section 4.6.1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Frames wait for everything that they want.
    Synchronous,
    /// Frames draw what is loaded. Only what frames want is loaded.
    Asynchronous,
    /// Frames draw what is loaded. What later frames will probably want is loaded too.
    #[default]
    AsynchronousWithPrefetch,
}

/// How a session behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Whether frames wait, and whether the session looks ahead.
    pub mode: Mode,
    /// Bound of the cache of pages, bytes.
    pub byte_cache: u64,
    /// Bound of the cache of decoded surfaces, bytes.
    pub decoded_cache: u64,
    /// Bound of the cache of decoded images, bytes; streams of texels may take an eighth of it besides. Images are
    /// drawn smaller where they would not fit.
    pub texel_cache: u64,
    /// In a view, images are drawn at the size at which a pixel has about this many texels along each side, at most by
    /// the root of two more or fewer; larger than 0. With 1, the default, a pixel has half a texel to two.
    pub texels_per_pixel: f64,
    /// Most reads in flight at once; at least 1. Correa has eight threads; with twice as many there is nearly always
    /// one left to prefetch.
    pub max_reads: usize,
    /// Pages up to this many bytes apart are read at once, which wastes the bytes between them.
    pub max_gap: u64,
    /// Joining pages makes no read larger than this.
    pub max_read_bytes: u64,
    /// Most bytes prefetched in a frame. Correa has 2 MB at 10 frames a second.
    pub prefetch_bytes: u64,
    /// Attempts to read a page before it is given up; at least 1. A page that arrives but is not sound gets two.
    pub max_attempts: u32,
    /// Time before a failed read is tried again; it doubles with each attempt.
    pub retry_delay: Duration,
    /// Whether a root whose wanted level is not loaded may stay finer than wanted, if it was drawn so, instead of
    /// becoming coarser (Niski 2007, section 6.2). Frames may then exceed a triangle budget until the wanted level is
    /// loaded.
    pub may_stay_finer: bool,
    /// Most bytes of surfaces that a frame draws newly, in memory as in the cache of decoded ones, so that no frame has
    /// much to upload. What does not fit waits, and what was drawn in its place stays; the largest gain of detail goes
    /// first. However small the number, one root or group gives way in each frame, and what nothing was drawn in place
    /// of is drawn at once. No bound by default. Frames that wait ([`Mode::Synchronous`]) and heights have none.
    pub upload_bytes: u64,
    /// Of heights: in a view, tiles whose samples take more pixels than this give way to their quarters for the sake of
    /// light and colours, even where their triangles are near enough. Infinite by default: then geometry alone decides.
    pub sample_px: f64,
    /// Whether roots of a mesh get normals for smooth light, alike on both sides of every border ([`DrawnRoot::lit`];
    /// SPEC.md, 14.5). For files that store no normals: it takes a third more memory for decoded surfaces, and time to
    /// decode them. False by default: then nothing is computed.
    pub light: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            byte_cache: 64 << 20,
            decoded_cache: 256 << 20,
            texel_cache: 256 << 20,
            texels_per_pixel: 1.0,
            max_reads: 16,
            max_gap: 16 << 10,
            max_read_bytes: 1 << 20,
            prefetch_bytes: 256 << 10,
            max_attempts: 6,
            retry_delay: Duration::from_millis(100),
            may_stay_finer: true,
            upload_bytes: u64::MAX,
            sample_px: f64::INFINITY,
            light: false,
        }
    }
}
