//! A streamer: everything that a program with threads needs to draw a file from a moving camera.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use super::{
    Counters, Expecter, Follower, Frame, HeightsSession, Loaders, Mode, Options, Picture, Problem, Session, Shows,
    walker::{Walk, Walker},
};
use crate::{
    decode::Mesh,
    error::{Error, Result},
    heights::Heights,
    select::{Coherence, Cut, Hierarchy, Limiter, Node, Query, Taken, View},
    source::ReadAt,
};

/// How a [`Streamer`] behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamerOptions {
    /// Options of the session.
    pub session: Options,
    /// How far cuts of meshes may lag behind the camera.
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
    /// Triangles of the wanted cut; 0 for nodes that were chosen elsewhere.
    pub wanted_triangle_count: u64,
    /// Why that is not finer.
    pub limited_by: Limiter,
    /// Time for choosing cuts of meshes.
    pub select_time: Duration,
    /// Time for updating the picture, with waiting; of heights, with choosing.
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

    /// What it takes of a budget that is shared ([`crate::select::SharedBudget`]).
    pub fn taken(&self) -> Taken {
        Taken::new(self.wanted_triangle_count, self.limited_by)
    }

    /// Whether everything is drawn as wanted and nothing has been given up.
    pub fn is_complete(&self) -> bool {
        self.frame.is_complete && self.frame.lost_roots.is_empty()
    }
}

/// Draws a file of either kind from a moving camera: a session, its [`Loaders`], and what chooses its cuts.
///
/// In each frame, call [`Streamer::frame`]; then draw [`Streamer::overview`] if there is one, else
/// [`Streamer::picture`].
/// [`Frame::changes`] says what is new in it.
pub struct Streamer {
    content: Content,
    loaders: Loaders,
    bytes_read: u64,
    work_times: [Duration; 2],
}

enum Content {
    Mesh(Box<MeshContent>),
    Heights(Box<HeightsContent>),
}

struct MeshContent {
    follower: Follower,
    /// For a file whose tree is not known as a whole.
    walker: Option<Walker>,
    session: Session,
    shows: Shows,
}

struct HeightsContent {
    session: HeightsSession,
    expecter: Expecter,
}

/// How far ahead the camera's motion is predicted, which only one mode wants.
fn ahead(options: &StreamerOptions) -> Duration {
    if options.session.mode == Mode::AsynchronousWithPrefetch { options.ahead } else { Duration::ZERO }
}

impl Streamer {
    /// Starts threads that load for a session; `hierarchy` is that of the session's file, and `source` has its bytes.
    pub fn new(
        session: Session,
        hierarchy: Hierarchy,
        source: Arc<impl ReadAt + Send + Sync + 'static>,
        options: StreamerOptions,
    ) -> Self {
        let loaders = Loaders::spawn(&session, source, options.thread_count);
        let follower = Follower::new(Arc::new(hierarchy), options.coherence, ahead(&options));
        let mesh = MeshContent { follower, walker: None, session, shows: Shows::Nothing };
        Self::of(Content::Mesh(Box::new(mesh)), loaders)
    }

    fn of(content: Content, loaders: Loaders) -> Self {
        Self { content, loaders, bytes_read: 0, work_times: [Duration::ZERO; 2] }
    }

    /// Has a thread look for the parts of the tree that queries want.
    pub(crate) fn with_walk(mut self, walk: Box<Walk>, coherence: Coherence) -> Self {
        if let Content::Mesh(mesh) = &mut self.content {
            mesh.walker = Some(Walker::spawn(walk, coherence));
        }
        self
    }

