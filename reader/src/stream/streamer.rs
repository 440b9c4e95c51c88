//! A streamer: everything that a program with threads needs to draw a file from a moving camera.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use super::{
    Follower, Frame, Loaders, Options, Picture, Session, Shows,
    walker::{Walk, Walker},
};
use crate::{
    decode::Mesh,
    error::Result,
    select::{Coherence, Hierarchy, Limiter, Node, Query, View},
    source::ReadAt,
};

/// How a [`Streamer`] behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamerOptions {
    /// Options of the session.
    pub session: Options,
    /// How far cuts may lag behind the camera.
    pub coherence: Coherence,
    /// How far ahead the camera's motion is predicted, for [`super::Mode::AsynchronousWithPrefetch`].
    pub ahead: Duration,
    /// Threads that load. They mostly wait, so more threads than processors are useful.
    pub thread_count: usize,
}

impl Default for StreamerOptions {
    fn default() -> Self {
        let ahead = Duration::from_millis(300);
        Self { session: Options::default(), coherence: Coherence::default(), ahead, thread_count: 4 }
    }
}

/// The result of a frame, and its cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Streamed {
    /// The session's result.
    pub frame: Frame,
    /// The budget that the wanted cut exceeds, because even the coarsest cut of the visible roots does.
    pub exceeded: Option<Limiter>,
    /// Time for choosing cuts.
    pub select_time: Duration,
    /// Time for updating the picture, with waiting, without choosing.
    pub update_time: Duration,
    /// Time spent reading and decoding since the end of the frame before, over all threads.
    pub work_times: [Duration; 2],
    /// Bytes requested since the end of the frame before.
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
/// In each frame, call [`Streamer::frame`]; then draw [`Streamer::overview`] if there is one, else
/// [`Streamer::picture`].
/// [`Frame::changes`] says what is new in it.
pub struct Streamer {
    follower: Follower,
    /// For a file whose tree is not known as a whole.
    walker: Option<Walker>,
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
            walker: None,
            loaders: Loaders::spawn(&session, source, options.thread_count),
            session,
            shows: Shows::Nothing,
            bytes_read: 0,
            work_times: [Duration::ZERO; 2],
        }
    }

    /// Has a thread look for the parts of the tree that queries want.
    pub(crate) fn with_walk(self, walk: Box<Walk>, coherence: Coherence) -> Self {
        Self { walker: Some(Walker::spawn(walk, coherence)), ..self }
    }

    /// Draws what a query wants, as far as it is loaded.
    ///
    /// # Errors
    /// As [`crate::select::Adapter::update`].
    pub fn frame(&mut self, query: &Query) -> Result<Streamed> {
        let begun = Instant::now();
        match self.walker.as_mut().and_then(|walker| walker.follow(query)) {
            Some(Ok(adapter)) => self.follower.replace(adapter),
            Some(Err(error)) => self.session.report("the index".into(), error),
            None => {}
        }
        let mut query = std::borrow::Cow::Borrowed(query);
        let known = self.follower.hierarchy().filter();
        if self.walker.is_some() && known != query.objects.as_ref() {
            // Until the walker has found what shows other objects, what was shown stays.
            query.to_mut().objects = known.cloned();
        }
        let (wanted, expected) = self.follower.follow(&query, self.loaders.now())?;
        self.session.show_objects(query.objects.clone())?;
        self.session.look_from(query.view.as_ref())?;
        let select_time = begun.elapsed();
        Ok(Streamed { select_time, exceeded: wanted.exceeded, ..self.draw(&wanted.nodes, &expected)? })
    }

    /// Draws nodes that were chosen elsewhere.
    ///
    /// # Errors
    /// As [`Session::begin`].
    pub fn show(&mut self, nodes: &[Node]) -> Result<Streamed> {
        self.session.look_from(None)?;
        self.draw(nodes, &[])
    }

    fn draw(&mut self, wanted: &[Node], expected: &[Node]) -> Result<Streamed> {
        let (begun, stalls) = (Instant::now(), self.session.counters().stalls);
        let frame = self.loaders.frame(&mut self.session, wanted, expected)?;
        let (update_time, counters, work_times) = (begun.elapsed(), self.session.counters(), self.loaders.work_times());
        let bytes_read = counters.bytes_read + self.session.texel_counters().bytes_read;
        let streamed = Streamed {
            exceeded: None,
            select_time: Duration::ZERO,
            update_time,
            work_times: [0, 1].map(|k| work_times[k] - self.work_times[k]),
            bytes_read: bytes_read.saturating_sub(self.bytes_read),
            has_stalled: counters.stalls > stalls,
            frame,
        };
        (self.shows, self.bytes_read, self.work_times) = (streamed.frame.shows, bytes_read, work_times);
        Ok(streamed)
    }

    /// Waits until everything for the last frame is loaded. The next frame draws it; of a large file, it may want more
    /// then.
    pub fn settle(&self) {
        self.loaders.settle();
        if let Some(walker) = &self.walker {
            walker.settle();
        }
    }

    /// The picture to draw, unless [`Streamer::overview`] returns a mesh.
    pub fn picture(&self) -> &Picture {
        self.session.picture()
    }

    /// The small mesh to draw until the coarsest level is loaded.
    pub fn overview(&self) -> Option<&Mesh> {
        self.session.overview().filter(|_| self.shows == Shows::Overview)
    }

    /// The number of triangles to draw.
    pub fn triangle_count(&self) -> u64 {
        self.overview().map_or_else(|| self.picture().triangle_count(), |mesh| mesh.triangles.len() as u64)
    }

    /// The largest screen error of the picture in a view, pixels.
    ///
    /// # Errors
    /// [`crate::Error::Query`] if something in the view is not finite or makes no sense.
    pub fn error_px(&self, view: &View) -> Result<f64> {
        self.picture().error_px(view)
    }

    /// The size of the largest texel of the picture in a view, pixels; 0 without texels. Above 1 images are blurred
    /// there. Of each block the smallest texels count: others are larger because the input has no more there.
    ///
    /// # Errors
    /// As [`Streamer::error_px`].
    pub fn texel_px(&self, view: &View) -> Result<f64> {
        let index = self.session.index();
        let step = index.lattice().step();
        self.picture().roots().try_fold(0.0, |most, drawn| {
            let Some(texture) = drawn.texture() else { return Ok(most) };
            let map = texture.texture.map.as_ref();
            let Some(size) = map.and_then(|map| map.smallest_texel()) else { return Ok(most) };
            Ok(view.error_px(index.root_bounds(drawn.surface.root)?, size * step)?.max(most))
        })
    }

    /// The follower, which chooses the cuts.
    pub fn follower(&self) -> &Follower {
        &self.follower
    }

    /// The session, with its counters and problems.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The session, to retry what has failed.
    pub fn session_mut(&mut self) -> &mut Session {
        &mut self.session
    }
}
