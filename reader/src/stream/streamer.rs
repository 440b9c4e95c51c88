//! Everything that a program with threads needs to draw a file from a moving camera.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use super::{Follower, Frame, Loaders, Options, Picture, Session, Shows};
use crate::{
    decode::Mesh,
    error::Result,
    select::{Coherence, Hierarchy, Limiter, Node, Query, View},
    source::ReadAt,
};

/// How a [`Streamer`] behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamerOptions {
    /// What the session does about what is not there.
    pub session: Options,
    /// How much cuts may lag behind the camera.
    pub coherence: Coherence,
    /// How far the camera's motion is followed ahead, for [`super::Mode::AsynchronousWithPrefetch`].
    pub ahead: Duration,
    /// Threads that load. They mostly wait, so that more than processors are of use.
    pub thread_count: usize,
}

impl Default for StreamerOptions {
    fn default() -> Self {
        let ahead = Duration::from_millis(300);
        Self { session: Options::default(), coherence: Coherence::default(), ahead, thread_count: 4 }
    }
}

/// What came of a frame, and what it took.
#[derive(Clone, Debug, PartialEq)]
pub struct Streamed {
    /// What the session says.
    pub frame: Frame,
    /// The budget that the wanted cut exceeds, because even the coarsest cut of what is in sight does.
    pub exceeded: Option<Limiter>,
    /// Choosing cuts.
    pub select_time: Duration,
    /// Until the picture was updated, waiting included, choosing not.
    pub update_time: Duration,
    /// Reading and decoding since the frame before ended, all threads together.
    pub work_times: [Duration; 2],
    /// Bytes asked for since the frame before ended.
    pub bytes_read: u64,
    /// Whether the frame waited.
    pub has_stalled: bool,
}

impl Streamed {
    /// Whether a whole surface is drawn: the overview, or all roots.
    pub fn is_whole(&self) -> bool {
        self.frame.shows != Shows::Nothing && self.frame.lost_roots.is_empty()
    }

    /// Whether everything is drawn as wanted and nothing has been given up.
    pub fn is_complete(&self) -> bool {
        self.frame.is_complete && self.frame.lost_roots.is_empty()
    }
}

/// Draws a file from a moving camera: a [`Follower`], a [`Session`] and its [`Loaders`].
///
/// In each frame: [`Streamer::frame`]; then draw [`Streamer::overview`] or else [`Streamer::picture`], of which
/// [`Frame::changes`] says what is new.
pub struct Streamer {
    follower: Follower,
    session: Session,
    loaders: Loaders,
    shows: Shows,
    bytes_read: u64,
    work_times: [Duration; 2],
}

impl Streamer {
    /// Starts threads that load for a session; `hierarchy` is that of the session's file, and `source` has its bytes.
    pub fn new(
        session: Session,
        hierarchy: Hierarchy,
        source: Arc<impl ReadAt + Send + Sync + 'static>,
        options: StreamerOptions,
    ) -> Self {
        let looks_ahead = options.session.mode == super::Mode::AsynchronousWithPrefetch;
        let ahead = if looks_ahead { options.ahead } else { Duration::ZERO };
        Self {
            follower: Follower::new(Arc::new(hierarchy), options.coherence, ahead),
            loaders: Loaders::spawn(&session, source, options.thread_count),
            session,
            shows: Shows::Nothing,
            bytes_read: 0,
            work_times: [Duration::ZERO; 2],
        }
    }

    /// Draws what a query wants, as far as it is there.
    ///
    /// # Errors
    /// As [`crate::select::Adapter::update`].
    pub fn frame(&mut self, query: &Query) -> Result<Streamed> {
        let begun = Instant::now();
        let (wanted, expected) = self.follower.follow(query, self.loaders.now())?;
        let select_time = begun.elapsed();
        Ok(Streamed { select_time, exceeded: wanted.exceeded, ..self.draw(&wanted.nodes, &expected)? })
    }

    /// Draws nodes that were chosen elsewhere.
    ///
    /// # Errors
    /// As [`Session::begin`].
    pub fn show(&mut self, nodes: &[Node]) -> Result<Streamed> {
        self.draw(nodes, &[])
    }

    fn draw(&mut self, wanted: &[Node], expected: &[Node]) -> Result<Streamed> {
        let (begun, stalls) = (Instant::now(), self.session.counters().stalls);
        let frame = self.loaders.frame(&mut self.session, wanted, expected)?;
        let (update_time, counters, work_times) = (begun.elapsed(), self.session.counters(), self.loaders.work_times());
        let streamed = Streamed {
            exceeded: None,
            select_time: Duration::ZERO,
            update_time,
            work_times: [0, 1].map(|k| work_times[k] - self.work_times[k]),
            bytes_read: counters.bytes_read - self.bytes_read,
            has_stalled: counters.stalls > stalls,
            frame,
        };
        (self.shows, self.bytes_read, self.work_times) = (streamed.frame.shows, counters.bytes_read, work_times);
        Ok(streamed)
    }

    /// Waits until nothing is left to be loaded for the last frame; what has come is in the next one.
    pub fn settle(&self) {
        self.loaders.settle();
    }

    /// What is drawn, unless [`Streamer::overview`] says otherwise.
    pub fn picture(&self) -> &Picture {
        self.session.picture()
    }

    /// The small mesh that is drawn while there are no roots.
    pub fn overview(&self) -> Option<&Mesh> {
        self.session.overview().filter(|_| self.shows == Shows::Overview)
    }

    /// How many triangles are drawn.
    pub fn triangle_count(&self) -> u64 {
        self.overview().map_or_else(|| self.picture().triangle_count(), |mesh| mesh.triangles.len() as u64)
    }

    /// How many pixels the picture is off at most where a view sees it.
    ///
    /// # Errors
    /// [`crate::Error::Query`] where the view is none.
    pub fn error_px(&self, view: &View) -> Result<f64> {
        let index = self.session.index();
        self.picture().roots().try_fold(0.0, |most, drawn| {
            let bounds = index.root_bounds(drawn.surface.root)?;
            Ok(view.error_px(bounds, drawn.error())?.max(most))
        })
    }

    /// What cuts are made from.
    pub fn follower(&self) -> &Follower {
        &self.follower
    }

    /// Counters, problems and the rest.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// To try again what has failed.
    pub fn session_mut(&mut self) -> &mut Session {
        &mut self.session
    }
}