    /// Draws what a query wants, as far as it is loaded.
    ///
    /// # Errors
    /// As [`crate::select::Adapter::update`]; of heights, as [`HeightsSession::begin`].
    pub fn frame(&mut self, query: &Query) -> Result<Streamed> {
        let begun = Instant::now();
        match &mut self.content {
            Content::Mesh(mesh) => {
                let (wanted, expected) = mesh.follow(query, self.loaders.now())?;
                let select_time = begun.elapsed();
                let streamed = self.draw(&wanted.nodes, &expected)?;
                Ok(Streamed {
                    select_time,
                    wanted_triangle_count: wanted.triangle_count,
                    limited_by: wanted.limited_by,
                    exceeded: wanted.exceeded,
                    ..streamed
                })
            }
            Content::Heights(heights) => {
                let HeightsContent { session, expecter } = &mut **heights;
                let stalls = session.counters().stalls;
                let expected = expecter.expect(query, self.loaders.now());
                let frame = self.loaders.frame_of_heights(session, query, expected.as_ref())?;
                let (exceeded, limited_by) = (session.exceeded(), session.limiter());
                let wanted_triangle_count = session.wanted_triangle_count();
                Ok(Streamed { exceeded, limited_by, wanted_triangle_count, ..self.streamed(frame, begun, stalls) })
            }
        }
    }

    /// Draws nodes of a mesh that were chosen elsewhere.
    ///
    /// # Errors
    /// As [`Session::begin`]; [`Error::Query`] for heights.
    pub fn show(&mut self, nodes: &[Node]) -> Result<Streamed> {
        let Content::Mesh(mesh) = &mut self.content else { return Err(no_mesh()) };
        mesh.session.look_from(None)?;
        self.draw(nodes, &[])
    }

    fn draw(&mut self, wanted: &[Node], expected: &[Node]) -> Result<Streamed> {
        let Content::Mesh(mesh) = &mut self.content else { return Err(no_mesh()) };
        let (begun, stalls) = (Instant::now(), mesh.session.counters().stalls);
        let frame = self.loaders.frame(&mut mesh.session, wanted, expected)?;
        mesh.shows = frame.shows;
        Ok(self.streamed(frame, begun, stalls))
    }

    /// A frame, and what it has cost since it began and since the end of the one before.
    fn streamed(&mut self, frame: Frame, begun: Instant, stalls: u64) -> Streamed {
        let ([counters, texels], work_times) = (self.counters(), self.loaders.work_times());
        let bytes_read = counters.bytes_read + texels.bytes_read;
        let streamed = Streamed {
            exceeded: None,
            wanted_triangle_count: 0,
            limited_by: Limiter::Finest,
            select_time: Duration::ZERO,
            update_time: begun.elapsed(),
            work_times: [0, 1].map(|k| work_times[k] - self.work_times[k]),
            bytes_read: bytes_read.saturating_sub(self.bytes_read),
            has_stalled: counters.stalls > stalls,
            frame,
        };
        (self.bytes_read, self.work_times) = (bytes_read, work_times);
        streamed
    }

    /// Waits until everything for the last frame is loaded. The next frame draws it; of a large file, it may want more
    /// then.
    pub fn settle(&self) {
        self.loaders.settle();
        if let Content::Mesh(mesh) = &self.content
            && let Some(walker) = &mesh.walker
        {
            walker.settle();
        }
    }

    /// The picture to draw, unless [`Streamer::overview`] returns a mesh.
    pub fn picture(&self) -> &Picture {
        match &self.content {
            Content::Mesh(mesh) => mesh.session.picture(),
            Content::Heights(heights) => heights.session.picture(),
        }
    }

    /// The small mesh to draw until the coarsest level is loaded. Heights have none: they are there at once.
    pub fn overview(&self) -> Option<&Mesh> {
        let Content::Mesh(mesh) = &self.content else { return None };
        mesh.session.overview().filter(|_| mesh.shows == Shows::Overview)
    }

    /// The number of triangles to draw.
    pub fn triangle_count(&self) -> u64 {
        self.overview().map_or_else(|| self.picture().triangle_count(), |mesh| mesh.triangles.len() as u64)
    }

    /// The largest screen error of the picture in a view, pixels.
    ///
    /// # Errors
    /// [`crate::Error::Query`] if something in the view is not finite or makes no sense.
    pub fn error_px(&mut self, view: &View) -> Result<f64> {
        match &mut self.content {
            Content::Mesh(mesh) => mesh.session.picture().error_px(view),
            Content::Heights(heights) => heights.session.error_px(view),
        }
    }

