//! A streamer of heights: everything that a program with threads needs to draw them from a moving camera.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use super::HeightsSession;
use crate::{
    error::Result,
    heights::HeightsIndex,
    select::Query,
    source::ReadAt,
    stream::{Expecter, Loaders, Mode, Picture, Streamed, StreamerOptions},
};

/// Draws a file of heights from a moving camera, as a [`super::super::Streamer`] draws a mesh: a [`HeightsSession`] and
/// its [`Loaders`].
///
/// In each frame, call [`HeightsStreamer::frame`]; then draw [`HeightsStreamer::picture`].
/// [`super::super::Frame::changes`] says what is new in it.
pub struct HeightsStreamer {
    session: HeightsSession,
    loaders: Loaders,
    expecter: Expecter,
    bytes_read: u64,
    work_times: [Duration; 2],
}

impl HeightsStreamer {
    /// Starts threads that load from `source`, which has the bytes of the index's file. Of the options, `coherence` has
    /// no meaning.
    ///
    /// # Errors
    /// As [`HeightsSession::new`].
    pub fn new(
        index: Arc<HeightsIndex>,
        source: Arc<impl ReadAt + Send + Sync + 'static>,
        options: StreamerOptions,
    ) -> Result<Self> {
        let session = HeightsSession::new(index, options.session)?;
        let looks_ahead = options.session.mode == Mode::AsynchronousWithPrefetch;
        Ok(Self {
            loaders: Loaders::spawn_for_heights(&session, source, options.thread_count),
            session,
            expecter: Expecter::new(if looks_ahead { options.ahead } else { Duration::ZERO }),
            bytes_read: 0,
            work_times: [Duration::ZERO; 2],
        })
    }

    /// Draws what a query wants, as far as it is loaded.
    ///
    /// # Errors
    /// As [`HeightsSession::begin`].
    pub fn frame(&mut self, query: &Query) -> Result<Streamed> {
        let (begun, stalls) = (Instant::now(), self.session.counters().stalls);
        let expected = self.expecter.expect(query, self.loaders.now());
        let frame = self.loaders.frame_of_heights(&mut self.session, query, expected.as_ref())?;
        let (counters, work_times) = (self.session.counters(), self.loaders.work_times());
        let streamed = Streamed {
            exceeded: self.session.exceeded(),
            select_time: Duration::ZERO,
            update_time: begun.elapsed(),
            work_times: [0, 1].map(|k| work_times[k] - self.work_times[k]),
            bytes_read: counters.bytes_read.saturating_sub(self.bytes_read),
            has_stalled: counters.stalls > stalls,
            frame,
        };
        (self.bytes_read, self.work_times) = (counters.bytes_read, work_times);
        Ok(streamed)
    }

    /// Waits until everything for the last frame is loaded. The next frame draws it, and may want more then.
    pub fn settle(&self) {
        self.loaders.settle();
    }

    /// The picture to draw.
    pub fn picture(&self) -> &Picture {
        self.session.picture()
    }

    /// The session, with its counters and problems.
    pub fn session(&self) -> &HeightsSession {
        &self.session
    }

    /// The session, to retry what has failed.
    pub fn session_mut(&mut self) -> &mut HeightsSession {
        &mut self.session
    }
}