    /// The size of the largest texel of the picture in a view, pixels; 0 without texels, and for heights. Above 1
    /// images are blurred there. Of each block the smallest texels count: others are larger because the input has no
    /// more there.
    ///
    /// # Errors
    /// As [`Streamer::error_px`].
    pub fn texel_px(&self, view: &View) -> Result<f64> {
        let Content::Mesh(mesh) = &self.content else { return Ok(0.0) };
        let index = mesh.session.index();
        let step = index.lattice().step();
        self.picture().roots().try_fold(0.0, |most, drawn| {
            let Some(texture) = drawn.texture() else { return Ok(most) };
            let map = texture.texture.map.as_ref();
            let Some(size) = map.and_then(|map| map.smallest_texel()) else { return Ok(most) };
            Ok(view.error_px(index.root_bounds(drawn.surface.root)?, size * step)?.max(most))
        })
    }

    /// Shows these channels of a mesh from the next frame on, by number.
    ///
    /// # Errors
    /// As [`Session::show_channels`]; [`Error::Query`] for heights, which have their normals and colours anyway.
    pub fn show_channels(&mut self, channels: &[u8]) -> Result<()> {
        let Content::Mesh(mesh) = &mut self.content else { return Err(no_mesh()) };
        mesh.session.show_channels(channels)
    }

    /// What has been done so far: for geometry, and for the images of a mesh.
    pub fn counters(&self) -> [Counters; 2] {
        match &self.content {
            Content::Mesh(mesh) => [mesh.session.counters(), mesh.session.texel_counters()],
            Content::Heights(heights) => [heights.session.counters(), Counters::default()],
        }
    }

    /// What could not be loaded since the last call.
    pub fn take_problems(&self) -> Vec<Problem> {
        match &self.content {
            Content::Mesh(mesh) => mesh.session.take_problems(),
            Content::Heights(heights) => heights.session.take_problems(),
        }
    }

    /// Has later frames try again what could not be loaded.
    pub fn retry_failed(&mut self) {
        match &mut self.content {
            Content::Mesh(mesh) => mesh.session.retry_failed(),
            Content::Heights(heights) => heights.session.retry_failed(),
        }
    }

    /// What chooses the cuts of a mesh.
    pub fn follower(&self) -> Option<&Follower> {
        let Content::Mesh(mesh) = &self.content else { return None };
        Some(&mesh.follower)
    }

    /// The session of a mesh.
    pub fn session(&self) -> Option<&Session> {
        let Content::Mesh(mesh) = &self.content else { return None };
        Some(&mesh.session)
    }

    /// The session of heights.
    pub fn heights_session(&self) -> Option<&HeightsSession> {
        let Content::Heights(heights) = &self.content else { return None };
        Some(&heights.session)
    }
}

impl<S: ReadAt + Clone + Send + Sync + 'static> Heights<S> {
    /// Starts threads that load this file for a moving camera.
    ///
    /// # Errors
    /// As [`HeightsSession::new`].
    pub fn streamer(&self, options: StreamerOptions) -> Result<Streamer> {
        let session = HeightsSession::new(Arc::clone(self.index()), options.session)?;
        let loaders = Loaders::spawn_for_heights(&session, Arc::new(self.source().clone()), options.thread_count);
        let heights = HeightsContent { session, expecter: Expecter::new(ahead(&options)) };
        Ok(Streamer::of(Content::Heights(Box::new(heights)), loaders))
    }
}

fn no_mesh() -> Error {
    Error::Query { what: "this file has heights; only a mesh has nodes and channels".into() }
}

impl MeshContent {
    /// The cut that a query wants at a time, and the nodes that later frames will probably want.
    fn follow(&mut self, query: &Query, now: Duration) -> Result<(Cut, Vec<Node>)> {
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
        let cuts = self.follower.follow(&query, now)?;
        self.session.show_objects(query.objects.clone())?;
        self.session.look_from(query.view.as_ref())?;
        Ok(cuts)
    }
}
